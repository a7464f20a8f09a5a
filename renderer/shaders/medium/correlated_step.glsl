// Free flights among fibers rather than among independent points (renderer/VOLUME_AGAINST_FIBERS.md).
// - N fibers that cover optical depth x let (1 - x/N)^N pass: at least one fiber stands in every run of voxels, and
//   one fiber hides x = 2a/h of its voxel's width, not 1 - exp(-x). Binomial; exponential for many fibers.
// - A path that leaves a fiber has N - 1 of them before it in the first run of voxels that reaches into that fiber, and
//   meets none whose front lies behind it (medium/fiber_front.glsl).
// - A path that goes back near to where the camera is goes through a gap: what would have stopped it on the way there
//   is known to be absent (the hot spot of plant canopies: Kuusk 1985; Jupp and Strahler 1991). Later gaps end at the
//   fiber that the path left before, which stops it about as often as the gap lets it pass.
#include "path/state.glsl"
#include "medium/volume.glsl"
#include "medium/fiber_front.glsl"

struct CorrelatedStep {
    float depth;   // what the step takes from the free optical depth
    float fibers;  // N, at least one
    float others;  // the exponent: N less the own fiber and less those known to be absent
    float held;    // depth of the run before this step
};

// Share of the fibers between distances t0 and t1 that would have stopped the path on its way here, for fibers
// parallel to the one it leaves. The share at distance s across the fibers falls from cos^2(turn/2) to zero at 2S;
// S = a c^2 / (2 (c + 1.5)), c = cot(turn/2), fits the overlap of two strips of width 2a to 3 % up to a turn of 60
// degrees, where it matters.
float known_gap(Path p, float t0, float t1) {
    vec3 forth = p.direction - dot(p.left_axis, p.direction) * p.left_axis;
    vec3 back = p.left_wo - dot(p.left_axis, p.left_wo) * p.left_axis;
    float forth_length = max(length(forth), 1e-6);
    float back_length = max(length(back), 1e-6);
    float cosine = dot(forth, back) / (forth_length * back_length);
    float cotangent = sqrt(max(1.0 + cosine, 0.0) / max(1.0 - cosine, 1e-6));
    float end = max(fiber_radius * cotangent * cotangent / (cotangent + 1.5), 1e-6);
    float known = min(end, p.left_gap * back_length);
    vec2 s = vec2(t0, t1) * forth_length;
    vec2 within = min(s, known);
    vec2 integral = within - 0.5 * within * within / end;
    return (0.5 + 0.5 * cosine) * clamp((integral.y - integral.x) / max(s.y - s.x, 1e-6), 0.0, 1.0);
}

float binomial_depth(float depth, float fibers, float others) {
    return -others * log(max(1.0 - depth / fibers, 1e-6));
}

CorrelatedStep correlated_step(inout Path p, Cell cell, float t_exit) {
    if (cell.extinction == 0.0) {
        p.run = FiberRun(0.0, 0.0, min(p.run.own, 0.0));
        return CorrelatedStep(0.0, 1.0, 1.0, 0.0);
    }
    bool leaves = p.left_axis != vec3(0.0);
    if (leaves && p.run.own != OWN_PASSED) {
        vec3 center = 0.5 * vec3(cell.lower + cell.upper);
        float half_width = 0.5 * float(cell.upper.x - cell.lower.x);
        if (length(to_own_axis(p, center)) < fiber_radius + half_width) p.run.own = 1.0;
    }
    p.run.fibers += cell.fibers;
    CorrelatedStep s;
    s.fibers = max(p.run.fibers, 1.0);
    s.others = s.fibers - max(p.run.own, 0.0);
    if (leaves) s.others *= (1.0 - known_gap(p, p.t, t_exit)) * (1.0 - share_behind(p, p.t, t_exit));
    s.held = p.run.depth;
    p.run.depth += cell.extinction * (t_exit - p.t);
    s.depth = max(
        binomial_depth(p.run.depth, s.fibers, s.others) - binomial_depth(s.held, s.fibers, s.others), 0.0);
    if (p.run.fibers >= 1.0) p.run = FiberRun(0.0, 0.0, p.run.own != 0.0 ? OWN_PASSED : 0.0);
    return s;
}

// Optical depth into the step, as if fibers were independent, at which `left` of the free depth is used up.
float correlated_place(CorrelatedStep s, float left) {
    float whole = left + binomial_depth(s.held, s.fibers, s.others);
    return max(s.fibers * (1.0 - exp(-whole / s.others)) - s.held, 0.0);
}
