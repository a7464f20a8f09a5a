// Regular tracking as in track_exact.glsl, through fibers and all other media at once.
#include "medium/stepping.glsl"
#include "path/segments.glsl"
#include "medium/media.glsl"
#constant BRICK_POOL
#include "generated/parking.glsl"  // medium/parking.glsl; empty where all bricks are on the device

// Optical depth of the whole step that counts for this segment: in the flight's color, or in the clearest so far.
float counted_depth(inout Path p, Extinction extinction, float length) {
    if (p.mode == MODE_FLIGHT) {
#if EXTINCTION_RGB
        return of_color(extinction, p.color) * length;
#else
        return extinction * length;
#endif
    }
#if EXTINCTION_RGB
    return clearest(p.depths + extinction * length) - clearest(p.depths);
#else
    return extinction * length;
#endif
}

void track(inout Path p) {
#if BRICK_POOL
    if (park(p)) return;
#endif
    MediaCell cell = media_cell(p.voxel, p.direction);
    ivec3 next;
    float t_cell = max(leave_box(cell.lower, cell.upper, p.origin, p.direction, next), p.t);
#if SURFACES
    t_cell = max(min(t_cell, p.t_end), p.t);
#endif
    float t_exit = t_cell;
    Extinction extinction = cell.extinction;
#if HOMOGENEOUS_MEDIA
    add_homogeneous(p.origin, p.direction, p.t, t_exit, extinction);
#endif
    float depth = counted_depth(p, extinction, t_exit - p.t);
    bool collides = p.depth_left < depth;
    float step = t_exit - p.t;
    if (collides) step *= p.depth_left / depth;
#if EXTINCTION_RGB
    p.depths += extinction * step;
#endif
    bool stays = collides || t_exit < t_cell;
    if (!stays) {
        p.depth_left -= depth;
        leave_cell(p, t_exit, next);
        return;
    }
    p.t = collides ? min(p.t + step, t_exit) : t_exit;
    // of a box of many voxels: the one it is in now
    ivec3 upper = min(cell.upper, grid_cells * 8);
    p.voxel = clamp(ivec3(floor(p.origin + p.direction * p.t)), max(cell.lower, ivec3(0)), upper - 1);
    if (!collides) {
        p.depth_left -= depth;
        return;
    }
    bool shadow = p.mode == MODE_SHADOW;
    p.mode = MODE_COLLISION;
    if (shadow) start_flight(p);
}
