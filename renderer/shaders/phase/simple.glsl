// Isotropic, Henyey-Greenstein and SGGX scattering with albedo and emission, chosen by kind.
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

struct SimplePhase {
    vec3 wo;
    vec3 albedo;
    float kind;
    vec3 emission;
    float shape;  // g, or SGGX roughness
};

const float KIND_FIBERS = -1.0;
const float KIND_HENYEY_GREENSTEIN = 1.0;
const float KIND_SGGX = 2.0;

// From its two rows: albedo, kind; emission, shape.
SimplePhase simple_phase(vec4 first, vec4 second, vec3 wo) {
    return SimplePhase(wo, first.rgb, first.w, second.rgb, second.w);
}

float simple_pdf(SimplePhase phase, vec3 wi) {
    float pdf = isotropic_pdf(phase.wo, wi);
#if PHASE_HENYEY_GREENSTEIN
    if (phase.kind == KIND_HENYEY_GREENSTEIN) pdf = henyey_greenstein_pdf(phase.wo, wi, phase.shape);
#endif
#if PHASE_SGGX
    if (phase.kind == KIND_SGGX) pdf = sggx_pdf(phase.wo, wi, phase.shape);
#endif
    return pdf;
}

vec3 simple_eval(SimplePhase phase, vec3 wi, out float pdf) {
    pdf = simple_pdf(phase, wi);
    return phase.albedo * pdf;
}

vec3 simple_sample(SimplePhase phase, inout uvec4 rng, out vec3 weight, out float pdf) {
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
