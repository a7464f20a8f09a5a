// Extinction where media take part that are no fibers: homogeneous ones within boxes and balls, grids that dim all
// directions alike, and any of them by color. Needs from the program: what medium/volume.glsl needs.
#include "medium/volume.glsl"
#include "path/state.glsl"
#constant GRID_MEDIA         // media on the grid, the volume's own first
#constant HOMOGENEOUS_MEDIA  // behind them
uniform vec4 grid_tints[GRID_MEDIA];  // share of the extinction by color; w: 1 where it is the same toward all directions
#if HOMOGENEOUS_MEDIA
uniform vec4 bound_lower[HOMOGENEOUS_MEDIA];  // corner of a box, or middle of a ball [voxels]; w: 1 for a ball
uniform vec4 bound_upper[HOMOGENEOUS_MEDIA];  // the other corner; or its radius
uniform vec4 bound_extinction[HOMOGENEOUS_MEDIA];  // [1/voxel]
#endif

#if EXTINCTION_RGB
#define Extinction vec3
float of_color(vec3 value, uint color) { return color == 0u ? value.x : color == 1u ? value.y : value.z; }
float clearest(vec3 value) { return min(value.x, min(value.y, value.z)); }
#else
#define Extinction float
float of_color(float value, uint color) { return value; }
float clearest(float value) { return value; }
#endif

Extinction grid_extinction(uint word, uvec2 brick, vec3 direction) {
    vec4 tint = grid_tints[brick.y & 0xffffu];
    float per_level = uintBitsToFloat(brick.x);
    float gray = tint.w > 0.0 ? float(word >> 20) * per_level : voxel_extinction(word, per_level, direction);
#if EXTINCTION_RGB
    return gray * tint.rgb;
#else
    return gray;
#endif
}

#if HOMOGENEOUS_MEDIA
// Where a ray is inside of a bound: from x to y; nowhere where x > y.
vec2 bound_span(int i, vec3 origin, vec3 direction) {
    vec3 to_lower = bound_lower[i].xyz - origin;
    vec3 a = to_lower / direction;
    vec3 b = (bound_upper[i].xyz - origin) / direction;
    vec3 near = min(a, b);
    vec3 far = max(a, b);
    vec2 box = vec2(max(near.x, max(near.y, near.z)), min(far.x, min(far.y, far.z)));
    // the ball by the distance of its middle from the ray, which keeps its digits far away (Hearn and Baker)
    float along = dot(to_lower, direction);
    vec3 aside = to_lower - along * direction;
    float radius = bound_upper[i].x;
    float half_chord2 = radius * radius - dot(aside, aside);
    float half_chord = sqrt(max(half_chord2, 0.0));
    vec2 ball = half_chord2 > 0.0 ? vec2(along - half_chord, along + half_chord) : vec2(1.0, 0.0);
    return bound_lower[i].w > 0.0 ? ball : box;
}

Extinction homogeneous_extinction(int i) {
#if EXTINCTION_RGB
    return bound_extinction[i].rgb;
#else
    return bound_extinction[i].x;
#endif
}

// Adds what is homogeneous around `t`, and shortens the step to the next bound.
void add_homogeneous(vec3 origin, vec3 direction, float t, inout float t_exit, inout Extinction extinction) {
    for (int i = 0; i < HOMOGENEOUS_MEDIA; ++i) {
        vec2 span = bound_span(i, origin, direction);
        bool met = span.x < span.y;
        if (met && t < span.x) t_exit = min(t_exit, span.x);
        if (met && t >= span.x && t < span.y) {
            t_exit = min(t_exit, span.y);
            extinction += homogeneous_extinction(i);
        }
    }
}
#endif

struct MediaCell {
    ivec3 lower;
    ivec3 upper;
    Extinction extinction;  // of what lies on the grid
};

// As exact_cell of medium/volume.glsl.
MediaCell media_cell(ivec3 voxel, vec3 direction) {
    ivec3 cell = voxel >> 3;
    uint word = cell_word(cell);
    if (word >= EMPTY_CELL) {
        Cell empty = empty_cells(cell, word);
        return MediaCell(empty.lower, empty.upper, Extinction(0.0));
    }
    CellBricks held = cell_bricks(word);
    uint index = voxel_index(voxel, held.level);
    Extinction extinction = Extinction(0.0);
    int radius = 7;
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        if (layer < held.layers) {
            uint stored = voxel_word(held.first + layer, index);
            bool occupied = (stored >> 20) != 0u;
            radius = min(radius, occupied ? 0 : int(stored & 7u));
            if (occupied) extinction += grid_extinction(stored, bricks[held.first + layer], direction);
        }
    }
    ivec3 lower;
    ivec3 upper;
    voxel_box(voxel, radius, held.level, lower, upper);
    return MediaCell(lower, upper, extinction);
}
