// Longitudinal lobes M of the fiber phase function, all three lobes at once: Gaussian (Khungurn et al. 2015, with the
// exact normalization) and von Mises-Fisher (d'Eon et al. 2011). Twin: fiber_model/scattering/longitudinal.py
#include "math/constants.glsl"
#include "math/arctangent.glsl"
#include "math/bessel.glsl"
#include "phase/fiber_block.glsl"

// Scale of M for this wo: peak / G(theta_o) per lobe. The constants of G come from renderer/scattering_block.py.
vec3 fiber_longitudinal_scale(FiberScattering s, float sin_o, float cos_o) {
    float gap = arctangent(cos_o, abs(sin_o));  // to the pole
    vec3 y = gap / s.width.xyz;
    vec3 falloff = exp(-0.5 * y * y * s.norm_narrow.xyz);
    float toward_pole = 1.0 - gap / HALF_PI;
    vec3 z = mix(vec3(toward_pole * toward_pole), 1.0 / (1.0 + 0.5 * y), s.norm_narrow.xyz);
    vec3 tail = s.norm_tail[7].xyz;
    tail = tail * z + s.norm_tail[6].xyz;
    tail = tail * z + s.norm_tail[5].xyz;
    tail = tail * z + s.norm_tail[4].xyz;
    tail = tail * z + s.norm_tail[3].xyz;
    tail = tail * z + s.norm_tail[2].xyz;
    tail = tail * z + s.norm_tail[1].xyz;
    tail = tail * z + s.norm_tail[0].xyz;
    return s.peak.xyz / (s.norm_constant.xyz + s.norm_cos2.xyz * cos_o * cos_o - falloff * tail);
}

// M per lobe. theta_i + theta_o from products of sines and cosines: exact to 1e-7 rad where they nearly cancel.
vec3 fiber_longitudinal_eval(FiberScattering s, vec3 scale, float sin_o, float cos_o, float sin_i, float cos_i) {
    float sin_sum = sin_i * cos_o + cos_i * sin_o;
    float cos_sum = cos_i * cos_o - sin_i * sin_o;
    if (s.width.w == 0.0) {
        vec3 deviations = arctangent(sin_sum, cos_sum) / s.width.xyz;
        return scale * exp(-0.5 * deviations * deviations) * cos_i;
    }
    vec3 concentration = 1.0 / (s.width.xyz * s.width.xyz);
    float drop = cos_sum > 0.0 ? sin_sum * sin_sum / (1.0 + cos_sum) : 1.0 - cos_sum;
    return scale * exp(-drop * concentration) * bessel_i0e(cos_o * cos_i * concentration);
}

// Rejection sampling of the Gaussian lobe, density g(theta; mean, beta) cos^2(theta).
// 2 ln cos(theta) + theta^2 is concave, so it lies under its tangent at any point c; the envelope is therefore a
// Gaussian of precision 1/beta^2 + 2. At the mode the acceptance is at least 0.65 for beta of 0.5 to 60 degrees.
struct FiberProposal {
    float tangent;      // c, close to the mode
    float slope;        // of the tangent
    float mean;         // of the envelope
    float deviation;
    float cos_tangent;
};

// mean_theta = -theta_o. c solves c + 2 beta^2 tan(c) = mean_theta up to cot(y) = 1/y - y/3; no need to solve it exactly.
FiberProposal fiber_longitudinal_proposal(float sin_o, float cos_o, float beta) {
    float gap = arctangent(cos_o, abs(sin_o));
    float stretch = 1.0 + 0.66666667 * beta * beta;
    float from_pole = (gap + sqrt(gap * gap + 8.0 * beta * beta * stretch)) / (2.0 * stretch);
    from_pole = min(from_pole, HALF_PI);
    float side = sin_o > 0.0 ? -1.0 : 1.0;
    FiberProposal p;
    p.tangent = side * (HALF_PI - from_pole);
    p.cos_tangent = sin(from_pole);
    p.slope = 2.0 * p.tangent - 2.0 * side * cos(from_pole) / p.cos_tangent;
    float variance = 1.0 / (1.0 / (beta * beta) + 2.0);
    p.mean = variance * (side * (HALF_PI - gap) / (beta * beta) + p.slope);
    p.deviation = sqrt(variance);
    return p;
}

// One try with a standard normal and a uniform number; theta is set only if it is accepted.
bool fiber_longitudinal_try(FiberProposal p, float normal, float u, inout float theta) {
    float candidate = p.mean + p.deviation * normal;
    float ratio = cos(candidate) / p.cos_tangent;
    float chance = ratio * ratio * exp((candidate - p.tangent) * (candidate + p.tangent - p.slope));
    bool accepted = abs(candidate) < HALF_PI && u < chance;
    theta = accepted ? candidate : theta;
    return accepted;
}

// (sin theta_i, cos theta_i) of a direction whose angle to one of the specular cone has the cosine 1 - drop, in turn u.
vec2 fiber_about_cone(float sin_o, float cos_o, float drop, float u) {
    float side = sqrt(drop * (2.0 - drop));
    float around = side * cos(TWO_PI * u);
    float outward = (1.0 - drop) * cos_o + around * sin_o;
    float across = side * sin(TWO_PI * u);
    return vec2(around * cos_o - (1.0 - drop) * sin_o, sqrt(outward * outward + across * across));
}

// Of a von Mises-Fisher direction about the specular cone (d'Eon et al. 2013).
vec2 fiber_vmf_sample(float sin_o, float cos_o, float beta, vec2 u) {
    float v = beta * beta;
    float keep = 1.0 - u.x;  // in (0, 1]
    float drop = min(2.0, -v * log(keep + (1.0 - keep) * exp(-2.0 / v)));
    return fiber_about_cone(sin_o, cos_o, drop, u.y);
}
