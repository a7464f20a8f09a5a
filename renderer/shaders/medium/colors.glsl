// Free flights where extinction depends on color. A flight goes by the optical depth of one channel, chosen in proportion to
// the throughput; the balance heuristic over the three channels weighs what it brings (single-sample form, Veach and
// Guibas 1995). With throughput b, depths d and extinction s of what was met, a collision brings
//     b_j exp(-d_j) s_j sum(b) / sum_i b_i exp(-d_i) s_i,
// and an end without collision the same without s. So the sum over the channels never changes: no weight can grow.
#include "path/state.glsl"

void choose_color(inout Path p, uint bits) {
    float target = unit_float(bits) * (p.throughput.x + p.throughput.y + p.throughput.z);
    p.color = target < p.throughput.x ? 0u : target < p.throughput.x + p.throughput.y ? 1u : 2u;
    p.depths = vec3(0.0);
}

// exp(-depths) over that of the clearest channel, which never overflows and is 1 for one of them.
vec3 color_transmittance(vec3 depths) {
    return exp(min(depths.x, min(depths.y, depths.z)) - depths);
}

// Throughput after a flight that met extinction `met`, or none: vec3(1).
void settle_colors(inout Path p, vec3 met) {
    vec3 passed = p.throughput * color_transmittance(p.depths) * met;
    float whole = p.throughput.x + p.throughput.y + p.throughput.z;
    p.throughput = passed * (whole / max(passed.x + passed.y + passed.z, 1e-30));
}
