// Regular tracking: extinction is constant in a voxel (nearest lookup), so optical depth is summed exactly.
#include "medium/stepping.glsl"
#include "path/segments.glsl"
#constant FIBER_CORRELATION
#if FIBER_CORRELATION
#include "medium/correlated_step.glsl"
#endif
#constant BRICK_POOL
#include "generated/parking.glsl"  // medium/parking.glsl; empty where all bricks are on the device

void track(inout Path p) {
#if BRICK_POOL
    if (park(p)) return;
#endif
    Cell cell = exact_cell(p.voxel, p.direction);
    ivec3 next;
    float t_exit = max(leave_box(cell.lower, cell.upper, p.origin, p.direction, next), p.t);
#if SURFACES
    t_exit = max(min(t_exit, p.t_end), p.t);
#endif
#if FIBER_CORRELATION
    CorrelatedStep among = correlated_step(p, cell, t_exit);
    float depth = among.depth;
#else
    float depth = cell.extinction * (t_exit - p.t);
#endif
    bool shadow = p.mode == MODE_SHADOW;
    if (p.depth_left < depth) {
#if FIBER_CORRELATION
        p.t = min(p.t + correlated_place(among, p.depth_left) / cell.extinction, t_exit);
#else
        p.t += p.depth_left / cell.extinction;
#endif
        p.mode = MODE_COLLISION;
        if (shadow) start_flight(p);
        return;
    }
    p.depth_left -= depth;
    leave_cell(p, t_exit, next);
}
