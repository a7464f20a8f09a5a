// One step of the walk through the hierarchy of surfaces, looking for the nearest one before p.t_end: one node, and its
// triangles where it is a leaf. No stack: each node knows the next one, hit or missed, for the six main directions.
// Needs from the program: lights[], surface_nodes, surface_triangles, with instances surface_instances.
#include "geometry/box.glsl"
#include "geometry/triangle.glsl"
#include "geometry/instance.glsl"
#include "path/segments.glsl"

// +x, -x, +y, -y, +z, -z: the axis along which the ray moves fastest.
uint main_direction(vec3 d) {
    vec3 a = abs(d);
    uint axis = a.x >= a.y ? (a.x >= a.z ? 0u : 2u) : (a.y >= a.z ? 1u : 2u);
    float along = axis == 0u ? d.x : (axis == 1u ? d.y : d.z);
    return 2u * axis + uint(along < 0.0);
}

void try_triangle(inout Path p, uint triangle, vec3 origin, vec3 direction) {
    vec2 b;
    float t = triangle_distance(triangle, origin, direction, p.t_end, b);
    if (t > 0.0) {
        p.t_end = t;
        p.triangle = triangle;
#if SURFACE_INSTANCES
        p.met_instance = p.instance;
#endif
    }
}

// The node after this one, hit in x and missed in y.
uvec2 next_nodes(uint row, vec3 direction) {
    uint order = main_direction(direction);
    vec4 links = lights[row + 2u + (order >> 1u)];
    return floatBitsToUint((order & 1u) == 0u ? links.xy : links.zw);
}

void seek(inout Path p) {
    uint row = surface_nodes + 5u * p.node;
    vec4 lower = lights[row];
    vec4 upper = lights[row + 1u];
    vec3 origin = p.origin;
    vec3 direction = p.direction;
#if SURFACE_INSTANCES
    if (p.instance != NO_INSTANCE) {
        origin = to_instance(p.instance, vec4(p.origin, 1.0));
        direction = without_zeros(to_instance(p.instance, vec4(p.direction, 0.0)));
    }
#endif
    uvec2 next = next_nodes(row, direction);
    bool meets = meets_box(lower.xyz, upper.xyz, origin, 1.0 / direction, p.t_end);
    uint count = meets ? floatBitsToUint(upper.w) : 0u;
    uint first = floatBitsToUint(lower.w);
    p.node = meets ? next.x : next.y;
#if SURFACE_INSTANCES
    if (count == ENTER_INSTANCE) {
        p.instance = first;
        p.node = instance_numbers(first).x;
        return;
    }
#endif
    if (count > 0u) try_triangle(p, first, origin, direction);
    if (count > 1u) try_triangle(p, first + 1u, origin, direction);
    bool blocked = p.sought == MODE_SHADOW && p.triangle != NO_TRIANGLE;
#if SURFACE_INSTANCES
    if (p.node == NO_NODE && p.instance != NO_INSTANCE) {
        // back among the instances: a leaf there has the same link, hit or missed
        p.node = next_nodes(surface_nodes + 5u * instance_numbers(p.instance).y, p.direction).x;
        p.instance = NO_INSTANCE;
    }
#endif
    if (p.node == NO_NODE || blocked) end_seek(p);
}
