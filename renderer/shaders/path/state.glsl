// The state of one lane, and its place in the state buffer between dispatches. Everything a path depends on is
// saved bit by bit, so cutting a path into dispatches changes nothing.
// Needs from the program: states[] (9 uvec4 per lane, 1 more with surfaces, 3 more where fibers are correlated, 1 more where
// extinction depends on color;
// `state_words` in renderer/kernel.py), lane_count, seed.
#include "rng/random.glsl"
#constant SURFACES
#include "generated/instancing.glsl"  // SURFACE_INSTANCES; empty where there are no surfaces
#constant FIBER_CORRELATION
#constant EXTINCTION_RGB
#constant BRICK_POOL

// 32 random bits each; moves the sample on by one dimension.
uvec4 random_words(inout uvec4 rng) {
    uvec4 bits = random_bits(rng);
    rng.z += 1u;
    return bits;
}

// [0, 1), 24 bits.
float unit_float(uint bits) {
    return float(bits >> 8u) * 5.9604644775390625e-8;
}

// Exponential with mean 1. From all 32 bits, so that the tail reaches 22.9; never infinite.
float exponential(uint bits) {
    return -log((float(bits) + 0.5) * 2.3283064365386963e-10);
}

const uint MODE_FLIGHT = 0u;     // looking for the next collision
const uint MODE_SHADOW = 1u;     // on the way to a light
const uint MODE_COLLISION = 2u;  // a scattering event is due
const uint MODE_ESCAPED = 3u;    // left the volume
const uint MODE_IDLE = 4u;       // needs a new sample
const uint MODE_DONE = 5u;       // no samples left
#if SURFACES
const uint MODE_SEEK = 6u;       // looking for the surface that ends the segment
const uint MODE_SURFACE = 7u;    // has met it
const uint NO_INSTANCE = 0xffffffffu;
const uint NO_TRIANGLE = 0xffffffffu;
const uint NO_NODE = 0xffffffffu;
const float NO_END = 1e30;
const ivec3 ON_SURFACE = ivec3(-0x40000000);  // the voxel of an origin that lies on a surface
#endif
const uint MODE_PARKED = 8u;     // added to flight or shadow: waits for a brick that is not on the device
const uint NO_BRICK = 0xffffffffu;

#if FIBER_CORRELATION
#include "medium/fiber_run.glsl"
const uint CORRELATION_ROW = 9u + uint(SURFACES);
#endif
#if EXTINCTION_RGB
const uint COLOR_ROW = 9u + uint(SURFACES);  // fibers are not correlated there
#endif

struct Path {
    vec3 origin;         // of the segment [voxels]
    float t;             // along the segment [voxels]
    vec3 direction;
    float depth_left;    // optical depth left before the collision, or before a shadow ray is given up
    vec3 throughput;
    float phase_pdf;     // of `direction` as phase function sampling chose it [1/sr]
    vec3 next_direction; // of the flight that follows the shadow ray
    float next_depth;    // its free optical depth
    vec3 light;          // what the shadow ray carries if nothing is in its way
    float shadow_depth;  // depth_left when it started
    vec3 radiance;       // of this sample so far
    uint mode;
    ivec3 voxel;         // where t is
    uint bounce;         // scattering events so far
    ivec3 origin_voxel;
    uvec4 rng;           // pixel, sample, dimension, seed; see rng/random.glsl
    float next_free;     // delta tracking: optical depth to the next tentative collision
#if BRICK_POOL
    uint wanted;         // the brick a parked path waits for
    uint slot;           // where its sample is summed
#endif
#if SURFACES
    float t_end;         // where the segment ends: the nearest surface found, or the light [voxels]
    uint node;           // of the hierarchy, the next to be looked at
    uint triangle;       // the nearest found
    uint sought;         // the mode that follows: flight or shadow
#if SURFACE_INSTANCES
    uint instance;       // that the walk is in
    uint met_instance;   // the one of `triangle`
#endif
#endif
#if FIBER_CORRELATION
    vec3 left_axis;      // of the fiber that the segment leaves; zero where it leaves none
    vec3 left_wo;        // toward where the path came to it from
    float left_gap;      // as far as that is known to be free [voxels]; 0: a fiber ends it
    float left_side;     // where that fiber was passed, in its radii: -1 to 1
    FiberRun run;        // what the segment has passed since it last was among no fibers
#endif
#if EXTINCTION_RGB
    vec3 depths;         // optical depth of the segment so far, by color
    uint color;          // the channel whose depth ends the flight
#endif
};

