// Sums over a block of samples of a pixel. One lane owns such a block and adds its samples in order, so the sums do not
// depend on scheduling. `place`: where they lie, film_place(). Needs from the program: film[], film_layer_size().
//   0: radiance, opacity   1: radiance squared, depth of the first scattering [voxels]
//   2: t_x t_x, t_y t_y, t_x t_y, t_x t_z of the fiber axis t there   3: albedo there, t_y t_z
//   4: opacity as the filter weighs it, paths cut short, paths that met a surface first, 0
//   5: normal of that surface, 0 (in scenes with surfaces)
// An axis has no sign, so its outer product is summed, never the vector. t_z t_z is what is missing to the number of
// first scatterings, and that number is the sum of opacity less those that met a surface.

void film_add(uint place, uint layer, vec4 value) {
    uint index = layer * film_layer_size() + place;
    film[index] += value;
}

void film_add_sample(uint place, vec3 radiance, float opacity) {
    film_add(place, 0u, vec4(radiance, opacity));
    precise vec3 squares = radiance * radiance;  // no fused multiply-add: out of core they are added on the host
    film_add(place, 1u, vec4(squares, 0.0));
}

void film_add_filtered_opacity(uint place, float opacity) {
    film_add(place, 4u, vec4(opacity, 0.0, 0.0, 0.0));
}

void film_add_cut(uint place) {
    film_add(place, 4u, vec4(0.0, 1.0, 0.0, 0.0));
}

void film_add_first_surface(uint place, float depth, vec3 normal, vec3 albedo) {
    film_add(place, 1u, vec4(0.0, 0.0, 0.0, depth));
    film_add(place, 3u, vec4(albedo, 0.0));
    film_add(place, 4u, vec4(0.0, 0.0, 1.0, 0.0));
    film_add(place, 5u, vec4(normal, 0.0));
}

void film_add_first_scattering(uint place, float depth, vec3 axis, vec3 albedo) {
    film_add(place, 1u, vec4(0.0, 0.0, 0.0, depth));
    precise vec4 outer = axis.xyxx * axis.xyyz;
    precise float yz = axis.y * axis.z;
    film_add(place, 2u, outer);
    film_add(place, 3u, vec4(albedo, yz));
}
