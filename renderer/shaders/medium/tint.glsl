// The dye of a voxel, linear RGB, from its word of color. Twin: renderer/voxel_colors.py
vec3 tint_of_word(uint word) {
    vec3 root = vec3(uvec3(word >> 20u, word >> 10u, word) & 1023u) / 1023.0;
    return root * root;
}
