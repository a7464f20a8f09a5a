// Delta tracking for flights (Woodcock et al. 1965), ratio tracking for shadow rays (Novak et al. 2014), with one
// majorant per brick. The free optical depth is consumed across bricks and drawn anew at tentative collisions only.
#include "medium/stepping.glsl"
#include "path/segments.glsl"
#constant BRICK_POOL
#include "generated/parking.glsl"  // medium/parking.glsl; empty where all bricks are on the device

void track(inout Path p) {
    Cell cell = majorant_cell(p.voxel);
    ivec3 next;
    float t_exit = max(leave_box(cell.lower, cell.upper, p.origin, p.direction, next), p.t);
#if SURFACES
    t_exit = max(min(t_exit, p.t_end), p.t);
#endif
    float depth = cell.extinction * (t_exit - p.t);
    bool shadow = p.mode == MODE_SHADOW;
    if (p.next_free < depth) {
#if BRICK_POOL
        if (park(p)) return;  // in the brick it is in, where the collision will be
#endif
        p.t += p.next_free / cell.extinction;
        p.voxel = clamp(ivec3(floor(p.origin + p.direction * p.t)), cell.lower, cell.upper - 1);
        float extinction = exact_cell(p.voxel, p.direction).extinction;
        majorant_violations += uint(extinction > cell.extinction);
        uvec4 bits = random_words(p.rng);
        p.next_free = exponential(bits.x);
        float real = extinction / cell.extinction;
        if (shadow) {
            p.depth_left += log(max(1.0 - real, 1e-30));
            if (p.depth_left < 0.0) start_flight(p);
        } else if (unit_float(bits.y) < real) {
            p.mode = MODE_COLLISION;
        }
        return;
    }
    p.next_free -= depth;
    leave_cell(p, t_exit, next);
}
