// Isotropic scattering with an albedo per medium, for comparison with other renderers and with theory.
// Needs from the program: phase_media[], the albedo in rgb.
#include "phase/isotropic.glsl"
#include "rng/random.glsl"

struct Phase {
    vec3 wo;
    vec3 albedo;
};

Phase phase_at(uint medium, vec3 wo) {
    return Phase(wo, phase_media[medium].rgb);
}

vec3 phase_albedo(Phase phase) {
    return phase.albedo;
}

vec3 phase_eval(Phase phase, vec3 wi, out float pdf) {
    pdf = isotropic_pdf(phase.wo, wi);
    return phase.albedo * isotropic_eval(phase.wo, wi);
}

vec3 phase_sample(Phase phase, inout uvec4 rng, out vec3 weight, out float pdf) {
    vec3 wi = isotropic_sample(phase.wo, random4(rng).xy);
    weight = phase.albedo;
    pdf = isotropic_pdf(phase.wo, wi);
    return wi;
}
