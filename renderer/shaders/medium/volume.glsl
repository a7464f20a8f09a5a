// Looking up the two-level grid (renderer/brick_pool.py): the box around a voxel in which extinction is constant.
// Needs from the program: cells[], bricks[], voxel_word(brick, voxel), grid_cells (cells along x, y, z).
#include "math/hemi_octahedral.glsl"
#constant LAYER_COUNT
#constant EXTINCTION_PROJECTED
#constant FIBER_CORRELATION
#constant EXTINCTION_FLAKES
#constant DETAIL
#constant VOXEL_COLORS
#if VOXEL_COLORS
#include "medium/tint.glsl"
#endif

const uint EMPTY_CELL = 0x80000000u;

struct Cell {
    ivec3 lower;       // first voxel of the box
    ivec3 upper;       // one past its last
    float extinction;  // for the given direction [1/voxel]; in a majorant cell, a bound on it
#if FIBER_CORRELATION
    float fibers;      // how many fibers cross the voxel
#endif
};

bool is_outside(ivec3 voxel) {
    return any(lessThan(voxel, ivec3(0))) || any(greaterThanEqual(voxel, grid_cells * 8));
}

uint cell_word(ivec3 cell) {
    return cells[uint((cell.x * grid_cells.y + cell.y) * grid_cells.z + cell.z)];
}

Cell empty_cells(ivec3 cell, uint word) {
    int radius = int(word & 0xffffu);
    Cell box;
    box.lower = (cell - radius) * 8;
    box.upper = (cell + radius + 1) * 8;
    box.extinction = 0.0;
#if FIBER_CORRELATION
    box.fibers = 0.0;
#endif
    return box;
}

// The bricks of an occupied cell: how many, the first, and their level: voxels 2^level times as large as the lattice's.
struct CellBricks {
    uint first;
    uint layers;
    int level;
};

CellBricks cell_bricks(uint word) {
#if DETAIL
    return CellBricks(word & 0x01ffffffu, (word >> 28) + 1u, int(word >> 25) & 7);
#else
    return CellBricks(word & 0x0fffffffu, (word >> 28) + 1u, 0);
#endif
}

// First voxel of the brick around a voxel.
ivec3 brick_corner(ivec3 voxel, int level) {
    return (voxel >> (level + 3)) * (8 << level);
}

// A voxel of its level, or the empty ones `radius` around it within their brick.
void voxel_box(ivec3 voxel, int radius, int level, out ivec3 lower, out ivec3 upper) {
    ivec3 corner = brick_corner(voxel, level);
    ivec3 place = voxel >> level;
    lower = max((place - radius) * (1 << level), corner);
    upper = min((place + radius + 1) * (1 << level), corner + (8 << level));
}

uint voxel_index(ivec3 voxel, int level) {
    ivec3 local = (voxel >> level) & 7;
    return uint((local.x * 8 + local.y) * 8 + local.z);
}

// Extinction of one stored voxel [1/voxel]: (2 phi / (pi a)) sin(angle to the fiber), the same with the projected area of
// SGGX flakes, or phi times a scale.
float voxel_extinction(uint word, float extinction_per_level, vec3 direction) {
    float extinction = float(word >> 20) * extinction_per_level;
#if EXTINCTION_PROJECTED
    vec3 axis = unscaled_axis(word);
    float cosine = dot(axis, direction);
#if EXTINCTION_FLAKES
    cosine *= sqrt(1.0 - flake_roughness * flake_roughness);
#endif
    extinction *= sqrt(max(1.0 - cosine * cosine / dot(axis, axis), 0.0));
#endif
    return extinction;
}

#if FIBER_CORRELATION
// Fibers of a voxel: their length over that of the longest chord along their axis, phi h^2 max|t| / (pi a^2), so that
// one fiber alone, which may cross a voxel's middle, never counts as more than one.
float voxel_fibers(uint word, float extinction_per_level) {
    vec3 axis = abs(normalize(unscaled_axis(word)));
    return float(word >> 20) * extinction_per_level * max(axis.x, max(axis.y, axis.z)) / (2.0 * fiber_radius);
}
#endif

