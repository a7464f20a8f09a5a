// Surfaces are diffuse, principled or measured: what path/surface.glsl calls. Only what the scene has is compiled in.
// Needs from the program: lights[] (the material's rows, renderer/materials.py), surface_measured.
#include "surface/diffuse.glsl"
#constant SURFACE_PRINCIPLED
#constant SURFACE_MEASURED
#if SURFACE_PRINCIPLED
#include "surface/principled.glsl"
#endif
#include "generated/merl.glsl"  // surface/merl.glsl; empty where nothing is measured

const float BSDF_DIFFUSE = 0.0;
const float BSDF_MEASURED = 2.0;

struct Bsdf {
    float kind;
    vec3 color;
#if SURFACE_PRINCIPLED
    Principled principled;
#endif
#if SURFACE_MEASURED
    uint table;
#endif
};

Bsdf bsdf_of(uint row, vec3 color) {
    Bsdf bsdf;
    vec4 a = lights[row + 2u];
    vec4 c = lights[row + 4u];
    bsdf.kind = c.z;
    bsdf.color = color;
#if SURFACE_PRINCIPLED
    vec4 b = lights[row + 3u];
    bsdf.principled = Principled(color, a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y);
#endif
#if SURFACE_MEASURED
    // of other materials the first table, which they do not use
    bsdf.table = surface_measured + (c.z == BSDF_MEASURED ? floatBitsToUint(a.x) : 0u);
#endif
    return bsdf;
}

// With the cosine.
vec3 bsdf_eval(Bsdf bsdf, vec3 wo, vec3 wi, out float pdf) {
    pdf = diffuse_pdf(wo, wi);
    vec3 value = bsdf.color * diffuse_eval(wo, wi);
#if SURFACE_PRINCIPLED
    if (bsdf.kind == 1.0) {
        pdf = principled_pdf(bsdf.principled, wo, wi);
        value = principled_eval(bsdf.principled, wo, wi);
    }
#endif
#if SURFACE_MEASURED
    if (bsdf.kind == BSDF_MEASURED) {
        pdf = merl_pdf(bsdf.table, wo, wi);
        value = merl_eval(bsdf.table, wo, wi);
    }
#endif
    return value * max(wi.z, 0.0);
}

vec3 bsdf_sample(Bsdf bsdf, vec3 wo, vec3 u, out vec3 weight, out float pdf) {
    vec3 wi = diffuse_sample(wo, u.xy);
#if SURFACE_PRINCIPLED
    if (bsdf.kind == 1.0) wi = principled_sample(bsdf.principled, wo, u);
#endif
#if SURFACE_MEASURED
    if (bsdf.kind == BSDF_MEASURED) wi = merl_sample(bsdf.table, wo, u);
#endif
    vec3 value = bsdf_eval(bsdf, wo, wi, pdf);
    weight = pdf > 0.0 ? value / pdf : vec3(0.0);
    return wi;
}
