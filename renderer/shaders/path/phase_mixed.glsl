// Fibers and simple phase functions in one picture, behind the five functions the path tracer calls. Needs from the
// program: phase_media[] of FiberScattering for every medium (of simple ones any), and fiber_table[] that ends with the two
// rows of phase/simple.glsl for every medium, of kind KIND_FIBERS where it is fibers.
#include "phase/fiber.glsl"
#include "path/dye.glsl"
#include "phase/simple.glsl"
#constant MEDIUM_COUNT
#constant SIMPLE_ROW  // of fiber_table[], the first of medium 0

struct Phase {
    bool fibers;
    SimplePhase plain;
    FiberScattering s;
    FiberLobes lobes;
};

Phase phase_at(uint medium, vec3 wo, vec3 tint) {
    uint row = uint(SIMPLE_ROW) + 2u * medium;
    SimplePhase plain = simple_phase(fiber_table[row], fiber_table[row + 1u], wo);
    plain.albedo *= tint;
    FiberScattering s = fiber_at_inclination(phase_media[medium], wo);
    dye(s, tint);
    return Phase(plain.kind == KIND_FIBERS, plain, s, fiber_lobes(s, wo));
}

vec3 phase_albedo(Phase phase) {
    return phase.fibers ? fiber_lobes_value(phase.lobes, vec4(1.0)) : phase.plain.albedo;
}

vec3 phase_emission(Phase phase) {
    return phase.plain.emission;
}

vec3 phase_eval(Phase phase, vec3 wi, out float pdf) {
    if (!phase.fibers) return simple_eval(phase.plain, wi, pdf);
    vec4 densities = fiber_lobe_densities(phase.s, phase.lobes, wi);
    pdf = dot(phase.lobes.chance, densities);
    return fiber_lobes_value(phase.lobes, densities);
}

vec3 phase_sample(Phase phase, inout uvec4 rng, out vec3 weight, out float pdf) {
    if (!phase.fibers) return simple_sample(phase.plain, rng, weight, pdf);
    return fiber_lobes_sample(phase.s, phase.lobes, rng, weight, pdf);
}
