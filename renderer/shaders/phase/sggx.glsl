// Specular SGGX microflakes around a fiber (Heitz, Dupuy, Crassin and Dachsbacher 2015). Local frame: x is the fiber;
// S = diag(r^2, 1, 1), r the roughness: flakes lie along the fiber, and see a projected area of sqrt(w^T S w).
// Twin: tests/renderer/shaders/reference.py
#include "math/constants.glsl"
#include "math/frames.glsl"

float sggx_area(vec3 w, float r) {
    return sqrt(r * r * w.x * w.x + dot(w.yz, w.yz));
}

// Distribution of flake normals, D(h) = 1 / (pi sqrt|S| (h^T S^-1 h)^2).
float sggx_normals(vec3 h, float r) {
    float shape = h.x * h.x / (r * r) + dot(h.yz, h.yz);
    return 1.0 / (PI * r * shape * shape);
}

float sggx_eval(vec3 wo, vec3 wi, float r) {
    vec3 sum = wo + wi;
    float size = length(sum);
    return size > 0.0 ? sggx_normals(sum / size, r) / (4.0 * sggx_area(wo, r)) : 0.0;
}

float sggx_pdf(vec3 wo, vec3 wi, float r) {
    return sggx_eval(wo, wi, r);
}

// A visible normal: the sphere's, seen along the stretched direction, stretched back; then the mirror direction.
vec3 sggx_sample(vec3 wo, float r, vec2 u) {
    vec3 stretch = vec3(r, 1.0, 1.0);
    vec3 b1;
    vec3 b2;
    vec3 w = normalize(wo * stretch);
    orthonormal_basis(w, b1, b2);
    float radius = sqrt(u.x);
    vec3 ball = radius * cos(TWO_PI * u.y) * b1 + radius * sin(TWO_PI * u.y) * b2 + sqrt(1.0 - u.x) * w;
    vec3 h = normalize(ball * stretch);
    return 2.0 * dot(wo, h) * h - wo;
}
