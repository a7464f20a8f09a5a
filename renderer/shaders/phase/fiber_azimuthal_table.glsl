// Azimuthal lobes N given by tables, symmetric and piecewise linear; lanes R, TT, TRT; angles from the center of TT for
// all three. Rows belong to light at equal steps of 1 - cos(theta_o); N is a mixture of two of them. Needs from the
// program: vec4 fiber_table[], filled by renderer/azimuthal_block.py. Twin: fiber_model/scattering/azimuthal_table.py
#include "math/constants.glsl"
#include "rng/random.glsl"
#include "phase/fiber_block.glsl"

bool fiber_is_tabulated(FiberScattering s) {
    return s.table.z > 0.0;
}

// The lower of the two rows, and the share of the upper.
float fiber_table_share(FiberScattering s, float cos_o, out int lower) {
    float place = max(0.0, 1.0 - cos_o) * (s.table.w - 1.0);
    lower = max(0, min(int(place), int(s.table.w) - 2));
    return place - float(lower);
}

vec3 fiber_table_eval(FiberScattering s, float cos_o, float from_tt) {
    int cells = int(s.table.z), lower;
    float share = fiber_table_share(s, cos_o, lower);
    float place = from_tt * s.table.z / PI;
    int cell = min(int(place), cells - 1);
    float part = place - float(cell);
    int at = int(s.table.y) + 3 * (lower * (cells + 1) + cell);
    vec3 density = mix(fiber_table[at].xyz, fiber_table[at + 3].xyz, part);
    if (s.table.w == 1.0) return density;
    at += 3 * (cells + 1);
    return mix(density, mix(fiber_table[at].xyz, fiber_table[at + 3].xyz, part), share);
}

// A piecewise linear density is a mixture of hat functions around the knots: a row by its share, a knot by Walker's alias
// method (1977), a place under the hat by the inverse of its distribution, and a side. No loop, no search.
float fiber_table_sample(FiberScattering s, float cos_o, vec3 lane, inout uvec4 rng) {
    vec4 u = random4(rng);
    int knots = int(s.table.z) + 1, lower;
    float share = fiber_table_share(s, cos_o, lower);
    int row = lower + (u.x < share ? 1 : 0);
    int drawn = min(int(u.y * float(knots)), knots - 1);
    int at = int(s.table.y) + 3 * (row * knots + drawn);
    float knot = u.z < dot(lane, fiber_table[at + 1].xyz) ? float(drawn) : dot(lane, fiber_table[at + 2].xyz);
    float v = fract(2.0 * u.w);
    float hat = v < 0.5 ? sqrt(2.0 * v) - 1.0 : 1.0 - sqrt(2.0 - 2.0 * v);
    float phi = (knot + hat) * PI / s.table.z;
    return u.w < 0.5 ? phi : -phi;
}
