// Random numbers as functions of (pixel, sample, dimension, seed) = rng.xyzw; only the dimension moves on.
// RANDOM_KIND: 0 pcg4d; 1 philox4x32-10 (half the speed); 2 MD5; 3 Owen-scrambled Sobol in the first SOBOL_DIMENSIONS
// dimensions and pcg4d after them. All must give statistically equal images.
#constant RANDOM_KIND
#include "rng/pcg4d.glsl"
#if RANDOM_KIND == 1
#include "rng/philox.glsl"
#elif RANDOM_KIND == 2
#include "rng/md5.glsl"
#elif RANDOM_KIND == 3
#include "rng/sobol.glsl"
const uint SOBOL_DIMENSIONS = 6u;  // of four numbers each: the first flight, and two scatterings
#endif

uvec4 random_bits(uvec4 key) {
#if RANDOM_KIND == 1
    return philox4x32(uvec4(key.xyz, 0u), uvec2(key.w, 0x5EED5EEDu));
#elif RANDOM_KIND == 2
    return md5(key);
#elif RANDOM_KIND == 3
    if (key.z < SOBOL_DIMENSIONS) return sobol(key);
#endif
    return pcg4d(key);
}

// Uniform on [0, 1), multiples of 2^-24.
vec4 unit_interval(uvec4 bits) {
    return vec4(bits >> 8u) * 5.9604644775390625e-8;
}

// Four uniform numbers; advances the dimension by one.
vec4 random4(inout uvec4 rng) {
    vec4 u = unit_interval(random_bits(rng));
    rng.z += 1u;
    return u;
}

// Two independent standard normal numbers (Box and Muller 1958). 1 - u.x lies in (0, 1].
vec2 standard_normals(vec2 u) {
    float angle = 6.28318530717959 * u.y;
    return sqrt(-2.0 * log(1.0 - u.x)) * vec2(cos(angle), sin(angle));
}
