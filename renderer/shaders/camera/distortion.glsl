// Radial lens distortion (Brown 1971): a point at distance r from the axis, in focal lengths, is seen at distance
// r (1 + k1 r^2 + k2 r^4). Twin: renderer/distortion.py, which refuses lenses that these steps do not solve.
// Needs from the program: distortion = (k1, k2, half width and half height of the picture in focal lengths).

// One step of Newton's method toward s + a s^3 + b s^5 = 1.
float distortion_step(float s, float a, float b) {
    float q = s * s;
    return s - (s * (1.0 + q * (a + b * q)) - 1.0) / (1.0 + q * (3.0 * a + 5.0 * b * q));
}

// Where without the lens one would see what is seen at `place` in [-1, 1]^2.
vec2 undistorted(vec2 place) {
    vec2 far = place * distortion.zw;
    float r2 = dot(far, far);
    float a = distortion.x * r2;
    float b = distortion.y * r2 * r2;
    float s = distortion_step(distortion_step(distortion_step(1.0, a, b), a, b), a, b);
    return place * distortion_step(distortion_step(distortion_step(s, a, b), a, b), a, b);
}
