// Disney's principled BRDF (Burley 2012, "Physically based shading at Disney", and its reference code). Directions in
// the surface's frame, z along the normal, x along the tangent; both point away from the surface. Three strategies of
// sampling: cosine for the diffuse part, visible normals for the specular one (Heitz 2018), GTR1 for the clearcoat.
// Twin: tests/renderer/principled_reference.py
#include "math/constants.glsl"

struct Principled {
    vec3 color;
    float subsurface;
    float metallic;
    float specular;
    float specular_tint;
    float roughness;
    float anisotropic;
    float sheen;
    float sheen_tint;
    float clearcoat;
    float clearcoat_gloss;
};

float schlick_weight(float cosine) {
    float m = clamp(1.0 - cosine, 0.0, 1.0);
    return m * m * m * m * m;
}

vec2 principled_alphas(Principled m) {
    float aspect = sqrt(1.0 - 0.9 * m.anisotropic);
    float a = m.roughness * m.roughness;
    return max(vec2(0.001), vec2(a / aspect, a * aspect));
}

// Generalized Trowbridge and Reitz with exponent 2, GGX.
float gtr2(vec3 h, vec2 alpha) {
    vec2 s = h.xy / alpha;
    float t = dot(s, s) + h.z * h.z;
    return 1.0 / (PI * alpha.x * alpha.y * t * t);
}

// Exponent 1. The sine squared, not 1 - cosine squared, keeps its digits near the peak.
float gtr1(vec3 h, float alpha) {
    float a2 = alpha * alpha;
    return (a2 - 1.0) / (PI * log(a2) * (a2 + (1.0 - a2) * dot(h.xy, h.xy)));
}

// Smith's shadowing of GTR2 in one direction, divided by twice its cosine.
float smith_gtr2(vec3 w, vec2 alpha) {
    vec2 s = w.xy * alpha;
    return 1.0 / (w.z + sqrt(dot(s, s) + w.z * w.z));
}

float clearcoat_alpha(Principled m) {
    return mix(0.1, 0.001, m.clearcoat_gloss);
}

vec3 specular_color(Principled m, vec3 tint) {
    return mix(0.08 * m.specular * mix(vec3(1.0), tint, m.specular_tint), m.color, m.metallic);
}

vec3 color_tint(Principled m) {
    float luminance = dot(m.color, vec3(0.3, 0.6, 0.1));
    return luminance > 0.0 ? m.color / luminance : vec3(1.0);
}

// Without the cosine [1/sr].
vec3 principled_eval(Principled m, vec3 wo, vec3 wi) {
    if (wo.z <= 0.0 || wi.z <= 0.0) return vec3(0.0);
    vec3 h = normalize(wo + wi);
    float half_cosine = dot(wi, h);
    float in_weight = schlick_weight(wi.z);
    float out_weight = schlick_weight(wo.z);
    float half_weight = schlick_weight(half_cosine);
    vec3 tint = color_tint(m);

    float grazing = 2.0 * half_cosine * half_cosine * m.roughness;
    float diffuse = mix(1.0, 0.5 + grazing, in_weight) * mix(1.0, 0.5 + grazing, out_weight);
    float flatter = mix(1.0, 0.5 * grazing, in_weight) * mix(1.0, 0.5 * grazing, out_weight);
    float below = 1.25 * (flatter * (1.0 / (wi.z + wo.z) - 0.5) + 0.5);
    vec3 sheen = half_weight * m.sheen * mix(vec3(1.0), tint, m.sheen_tint);
    vec3 value = (mix(diffuse, below, m.subsurface) / PI * m.color + sheen) * (1.0 - m.metallic);

    vec2 alpha = principled_alphas(m);
    vec3 fresnel = mix(specular_color(m, tint), vec3(1.0), half_weight);
    value += fresnel * (smith_gtr2(wi, alpha) * smith_gtr2(wo, alpha) * gtr2(h, alpha));
    float coat = smith_gtr2(wi, vec2(0.25)) * smith_gtr2(wo, vec2(0.25)) * gtr1(h, clearcoat_alpha(m));
    return value + 0.25 * m.clearcoat * mix(0.04, 1.0, half_weight) * coat;
}

// How often each strategy is used: diffuse, specular, clearcoat; about the light each sends back.
vec3 principled_chances(Principled m, vec3 wo) {
    float weight = schlick_weight(wo.z);
    vec3 luminance = vec3(0.3, 0.6, 0.1);
    float diffuse = (1.0 - m.metallic) * (dot(m.color, luminance) + 0.2 * m.sheen);
    float specular = mix(dot(specular_color(m, color_tint(m)), luminance), 1.0, weight);
    vec3 chances = vec3(diffuse, specular, 0.25 * m.clearcoat * mix(0.04, 1.0, weight));
    chances = max(chances, vec3(0.0, 0.02, 0.0));
    return chances / (chances.x + chances.y + chances.z);
}

float principled_pdf(Principled m, vec3 wo, vec3 wi) {
    if (wo.z <= 0.0 || wi.z <= 0.0) return 0.0;
    vec3 h = normalize(wo + wi);
    vec2 alpha = principled_alphas(m);
    vec3 pdfs = vec3(wi.z / PI, 0.5 * smith_gtr2(wo, alpha) * gtr2(h, alpha),
                     gtr1(h, clearcoat_alpha(m)) * h.z / (4.0 * dot(wo, h)));
    return dot(principled_chances(m, wo), pdfs);
}

// A normal that is visible from wo (Heitz 2018, JCGT 7(4)).
vec3 visible_normal(vec3 wo, vec2 alpha, vec2 u) {
    vec3 v = normalize(vec3(alpha * wo.xy, wo.z));
    float across = dot(v.xy, v.xy);
    vec3 t1 = across > 1e-14 ? vec3(-v.y, v.x, 0.0) * inversesqrt(across) : vec3(1.0, 0.0, 0.0);
    vec3 t2 = cross(v, t1);
    float r = sqrt(u.x);
    vec2 t = r * vec2(cos(TWO_PI * u.y), sin(TWO_PI * u.y));
    float s = 0.5 * (1.0 + v.z);
    t.y = mix(sqrt(max(1.0 - t.x * t.x, 0.0)), t.y, s);
    vec3 n = t.x * t1 + t.y * t2 + sqrt(max(1.0 - dot(t, t), 0.0)) * v;
    return normalize(vec3(alpha * n.xy, max(n.z, 1e-7)));
}

vec3 clearcoat_normal(float alpha, vec2 u) {
    float a2 = alpha * alpha;
    float cosine2 = clamp((1.0 - pow(a2, 1.0 - u.x)) / (1.0 - a2), 0.0, 1.0);
    float sine = sqrt(1.0 - cosine2);
    return vec3(sine * cos(TWO_PI * u.y), sine * sin(TWO_PI * u.y), sqrt(cosine2));
}

// u.z chooses the strategy. What comes out may lie below the surface; its density is zero.
vec3 principled_sample(Principled m, vec3 wo, vec3 u) {
    vec3 chances = principled_chances(m, wo);
    float r = sqrt(u.x);
    vec3 cosine = vec3(r * cos(TWO_PI * u.y), r * sin(TWO_PI * u.y), sqrt(1.0 - u.x));
    bool coat = u.z >= chances.x + chances.y;
    vec3 h = coat ? clearcoat_normal(clearcoat_alpha(m), u.xy) : visible_normal(wo, principled_alphas(m), u.xy);
    return u.z < chances.x ? cosine : 2.0 * dot(wo, h) * h - wo;
}
