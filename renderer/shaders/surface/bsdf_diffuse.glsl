// Every surface is diffuse: what path/surface.glsl calls, behind Lambert's law.
#include "surface/diffuse.glsl"

struct Bsdf {
    vec3 color;
};

Bsdf bsdf_of(uint row, vec3 color) {
    return Bsdf(color);
}

// With the cosine.
vec3 bsdf_eval(Bsdf bsdf, vec3 wo, vec3 wi, out float pdf) {
    pdf = diffuse_pdf(wo, wi);
    return bsdf.color * diffuse_eval(wo, wi) * max(wi.z, 0.0);
}

vec3 bsdf_sample(Bsdf bsdf, vec3 wo, vec3 u, out vec3 weight, out float pdf) {
    vec3 wi = diffuse_sample(wo, u.xy);
    pdf = diffuse_pdf(wo, wi);
    weight = bsdf.color;
    return wi;
}
