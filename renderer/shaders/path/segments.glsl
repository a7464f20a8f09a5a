// Starting and ending the two kinds of segment, shadow ray and flight.
#include "medium/volume.glsl"
#include "medium/stepping.glsl"
#include "path/state.glsl"

// Below this transmittance a shadow ray survives by roulette; see start_shadow.
#constant SHADOW_ROULETTE
#constant SHADOW_COLLISIONS  // shadow rays meet collisions or places to look at, drawn at random
#constant SHADOW_MARCH
#if SHADOW_MARCH
uniform float march_step;  // [voxels]
#endif
#constant SURFACES
#constant FIBER_CORRELATION
#constant EXTINCTION_RGB
#if EXTINCTION_RGB
#include "medium/colors.glsl"
#endif

#if SURFACES
const float BEFORE_THE_LIGHT = 0.9999;  // so that a shadow ray does not end in the light's own shape

// The segment first looks for the surface that ends it, then goes through the volume in `mode`.
void start_seek(inout Path p, float t_end, uint mode) {
    p.t_end = t_end;
    p.node = 0u;
    p.triangle = NO_TRIANGLE;
    p.sought = mode;
#if SURFACE_INSTANCES
    p.instance = NO_INSTANCE;
    p.met_instance = NO_INSTANCE;
#endif
    p.mode = MODE_SEEK;
}
#endif

void start_segment(inout Path p, vec3 direction) {
    p.direction = direction;
#if FIBER_CORRELATION
    p.run = NO_FIBERS;
#endif
#if EXTINCTION_RGB
    p.depths = vec3(0.0);
#endif
#if SURFACES
    if (p.origin_voxel == ON_SURFACE) {
        p.t = 0.0;
        p.voxel = ivec3(floor(p.origin));
        return;
    }
#endif
    p.t = start_offset;
    p.voxel = start_offset > 0.0 ? ivec3(floor(p.origin + direction * start_offset)) : p.origin_voxel;
}

void start_flight(inout Path p) {
    start_segment(p, p.next_direction);
    p.depth_left = p.next_depth;
    p.next_free = p.next_depth;
#if EXTINCTION_RGB
    choose_color(p, random_words(p.rng).x);
#endif
#if SURFACES
    start_seek(p, NO_END, MODE_FLIGHT);
    if (p.throughput == vec3(0.0)) p.mode = MODE_ESCAPED;
#else
    bool over = is_outside(p.voxel) || p.throughput == vec3(0.0);
    p.mode = over ? MODE_ESCAPED : MODE_FLIGHT;
#endif
}

void end_shadow(inout Path p, float transmittance) {
    p.radiance += p.light * transmittance;
    start_flight(p);
}

// The transmittance T is needed exactly only while it is large. Let c = SHADOW_ROULETTE and u uniform: the estimate
// is T where T >= c, else c if c u < T, else 0; its mean is T. So the ray is given up at depth -log(c u).
void start_shadow(inout Path p, vec3 direction, float distance, vec3 light, uint bits) {
    p.light = light;
    start_segment(p, direction);
    p.depth_left = exponential(bits) - log(SHADOW_ROULETTE);
    p.shadow_depth = p.depth_left;
#if SHADOW_MARCH
    p.next_free = march_step * unit_float(random_words(p.rng).x);
#elif SHADOW_COLLISIONS
    p.next_free = exponential(random_words(p.rng).x);
#endif
#if SURFACES
    start_seek(p, distance * BEFORE_THE_LIGHT, MODE_SHADOW);
#else
    p.mode = MODE_SHADOW;
    if (is_outside(p.voxel)) end_shadow(p, 1.0);
#endif
}

// The segment has no fiber before it any more: at its surface, at its light, or out of the volume.
void end_segment(inout Path p) {
    bool shadow = p.mode == MODE_SHADOW;
    p.mode = MODE_ESCAPED;
#if SURFACES
    if (p.triangle != NO_TRIANGLE) p.mode = MODE_SURFACE;
#endif
#if EXTINCTION_RGB
    if (shadow) {
        p.light *= color_transmittance(p.depths);
    } else {
        settle_colors(p, vec3(1.0));
    }
#endif
    if (shadow) end_shadow(p, max(exp(p.depth_left - p.shadow_depth), SHADOW_ROULETTE));
}

#if SURFACES
// All surfaces are known: the light is hidden, or the segment goes through the volume as far as t_end.
void end_seek(inout Path p) {
    p.mode = p.sought;
    if (p.sought == MODE_SHADOW && p.triangle != NO_TRIANGLE) {
        start_flight(p);
        return;
    }
    if (!is_outside(p.voxel)) return;
    vec3 size = vec3(grid_cells * 8);
    float t = enter_box(size, p.origin, p.direction);
    if (t < 0.0 || t >= p.t_end || t < p.t) {
        end_segment(p);
        return;
    }
    p.t = t;
    p.voxel = clamp(ivec3(floor(p.origin + p.direction * t)), ivec3(0), grid_cells * 8 - 1);
}
#endif

// The segment goes on in the voxel behind a cell, or has left the volume.
void leave_cell(inout Path p, float t_exit, ivec3 next) {
    p.t = t_exit;
    p.voxel = next;
#if SURFACES
    if (is_outside(next) || t_exit >= p.t_end) end_segment(p);
#else
    if (is_outside(next)) end_segment(p);
#endif
}
