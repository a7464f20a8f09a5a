// Whether a ray meets a box before t_end. `inverse`: 1 / direction, whose components are nowhere infinite.
bool meets_box(vec3 lower, vec3 upper, vec3 origin, vec3 inverse, float t_end) {
    vec3 a = (lower - origin) * inverse;
    vec3 b = (upper - origin) * inverse;
    vec3 near = min(a, b);
    vec3 far = max(a, b);
    float t_near = max(max(near.x, near.y), max(near.z, 0.0));
    // 3 roundings on either side (Ize 2013)
    float t_far = min(far.x, min(far.y, min(far.z, t_end))) * 1.0000005;
    return t_near <= t_far;
}
