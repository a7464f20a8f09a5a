// Lights that stand somewhere: points, spots, quads, disks, triangles. Only the shapes that a scene has are compiled in.
// Needs from the program: lights[], local_lights (first row), local_first (first entry of the alias table).
#include "math/constants.glsl"
#include "math/angles.glsl"  // here, since an include counts once, wanted or not
#constant LOCAL_QUADS
#constant LOCAL_DISKS
#constant LOCAL_TRIANGLES
#if LOCAL_QUADS
#include "light/quad.glsl"
#endif
#if LOCAL_DISKS
#include "light/disk.glsl"
#endif
#if LOCAL_TRIANGLES
#include "light/triangle.glsl"
#endif

const float LIGHT_SPOT = 1.0;
const float LIGHT_QUAD = 2.0;
const float LIGHT_DISK = 3.0;
const float LIGHT_TRIANGLE = 4.0;

// Density, without the chance of the light, of choosing the direction to a place that a ray from `point` has met.
float local_light_pdf(uint light, vec3 point, vec3 away) {
    uint row = local_lights + 4u * light;
    float kind = lights[row].w;
    float pdf = 0.0;
#if LOCAL_QUADS
    if (kind == LIGHT_QUAD) pdf = quad_pdf(row, point, away);
#endif
#if LOCAL_DISKS
    if (kind == LIGHT_DISK) pdf = disk_pdf(row, point, away);
#endif
#if LOCAL_TRIANGLES
    if (kind == LIGHT_TRIANGLE) pdf = triangle_pdf(row, point, away);
#endif
    return pdf;
}

// From a point toward the light: direction, distance, radiance or irradiance divided by `pdf`, which is 0 for what
// cannot be met. `value` is the light's entry.
vec3 local_light_sample(uint light, vec3 value, vec3 point, vec2 u, out vec3 direction, out float distance, out float pdf) {
    uint row = local_lights + 4u * light;
    vec4 center = lights[row];
    vec3 normal = lights[row + 3u].xyz;
    vec3 away = center.xyz - point;
    bool area = center.w >= LIGHT_QUAD;
    bool bright = dot(away, normal) < 0.0;
    pdf = 0.0;
#if LOCAL_QUADS
    if (center.w == LIGHT_QUAD) away = quad_sample(row, point, u, pdf);
#endif
#if LOCAL_DISKS
    if (center.w == LIGHT_DISK) away = disk_sample(row, point, u, pdf);
#endif
#if LOCAL_TRIANGLES
    if (center.w == LIGHT_TRIANGLE) away = triangle_sample(row, point, u, pdf);
#endif
    distance = length(away);
    direction = away / max(distance, 1e-20);
    if (area) value = bright ? value / pdf : vec3(0.0);
    if (!area) value /= max(distance * distance, 1e-12);
    if (center.w == LIGHT_SPOT) {
        float beam = lights[row + 1u].w;
        float cutoff = lights[row + 2u].w;
        float angle = arctangent(length(cross(normal, direction)), -dot(normal, direction));
        value *= clamp((cutoff - angle) / (cutoff - beam), 0.0, 1.0);
    }
    return value;
}
