// Starting and ending the two kinds of segment, shadow ray and flight.
#include "medium/volume.glsl"
#include "path/state.glsl"

// Below this transmittance a shadow ray survives by roulette; see start_shadow.
#constant SHADOW_ROULETTE
#constant TRACKING_DELTA

void start_segment(inout Path p, vec3 direction) {
    p.direction = direction;
    p.t = start_offset;
    p.voxel = start_offset > 0.0 ? ivec3(floor(p.origin + direction * start_offset)) : p.origin_voxel;
}

void start_flight(inout Path p) {
    start_segment(p, p.next_direction);
    p.depth_left = p.next_depth;
    p.next_free = p.next_depth;
    bool over = is_outside(p.voxel) || p.throughput == vec3(0.0);
    p.mode = over ? MODE_ESCAPED : MODE_FLIGHT;
}

void end_shadow(inout Path p, float transmittance) {
    p.radiance += p.light * transmittance;
    start_flight(p);
}

// The transmittance T is needed exactly only while it is large. Let c = SHADOW_ROULETTE and u uniform: the estimate
// is T where T >= c, else c if c u < T, else 0; its mean is T. So the ray is given up at depth -log(c u).
void start_shadow(inout Path p, vec3 direction, vec3 light, uint bits) {
    p.light = light;
    start_segment(p, direction);
    p.depth_left = exponential(bits) - log(SHADOW_ROULETTE);
    p.shadow_depth = p.depth_left;
#if TRACKING_DELTA
    p.next_free = exponential(random_words(p.rng).x);
#endif
    p.mode = MODE_SHADOW;
    if (is_outside(p.voxel)) end_shadow(p, 1.0);
}

// The segment goes on in the voxel behind a cell, or has left the volume.
void leave_cell(inout Path p, float t_exit, ivec3 next) {
    p.t = t_exit;
    p.voxel = next;
    if (is_outside(next)) {
        bool shadow = p.mode == MODE_SHADOW;
        p.mode = MODE_ESCAPED;
        if (shadow) end_shadow(p, max(exp(p.depth_left - p.shadow_depth), SHADOW_ROULETTE));
    }
}
