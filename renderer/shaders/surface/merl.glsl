// A measured isotropic BRDF of MERL's database (Matusik et al. 2003), cell by cell in half and difference angles
// (Rusinkiewicz 1998). Directions in the surface's frame, z along the normal; both point away from the surface.
// Half vectors are sampled from tables of theta_h per angle of view, mixed with the cosine law.
// Needs from the program: lights[] (rows of renderer/measured_surface.py). Twin: MerlTable.evaluate (files/measured/)
#include "math/constants.glsl"
#include "math/arctangent.glsl"
#constant MERL_VIEWS

const uint MERL_CELLS = 1458000u;  // 90 x 90 x 180

uint merl_half_cell(float theta) {
    return min(uint(90.0 * sqrt(theta * (2.0 / PI))), 89u);
}

// Without the cosine [1/sr]. `table`: first row.
vec3 merl_eval(uint table, vec3 wo, vec3 wi) {
    if (wo.z <= 0.0 || wi.z <= 0.0) return vec3(0.0);
    vec3 h = wo + wi;
    float across = length(h.xy);
    float size = max(length(h), 1e-20);
    float cos_h = h.z / size;
    float sin_h = across / size;
    vec2 lean = across > 0.0 ? h.xy / across : vec2(1.0, 0.0);
    // wi seen from the half vector: u away from the normal
    float along = dot(lean, wi.xy);
    float d_v = lean.x * wi.y - lean.y * wi.x;
    float d_u = cos_h * along - sin_h * wi.z;
    float d_h = sin_h * along + cos_h * wi.z;
    float theta_d = arctangent(length(vec2(d_u, d_v)), d_h);
    float phi_d = arctangent(d_v, d_u);
    phi_d = phi_d < 0.0 ? phi_d + PI : phi_d;  // wo and wi exchanged
    uint d = min(uint(theta_d * (180.0 / PI)), 89u);
    uint phi = min(uint(phi_d * (180.0 / PI)), 179u);
    return lights[table + (merl_half_cell(arctangent(across, h.z)) * 90u + d) * 180u + phi].rgb;
}

// First row of the sampling table of this angle of view.
uint merl_view(uint table, vec3 wo) {
    float theta = arctangent(length(wo.xy), wo.z);
    return table + MERL_CELLS + 90u * min(uint(theta * (2.0 / PI * float(MERL_VIEWS))), uint(MERL_VIEWS) - 1u);
}

float merl_pdf(uint table, vec3 wo, vec3 wi) {
    if (wo.z <= 0.0 || wi.z <= 0.0) return 0.0;
    vec3 h = normalize(wo + wi);
    vec4 cell = lights[merl_view(table, wo) + merl_half_cell(arctangent(length(h.xy), h.z))];
    return mix(cell.x / (4.0 * dot(wo, h)), wi.z / PI, cell.w);
}

// What comes out may lie below the surface; its density is zero.
vec3 merl_sample(uint table, vec3 wo, vec3 u) {
    uint view = merl_view(table, wo);
    float share = lights[view].w;
    float r = sqrt(u.x);
    vec3 cosine = vec3(r * cos(TWO_PI * u.y), r * sin(TWO_PI * u.y), sqrt(1.0 - u.x));
    float place = (u.z - share) / (1.0 - share) * 90.0;
    uint chosen = uint(clamp(place, 0.0, 89.0));
    vec4 link = lights[view + chosen];
    chosen = place - float(chosen) < link.y ? chosen : floatBitsToUint(link.z);
    // within the cell even in solid angle, counted in sin^2(theta/2) = (1 - cos theta)/2, which keeps its digits
    vec2 edges = vec2(chosen, chosen + 1u) / 90.0;
    edges = sin(edges * edges * (0.5 * HALF_PI));
    float drop = mix(edges.x * edges.x, edges.y * edges.y, u.x);
    float sine = 2.0 * sqrt(drop * (1.0 - drop));
    vec3 h = vec3(sine * cos(TWO_PI * u.y), sine * sin(TWO_PI * u.y), 1.0 - 2.0 * drop);
    return u.z < share ? cosine : 2.0 * dot(wo, h) * h - wo;
}
