// Which medium a collision is with, where media take part that are no fibers: in proportion to what each brings.
#include "medium/media.glsl"
#if EXTINCTION_RGB
#include "medium/colors.glsl"
#endif

struct Collision {
    uint medium;
    vec3 axis;  // of the fiber; zero where there is none
    vec3 tint;  // its dye
    Extinction extinction;
    float target;
};

void consider(inout Collision chosen, Path p, uint medium, vec3 axis, vec3 tint, Extinction extinction) {
#if EXTINCTION_RGB
    float share = dot(p.throughput * color_transmittance(p.depths), extinction);
#else
    float share = extinction;
#endif
    if (share > 0.0 && chosen.target >= 0.0) chosen = Collision(medium, axis, tint, extinction, chosen.target);
    chosen.target -= share;
}

// `chosen.target` becomes -(sum of all shares) where it was 0; then u times that sum leads to one of them.
void consider_all(inout Collision chosen, Path p) {
    uint word = cell_word(p.voxel >> 3);
    CellBricks held = cell_bricks(word);
    uint layers = word >= EMPTY_CELL ? 0u : held.layers;
    uint index = voxel_index(p.voxel, held.level);
    for (uint layer = 0u; layer < uint(LAYER_COUNT); ++layer) {
        if (layer < layers) {
            uvec2 brick = bricks[held.first + layer];
            uint stored = voxel_word(held.first + layer, index);
            uint medium = brick.y & 0xffffu;
            bool fiber = grid_tints[medium].w == 0.0 && (stored >> 20) != 0u;
            vec3 axis = fiber ? normalize(unscaled_axis(stored)) : vec3(0.0);
            Extinction extinction = grid_extinction(stored, brick, p.direction);
            if ((stored >> 20) == 0u) extinction = Extinction(0.0);
            #if VOXEL_COLORS
            vec3 tint = tint_of_word(voxel_word(held.first + layer, 512u + index));
#else
            vec3 tint = vec3(1.0);
#endif
            consider(chosen, p, medium, axis, tint, extinction);
        }
    }
#if HOMOGENEOUS_MEDIA
    for (int i = 0; i < HOMOGENEOUS_MEDIA; ++i) {
        vec2 span = bound_span(i, p.origin, p.direction);
        bool inside = p.t >= span.x && p.t <= span.y && span.x < span.y;
        Extinction extinction = inside ? homogeneous_extinction(i) : Extinction(0.0);
        consider(chosen, p, uint(GRID_MEDIA + i), vec3(0.0), vec3(1.0), extinction);
    }
#endif
}

Collision collide(inout Path p, float u) {
    Collision chosen = Collision(0u, vec3(0.0), vec3(1.0), Extinction(0.0), 0.0);
    consider_all(chosen, p);
    chosen.target *= -u;
    consider_all(chosen, p);
#if EXTINCTION_RGB
    settle_colors(p, chosen.extinction);
#endif
    return chosen;
}
