// Reciprocal longitudinal lobes, M = q(theta_o) q(theta_i) a(theta_i) g(theta_o + theta_i) cos(theta_i), tables from
// renderer/symmetric_table.py. Lanes: R at normal incidence, TT, TRT, R toward grazing. Needs from the program:
// vec4 fiber_table[]. Twin: fiber_model/scattering/symmetric.py
#include "math/constants.glsl"
#include "math/arctangent.glsl"
#include "phase/fiber_block.glsl"

vec4 fiber_symmetric_widths(FiberScattering s) {
    return s.width.xyzx;
}

// a(theta) per lane.
vec4 fiber_symmetric_marginal(float cos_theta) {
    float grazing = max(0.0, 1.0 - cos_theta);
    float grazing2 = grazing * grazing;
    float rise = grazing2 * grazing2 * grazing;
    return vec4(1.0, 1.0 - rise, 1.0 - rise, rise);
}

// Where theta lies in the tables: 0 at the pole, 1 across the fiber.
float fiber_symmetric_place(float sin_theta, float cos_theta) {
    return sqrt(min(1.0, arctangent(cos_theta, abs(sin_theta)) / HALF_PI));
}

// ln q per lane, cubic Hermite.
vec4 fiber_symmetric_log_q(FiberScattering s, float place) {
    float at = place * float(FIBER_TABLE_CELLS);
    int cell = min(int(at), FIBER_TABLE_CELLS - 1);
    float f = at - float(cell);
    int row = int(s.table.x) + 2 * cell;
    vec4 left = fiber_table[row];
    vec4 rise = fiber_table[row + 2] - left;
    vec4 bend_left = fiber_table[row + 1] - rise;
    vec4 bend_right = rise - fiber_table[row + 3];
    return left + f * (rise + (1.0 - f) * ((1.0 - f) * bend_left + f * bend_right));
}

// ln of what M has of wo alone.
vec4 fiber_symmetric_scale(FiberScattering s, float sin_o, float cos_o) {
    return fiber_symmetric_log_q(s, fiber_symmetric_place(sin_o, cos_o)) + log(s.peak);
}

vec4 fiber_symmetric_eval(FiberScattering s, vec4 scale, float sin_o, float cos_o, float sin_i, float cos_i) {
    float sin_sum = sin_i * cos_o + cos_i * sin_o;
    float cos_sum = cos_i * cos_o - sin_i * sin_o;
    vec4 deviations = arctangent(sin_sum, cos_sum) / fiber_symmetric_widths(s);
    vec4 log_q = fiber_symmetric_log_q(s, fiber_symmetric_place(sin_i, cos_i));
    return exp(scale + log_q - 0.5 * deviations * deviations) * fiber_symmetric_marginal(cos_i) * cos_i;
}

// Rejection sampling. With x = theta on the side of -theta_o, the target is w(x) g(x - |theta_o|), w = q a cos^2.
// ln w(x) + bend x^2/2 <= bound + tilt x, so a Gaussian of precision 1/beta^2 + bend lies above it. The grazing lane
// has w(0) = 0 and a second, far mode, exp(-far_rate x) as likely: only x > 0 is proposed, with the sum of both in
// place of w, and the sign is chosen with the acceptance. bound is the maximum of functions convex in (tilt, theta_o),
// hence convex: interpolated linearly in theta_o, both stay valid between the nodes.
struct SymmetricProposal {
    vec4 lane;          // one for the lobe to sample
    float side;         // sign of -theta_o
    float mean;
    float deviation;
    float bend;
    float tilt;
    float bound;
    float far_rate;     // the far side is less likely by exp(-far_rate x)
};

SymmetricProposal fiber_symmetric_proposal(FiberScattering s, float sin_o, float cos_o, vec4 lane) {
    float at = fiber_symmetric_place(sin_o, cos_o) * float(FIBER_ENVELOPE_CELLS);
    int cell = min(int(at), FIBER_ENVELOPE_CELLS - 1);
    int row = int(s.table.x) + FIBER_ENVELOPE_ROW + 2 * cell;
    float f = (at * at - float(cell * cell)) / float(2 * cell + 1);  // theta_o is linear in place^2
    float beta = dot(lane, fiber_symmetric_widths(s));
    float from_normal = arctangent(abs(sin_o), cos_o);
    float concentration = 1.0 / (beta * beta);
    SymmetricProposal p;
    p.bend = dot(lane, FIBER_TABLE_BEND);
    float variance = 1.0 / (concentration + p.bend);
    p.lane = lane;
    p.side = sin_o > 0.0 ? -1.0 : 1.0;
    p.tilt = dot(lane, mix(fiber_table[row], fiber_table[row + 2], f));
    p.bound = dot(lane, mix(fiber_table[row + 1], fiber_table[row + 3], f));
    p.mean = variance * (from_normal * concentration + p.tilt);
    p.deviation = sqrt(variance);
    p.far_rate = 2.0 * from_normal * concentration;
    return p;
}

// One try with a standard normal and a uniform number; theta is set only if it is accepted.
bool fiber_symmetric_try(FiberScattering s, SymmetricProposal p, float normal, float u, inout float theta) {
    float x = p.mean + p.deviation * normal;
    bool grazing = p.lane.w != 0.0;
    if (abs(x) >= HALF_PI || (grazing && x <= 0.0)) return false;
    float cos_x = cos(x);
    float log_q = dot(p.lane, fiber_symmetric_log_q(s, sqrt(1.0 - abs(x) / HALF_PI)));
    float chance = dot(p.lane, fiber_symmetric_marginal(cos_x)) * cos_x * cos_x
        * exp(log_q + x * (0.5 * p.bend * x - p.tilt) - p.bound);
    bool near = u < chance;
    bool far = !near && grazing && u < chance * (1.0 + exp(-p.far_rate * x));
    theta = near ? p.side * x : (far ? -p.side * x : theta);
    return near || far;
}
