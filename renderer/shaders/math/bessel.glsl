// exp(-x) I0(x) for x >= 0, to 4e-7 relative (Abramowitz and Stegun 9.8.1, 9.8.2), one value per lane.
vec3 bessel_i0e(vec3 x) {
    vec3 t = x / 3.75;
    vec3 s = min(t * t, vec3(1.0));
    vec3 small = exp(-min(x, vec3(3.75))) * (1.0 + s * (3.5156229 + s * (3.0899424 + s * (1.2067492 + s * (0.2659732
        + s * (0.0360768 + s * 0.0045813))))));
    vec3 large_x = max(x, vec3(3.75));
    vec3 r = 3.75 / large_x;
    vec3 large = (0.39894228 + r * (0.01328592 + r * (0.00225319 + r * (-0.00157565 + r * (0.00916281
        + r * (-0.02057706 + r * (0.02635537 + r * (-0.01647633 + r * 0.00392377)))))))) * inversesqrt(large_x);
    return vec3(x.x < 3.75 ? small.x : large.x, x.y < 3.75 ? small.y : large.y, x.z < 3.75 ? small.z : large.z);
}
