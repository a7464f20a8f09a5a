// One scattering event: a light is chosen and a shadow ray sent to it, and a new direction is sampled.
#include "math/frames.glsl"
#include "generated/phase.glsl"
#include "generated/local_lights.glsl"  // light/local.glsl; empty where there are none
#include "light/lights.glsl"
#include "film/film.glsl"
#include "medium/stepping.glsl"
#include "path/segments.glsl"
#constant SAMPLE_LIGHTS
#constant SAMPLE_PHASE
#constant OTHER_MEDIA  // than those of fibers on the grid
#include "generated/collide.glsl"  // medium/collide.glsl; empty where there are none
#constant BRICK_POOL
#constant FIBER_CORRELATION
#if FIBER_CORRELATION
#include "medium/fiber_front.glsl"
#endif

// Where the path's sample is summed: out of core apart from all others, since samples may overtake each other.
uint film_place(Path p) {
#if BRICK_POOL
    return p.slot;
#else
    return film_place(p.rng.xy);
#endif
}

// Balance heuristic between light sampling and phase function sampling.
float light_weight(float light_pdf, float phase_pdf) {
#if SAMPLE_LIGHTS && SAMPLE_PHASE
    return light_pdf > 0.0 ? light_pdf / (light_pdf + phase_pdf) : 1.0;
#else
    return light_pdf > 0.0 ? float(SAMPLE_LIGHTS) : 1.0;
#endif
}

float phase_weight(float light_pdf, float phase_pdf) {
    return 1.0 - (light_pdf > 0.0 ? light_weight(light_pdf, phase_pdf) : 0.0);
}

// Throughput below which paths end by roulette. In proportion to the throughput alone, half of the paths of a fiber of
// albedo 0.95 end at the first throw and what survives counts 2.3 times, the largest part of a picture's variance.
const float ROULETTE_BELOW = 0.25;

// Survivors have throughput ROULETTE_BELOW in their brightest color, at most 20 times what they had.
void roulette(inout Path p, uint bits) {
    float brightest = max(p.throughput.x, max(p.throughput.y, p.throughput.z));
    float survival = clamp(brightest * (1.0 / ROULETTE_BELOW), 0.05, 1.0);
    bool survives = unit_float(bits) < survival;
    p.throughput = survives ? p.throughput / survival : vec3(0.0);
}

void cut_path(inout Path p) {
    cut_paths += 1u;
    film_add_cut(film_place(p));
    p.mode = MODE_ESCAPED;
    p.throughput = vec3(0.0);
}

void scatter(inout Path p) {
    uvec4 bits = random_words(p.rng);
#if OTHER_MEDIA
    Collision with = collide(p, unit_float(bits.x));
    uint medium = with.medium;
    vec3 axis = with.axis;
    vec3 tint = with.tint;
    mat3 frame = fiber_frame(axis == vec3(0.0) ? vec3(0.0, 1.0, 0.0) : axis);
#else
    vec3 axis;
    vec3 tint;
    uint medium = choose_medium(p.voxel, p.direction, unit_float(bits.x), axis, tint);
    mat3 frame = fiber_frame(axis);
#endif
#if FIBER_CORRELATION
    move_to_front(p, axis, unit_interval(random_words(p.rng)).xy, p.left_side);
#endif
    Phase phase = phase_at(medium, -p.direction * frame, tint);
    if (p.bounce == 0u) {
        film_add_first_scattering(film_place(p), p.t, axis, phase_albedo(phase));
    }
    p.radiance += p.throughput * phase_emission(phase);
    if (p.bounce >= max_bounces) {
        cut_path(p);
        return;
    }
#if FIBER_CORRELATION
    p.left_axis = axis;
    p.left_wo = -p.direction;
    p.left_gap = p.bounce == 0u ? p.t : 0.0;
#endif
    p.bounce += 1u;
    p.origin = p.origin + p.direction * p.t;
    p.origin_voxel = p.voxel;

    uvec4 light_bits = random_words(p.rng);
    LightSample light = light_sample(light_bits.xy, unit_interval(light_bits).zw, p.origin);
    float eval_pdf;
    vec3 value = phase_eval(phase, light.direction * frame, eval_pdf);
    vec3 carried = p.throughput * value * light.value * light_weight(light.pdf, eval_pdf);

    vec3 weight;
    vec3 wi = phase_sample(phase, p.rng, weight, p.phase_pdf);
    p.throughput *= weight;
    p.next_direction = without_zeros(normalize(frame * wi));
    p.next_depth = exponential(bits.y);
    if (p.bounce >= roulette_start) roulette(p, bits.z);
    if (max(carried.x, max(carried.y, carried.z)) > 0.0) {
        start_shadow(p, without_zeros(light.direction), light.distance, carried, bits.w);
    } else {
        start_flight(p);
    }
}
