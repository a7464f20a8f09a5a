// Residual ratio tracking of shadow rays (Novak, Selle and Jarosz 2014). Each brick has a control extinction c, of the mean
// of its voxels; exp(-c) is taken exactly, and ratio tracking estimates what differs, by collisions at the rate
// r = max(majorant - c, c) that bounds it: T = exp(-integral of c) prod (1 - (s - c) / r). Factors pass 1 where s < c, so a ray
// cannot be given up before its end.
#include "medium/stepping.glsl"
#include "path/segments.glsl"
#constant BRICK_POOL
#include "generated/parking.glsl"  // medium/parking.glsl; empty where all bricks are on the device

// The brick's control, of the layers of the voxel's cell; zero where nothing is.
float control_extinction(ivec3 voxel) {
    uint word = cell_word(voxel >> 3);
    if (word >= EMPTY_CELL) return 0.0;
    CellBricks held = cell_bricks(word);
    float control = 0.0;
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        if (layer < held.layers) {
            uvec2 brick = bricks[held.first + layer];
            control += uintBitsToFloat(brick.x) * float((brick.y >> 16) & 0xfffu) * float(brick.y >> 28) / 16.0;
        }
    }
    return control;
}

void residual_step(inout Path p) {
    Cell cell = majorant_cell(p.voxel);
    float control = control_extinction(p.voxel);
    float rate = max(cell.extinction - control, control);
    ivec3 next;
    float t_exit = max(leave_box(cell.lower, cell.upper, p.origin, p.direction, next), p.t);
#if SURFACES
    t_exit = max(min(t_exit, p.t_end), p.t);
#endif
    float depth = rate * (t_exit - p.t);
    if (p.next_free < depth) {
#if BRICK_POOL
        if (park(p)) return;  // in the brick it is in, where the collision will be
#endif
        float length = p.next_free / rate;
        p.t += length;
        p.voxel = clamp(ivec3(floor(p.origin + p.direction * p.t)), cell.lower, cell.upper - 1);
        float extinction = exact_cell(p.voxel, p.direction).extinction;
        majorant_violations += uint(extinction > cell.extinction);
        p.next_free = exponential(random_words(p.rng).x);
        p.depth_left += log(max(1.0 - (extinction - control) / rate, 1e-30)) - control * length;
        return;
    }
    p.next_free -= depth;
    p.depth_left -= control * (t_exit - p.t);
    bool over = is_outside(next);
#if SURFACES
    over = over || t_exit >= p.t_end;
#endif
    if (over && p.depth_left < 0.0) {
        start_flight(p);
        return;
    }
    leave_cell(p, t_exit, next);
}
