// The volumetric path tracer. Each lane carries one path and works for a fixed number of rounds; a round is a few
// tracking steps and then at most one costly event. (llvmpipe executes every branch of a loop body at every
// iteration, taken or not, so costly events have to wait outside the tracking loop.)
#version 430
#constant GROUP_SIZE
#constant STEPS_PER_ROUND
#constant SEEKS_PER_ROUND
#constant BRICK_POOL

layout(local_size_x = GROUP_SIZE) in;

layout(std430, binding = 0) readonly buffer Cells { uint cells[]; };
layout(std430, binding = 1) readonly buffer Bricks { uvec2 bricks[]; };  // extinction per level; medium, top level. Then slots
layout(std430, binding = 2) buffer States { uvec4 states[]; };
layout(std430, binding = 3) buffer Film { vec4 film[]; };
layout(std430, binding = 4) readonly buffer Lights { vec4 lights[]; };
layout(std430, binding = 5) buffer Counters { uint counters[]; };
#include "generated/phase_block.glsl"  // binding 6

uniform ivec3 grid_cells;
uniform uint lane_count;
uniform uint round_count;
uniform uint seed;
uniform uvec2 image_size;
uniform uint first_row;  // of this pass
uniform uint row_count;
uniform uint first_column;  // of this pass
uniform uint column_count;
uniform uint sample_begin;
uniform uint sample_end;
uniform uint block_shift;    // blocks of 2^block_shift samples are summed apart
uniform uint first_block;    // of this pass
uniform uint block_count;
uniform uint film_layers;
#if BRICK_POOL
uniform uint film_slots;  // of single samples
#endif
uniform uint max_bounces;
uniform uint roulette_start;
uniform float start_offset;  // of segments after a scattering event [voxels]
uniform float flake_roughness;  // of SGGX media
uniform float fiber_radius;  // of the thickest fiber [voxels]
uniform vec4 background;     // color; w > 0: the environment instead
uniform int camera_perspective;
uniform vec3 camera_position;
uniform vec3 camera_forward;
uniform vec3 camera_right;
uniform vec3 camera_up;
uniform ivec2 environment_size;
uniform uint light_count;
uniform vec4 directional_lights[16];
uniform uint local_first;  // entry of the first light that stands somewhere
uniform uint local_lights;   // first row of their places
uniform uint surface_nodes;  // first rows of each kind in lights[], behind the lights (renderer/surfaces.py)
uniform uint surface_instances;
uniform uint surface_triangles;
uniform uint surface_attributes;
uniform uint surface_materials;
uniform uint surface_texels;
uniform uint surface_measured;

const uint COUNTER_PIXEL = 0u;

uint track_steps = 0u;
uint scattering_events = 0u;
uint finished_samples = 0u;
uint cut_paths = 0u;
uint broken_samples = 0u;
uint majorant_violations = 0u;

uint film_pixel_count() {
    return row_count * column_count;
}

// Places of one layer of the film.
uint film_layer_size() {
#if BRICK_POOL
    return film_slots;
#else
    return film_pixel_count();
#endif
}

// Where the sums of (pixel, sample) lie among those of this pass: block by block, the layers of a block together.
uint film_place(uvec2 key) {
    uint row = key.x / image_size.x;
    uint pixel = (row - first_row) * column_count + (key.x - row * image_size.x - first_column);
    return ((key.y >> block_shift) - first_block) * film_layers * film_pixel_count() + pixel;
}

// The n-th pixel of this pass: column by column in strips of 16 rows, so that paths at work at the same time lie near
// each other and share the voxels in the caches.
uint nth_pixel(uint n) {
    uint strip = n / (16u * column_count);
    uint rows = min(16u, row_count - strip * 16u);
    uint m = n - strip * 16u * column_count;
    return (first_row + strip * 16u + m % rows) * image_size.x + first_column + m / rows;
}

#include "generated/voxel_pages.glsl"
#include "generated/track.glsl"
#include "path/samples.glsl"
#constant SURFACES
#include "generated/surfaces.glsl"  // geometry/seek.glsl, path/surface.glsl; empty where there are none

void main() {
    uint lane = gl_GlobalInvocationID.x;
    Path path = load_path(lane);
    for (uint r = 0u; r < round_count && path.mode != MODE_DONE && path.mode < MODE_PARKED; ++r) {
#if SURFACES
        for (uint i = 0u; i < uint(SEEKS_PER_ROUND) && path.mode == MODE_SEEK; ++i) seek(path);
        if (path.mode == MODE_SURFACE) meet_surface(path);
#endif
        for (uint i = 0u; i < uint(STEPS_PER_ROUND) && path.mode <= MODE_SHADOW; ++i) {
            track(path);
            track_steps += 1u;
#if BRICK_POOL
            track_steps -= path.mode >> 3u;  // trying in vain is no step
#endif
        }
        if (path.mode == MODE_COLLISION) {
            scatter(path);
            scattering_events += 1u;
        }
        if (path.mode == MODE_ESCAPED) finish_sample(path);
        if (path.mode == MODE_IDLE) start_sample(path);
    }
    store_path(lane, path);
    atomicAdd(counters[1], track_steps);
    atomicAdd(counters[2], scattering_events);
    atomicAdd(counters[3], finished_samples);
    atomicAdd(counters[4], cut_paths);
    atomicAdd(counters[5], broken_samples);
    atomicAdd(counters[6], majorant_violations);
    atomicAdd(counters[7], uint(path.mode != MODE_DONE));
#if BRICK_POOL
    atomicAdd(counters[8], uint(path.mode >= MODE_PARKED));
#endif
}
