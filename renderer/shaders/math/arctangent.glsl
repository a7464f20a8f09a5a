// atan2 to 2e-7 rad on every driver. GLSL allows atan 4096 ulp, and Mesa's is off by 1e-6 or more, which a lobe of
// half a degree shows. Coefficients: Cephes atanf (Moshier 1992).
#include "math/constants.glsl"

float arctangent(float y, float x) {
    float ax = abs(x);
    float ay = abs(y);
    float low = min(ax, ay);
    float high = max(max(ax, ay), 1e-37);
    bool upper = low > 0.41421356 * high;  // tan(pi/8): reduce to [-tan(pi/8), tan(pi/8)]
    float t = upper ? (low - high) / (low + high) : low / high;
    float z = t * t;
    float series = ((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1;
    float angle = (upper ? 0.25 * PI : 0.0) + (series * z * t + t);
    angle = ay > ax ? HALF_PI - angle : angle;
    angle = x < 0.0 ? PI - angle : angle;
    return y < 0.0 ? -angle : angle;
}
