// The thin lens: rays start on the aperture and meet in the plane of focus, where the pinhole's ray would.
// Needs from the program: camera_forward, camera_right, camera_up, lens = (radius [voxels], distance of the plane of
// focus [voxels], corners of the aperture or 0, its rotation [rad]).
#include "math/constants.glsl"

// Uniform on the unit disk, areas kept, neighbors kept (Shirley and Chiu 1997).
vec2 disk_place(vec2 u) {
    vec2 s = 2.0 * u - 1.0;
    bool wide = abs(s.x) > abs(s.y);
    float radius = wide ? s.x : s.y;
    float ratio = radius == 0.0 ? 0.0 : (wide ? s.y / s.x : s.x / s.y);
    float angle = wide ? 0.25 * PI * ratio : HALF_PI - 0.25 * PI * ratio;
    return radius * vec2(cos(angle), sin(angle));
}

// Uniform in the regular polygon with its corners on the unit circle, one of them at the angle `rotation`.
vec2 polygon_place(float corners, float rotation, vec2 u) {
    float side = min(floor(u.x * corners), corners - 1.0);
    float r = sqrt(u.x * corners - side);
    vec2 angles = (vec2(side, side + 1.0) * TWO_PI) / corners + rotation;
    vec2 x = cos(angles);
    vec2 y = sin(angles);
    return r * vec2(mix(x.x, x.y, u.y), mix(y.x, y.y, u.y));
}

// Moves the pinhole's ray to a place on the lens.
void lens_ray(vec2 u, inout vec3 origin, inout vec3 direction) {
    vec2 place = lens.x * (lens.z > 0.0 ? polygon_place(lens.z, lens.w, u) : disk_place(u));
    vec3 start = place.x * normalize(camera_right) + place.y * normalize(camera_up);
    direction = normalize(direction * (lens.y / dot(direction, camera_forward)) - start);
    origin += start;
}
