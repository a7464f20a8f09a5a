// Textures of 8-bit sRGB, looked up with bilinear interpolation of linear light, repeated, the same on every driver.
// Needs from the program: lights[], surface_texels.

vec3 linear_from_srgb(vec3 s) {
    return mix(s / 12.92, pow((s + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), s));
}

vec3 texel(uint first, ivec2 place, ivec2 size) {
    uint index = first + uint(place.y * size.x + place.x);
    vec4 four = lights[surface_texels + (index >> 2u)];
    uint pick = index & 3u;
    uint word = floatBitsToUint(pick < 2u ? (pick == 0u ? four.x : four.y) : (pick == 2u ? four.z : four.w));
    return linear_from_srgb(vec3(uvec3(word, word >> 8u, word >> 16u) & 255u) / 255.0);
}

vec3 texture_color(uint first, ivec2 size, vec2 uv) {
    vec2 place = (uv - floor(uv)) * vec2(size) - 0.5;
    ivec2 low = ivec2(floor(place));
    vec2 part = place - vec2(low);
    ivec2 a = ivec2(low.x < 0 ? size.x - 1 : low.x, low.y < 0 ? size.y - 1 : low.y);
    ivec2 b = ivec2(low.x + 1 >= size.x ? 0 : low.x + 1, low.y + 1 >= size.y ? 0 : low.y + 1);
    return mix(mix(texel(first, a, size), texel(first, ivec2(b.x, a.y), size), part.x),
               mix(texel(first, ivec2(a.x, b.y), size), texel(first, b, size), part.x), part.y);
}
