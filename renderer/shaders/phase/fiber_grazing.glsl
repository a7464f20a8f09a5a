// A fiber whose widths and T depend on the inclination of the light: its constants at one inclination. Everything is linear
// in 1 - cos(theta_o) between light at a right angle and light along the fiber. Twin: at_inclination in
// fiber_model/scattering/phase.py
#include "math/bessel.glsl"
#include "math/constants.glsl"
#include "phase/fiber_block.glsl"
#constant FIBER_GRAZING  // 1 where a medium's widths or T go with the inclination of the light

#if FIBER_GRAZING > 0
// 1 - exp(-x) for x >= 0, where it nearly vanishes too.
vec3 fiber_one_minus_exp(vec3 x) {
    vec3 series = x * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0 * (1.0 - x / 7.0))))));
    return mix(1.0 - exp(-x), series, lessThan(x, vec3(0.5)));
}

// The azimuthal lobe of the kind of `lobe` with width gamma; renderer/scattering_block.py has the same as _azimuthal.
vec4 fiber_azimuthal_lobe(vec4 lobe, float gamma) {
    if (lobe.x == 0.0 || lobe.x == 4.0) return lobe;
    if (lobe.x == 3.0) {
        float kappa = 1.0 / (gamma * gamma);
        float tau = 1.0 + sqrt(1.0 + 4.0 * kappa * kappa);
        float rho = (tau - sqrt(2.0 * tau)) / (2.0 * kappa);
        return vec4(3.0, gamma, INV_TWO_PI / bessel_i0e(vec3(kappa)).x, (1.0 - rho) / (1.0 + rho));
    }
    bool images = gamma <= 1.4;
    return vec4(images ? 1.0 : 2.0, gamma, images ? 0.39894228 / gamma : exp(-0.5 * gamma * gamma), 0.0);
}
#endif

FiberScattering fiber_at_inclination(FiberScattering s, vec3 wo) {
#if FIBER_GRAZING > 0
    if (s.grow_width.w == 0.0) return s;
    float toward_grazing = max(0.0, 1.0 - length(wo.yz));
    vec3 normal = s.width.xyz;
    s.width.xyz += toward_grazing * s.grow_width.xyz;
    s.energy_tt += toward_grazing * s.grow_tt;
    s.energy_trt += toward_grazing * s.grow_trt;
    s.around_tt = fiber_azimuthal_lobe(s.around_tt, s.around_tt.y + toward_grazing * s.grow_around.x);
    s.around_trt = fiber_azimuthal_lobe(s.around_trt, s.around_trt.y + toward_grazing * s.grow_around.y);
    vec3 variance = s.width.xyz * s.width.xyz;
    if (s.width.w == 1.0) {
        s.peak.xyz = 1.0 / (variance * (1.0 - exp(-2.0 / variance)));
        return s;
    }
    s.peak.xyz = 0.39894228 / s.width.xyz;
    s.norm_constant.xyz = 0.5 * fiber_one_minus_exp(2.0 * variance);
    s.norm_cos2.xyz = exp(-2.0 * variance);
    vec3 grown = variance / (normal * normal);
    for (int i = 0; i < 8; ++i) s.norm_tail[i].xyz *= grown;
#endif
    return s;
}
