// Surfaces are diffuse or principled: what path/surface.glsl calls.
// Needs from the program: lights[] (the material's rows, renderer/surfaces.py).
#include "surface/diffuse.glsl"
#include "surface/principled.glsl"

struct Bsdf {
    bool diffuse;
    Principled principled;
};

Bsdf bsdf_of(uint row, vec3 color) {
    vec4 a = lights[row + 2u];
    vec4 b = lights[row + 3u];
    vec4 c = lights[row + 4u];
    return Bsdf(c.z == 0.0, Principled(color, a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y));
}

// With the cosine.
vec3 bsdf_eval(Bsdf bsdf, vec3 wo, vec3 wi, out float pdf) {
    Principled m = bsdf.principled;
    pdf = bsdf.diffuse ? diffuse_pdf(wo, wi) : principled_pdf(m, wo, wi);
    vec3 value = bsdf.diffuse ? m.color * diffuse_eval(wo, wi) : principled_eval(m, wo, wi);
    return value * max(wi.z, 0.0);
}

vec3 bsdf_sample(Bsdf bsdf, vec3 wo, vec3 u, out vec3 weight, out float pdf) {
    vec3 wi = bsdf.diffuse ? diffuse_sample(wo, u.xy) : principled_sample(bsdf.principled, wo, u);
    vec3 value = bsdf_eval(bsdf, wo, wi, pdf);
    weight = pdf > 0.0 ? value / pdf : vec3(0.0);
    return wi;
}
