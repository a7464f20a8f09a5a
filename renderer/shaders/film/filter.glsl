// Filter importance sampling (Ernst, Stamminger and Greiner 2006): a sample is placed around its pixel in proportion
// to the filter's absolute value and counts for that pixel alone, so that no sum is shared between pixels. What the
// table of places misses of the filter's shape, and its sign, is in the weight; its mean is 1.
// Needs from the program: filter_edges[] (places of equal chance), filter_shape = (radius, sigma or tau, value of the
// Gaussian at its radius, 1 / integral).
#include "math/constants.glsl"
#constant PIXEL_FILTER
#constant FILTER_CELLS

float sinc(float x) {
    float y = PI * x;
    return abs(y) < 1e-3 ? 1.0 - y * y / 6.0 : sin(y) / y;
}

// Along one axis, `x` in pixels from the middle of the pixel.
float filter_value(float x) {
#if PIXEL_FILTER == 2
    return sinc(x) * sinc(x / filter_shape.y);
#else
    return max(exp(-0.5 * x * x / (filter_shape.y * filter_shape.y)) - filter_shape.z, 0.0);
#endif
}

// Where a uniform number lands, and the weight it has there.
float filter_place(float u, out float weight) {
    float cell = min(floor(u * float(FILTER_CELLS)), float(FILTER_CELLS) - 1.0);
    float low = filter_edges[int(cell)];
    float width = filter_edges[int(cell) + 1] - low;
    float x = low + width * (u * float(FILTER_CELLS) - cell);
    weight = filter_value(x) * filter_shape.w * width * float(FILTER_CELLS);
    return x;
}

// From the middle of the pixel.
vec2 filter_offset(vec2 u, out float weight) {
    vec2 weights;
    vec2 place = vec2(filter_place(u.x, weights.x), filter_place(u.y, weights.y));
    weight = weights.x * weights.y;
    return place;
}
