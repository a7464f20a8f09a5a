// A ray and a triangle (Moeller and Trumbore 1997), or the parallelogram of its two edges, or the ellipse in that.
// Needs from the program: lights[], surface_triangles (first row of the triangles; renderer/surfaces.py).

// Distance along the ray, or -1 where there is no meeting before `t_end`; places on the edges in `b`.
float triangle_distance(uint triangle, vec3 origin, vec3 direction, float t_end, out vec2 b) {
    uint row = surface_triangles + 3u * triangle;
    vec4 edge = lights[row + 1u];
    vec3 e1 = edge.xyz;
    vec3 e2 = lights[row + 2u].xyz;
    vec3 p = cross(direction, e2);
    float scale = 1.0 / dot(e1, p);
    vec3 s = origin - lights[row].xyz;
    vec3 q = cross(s, e1);
    b = vec2(dot(s, p), dot(direction, q)) * scale;
    float t = dot(e2, q) * scale;
    // written so that a division by zero misses
    vec2 m = b - 0.5;
    bool inside = edge.w == 0.0 ? b.x + b.y <= 1.0 : (edge.w == 1.0 ? max(b.x, b.y) <= 1.0 : dot(m, m) <= 0.25);
    bool meets = b.x >= 0.0 && b.y >= 0.0 && inside && t > 0.0 && t < t_end;
    return meets ? t : -1.0;
}