Path load_path(uint lane) {
    uvec4 w0 = states[lane];
    uvec4 w1 = states[lane + lane_count];
    uvec4 w2 = states[lane + lane_count * 2u];
    uvec4 w3 = states[lane + lane_count * 3u];
    uvec4 w4 = states[lane + lane_count * 4u];
    uvec4 w5 = states[lane + lane_count * 5u];
    uvec4 w6 = states[lane + lane_count * 6u];
    uvec4 w7 = states[lane + lane_count * 7u];
    uvec4 w8 = states[lane + lane_count * 8u];
    Path p;
    p.origin = uintBitsToFloat(w0.xyz);
    p.t = uintBitsToFloat(w0.w);
    p.direction = uintBitsToFloat(w1.xyz);
    p.depth_left = uintBitsToFloat(w1.w);
    p.throughput = uintBitsToFloat(w2.xyz);
    p.phase_pdf = uintBitsToFloat(w2.w);
    p.next_direction = uintBitsToFloat(w3.xyz);
    p.next_depth = uintBitsToFloat(w3.w);
    p.light = uintBitsToFloat(w4.xyz);
    p.shadow_depth = uintBitsToFloat(w4.w);
    p.radiance = uintBitsToFloat(w5.xyz);
    p.mode = w5.w;
    p.voxel = ivec3(w6.xyz);
    p.bounce = w6.w;
    p.origin_voxel = ivec3(w7.xyz);
    p.rng = uvec4(w8.x, w8.y, w7.w, seed);
    p.next_free = uintBitsToFloat(w8.z);
#if BRICK_POOL
    p.slot = p.mode >> 4u;
    p.mode &= MODE_PARKED - 1u;  // parked paths try again
    p.wanted = NO_BRICK;
#endif
#if SURFACES
    uvec4 w9 = states[lane + lane_count * 9u];
    p.t_end = uintBitsToFloat(w9.x);
    p.node = w9.y;
    p.triangle = w9.z;
    p.sought = w9.w;
#if SURFACE_INSTANCES
    p.sought = w9.w & 1u;
    p.instance = (w9.w >> 1u) - 1u;  // 0 becomes NO_INSTANCE
    p.met_instance = w8.w;
#endif
#endif
#if FIBER_CORRELATION
    uvec4 c0 = states[lane + lane_count * CORRELATION_ROW];
    uvec4 c1 = states[lane + lane_count * (CORRELATION_ROW + 1u)];
    uvec4 c2 = states[lane + lane_count * (CORRELATION_ROW + 2u)];
    p.left_axis = uintBitsToFloat(c0.xyz);
    p.left_gap = uintBitsToFloat(c0.w);
    p.left_wo = uintBitsToFloat(c1.xyz);
    p.run = FiberRun(uintBitsToFloat(c1.w), uintBitsToFloat(c2.x), uintBitsToFloat(c2.y));
    p.left_side = uintBitsToFloat(c2.z);
#endif
#if EXTINCTION_RGB
    uvec4 by_color = states[lane + lane_count * COLOR_ROW];
    p.depths = uintBitsToFloat(by_color.xyz);
    p.color = by_color.w;
#endif
    return p;
}

void store_path(uint lane, Path p) {
    states[lane] = uvec4(floatBitsToUint(p.origin), floatBitsToUint(p.t));
    states[lane + lane_count] = uvec4(floatBitsToUint(p.direction), floatBitsToUint(p.depth_left));
    states[lane + lane_count * 2u] = uvec4(floatBitsToUint(p.throughput), floatBitsToUint(p.phase_pdf));
    states[lane + lane_count * 3u] = uvec4(floatBitsToUint(p.next_direction), floatBitsToUint(p.next_depth));
    states[lane + lane_count * 4u] = uvec4(floatBitsToUint(p.light), floatBitsToUint(p.shadow_depth));
#if BRICK_POOL
    p.mode |= p.slot << 4u;
#endif
    states[lane + lane_count * 5u] = uvec4(floatBitsToUint(p.radiance), p.mode);
    states[lane + lane_count * 6u] = uvec4(uvec3(p.voxel), p.bounce);
    states[lane + lane_count * 7u] = uvec4(uvec3(p.origin_voxel), p.rng.z);
#if BRICK_POOL
    uint wanted = p.wanted;
#else
    uint wanted = NO_BRICK;
#endif
    states[lane + lane_count * 8u] = uvec4(p.rng.x, p.rng.y, floatBitsToUint(p.next_free), wanted);
#if SURFACES
    states[lane + lane_count * 9u] = uvec4(floatBitsToUint(p.t_end), p.node, p.triangle, p.sought);
#if SURFACE_INSTANCES
    states[lane + lane_count * 8u].w = p.met_instance;
    states[lane + lane_count * 9u].w = p.sought | (p.instance + 1u) << 1u;
#endif
#endif
#if FIBER_CORRELATION
    states[lane + lane_count * CORRELATION_ROW] = uvec4(floatBitsToUint(p.left_axis), floatBitsToUint(p.left_gap));
    states[lane + lane_count * (CORRELATION_ROW + 1u)] =
        uvec4(floatBitsToUint(p.left_wo), floatBitsToUint(p.run.depth));
    states[lane + lane_count * (CORRELATION_ROW + 2u)] =
        floatBitsToUint(vec4(p.run.fibers, p.run.own, p.left_side, 0.0));
#endif
#if EXTINCTION_RGB
    states[lane + lane_count * COLOR_ROW] = uvec4(floatBitsToUint(p.depths), p.color);
#endif
}