// Exact: a voxel with fiber, or the box without any around it.
Cell exact_cell(ivec3 voxel, vec3 direction) {
    ivec3 cell = voxel >> 3;
    uint word = cell_word(cell);
    if (word >= EMPTY_CELL) return empty_cells(cell, word);
    CellBricks held = cell_bricks(word);
    uint index = voxel_index(voxel, held.level);
    float extinction = 0.0;
    float fibers = 0.0;
    int radius = 7;
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        if (layer < held.layers) {
            uint stored = voxel_word(held.first + layer, index);
            bool occupied = (stored >> 20) != 0u;
            radius = min(radius, occupied ? 0 : int(stored & 7u));
            extinction += occupied
                ? voxel_extinction(stored, uintBitsToFloat(bricks[held.first + layer].x), direction) : 0.0;
#if FIBER_CORRELATION
            float across = float(1 << (2 * held.level));  // voxels of the lattice in its cross-section
            if (occupied) fibers += across * voxel_fibers(stored, uintBitsToFloat(bricks[held.first + layer].x));
#endif
        }
    }
    Cell box;
    voxel_box(voxel, radius, held.level, box.lower, box.upper);
    box.extinction = extinction;
#if FIBER_CORRELATION
    box.fibers = fibers;
#endif
    return box;
}

// Bound of the whole brick, or the box of empty cells.
Cell majorant_cell(ivec3 voxel) {
    ivec3 cell = voxel >> 3;
    uint word = cell_word(cell);
    if (word >= EMPTY_CELL) return empty_cells(cell, word);
    CellBricks held = cell_bricks(word);
    float majorant = 0.0;
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        if (layer < held.layers) {
            uvec2 brick = bricks[held.first + layer];
            majorant += uintBitsToFloat(brick.x) * float((brick.y >> 16) & 0xfffu);
        }
    }
    // rounded up: the sum above and the one over a voxel may round differently
    Cell box;
    box.lower = brick_corner(voxel, held.level);
    box.upper = box.lower + (8 << held.level);
    box.extinction = majorant * (1.0 + 1e-6);
#if FIBER_CORRELATION
    box.fibers = 0.0;
#endif
    return box;
}

// The medium met at a collision, chosen in proportion to extinction by u in [0, 1); `axis` is its fiber direction,
// `tint` its dye.
uint choose_medium(ivec3 voxel, vec3 direction, float u, out vec3 axis, out vec3 tint) {
    uint word = cell_word(voxel >> 3);
    CellBricks held = cell_bricks(word);
    uint index = voxel_index(voxel, held.level);
    uint stored[LAYER_COUNT];
    float extinction[LAYER_COUNT];
    float sum = 0.0;
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        bool used = layer < held.layers;
        stored[layer] = used ? voxel_word(held.first + layer, index) : 0u;
        extinction[layer] = used && (stored[layer] >> 20) != 0u
            ? voxel_extinction(stored[layer], uintBitsToFloat(bricks[held.first + layer].x), direction) : 0.0;
        sum += extinction[layer];
    }
    float target = u * sum;
    uint medium = 0u;
    uint chosen = 0u;
    tint = vec3(1.0);
#if VOXEL_COLORS
    uint brick = held.first;
#endif
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        if (extinction[layer] > 0.0 && target >= 0.0) {
            chosen = stored[layer];
            medium = bricks[held.first + layer].y & 0xffffu;
#if VOXEL_COLORS
            brick = held.first + layer;
#endif
        }
        target -= extinction[layer];
    }
#if VOXEL_COLORS
    tint = tint_of_word(voxel_word(brick, 512u + index));
#endif
    axis = normalize(unscaled_axis(chosen));
    return medium;
}
