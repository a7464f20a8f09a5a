// Orthonormal frames around a unit vector, without branches on its direction (Duff et al. 2017, JCGT 6(1)).

// b1, b2 and n are right-handed: cross(b1, b2) = n.
void orthonormal_basis(vec3 n, out vec3 b1, out vec3 b2) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    b1 = vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x);
    b2 = vec3(b, s + n.y * n.y * a, -n.y);
}

// Local frame of a fiber: x is its axis. world = frame * local, local = world * frame.
mat3 fiber_frame(vec3 axis) {
    vec3 b1;
    vec3 b2;
    orthonormal_basis(axis, b1, b2);
    return mat3(axis, b1, b2);
}
