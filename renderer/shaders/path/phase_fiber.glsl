// The three-lobe fiber of phase/fiber.glsl behind the four functions the path tracer calls.
// Needs from the program: phase_media[] of FiberScattering, and fiber_table[] where a medium is symmetric or has
// tables around the fiber.
#include "phase/fiber.glsl"
#include "path/dye.glsl"
#constant MEDIUM_COUNT

struct Phase {
    FiberScattering s;
    FiberLobes lobes;
};

Phase phase_at(uint medium, vec3 wo, vec3 tint) {
    // an index known at compile time lets llvmpipe load the constants once per vector of lanes
    FiberScattering s = fiber_at_inclination(phase_media[MEDIUM_COUNT == 1 ? 0u : medium], wo);
    dye(s, tint);
    return Phase(s, fiber_lobes(s, wo));
}

vec3 phase_albedo(Phase phase) {
    return fiber_lobes_value(phase.lobes, vec4(1.0));
}

vec3 phase_emission(Phase phase) {
    return vec3(0.0);
}

vec3 phase_eval(Phase phase, vec3 wi, out float pdf) {
    vec4 densities = fiber_lobe_densities(phase.s, phase.lobes, wi);
    pdf = dot(phase.lobes.chance, densities);
    return fiber_lobes_value(phase.lobes, densities);
}

vec3 phase_sample(Phase phase, inout uvec4 rng, out vec3 weight, out float pdf) {
    return fiber_lobes_sample(phase.s, phase.lobes, rng, weight, pdf);
}
