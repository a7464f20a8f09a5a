// All lights in one alias table (Walker 1977): one entry per texel of the latitude-longitude environment, then one
// per directional light, and one that stands for no light. Radiance is constant in a texel, so the sampled density is exactly the evaluated one.
// Up is +y; column 0 starts at -z and goes toward +x, as in Mitsuba 3 (renderer/environment.py).
// Needs from the program: lights[] (per entry: vec4(radiance, pdf), vec4(threshold, alias, 0, 0)), light_count,
// environment_size (columns, rows), directional_lights[]; with LOCAL_LIGHTS, light/local.glsl and what it needs.

#include "math/constants.glsl"
#include "math/arctangent.glsl"
#constant LOCAL_LIGHTS

struct LightSample {
    vec3 direction;  // toward the light
    vec3 value;      // radiance / pdf, or irradiance / probability
    float pdf;       // [1/sr]; 0 for a light that no phase function sample can hit
    float distance;  // [voxels]
};

const float INFINITELY_FAR = 1e30;

// Not acos: Mesa's is off by 1e-4 rad and more, a texel's width near the edge of every row of a large picture.
uint environment_texel(vec3 direction) {
    float u = arctangent(direction.x, -direction.z) * (0.5 / PI);
    float v = arctangent(length(direction.xz), direction.y) * (1.0 / PI);
    ivec2 place = ivec2(floor(vec2(u - floor(u), v) * vec2(environment_size)));
    place = clamp(place, ivec2(0), environment_size - 1);
    return uint(place.y * environment_size.x + place.x);
}

// Radiance from `direction`, and in w the density with which light_sample chooses it [1/sr].
vec4 environment_eval(vec3 direction) {
    return lights[2u * environment_texel(direction)];
}

// y of a direction in this row, uniform in solid angle by u, and its distance from the axis. Counted from the nearer
// pole in sin^2(theta/2) = (1 - y)/2, which keeps its digits where y rounds to one.
float environment_height(uint row, float u, out float radius) {
    bool below = 2u * row >= uint(environment_size.y);
    uint from_pole = below ? uint(environment_size.y) - 1u - row : row;
    vec2 edges = sin(vec2(from_pole, from_pole + 1u) * (HALF_PI / float(environment_size.y)));
    edges *= edges;
    float drop = mix(edges.x, edges.y, below ? 1.0 - u : u);
    radius = 2.0 * sqrt(drop * (1.0 - drop));
    return below ? 2.0 * drop - 1.0 : 1.0 - 2.0 * drop;
}

LightSample light_sample(uvec2 choice, vec2 u, vec3 point) {
    // choice is a fraction of 64 bits; times light_count, its whole part is the entry, as even as 64 bits allow, and
    // the rest decides between the entry and its alias
    uint high;
    uint low;
    uint unused_low;
    uint carried;
    uint carry;
    umulExtended(choice.x, light_count, high, low);
    umulExtended(choice.y, light_count, carried, unused_low);
    uint rest = uaddCarry(low, carried, carry);
    high += carry;
    vec4 link = lights[2u * high + 1u];
    uint entry = float(rest >> 8u) * 5.9604644775390625e-8 < link.x ? high : floatBitsToUint(link.y);
    vec4 radiance = lights[2u * entry];
#if LOCAL_LIGHTS
    if (entry >= local_first) {
        LightSample s;
        vec3 value = radiance.rgb / radiance.w;
        s.value = local_light_sample(entry - local_first, value, point, u, s.direction, s.distance, s.pdf);
        s.pdf *= radiance.w;
        return s;
    }
#endif
    uint texel_count = uint(environment_size.x * environment_size.y);
    if (entry >= texel_count) {
        vec3 direction = directional_lights[min(entry - texel_count, 15u)].xyz;  // one more entry has no light
        return LightSample(direction, radiance.rgb / max(radiance.w, 1e-30), 0.0, INFINITELY_FAR);
    }
    uint row = entry / uint(environment_size.x);
    uint column = entry - row * uint(environment_size.x);
    float phi = (float(column) + u.x) * (2.0 * PI / float(environment_size.x));
    float radius;
    float y = environment_height(row, u.y, radius);
    vec3 value = radiance.w > 0.0 ? radiance.rgb / radiance.w : vec3(0.0);
    return LightSample(vec3(radius * sin(phi), y, -radius * cos(phi)), value, radiance.w, INFINITELY_FAR);
}
