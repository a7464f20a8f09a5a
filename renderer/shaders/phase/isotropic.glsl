// Isotropic scattering: 1 / (4 pi) per steradian.
#include "math/constants.glsl"

float isotropic_eval(vec3 wo, vec3 wi) {
    return INV_FOUR_PI;
}

float isotropic_pdf(vec3 wo, vec3 wi) {
    return INV_FOUR_PI;
}

vec3 isotropic_sample(vec3 wo, vec2 u) {
    float z = 1.0 - 2.0 * u.x;
    float r = 2.0 * sqrt(u.x * (1.0 - u.x));  // sqrt(1 - z^2) without cancellation
    return vec3(r * cos(TWO_PI * u.y), r * sin(TWO_PI * u.y), z);
}
