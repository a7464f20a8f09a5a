// Henyey and Greenstein 1941. wo and wi both point away from the point, so forward scattering (g > 0) is wi = -wo.
// Twin: tests/renderer/shaders/reference.py
#include "math/constants.glsl"
#include "math/frames.glsl"

float henyey_greenstein_eval(vec3 wo, vec3 wi, float g) {
    // |wo + wi|^2 = 2 + 2 dot(wo, wi) keeps its digits at the forward peak, where 1 + g^2 + 2 g dot loses them
    vec3 sum = wo + wi;
    float denominator = (1.0 - g) * (1.0 - g) + g * dot(sum, sum);
    return INV_FOUR_PI * (1.0 - g * g) / (denominator * sqrt(denominator));
}

float henyey_greenstein_pdf(vec3 wo, vec3 wi, float g) {
    return henyey_greenstein_eval(wo, wi, g);
}

vec3 henyey_greenstein_sample(vec3 wo, float g, vec2 u) {
    // 1 - cos of the angle from the forward direction, inverted from the cumulative distribution
    float a = 1.0 - g + 2.0 * g * u.x;
    float drop = 2.0 * (1.0 - u.x) * (1.0 - g) * (1.0 - g) * (1.0 + g * u.x) / (a * a);
    float side = sqrt(max(0.0, drop * (2.0 - drop)));
    vec3 b1;
    vec3 b2;
    orthonormal_basis(wo, b1, b2);
    return side * cos(TWO_PI * u.y) * b1 + side * sin(TWO_PI * u.y) * b2 - (1.0 - drop) * wo;
}
