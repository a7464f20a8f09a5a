// Lambert's law. Directions in the surface's frame, z along the normal; both point away from the surface.
#include "math/constants.glsl"

// Reflectance 1, without the cosine [1/sr].
float diffuse_eval(vec3 wo, vec3 wi) {
    return wo.z > 0.0 && wi.z > 0.0 ? 1.0 / PI : 0.0;
}

float diffuse_pdf(vec3 wo, vec3 wi) {
    return wo.z > 0.0 ? max(wi.z, 0.0) / PI : 0.0;
}

// In proportion to the cosine: uniform on the disk below (Malley).
vec3 diffuse_sample(vec3 wo, vec2 u) {
    float r = sqrt(u.x);
    return vec3(r * cos(TWO_PI * u.y), r * sin(TWO_PI * u.y), sqrt(1.0 - u.x));
}
