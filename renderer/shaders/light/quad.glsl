// A rectangle sampled uniformly by solid angle (Urena, Fajardo and King 2013); where it is small to see, by area.
// Needs from the program: lights[].
#include "math/angles.glsl"

// A rectangle as it is seen from a point: z toward the viewer's side, x and y along its edges.
struct SeenRectangle {
    vec2 low;      // corner nearest to minus infinity, from the point
    vec2 high;
    float height;  // of the rectangle along its normal; negative on its bright side
    float solid_angle;  // 0: choose by area
    float k;
    vec2 b;
};

SeenRectangle see_rectangle(uint row, vec3 point) {
    vec3 half_x = lights[row + 1u].xyz;
    vec3 half_y = lights[row + 2u].xyz;
    vec2 size = vec2(length(half_x), length(half_y));
    vec3 d = lights[row].xyz - point;
    vec2 middle = vec2(dot(d, half_x), dot(d, half_y)) / size;
    SeenRectangle r;
    r.low = middle - size;
    r.high = middle + size;
    r.height = dot(d, lights[row + 3u].xyz);
    vec2 nearest = clamp(vec2(0.0), r.low, r.high);
    float z = abs(r.height);
    float away = dot(nearest, nearest) + z * z;
    bool large = 4.0 * size.x * size.y * z > 0.1 * away * sqrt(away);
    vec3 v00 = vec3(r.low, -z);
    vec3 v11 = vec3(r.high, -z);
    vec3 v01 = vec3(v00.x, v11.y, -z);
    vec3 v10 = vec3(v11.x, v00.y, -z);
    vec3 n0 = normalize(cross(v00, v10));
    vec3 n1 = normalize(cross(v10, v11));
    vec3 n2 = normalize(cross(v11, v01));
    vec3 n3 = normalize(cross(v01, v00));
    r.b = vec2(n0.z, n2.z);
    r.k = TWO_PI - angle_between(-n2, n3) - angle_between(-n3, n0);
    float solid = angle_between(-n0, n1) + angle_between(-n1, n2) - r.k;
    r.solid_angle = large && solid > 0.01 ? solid : 0.0;
    return r;
}

// Place on the rectangle's plane, from the point below it, uniform in solid angle.
vec2 place_by_solid_angle(SeenRectangle r, vec2 u) {
    float z = abs(r.height);
    float a = u.x * r.solid_angle + r.k;
    float f = (cos(a) * r.b.x - r.b.y) / sin(a);
    float c = clamp((f > 0.0 ? 1.0 : -1.0) * inversesqrt(f * f + r.b.x * r.b.x), -1.0, 1.0);
    float x = clamp(c * z * inversesqrt(max(1.0 - c * c, 1e-12)), r.low.x, r.high.x);
    float d = sqrt(x * x + z * z);
    float h0 = r.low.y * inversesqrt(d * d + r.low.y * r.low.y);
    float h1 = r.high.y * inversesqrt(d * d + r.high.y * r.high.y);
    float h = mix(h0, h1, u.y);
    return vec2(x, clamp(h * d * inversesqrt(max(1.0 - h * h, 1e-12)), r.low.y, r.high.y));
}

// Density with which a place of it is chosen [1/sr]; `away`: from the point to it.
float rectangle_pdf(SeenRectangle r, vec3 away) {
    vec2 size = r.high - r.low;
    float squared = dot(away, away);
    float by_area = squared * sqrt(squared) / (size.x * size.y * max(abs(r.height), 1e-20));
    return r.solid_angle > 0.0 ? 1.0 / r.solid_angle : by_area;
}

// From the point to a place on the rectangle.
vec3 quad_sample(uint row, vec3 point, vec2 u, out float pdf) {
    SeenRectangle r = see_rectangle(row, point);
    vec2 place = r.solid_angle > 0.0 ? place_by_solid_angle(r, u) : mix(r.low, r.high, u);
    vec2 size = 0.5 * (r.high - r.low);
    vec3 away = place.x / size.x * lights[row + 1u].xyz + place.y / size.y * lights[row + 2u].xyz
        + r.height * lights[row + 3u].xyz;
    pdf = rectangle_pdf(r, away);
    return away;
}

float quad_pdf(uint row, vec3 point, vec3 away) {
    return rectangle_pdf(see_rectangle(row, point), away);
}
