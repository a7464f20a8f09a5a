// Isotropic, Henyey-Greenstein and SGGX media with albedo and emission, for comparison with other renderers and with
// theory. Needs from the program: phase_media[], two rows each: albedo, kind; emission, g or roughness.
#include "rng/random.glsl"
#include "math/constants.glsl"
#include "math/frames.glsl"
#constant PHASE_HENYEY_GREENSTEIN
#constant PHASE_SGGX
#include "phase/isotropic.glsl"
#if PHASE_HENYEY_GREENSTEIN
#include "phase/henyey_greenstein.glsl"
#endif
#if PHASE_SGGX
#include "phase/sggx.glsl"
#endif

struct Phase {
    vec3 wo;
    vec3 albedo;
    float kind;
    vec3 emission;
    float shape;  // g, or SGGX roughness
};

const float KIND_HENYEY_GREENSTEIN = 1.0;
const float KIND_SGGX = 2.0;

Phase phase_at(uint medium, vec3 wo, vec3 tint) {
    vec4 first = phase_media[2u * medium];
    vec4 second = phase_media[2u * medium + 1u];
    return Phase(wo, first.rgb * tint, first.w, second.rgb, second.w);
}

vec3 phase_albedo(Phase phase) {
    return phase.albedo;
}

// Radiance emitted per optical depth.
vec3 phase_emission(Phase phase) {
    return phase.emission;
}

float simple_pdf(Phase phase, vec3 wi) {
    float pdf = isotropic_pdf(phase.wo, wi);
#if PHASE_HENYEY_GREENSTEIN
    if (phase.kind == KIND_HENYEY_GREENSTEIN) pdf = henyey_greenstein_pdf(phase.wo, wi, phase.shape);
#endif
#if PHASE_SGGX
    if (phase.kind == KIND_SGGX) pdf = sggx_pdf(phase.wo, wi, phase.shape);
#endif
    return pdf;
}

vec3 phase_eval(Phase phase, vec3 wi, out float pdf) {
    pdf = simple_pdf(phase, wi);
    return phase.albedo * pdf;
}

vec3 phase_sample(Phase phase, inout uvec4 rng, out vec3 weight, out float pdf) {
    vec2 u = random4(rng).xy;
    vec3 wi = isotropic_sample(phase.wo, u);
#if PHASE_HENYEY_GREENSTEIN
    if (phase.kind == KIND_HENYEY_GREENSTEIN) wi = henyey_greenstein_sample(phase.wo, phase.shape, u);
#endif
#if PHASE_SGGX
    if (phase.kind == KIND_SGGX) wi = sggx_sample(phase.wo, phase.shape, u);
#endif
    weight = phase.albedo;
    pdf = simple_pdf(phase, wi);
    return wi;
}
