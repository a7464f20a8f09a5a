// A path has met a surface: light sampling and a new direction, as scatter.glsl does for fibers.
#include "geometry/vertex.glsl"
#include "generated/bsdf.glsl"  // surface/bsdf_diffuse.glsl or surface/bsdf_mixed.glsl
#include "generated/texture.glsl"  // surface/texture.glsl; empty where there are no textures
#include "path/scatter.glsl"
#constant SURFACE_PRINCIPLED
#constant SURFACE_TEXTURES

// x along the texture's u where that is known, z along the smooth normal.
mat3 surface_frame(Path p, SurfaceVertex vertex) {
    mat3 frame;
    frame[2] = vertex.normal;
    orthonormal_basis(vertex.normal, frame[0], frame[1]);
#if SURFACE_PRINCIPLED
    vec3 tangent = surface_tangent(p.triangle);
#if SURFACE_INSTANCES
    tangent = from_instance(p.met_instance, vec4(tangent, 0.0));
    tangent /= max(length(tangent), 1e-20);
#endif
    tangent -= dot(tangent, vertex.normal) * vertex.normal;
    float size = length(tangent);
    if (size > 1e-3) {
        frame[0] = tangent / size;
        frame[1] = cross(frame[2], frame[0]);
    }
#endif
    return frame;
}

uint material_row(SurfaceVertex vertex) {
    return surface_materials + 5u * vertex.material;
}

vec3 surface_color(SurfaceVertex vertex) {
    uint row = material_row(vertex);
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
        film_add_first_surface(film_place(p), p.t_end, normal, vec3(0.0));
        p.radiance += p.throughput * emitted;
        p.bounce = 1u;
    } else {
        float pdf = entry.w * local_light_pdf(light, p.origin, p.direction * p.t_end);
        p.radiance += p.throughput * emitted * phase_weight(pdf, p.phase_pdf);
    }
    p.throughput = vec3(0.0);
    p.mode = MODE_ESCAPED;
}
#endif

SurfaceVertex met_vertex(Path p) {
#if SURFACE_INSTANCES
    uint at = p.met_instance;
    vec3 origin = to_instance(at, vec4(p.origin, 1.0));
    SurfaceVertex vertex = surface_vertex(p.triangle, origin, to_instance(at, vec4(p.direction, 0.0)));
    uint material = instance_numbers(at).z;
    vertex.material = material == 0xffffffffu ? vertex.material : material;
    vertex.flat_normal = normal_from_instance(at, vertex.flat_normal);
    vertex.normal = normal_from_instance(at, vertex.normal);
    vertex.position = from_instance(at, vec4(vertex.position, 1.0));
    // the map rounds where the whole point is large, also along an axis on which it lies near zero
    vec3 size = abs(vertex.position);
    vertex.position += vertex.flat_normal * (1e-6 * max(size.x, max(size.y, size.z)));
    return vertex;
#else
    return surface_vertex(p.triangle, p.origin, p.direction);
#endif
}

void meet_surface(inout Path p) {
    SurfaceVertex vertex = met_vertex(p);
#if LOCAL_LIGHTS
    uint emitter = floatBitsToUint(lights[material_row(vertex)].w);
    if (emitter > 0u) {
        meet_light(p, emitter - 1u, vertex.normal);
        return;
    }
#endif
    vec3 color = surface_color(vertex);
    if (p.bounce == 0u) film_add_first_surface(film_place(p), p.t_end, vertex.normal, color);
    if (p.bounce >= max_bounces) {
        cut_path(p);
        return;
    }
#if FIBER_CORRELATION
    p.left_axis = vec3(0.0);
#endif
    p.bounce += 1u;
    p.origin = off_surface(vertex.position, vertex.flat_normal);
    p.origin_voxel = ON_SURFACE;
    mat3 frame = surface_frame(p, vertex);
    vec3 wo = -p.direction * frame;

    uvec4 bits = random_words(p.rng);
    uvec4 light_bits = random_words(p.rng);
    LightSample light = light_sample(light_bits.xy, unit_interval(light_bits).zw, p.origin);
    vec3 wi = light.direction * frame;
    bool outside = dot(light.direction, vertex.flat_normal) > 0.0;
    Bsdf bsdf = bsdf_of(material_row(vertex), color);
    float eval_pdf;
    vec3 value = bsdf_eval(bsdf, wo, wi, eval_pdf);
    if (!outside) value = vec3(0.0);
    vec3 carried = p.throughput * value * light.value * light_weight(light.pdf, eval_pdf);

    vec3 weight;
    wi = bsdf_sample(bsdf, wo, unit_interval(bits).xyz, weight, p.phase_pdf);
    p.next_direction = without_zeros(normalize(frame * wi));
    bool inward = dot(p.next_direction, vertex.flat_normal) <= 0.0;  // smooth normals alone can send it there
    p.throughput *= inward ? vec3(0.0) : weight;
    uvec4 more = random_words(p.rng);
    p.next_depth = exponential(more.x);
    if (p.bounce >= roulette_start) roulette(p, more.y);
    if (max(carried.x, max(carried.y, carried.z)) > 0.0) {
        start_shadow(p, without_zeros(light.direction), light.distance, carried, more.z);
    } else {
        start_flight(p);
    }
}
