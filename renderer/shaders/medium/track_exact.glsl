// Regular tracking: extinction is constant in a voxel (nearest lookup), so optical depth is summed exactly.
#include "medium/stepping.glsl"
#include "path/segments.glsl"

void track(inout Path p) {
    Cell cell = exact_cell(p.voxel, p.direction);
    ivec3 next;
    float t_exit = max(leave_box(cell.lower, cell.upper, p.origin, p.direction, next), p.t);
#if SURFACES
    t_exit = max(min(t_exit, p.t_end), p.t);
#endif
    float depth = cell.extinction * (t_exit - p.t);
    bool shadow = p.mode == MODE_SHADOW;
    if (p.depth_left < depth) {
        p.t += p.depth_left / cell.extinction;
        p.mode = MODE_COLLISION;
        if (shadow) start_flight(p);
        return;
    }
    p.depth_left -= depth;
    leave_cell(p, t_exit, next);
}
