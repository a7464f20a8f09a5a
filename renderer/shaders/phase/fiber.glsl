// Three-lobe fiber phase function R, TT, TRT (thesis section 6.2, after Khungurn et al. 2015), per steradian.
// Local frame: x is the fiber; wo and wi point away from the point. Every lobe is sampled exactly, so a gray fiber's
// weight is its albedo for every sample. Twin: fiber_model/scattering/phase.py
#include "math/constants.glsl"
#include "rng/random.glsl"
#include "phase/fiber_block.glsl"
#include "phase/fiber_longitudinal.glsl"
#include "phase/fiber_azimuthal.glsl"
#include "phase/fiber_grazing.glsl"
#constant FIBER_SYMMETRIC  // how many media are of the kind symmetric: 0 none, 1 some, 2 all
#if FIBER_SYMMETRIC > 0
#include "phase/fiber_symmetric.glsl"
#endif
#constant FIBER_TABULATED  // 1 where a medium has tables of N
#if FIBER_TABULATED > 0
#include "phase/fiber_azimuthal_table.glsl"
#endif
#constant FIBER_TAILS  // 1 where a lobe of a medium has a tail
#if FIBER_TAILS > 0
#include "phase/fiber_tail.glsl"
#endif

// What depends on wo only. Compute it once per vertex and share it between light sampling and scattering. All functions
// that take it want the medium as fiber_at_inclination gives it for that wo.
struct FiberLobes {
    float sin_o;
    float cos_o;
    vec2 azimuth_o;      // unit vector (y, z); the y axis where wo runs along the fiber
    vec3 energy_r;       // a_R, a_TT, a_TRT, linear RGB
    vec3 energy_tt;
    vec3 energy_trt;
    vec3 energy_grazing; // what Schlick's term adds to R: apart for the longitudinal kind symmetric, else zero
    vec4 chance;         // of choosing a lobe, by its largest channel; sums to one, a black fiber takes R
    vec4 along_scale;    // normalization of M per lobe; its logarithm for symmetric
#if FIBER_TAILS > 0
    vec3 tail_weight;
    vec3 tail_spread;
#endif
};

bool fiber_is_symmetric(FiberScattering s) {
    return FIBER_SYMMETRIC == 2 || (FIBER_SYMMETRIC == 1 && s.width.w == 2.0);
}

vec2 fiber_azimuth(vec3 w, float cos_theta) {
    return cos_theta > 0.0 ? w.yz / cos_theta : vec2(1.0, 0.0);
}

bool fiber_is_vmf(FiberScattering s) {
    return FIBER_SYMMETRIC != 2 && s.width.w == 1.0;
}

float largest(vec3 color) {
    return max(color.r, max(color.g, color.b));
}

FiberLobes fiber_lobes(FiberScattering s, vec3 wo) {
    FiberLobes lobes;
    lobes.sin_o = wo.x;
    lobes.cos_o = length(wo.yz);
    lobes.azimuth_o = fiber_azimuth(wo, lobes.cos_o);
    float grazing = max(0.0, 1.0 - lobes.cos_o);
    float grazing2 = grazing * grazing;
    vec3 entering = (1.0 - s.fresnel_r.rgb) * (1.0 - grazing2 * grazing2 * grazing);
    lobes.energy_r = s.energy_r.rgb * (1.0 - entering);
    lobes.energy_tt = s.energy_tt.rgb * entering;
    lobes.energy_trt = s.energy_trt.rgb * entering;
    lobes.energy_grazing = vec3(0.0);
#if FIBER_TAILS > 0
    vec3 tail_width = s.tail_ratio.xyz * s.width.xyz;
    lobes.tail_weight = s.tail_weight.xyz + grazing * s.grow_tail.xyz;
    lobes.tail_spread = tail_width * tail_width;
#endif
#if FIBER_SYMMETRIC > 0
    if (fiber_is_symmetric(s)) {
        lobes.energy_r = s.energy_r.rgb * s.fresnel_r.rgb;
        lobes.energy_grazing = s.energy_r.rgb * (1.0 - s.fresnel_r.rgb) * (grazing2 * grazing2 * grazing);
    }
#endif
    vec3 strength = vec3(largest(lobes.energy_r), largest(lobes.energy_tt), largest(lobes.energy_trt));
    float strength_grazing = largest(lobes.energy_grazing);
    float total = strength.x + strength.y + strength.z + strength_grazing;
    lobes.chance = total > 0.0 ? vec4(strength / total, 0.0) : vec4(1.0, 0.0, 0.0, 0.0);
#if FIBER_SYMMETRIC > 0
    if (fiber_is_symmetric(s)) {
        lobes.chance.w = total > 0.0 ? strength_grazing / total : 0.0;
        lobes.along_scale = fiber_symmetric_scale(s, lobes.sin_o, lobes.cos_o);
        return lobes;
    }
#endif
    lobes.along_scale = vec4(fiber_longitudinal_scale(s, lobes.sin_o, lobes.cos_o), 0.0);
    return lobes;
}

