// A triangle of a mesh light, sampled uniformly by solid angle (Arvo 1995, "Stratified sampling of spherical
// triangles"); where it is small to see, by area.
// Needs from the program: lights[] (corner, two edges, unit normal).
#include "math/angles.glsl"

// Solid angle [sr] (van Oosterom and Strackee 1983), or 0 where the triangle is to be sampled by area.
float triangle_solid_angle(vec3 a, vec3 b, vec3 c) {
    float solid = 2.0 * arctangent(abs(dot(a, cross(b, c))), 1.0 + dot(a, b) + dot(b, c) + dot(c, a));
    return solid > 0.02 && solid < 6.2 ? solid : 0.0;
}

float seen_triangle_pdf(float solid_angle, float area, float height, vec3 away) {
    float squared = dot(away, away);
    return solid_angle > 0.0 ? 1.0 / solid_angle : squared * sqrt(squared) / (area * max(abs(height), 1e-20));
}

float triangle_pdf(uint row, vec3 point, vec3 away) {
    vec3 a = lights[row].xyz - point;
    vec3 e1 = lights[row + 1u].xyz;
    vec3 e2 = lights[row + 2u].xyz;
    float solid_angle = triangle_solid_angle(normalize(a), normalize(a + e1), normalize(a + e2));
    float height = dot(a, lights[row + 3u].xyz);
    return seen_triangle_pdf(solid_angle, 0.5 * length(cross(e1, e2)), height, away);
}

// The part of `v` across the unit vector `axis`, of unit length.
vec3 unit_across(vec3 v, vec3 axis) {
    return normalize(v - dot(v, axis) * axis);
}

// Direction, uniform in the spherical triangle of unit vectors.
vec3 spherical_triangle_sample(vec3 a, vec3 b, vec3 c, float solid_angle, vec2 u) {
    float angle_a = angle_between(cross(a, b), cross(a, c));
    float part = u.x * solid_angle - angle_a;
    float s = sin(part);
    float t = cos(part);
    float cos_a = cos(angle_a);
    float k1 = t - cos_a;
    float k2 = s + sin(angle_a) * dot(a, b);
    float q = ((k2 * t - k1 * s) * cos_a - k2) / ((k2 * s + k1 * t) * sin(angle_a));
    q = clamp(q, -1.0, 1.0);
    vec3 to_c = q * a + sqrt(max(1.0 - q * q, 0.0)) * unit_across(c, a);
    float drop = u.y * (1.0 - dot(to_c, b));
    return (1.0 - drop) * b + sqrt(max(drop * (2.0 - drop), 0.0)) * unit_across(to_c, b);
}

// From the point to a place on the triangle.
vec3 triangle_sample(uint row, vec3 point, vec2 u, out float pdf) {
    vec3 a = lights[row].xyz - point;
    vec3 e1 = lights[row + 1u].xyz;
    vec3 e2 = lights[row + 2u].xyz;
    float height = dot(a, lights[row + 3u].xyz);
    vec3 ua = normalize(a);
    vec3 ub = normalize(a + e1);
    vec3 uc = normalize(a + e2);
    float solid_angle = triangle_solid_angle(ua, ub, uc);
    float r = sqrt(u.x);
    vec3 away = a + (1.0 - r) * e1 + r * u.y * e2;
    if (solid_angle > 0.0) {
        vec3 w = spherical_triangle_sample(ua, ub, uc, solid_angle, u);
        away = w * (height / dot(w, lights[row + 3u].xyz));
    }
    pdf = seen_triangle_pdf(solid_angle, 0.5 * length(cross(e1, e2)), height, away);
    return away;
}
