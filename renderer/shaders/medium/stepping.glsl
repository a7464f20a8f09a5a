// Where a ray leaves a box of voxels. Voxel coordinates move by at least one along the exit axis at every step, so
// no rounding of t can stop a ray.

// Distance to the exit face and the voxel behind it. No component of `direction` may be zero.
float leave_box(ivec3 lower, ivec3 upper, vec3 origin, vec3 direction, out ivec3 next) {
    bvec3 forward = greaterThan(direction, vec3(0.0));
    vec3 face = vec3(forward.x ? upper.x : lower.x, forward.y ? upper.y : lower.y, forward.z ? upper.z : lower.z);
    vec3 t = (face - origin) / direction;
    float t_exit = min(t.x, min(t.y, t.z));
    ivec3 inside = clamp(ivec3(floor(origin + direction * t_exit)), lower, upper - 1);
    next = ivec3(t.x <= t_exit ? (forward.x ? upper.x : lower.x - 1) : inside.x,
                 t.y <= t_exit ? (forward.y ? upper.y : lower.y - 1) : inside.y,
                 t.z <= t_exit ? (forward.z ? upper.z : lower.z - 1) : inside.z);
    return t_exit;
}

// A direction whose components are nowhere zero.
vec3 without_zeros(vec3 direction) {
    return vec3(abs(direction.x) < 1e-18 ? 1e-18 : direction.x,
                abs(direction.y) < 1e-18 ? 1e-18 : direction.y,
                abs(direction.z) < 1e-18 ? 1e-18 : direction.z);
}

// Entry distance into the box [0, size], or -1 where the ray misses it; 0 from inside.
float enter_box(vec3 size, vec3 origin, vec3 direction) {
    vec3 a = -origin / direction;
    vec3 b = (size - origin) / direction;
    vec3 near = min(a, b);
    vec3 far = max(a, b);
    float t_near = max(max(near.x, near.y), max(near.z, 0.0));
    float t_far = min(far.x, min(far.y, far.z));
    return t_near < t_far ? t_near : -1.0;
}
