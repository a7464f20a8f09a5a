// A disk sampled by solid angle: it is seen as a spherical ellipse, mapped by polar coordinates around its middle
// (Guillen et al. 2017, "Area-preserving parameterizations for spherical ellipses"). Their map inverts an elliptic
// integral; here the slices' areas are interpolated linearly between five angles, and the density is that of this map,
// exactly: even within 1 % but for points very near to the disk's plane.
// Needs from the program: lights[].
#include "math/angles.glsl"

// The cone around the disk: |x / a|^2 + |y / b|^2 <= 1 in the plane at distance 1 across its axis.
struct SeenDisk {
    mat3 frame;  // x and y along the half axes, z along the cone's axis
    float a;     // tangents of the half angles
    float b;
    float height;  // of the disk along its normal; negative on its bright side
    float slices[5];  // areas of slices per angle, at every eighth of pi
};

// Area of a slice of the spherical ellipse, per angle and divided by a b: 1 / (s (s + 1)), s = 1 / cos(polar angle).
float disk_slice(float a, float b, vec2 turn) {
    float s = sqrt(1.0 + a * a * turn.x * turn.x + b * b * turn.y * turn.y);
    return 1.0 / (s * (s + 1.0));
}

SeenDisk see_disk(uint row, vec3 point) {
    vec3 half_x = lights[row + 1u].xyz;
    vec3 normal = lights[row + 3u].xyz;
    float radius = length(half_x);
    vec3 d = lights[row].xyz - point;
    SeenDisk seen;
    seen.height = dot(d, normal);
    vec3 across = d - seen.height * normal;
    float beside = length(across);
    vec3 e = beside > 1e-5 * radius ? across / beside : half_x / radius;
    // in the plane of e and the normal: the nearest and the farthest point of the edge
    float z = (seen.height < 0.0 ? -1.0 : 1.0) * max(abs(seen.height), 1e-5 * radius);
    vec2 near = vec2(beside - radius, z);
    vec2 far = vec2(beside + radius, z);
    float sizes = length(near) * length(far);
    float along = dot(near, far);
    float turned = 2.0 * radius * abs(z);  // |near x far|
    seen.a = along > 0.0 ? turned / (sizes + along) : (sizes - along) / turned;
    vec2 n = normalize(near);
    vec2 f = normalize(far);
    vec2 axis = along > 0.0 ? n + f : vec2(f.y - n.y, f.x - n.x) * vec2(-1.0, 1.0) * (z < 0.0 ? -1.0 : 1.0);
    axis = normalize(axis);
    float place = z * axis.x / axis.y;
    float off = place - beside;
    seen.b = sqrt(max(radius * radius - off * off, 1e-10 * radius * radius)) / length(vec2(place, z));
    vec3 axis_3 = axis.x * e + axis.y * normal;
    vec3 side = axis.y * e - axis.x * normal;
    seen.frame = mat3(side, cross(axis_3, side), axis_3);
    seen.slices = float[5](disk_slice(seen.a, seen.b, vec2(1.0, 0.0)),
                           disk_slice(seen.a, seen.b, vec2(0.923879533, 0.382683432)),
                           disk_slice(seen.a, seen.b, vec2(0.707106781, 0.707106781)),
                           disk_slice(seen.a, seen.b, vec2(0.382683432, 0.923879533)),
                           disk_slice(seen.a, seen.b, vec2(0.0, 1.0)));
    return seen;
}

// Solid angle of the disk as the map has it.
float disk_solid_angle(SeenDisk s) {
    float quarter = 0.5 * (s.slices[0] + s.slices[4]) + s.slices[1] + s.slices[2] + s.slices[3];
    return s.a * s.b * quarter * HALF_PI;
}

// Density in the direction whose ellipse angle, in the first quarter, has this cosine and sine.
float disk_density(SeenDisk s, vec2 turn) {
    float place = arctangent(turn.y, turn.x) * (8.0 / PI);
    float low = place < 2.0 ? (place < 1.0 ? s.slices[0] : s.slices[1]) : (place < 3.0 ? s.slices[2] : s.slices[3]);
    float high = place < 2.0 ? (place < 1.0 ? s.slices[1] : s.slices[2]) : (place < 3.0 ? s.slices[3] : s.slices[4]);
    float interpolated = mix(low, high, clamp(place - clamp(floor(place), 0.0, 3.0), 0.0, 1.0));
    return interpolated / (disk_slice(s.a, s.b, turn) * disk_solid_angle(s));
}

float disk_pdf(uint row, vec3 point, vec3 away) {
    SeenDisk s = see_disk(row, point);
    vec3 local = away * s.frame;
    vec2 turn = abs(local.xy) / vec2(s.a, s.b);
    float size = length(turn);
    return disk_density(s, size > 0.0 ? turn / size : vec2(1.0, 0.0));
}

// From the point to a place on the disk.
vec3 disk_sample(uint row, vec3 point, vec2 u, out float pdf) {
    SeenDisk s = see_disk(row, point);
    float quarters = 4.0 * u.x;
    uint quarter = uint(min(quarters, 3.0));
    // the part of the quarter's slices before the chosen one, in eighths of pi
    vec4 parts = 0.5 * vec4(s.slices[0] + s.slices[1], s.slices[1] + s.slices[2], s.slices[2] + s.slices[3],
                            s.slices[3] + s.slices[4]);
    float rest = (quarters - float(quarter)) * dot(parts, vec4(1.0));
    float low = s.slices[0];
    float high = s.slices[1];
    float start = 0.0;
    if (rest > parts.x) {
        rest -= parts.x;
        low = s.slices[1];
        high = s.slices[2];
        start = 1.0;
        if (rest > parts.y) {
            rest -= parts.y;
            low = s.slices[2];
            high = s.slices[3];
            start = 2.0;
            if (rest > parts.z) {
                rest -= parts.z;
                low = s.slices[3];
                high = s.slices[4];
                start = 3.0;
            }
        }
    }
    float place = 2.0 * rest / (low + sqrt(max(low * low + 2.0 * (high - low) * rest, 0.0)));
    float angle = (start + clamp(place, 0.0, 1.0)) * (PI / 8.0);
    vec2 turn = vec2(cos(angle), sin(angle));
    pdf = disk_density(s, turn);
    vec2 ellipse = vec2(s.a, s.b) * turn;
    float t = dot(ellipse, ellipse);
    float drop = u.y * t * disk_slice(s.a, s.b, turn);  // 1 - cosine of the polar angle
    ellipse *= vec2(quarter == 1u || quarter == 2u ? -1.0 : 1.0, quarter >= 2u ? -1.0 : 1.0)
        * (sqrt(drop * (2.0 - drop)) * inversesqrt(t));
    vec3 w = s.frame * vec3(ellipse, 1.0 - drop);
    return w * (s.height / dot(w, lights[row + 3u].xyz));
}
