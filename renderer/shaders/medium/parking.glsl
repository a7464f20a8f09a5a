// A path that needs a brick outside of the device's pool waits for it: parked, with its state as it was.
// Needs from the program: brick_slot(brick).
#include "medium/volume.glsl"
#include "path/state.glsl"

const uint NOT_RESIDENT = 0xffffffffu;

// The first brick of the voxel's cell that is not in the pool, or NO_BRICK.
uint missing_brick(ivec3 voxel) {
    uint word = cell_word(voxel >> 3);
    if (word >= EMPTY_CELL) return NO_BRICK;
    CellBricks held = cell_bricks(word);
    uint missing = NO_BRICK;
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        uint brick = held.first + layer;
        if (layer < held.layers && brick_slot(brick) == NOT_RESIDENT) missing = min(missing, brick);
    }
    return missing;
}

bool park(inout Path p) {
    p.wanted = missing_brick(p.voxel);
    bool waits = p.wanted != NO_BRICK;
    p.mode += waits ? MODE_PARKED : 0u;
    return waits;
}
