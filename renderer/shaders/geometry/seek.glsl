// One step of the walk through the hierarchy of surfaces, looking for the nearest one before p.t_end: one node, and its
// triangles where it is a leaf. No stack: each node knows the next one, hit or missed, for the six main directions.
// Needs from the program: lights[], surface_nodes, surface_triangles.
#include "geometry/box.glsl"
#include "geometry/triangle.glsl"
#include "path/segments.glsl"

// +x, -x, +y, -y, +z, -z: the axis along which the ray moves fastest.
uint main_direction(vec3 d) {
    vec3 a = abs(d);
    uint axis = a.x >= a.y ? (a.x >= a.z ? 0u : 2u) : (a.y >= a.z ? 1u : 2u);
    float along = axis == 0u ? d.x : (axis == 1u ? d.y : d.z);
    return 2u * axis + uint(along < 0.0);
}

void try_triangle(inout Path p, uint triangle) {
    vec2 b;
    float t = triangle_distance(triangle, p.origin, p.direction, p.t_end, b);
    if (t > 0.0) {
        p.t_end = t;
        p.triangle = triangle;
    }
}

void seek(inout Path p) {
    uint row = surface_nodes + 5u * p.node;
    vec4 lower = lights[row];
    vec4 upper = lights[row + 1u];
    uint order = main_direction(p.direction);
    vec4 links = lights[row + 2u + (order >> 1u)];
    uvec2 next = floatBitsToUint((order & 1u) == 0u ? links.xy : links.zw);
    bool meets = meets_box(lower.xyz, upper.xyz, p.origin, 1.0 / p.direction, p.t_end);
    uint count = meets ? floatBitsToUint(upper.w) : 0u;
    uint first = floatBitsToUint(lower.w);
    if (count > 0u) try_triangle(p, first);
    if (count > 1u) try_triangle(p, first + 1u);
    p.node = meets ? next.x : next.y;
    bool blocked = p.sought == MODE_SHADOW && p.triangle != NO_TRIANGLE;
    if (p.node == NO_NODE || blocked) end_seek(p);
}
