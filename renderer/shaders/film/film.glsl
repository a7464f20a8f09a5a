// Sums over the samples of a pixel. One lane owns a pixel during a pass and adds its samples in order, so the sums
// do not depend on scheduling. Needs from the program: film[], film_pixel_count().
//   0: radiance, opacity   1: radiance squared, depth of the first scattering [voxels]
//   2: t_x t_x, t_y t_y, t_x t_y, t_x t_z of the fiber axis t there   3: albedo there, t_y t_z
//   4: opacity as the filter weighs it, paths cut short, paths that met a surface first, 0
//   5: normal of that surface, 0 (in scenes with surfaces)
// An axis has no sign, so its outer product is summed, never the vector. t_z t_z is what is missing to the number of
// first scatterings, and that number is the sum of opacity less those that met a surface.

void film_add(uint pixel, uint layer, vec4 value) {
    uint index = layer * film_pixel_count() + pixel;
    film[index] += value;
}

void film_add_sample(uint pixel, vec3 radiance, float opacity) {
    film_add(pixel, 0u, vec4(radiance, opacity));
    film_add(pixel, 1u, vec4(radiance * radiance, 0.0));
}

void film_add_filtered_opacity(uint pixel, float opacity) {
    film_add(pixel, 4u, vec4(opacity, 0.0, 0.0, 0.0));
}

void film_add_cut(uint pixel) {
    film_add(pixel, 4u, vec4(0.0, 1.0, 0.0, 0.0));
}

void film_add_first_surface(uint pixel, float depth, vec3 normal, vec3 albedo) {
    film_add(pixel, 1u, vec4(0.0, 0.0, 0.0, depth));
    film_add(pixel, 3u, vec4(albedo, 0.0));
    film_add(pixel, 4u, vec4(0.0, 0.0, 1.0, 0.0));
    film_add(pixel, 5u, vec4(normal, 0.0));
}

void film_add_first_scattering(uint pixel, float depth, vec3 axis, vec3 albedo) {
    film_add(pixel, 1u, vec4(0.0, 0.0, 0.0, depth));
    film_add(pixel, 2u, vec4(axis.x * axis.x, axis.y * axis.y, axis.x * axis.y, axis.x * axis.z));
    film_add(pixel, 3u, vec4(albedo, axis.y * axis.z));
}
