// The point of a surface that a ray has met.
// Needs from the program: lights[], surface_triangles, surface_attributes.
#include "geometry/triangle.glsl"

struct SurfaceVertex {
    vec3 position;   // on the triangle, nearer to it than origin + t direction [voxels]
    vec3 flat_normal;    // of the triangle, toward the ray's origin
    vec3 normal;     // of the smooth surface, on the same side
    vec2 uv;
    uint material;
};

SurfaceVertex surface_vertex(uint triangle, vec3 origin, vec3 direction) {
    vec2 b;
    triangle_distance(triangle, origin, direction, 1e30, b);
    b = clamp(b, 0.0, 1.0);
    uint row = surface_triangles + 3u * triangle;
    vec3 e1 = lights[row + 1u].xyz;
    vec3 e2 = lights[row + 2u].xyz;
    uint at = surface_attributes + 4u * triangle;
    vec4 n0 = lights[at];
    vec4 n1 = lights[at + 1u];
    vec4 n2 = lights[at + 2u];
    vec3 v = lights[at + 3u].xyz;
    vec3 c = vec3(1.0 - b.x - b.y, b);
    vec3 flat_normal = normalize(cross(e1, e2));
    vec3 smooth_normal = normalize(c.x * n0.xyz + c.y * n1.xyz + c.z * n2.xyz);
    bool behind = dot(flat_normal, direction) > 0.0;
    flat_normal = behind ? -flat_normal : flat_normal;
    smooth_normal = behind ? -smooth_normal : smooth_normal;
    // a smooth normal that looks away from the ray shades nothing: the triangle's own instead
    if (dot(smooth_normal, direction) >= 0.0) smooth_normal = flat_normal;
    return SurfaceVertex(lights[row].xyz + b.x * e1 + b.y * e2, flat_normal, smooth_normal,
                         vec2(dot(c, vec3(n0.w, n1.w, n2.w)), dot(c, v)), floatBitsToUint(lights[row].w));
}

// Unit vector along which u grows and v does not; zero where a triangle has no texture coordinates.
vec3 surface_tangent(uint triangle) {
    uint row = surface_triangles + 3u * triangle;
    uint at = surface_attributes + 4u * triangle;
    vec3 u = vec3(lights[at].w, lights[at + 1u].w, lights[at + 2u].w);
    vec3 v = lights[at + 3u].xyz;
    vec2 first = vec2(u.y - u.x, v.y - v.x);
    vec2 second = vec2(u.z - u.x, v.z - v.x);
    float area = first.x * second.y - first.y * second.x;
    vec3 tangent = (second.y * lights[row + 1u].xyz - first.y * lights[row + 2u].xyz) * sign(area);
    float size = length(tangent);
    return size > 0.0 ? tangent / size : vec3(0.0);
}

// A point so far along `normal` that its rounding cannot lie behind the surface (Waechter and Binder 2019).
vec3 off_surface(vec3 position, vec3 normal) {
    ivec3 steps = ivec3(256.0 * normal);
    ivec3 bits = floatBitsToInt(position);
    vec3 moved = intBitsToFloat(bits + ivec3(position.x < 0.0 ? -steps.x : steps.x,
                                             position.y < 0.0 ? -steps.y : steps.y,
                                             position.z < 0.0 ? -steps.z : steps.z));
    vec3 near_zero = position + normal * (1.0 / 65536.0);
    return vec3(abs(position.x) < 0.03125 ? near_zero.x : moved.x, abs(position.y) < 0.03125 ? near_zero.y : moved.y,
                abs(position.z) < 0.03125 ? near_zero.z : moved.z);
}
