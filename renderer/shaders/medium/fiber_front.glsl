// A path meets a fiber at the side that it comes from and leaves from there, whereas density fills the whole fiber.
// So a collision draws where its fiber lies, and moves the path to that fiber's front: the same for one, many, or
// white fibers, since how many are met does not change. Leaving, it meets only fibers whose fronts lie ahead.
#include "path/state.glsl"

// Integral over q = 0..q of the share of fibers around the distance 2 a q across them whose front lies behind the start:
// for a fiber passed at u of its radius that share is max(1 - q / sqrt(1 - u^2), 0), and u is uniform.
float fronts_behind(float q) {
    q = min(q, 1.0);
    float r = sqrt(1.0 - q * q);
    return 0.75 * q * r + 0.25 * asin(q) - 0.5 * q * q * acos(q);
}

// The mean of that share between distances t0 and t1 on the way from a fiber.
float share_behind(Path p, float t0, float t1) {
    float cosine = dot(p.left_axis, p.direction);
    float across = sqrt(max(1.0 - cosine * cosine, 1e-8)) / (2.0 * fiber_radius);
    float q0 = min(t0 * across, 1.0);
    float q1 = min(t1 * across, 1.0);
    // of a step that goes beyond the reach of the own fiber, the part within it
    return clamp((fronts_behind(q1) - fronts_behind(q0)) / max((t1 - t0) * across, 1e-6), 0.0, 1.0);
}

// From the place in a fiber to its front, along the ray; u in [0, 1)^2. `side` becomes where the fiber is passed, in
// radii. Fronts lie ahead of where a segment starts.
void move_to_front(inout Path p, vec3 axis, vec2 u, out float side) {
    float cosine = dot(axis, p.direction);
    float sine = sqrt(max(1.0 - cosine * cosine, 1e-8));
    side = 2.0 * u.x - 1.0;
    float chord = 2.0 * fiber_radius * sqrt(1.0 - side * side);
    float t = p.t - u.y * min(chord, p.t * sine) / sine;
    ivec3 voxel = ivec3(floor(p.origin + p.direction * t));
    if (is_outside(voxel)) return;  // half a fiber before the first voxel
    p.t = t;
    p.voxel = voxel;
}

// From a point to the axis of the fiber that the path leaves, across it.
vec3 to_own_axis(Path p, vec3 point) {
    vec3 forth = normalize(p.left_wo - dot(p.left_axis, p.left_wo) * p.left_axis + 1e-6 * p.left_axis.zxy);
    vec3 center = -fiber_radius * (sqrt(max(1.0 - p.left_side * p.left_side, 0.0)) * forth
                                   + p.left_side * cross(p.left_axis, forth));
    vec3 d = p.origin + center - point;
    return d - dot(p.left_axis, d) * p.left_axis;
}