// M_k N_k [1/sr]; each integrates to one over the sphere.
vec4 fiber_lobe_densities(FiberScattering s, FiberLobes lobes, vec3 wi) {
    float cos_i = length(wi.yz);
    vec2 azimuth_i = fiber_azimuth(wi, cos_i);
    float cos_phi = dot(lobes.azimuth_o, azimuth_i);
    float sin_phi = lobes.azimuth_o.x * azimuth_i.y - lobes.azimuth_o.y * azimuth_i.x;
    float from_tt = arctangent(abs(sin_phi), -cos_phi);
    float around_tt = fiber_azimuthal_eval(s.around_tt, from_tt);
    float around_trt = s.around_trt.x == 0.0 ? INV_TWO_PI : fiber_azimuthal_eval(s.around_trt, PI - from_tt);
    vec3 around = vec3(INV_TWO_PI, around_tt, around_trt);
#if FIBER_TABULATED > 0
    if (fiber_is_tabulated(s)) {
        bvec3 given = bvec3(true, s.around_tt.x == 4.0, s.around_trt.x == 4.0);
        around = mix(around, fiber_table_eval(s, lobes.cos_o, from_tt), given);
    }
#endif
#if FIBER_SYMMETRIC > 0
    if (fiber_is_symmetric(s)) {
        return fiber_symmetric_eval(s, lobes.along_scale, lobes.sin_o, lobes.cos_o, wi.x, cos_i) * around.xyzx;
    }
#endif
    vec3 scale = lobes.along_scale.xyz;
    vec3 along = fiber_longitudinal_eval(s, scale, lobes.sin_o, lobes.cos_o, wi.x, cos_i);
#if FIBER_TAILS > 0
    along = mix(along, fiber_tail_eval(lobes.tail_spread, lobes.sin_o, lobes.cos_o, wi.x, cos_i), lobes.tail_weight);
#endif
    return vec4(along * around, 0.0);
}

vec3 fiber_lobes_value(FiberLobes lobes, vec4 densities) {
    vec3 value = lobes.energy_r * densities.x + lobes.energy_tt * densities.y + lobes.energy_trt * densities.z;
#if FIBER_SYMMETRIC > 0
    value += lobes.energy_grazing * densities.w;
#endif
    return value;
}

// The one loop of the sampler: (sin theta_i, cos theta_i) of the Gaussian or symmetric lobe, and phi where it is von
// Mises. All are tried twice per turn, with acceptance of at least 0.65, or 0.49 for symmetric, so FIBER_TURNS leave a
// chance below 1e-9 that a lobe stays pending; it then takes about the lobe's mode.
const int FIBER_TURNS = 16;

vec2 fiber_rejection(
    bool theta_pending, FiberScattering s, FiberLobes lobes, float beta, vec4 lane, vec4 around, inout uvec4 rng,
    inout float phi
) {
    FiberProposal proposal = fiber_longitudinal_proposal(lobes.sin_o, lobes.cos_o, beta);
    float theta = proposal.tangent;
#if FIBER_SYMMETRIC > 0
    SymmetricProposal symmetric = fiber_symmetric_proposal(s, lobes.sin_o, lobes.cos_o, lane);
    if (fiber_is_symmetric(s)) theta = symmetric.side * clamp(symmetric.mean, 0.0, HALF_PI);
#endif
    bool phi_pending = around.x == 3.0;
    phi = phi_pending ? 0.0 : phi;
    for (int i = 0; i < FIBER_TURNS; ++i) {
        if (!theta_pending && !phi_pending) break;
        if (theta_pending) {
            vec4 u = random4(rng);
            vec2 normals = standard_normals(u.xy);
#if FIBER_SYMMETRIC > 0
            if (fiber_is_symmetric(s)) {
                theta_pending = !fiber_symmetric_try(s, symmetric, normals.x, u.z, theta);
                if (theta_pending) theta_pending = !fiber_symmetric_try(s, symmetric, normals.y, u.w, theta);
            } else
#endif
            {
                theta_pending = !fiber_longitudinal_try(proposal, normals.x, u.z, theta);
                if (theta_pending) theta_pending = !fiber_longitudinal_try(proposal, normals.y, u.w, theta);
            }
        }
        if (phi_pending) {
            vec4 u = random4(rng);
            phi_pending = !fiber_von_mises_try(around, u.xy, phi);
            if (phi_pending) phi_pending = !fiber_von_mises_try(around, u.zw, phi);
        }
    }
    return vec2(sin(theta), cos(theta));
}

