// Fiber axis of a voxel word, 10 + 10 bits on the hemi-octahedral map (Cigolle et al. 2014, JCGT 3(2)), before it is
// normalized: its length is 590 to 1022. Twin: decode_axis in renderer/direction_encoding.py.
vec3 unscaled_axis(uint word) {
    float a = float((word >> 10) & 1023u);
    float b = float(word & 1023u);
    vec2 p = vec2(a + b - 1022.0, a - b);
    return vec3(p, 1022.0 - abs(p.x) - abs(p.y));
}
