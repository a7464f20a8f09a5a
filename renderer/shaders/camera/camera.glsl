// Camera rays, in voxels. Perspective: all from camera_position; orthographic: all along camera_forward.
// camera_right and camera_up reach from the middle of the picture to its edges (perspective: at distance 1).
// Needs from the program: the uniforms camera_*.

// `place` in [-1, 1]^2, x to the right and y up.
void camera_ray(vec2 place, out vec3 origin, out vec3 direction) {
    vec3 offset = place.x * camera_right + place.y * camera_up;
    bool perspective = camera_perspective != 0;
    origin = perspective ? camera_position : camera_position + offset;
    direction = normalize(perspective ? camera_forward + offset : camera_forward);
}

// Where in its pixel a sample lies, in [0, 1)^2: the R2 sequence (Roberts 2018) in 32-bit fixed point, shifted
// per pixel. Any number of samples is well spread, and the n-th does not depend on how many will follow.
vec2 pixel_jitter(uint sample_index, uvec2 shift) {
    uvec2 bits = shift + sample_index * uvec2(3242174889u, 2447445414u);
    return vec2(bits >> 8) * (1.0 / 16777216.0);
}
