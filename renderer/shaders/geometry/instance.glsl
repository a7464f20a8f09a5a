// Rays and vertices between the scene and a mesh that stands in it several times (renderer/instances.py). Distances
// along a ray are the same in both, because its direction keeps the length that the map gives it.
// Needs from the program: lights[], surface_instances (seven rows each).
#include "generated/instancing.glsl"

#if SURFACE_INSTANCES
const uint ENTER_INSTANCE = 0x80000000u;  // triangle count of a node that is an instance

vec3 to_instance(uint instance, vec4 v) {
    uint row = surface_instances + 7u * instance;
    return vec3(dot(lights[row], v), dot(lights[row + 1u], v), dot(lights[row + 2u], v));
}

vec3 from_instance(uint instance, vec4 v) {
    uint row = surface_instances + 7u * instance + 3u;
    return vec3(dot(lights[row], v), dot(lights[row + 1u], v), dot(lights[row + 2u], v));
}

// A normal goes by the transposed inverse, so that it stays across the surface.
vec3 normal_from_instance(uint instance, vec3 n) {
    uint row = surface_instances + 7u * instance;
    return normalize(n.x * lights[row].xyz + n.y * lights[row + 1u].xyz + n.z * lights[row + 2u].xyz);
}

// Root node, the leaf it hangs from, material (0xffffffff: that of each triangle).
uvec3 instance_numbers(uint instance) {
    return floatBitsToUint(lights[surface_instances + 7u * instance + 6u].xyz);
}
#endif
