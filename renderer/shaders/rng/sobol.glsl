// Two pairs of Sobol's first two dimensions, Owen-scrambled by hashes (Laine and Karras 2011; Burley 2020): any 2^n samples
// of a pixel from a multiple of 2^n on are a (0, n, 2)-net in each pair. Pairs of other dimensions see the samples in another
// scrambled order, so they are independent of each other. key: pixel, sample, dimension, seed, as in rng/random.glsl.
#include "rng/pcg4d.glsl"

// A hash whose low bits do not depend on the higher ones: of reversed bits, a nested uniform scramble.
uint scramble_reversed(uint v, uint seed) {
    v += seed;
    v ^= v * 0x6c50b47cu;
    v ^= v * 0xb82f1e52u;
    v ^= v * 0xc7afe638u;
    v ^= v * 0x8d22f6e6u;
    return v;
}

// Pascal's triangle modulo 2 as a matrix: of an index, its number in Sobol's second dimension, bits reversed.
uint pascal(uint v) {
    v ^= v >> 16;
    v ^= (v & 0xff00ff00u) >> 8;
    v ^= (v & 0xf0f0f0f0u) >> 4;
    v ^= (v & 0xccccccccu) >> 2;
    v ^= (v & 0xaaaaaaaau) >> 1;
    return v;
}

// `seed`: of the order, of one dimension, of the other.
uvec2 sobol_pair(uint index, uvec3 seeds) {
    uint order = bitfieldReverse(scramble_reversed(bitfieldReverse(index), seeds.x));
    return bitfieldReverse(uvec2(scramble_reversed(order, seeds.y), scramble_reversed(pascal(order), seeds.z)));
}

uvec4 sobol(uvec4 key) {
    uvec4 one = pcg4d(uvec4(key.x, 0xfffffffdu, key.z, key.w));
    uvec4 two = pcg4d(uvec4(key.x, 0xfffffffcu, key.z, key.w));
    return uvec4(sobol_pair(key.y, one.xyz), sobol_pair(key.y, uvec3(one.w, two.xy)));
}
