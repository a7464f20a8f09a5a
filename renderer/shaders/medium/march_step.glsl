// Ray marching of shadow rays: extinction every march_step voxels, from a random beginning, as if it held for that far.
// The optical depth is unbiased, its exponential is not: on average too much light passes (Jensen), less so the shorter the
// step. next_free: how far it is to the next place to look [voxels].
#include "medium/stepping.glsl"
#include "path/segments.glsl"
#constant BRICK_POOL
#include "generated/parking.glsl"  // medium/parking.glsl; empty where all bricks are on the device

void march(inout Path p) {
    Cell cell = majorant_cell(p.voxel);
    ivec3 next;
    float t_exit = max(leave_box(cell.lower, cell.upper, p.origin, p.direction, next), p.t);
#if SURFACES
    t_exit = max(min(t_exit, p.t_end), p.t);
#endif
    float length = t_exit - p.t;
    if (cell.extinction > 0.0 && p.next_free < length) {
#if BRICK_POOL
        if (park(p)) return;
#endif
        p.t += p.next_free;
        p.voxel = clamp(ivec3(floor(p.origin + p.direction * p.t)), cell.lower, cell.upper - 1);
        p.next_free = march_step;
        p.depth_left -= exact_cell(p.voxel, p.direction).extinction * march_step;
        if (p.depth_left < 0.0) start_flight(p);
        return;
    }
    p.next_free -= length;
    if (p.next_free < 0.0) p.next_free += march_step * ceil(-p.next_free / march_step);
    leave_cell(p, t_exit, next);
}
