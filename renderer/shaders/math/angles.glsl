// Angles that keep their digits, small or near a half turn.
#include "math/arctangent.glsl"

float angle_between(vec3 a, vec3 b) {
    return arctangent(length(cross(a, b)), dot(a, b));
}