vec3 fiber_albedo(FiberScattering s, vec3 wo) {
    s = fiber_at_inclination(s, wo);
    return fiber_lobes_value(fiber_lobes(s, wo), vec4(1.0));
}

vec3 fiber_eval(FiberScattering s, vec3 wo, vec3 wi) {
    s = fiber_at_inclination(s, wo);
    FiberLobes lobes = fiber_lobes(s, wo);
    return fiber_lobes_value(lobes, fiber_lobe_densities(s, lobes, wi));
}

float fiber_pdf(FiberScattering s, vec3 wo, vec3 wi) {
    s = fiber_at_inclination(s, wo);
    FiberLobes lobes = fiber_lobes(s, wo);
    return dot(lobes.chance, fiber_lobe_densities(s, lobes, wi));
}

// A direction with density pdf, and weight = eval / pdf per channel (at most the sum of the lobes' largest channels).
vec3 fiber_lobes_sample(FiberScattering s, FiberLobes lobes, inout uvec4 rng, out vec3 weight, out float pdf) {
    vec4 u = random4(rng);
    bool is_r = u.x < lobes.chance.x;
    bool is_tt = !is_r && u.x < lobes.chance.x + lobes.chance.y;
    bool is_grazing = fiber_is_symmetric(s) && u.x >= lobes.chance.x + lobes.chance.y + lobes.chance.z;
    bool uniform_around = is_r || is_grazing;
    float beta = uniform_around ? s.width.x : (is_tt ? s.width.y : s.width.z);
    vec4 around = uniform_around ? vec4(0.0) : (is_tt ? s.around_tt : s.around_trt);
    vec4 lane = vec4(is_r, is_tt, !uniform_around && !is_tt, is_grazing);
    float phi = fiber_azimuthal_sample(around, u.yz);
#if FIBER_TAILS > 0
    bool in_tail = u.w < dot(lobes.tail_weight, lane.xyz);
#else
    const bool in_tail = false;
#endif
    vec2 along = fiber_rejection(!fiber_is_vmf(s) && !in_tail, s, lobes, beta, lane, around, rng, phi);
    if (fiber_is_vmf(s) && !in_tail) along = fiber_vmf_sample(lobes.sin_o, lobes.cos_o, beta, random4(rng).xy);
#if FIBER_TAILS > 0
    if (in_tail) {
        float spread = dot(lobes.tail_spread, lane.xyz);
        along = fiber_tail_sample(lobes.sin_o, lobes.cos_o, spread, random4(rng).xy);
    }
#endif

    phi += is_tt ? PI : 0.0;
#if FIBER_TABULATED > 0
    if (fiber_is_tabulated(s) && (uniform_around || around.x == 4.0)) {
        phi = PI + fiber_table_sample(s, lobes.cos_o, vec3(uniform_around, lane.yz), rng);
    }
#endif
    vec2 turn = vec2(cos(phi), sin(phi));
    vec2 azimuth_i = vec2(
        lobes.azimuth_o.x * turn.x - lobes.azimuth_o.y * turn.y, lobes.azimuth_o.x * turn.y + lobes.azimuth_o.y * turn.x);
    vec3 wi = normalize(vec3(along.x, along.y * azimuth_i));
    vec4 densities = fiber_lobe_densities(s, lobes, wi);
    pdf = dot(lobes.chance, densities);
    weight = pdf > 0.0 ? fiber_lobes_value(lobes, densities) / pdf : vec3(0.0);
    return wi;
}

vec3 fiber_sample(FiberScattering s, vec3 wo, inout uvec4 rng, out vec3 weight, out float pdf) {
    s = fiber_at_inclination(s, wo);
    return fiber_lobes_sample(s, fiber_lobes(s, wo), rng, weight, pdf);
}
