// Simple phase functions behind the five functions the path tracer calls, for comparison with other renderers and
// with theory. Needs from the program: phase_media[], two rows each (phase/simple.glsl).
#include "phase/simple.glsl"
#define Phase SimplePhase

Phase phase_at(uint medium, vec3 wo, vec3 tint) {
    Phase phase = simple_phase(phase_media[2u * medium], phase_media[2u * medium + 1u], wo);
    phase.albedo *= tint;
    return phase;
}

vec3 phase_albedo(Phase phase) {
    return phase.albedo;
}

// Radiance emitted per optical depth.
vec3 phase_emission(Phase phase) {
    return phase.emission;
}

vec3 phase_eval(Phase phase, vec3 wi, out float pdf) {
    return simple_eval(phase, wi, pdf);
}

vec3 phase_sample(Phase phase, inout uvec4 rng, out vec3 weight, out float pdf) {
    return simple_sample(phase, rng, weight, pdf);
}
