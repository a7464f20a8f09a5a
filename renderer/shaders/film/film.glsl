// Sums over the samples of a pixel. One lane owns a pixel during a pass and adds its samples in order, so the sums
// do not depend on scheduling. Needs from the program: film[], film_pixel_count().
//   0: radiance, opacity   1: radiance squared, depth of the first scattering [voxels]
//   2: fiber axis there (see film_axis), 1   3: albedo there, 0

void film_add(uint pixel, uint layer, vec4 value) {
    uint index = layer * film_pixel_count() + pixel;
    film[index] += value;
}

void film_add_sample(uint pixel, vec3 radiance, float opacity) {
    film_add(pixel, 0u, vec4(radiance, opacity));
    film_add(pixel, 1u, vec4(radiance * radiance, 0.0));
}

void film_add_first_scattering(uint pixel, float depth, vec3 axis, vec3 albedo) {
    film_add(pixel, 1u, vec4(0.0, 0.0, 0.0, depth));
    film_add(pixel, 2u, vec4(axis, 1.0));
    film_add(pixel, 3u, vec4(albedo, 0.0));
}

// An axis has no sign; take the one with x > 0, so that axes of one yarn do not cancel.
vec3 film_axis(vec3 axis) {
    return axis.x < 0.0 ? -axis : axis;
}
