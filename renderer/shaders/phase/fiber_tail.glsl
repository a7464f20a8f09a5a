// Tails of the longitudinal lobes: the spherical Cauchy distribution about the specular cone, all three lobes at once.
// spread is the square of the width. Twin: fiber_model/scattering/tail.py
#include "phase/fiber_longitudinal.glsl"

// M per lobe. near and far are 1 + spread + sin sin -/+ cos cos, without cancellation.
vec3 fiber_tail_eval(vec3 spread, float sin_o, float cos_o, float sin_i, float cos_i) {
    float sin_sum = sin_i * cos_o + cos_i * sin_o;
    float cos_sum = cos_i * cos_o - sin_i * sin_o;
    float sin_gap = sin_i * cos_o - cos_i * sin_o;
    float cos_gap = cos_i * cos_o + sin_i * sin_o;
    float drop = cos_sum > 0.0 ? sin_sum * sin_sum / (1.0 + cos_sum) : 1.0 - cos_sum;
    float rise = cos_gap < 0.0 ? sin_gap * sin_gap / (1.0 - cos_gap) : 1.0 + cos_gap;
    vec3 near = spread + drop;
    vec3 far = spread + rise;
    vec3 product = near * far;
    return 0.25 * spread * (spread + 2.0) * (near + far) / (product * sqrt(product));
}

// (sin theta_i, cos theta_i) with density M cos theta_i.
vec2 fiber_tail_sample(float sin_o, float cos_o, float spread, vec2 u) {
    float drop = min(2.0, 2.0 * spread * u.x / (spread + 2.0 * (1.0 - u.x)));
    return fiber_about_cone(sin_o, cos_o, drop, u.y);
}
