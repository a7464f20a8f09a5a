// An axis (t and -t alike) as a point of the unit square, after the hemi-oct map of Cigolle et al. 2014 (JCGT 3(2)).

// Axis folded to z >= 0 -> [0, 1]^2.
vec2 hemi_octahedral_encode(vec3 axis) {
    vec3 t = axis.z < 0.0 ? -axis : axis;
    vec2 p = t.xy / (abs(t.x) + abs(t.y) + t.z);
    return vec2(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
}

vec3 hemi_octahedral_decode(vec2 e) {
    vec2 r = e * 2.0 - 1.0;
    vec2 p = vec2(r.x + r.y, r.x - r.y) * 0.5;
    return normalize(vec3(p, 1.0 - abs(p.x) - abs(p.y)));
}
