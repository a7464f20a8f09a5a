// A path has met a surface: light sampling and a new direction, as scatter.glsl does for fibers.
#include "geometry/vertex.glsl"
#include "surface/diffuse.glsl"
#include "generated/texture.glsl"  // surface/texture.glsl; empty where there are no textures
#include "path/scatter.glsl"
#constant SURFACE_TEXTURES

vec3 surface_color(SurfaceVertex vertex) {
    uint row = surface_materials + 2u * vertex.material;
    vec3 color = lights[row].rgb;
#if SURFACE_TEXTURES
    uvec3 place = floatBitsToUint(lights[row + 1u].xyz);
    if (place.x != 0xffffffffu) color *= texture_color(place.x, ivec2(place.yz), vertex.uv);
#endif
    return color;
}

#if LOCAL_LIGHTS
// Area lights shine on their front and end every path.
void meet_light(inout Path p, uint light, vec3 normal) {
    vec4 entry = lights[2u * (local_first + light)];
    bool front = dot(p.direction, lights[local_lights + 4u * light + 3u].xyz) < 0.0;
    vec3 emitted = front ? entry.rgb : vec3(0.0);
    if (p.bounce == 0u) {
        film_add_first_surface(film_pixel(p.rng.x), p.t_end, normal, vec3(0.0));
        p.radiance += emitted;
        p.bounce = 1u;
    } else {
        float pdf = entry.w * local_light_pdf(light, p.origin, p.direction * p.t_end);
        p.radiance += p.throughput * emitted * phase_weight(pdf, p.phase_pdf);
    }
    p.throughput = vec3(0.0);
    p.mode = MODE_ESCAPED;
}
#endif

void meet_surface(inout Path p) {
    SurfaceVertex vertex = surface_vertex(p.triangle, p.origin, p.direction);
#if LOCAL_LIGHTS
    uint emitter = floatBitsToUint(lights[surface_materials + 2u * vertex.material].w);
    if (emitter > 0u) {
        meet_light(p, emitter - 1u, vertex.normal);
        return;
    }
#endif
    vec3 color = surface_color(vertex);
    if (p.bounce == 0u) film_add_first_surface(film_pixel(p.rng.x), p.t_end, vertex.normal, color);
    if (p.bounce >= max_bounces) {
        cut_path(p);
        return;
    }
    p.bounce += 1u;
    p.origin = off_surface(vertex.position, vertex.flat_normal);
    p.origin_voxel = ON_SURFACE;
    mat3 frame;
    frame[2] = vertex.normal;
    orthonormal_basis(vertex.normal, frame[0], frame[1]);
    vec3 wo = -p.direction * frame;

    uvec4 bits = random_words(p.rng);
    uvec4 light_bits = random_words(p.rng);
    LightSample light = light_sample(light_bits.xy, unit_interval(light_bits).zw, p.origin);
    vec3 wi = light.direction * frame;
    bool outside = dot(light.direction, vertex.flat_normal) > 0.0;
    vec3 value = outside ? color * diffuse_eval(wo, wi) * max(wi.z, 0.0) : vec3(0.0);
    vec3 carried = p.throughput * value * light.value * light_weight(light.pdf, diffuse_pdf(wo, wi));

    wi = diffuse_sample(wo, unit_interval(bits).xy);
    p.phase_pdf = diffuse_pdf(wo, wi);
    p.next_direction = without_zeros(normalize(frame * wi));
    bool inward = dot(p.next_direction, vertex.flat_normal) <= 0.0;  // smooth normals alone can send it there
    p.throughput *= inward ? vec3(0.0) : color;
    uvec4 more = random_words(p.rng);
    p.next_depth = exponential(more.x);
    if (p.bounce >= roulette_start) roulette(p, more.y);
    if (max(carried.x, max(carried.y, carried.z)) > 0.0) {
        start_shadow(p, without_zeros(light.direction), light.distance, carried, more.z);
    } else {
        start_flight(p);
    }
}
