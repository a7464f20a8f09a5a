// The beginning and the end of a sample: a camera ray, and what the finished path adds to its pixel.
#include "camera/camera.glsl"
#constant CAMERA_LENS
#constant CAMERA_DISTORTION
#constant PIXEL_FILTER
#constant BRICK_POOL
#include "generated/distortion.glsl"  // camera/distortion.glsl, camera/lens.glsl, film/filter.glsl; empty where the
#include "generated/lens.glsl"        // scene needs none
#include "generated/filter.glsl"
#include "path/scatter.glsl"

const uint NO_PIXEL = 0xffffffffu;
const uint LENS_DIMENSION = 0xfffffffeu;  // which no path of less than a billion events reaches

// Light met on leaving the volume; a path that ran into nothing sees the background.
vec3 escaped_radiance(Path p) {
    vec4 environment = environment_eval(p.direction);
    // until it meets something a path has throughput 1, but where it saw colored media
    if (p.bounce == 0u) return p.throughput * (background.w > 0.0 ? environment.rgb : background.rgb);
    return p.throughput * environment.rgb * phase_weight(environment.w, p.phase_pdf);
}

// Where in the picture the sample lies [pixels], and how much it counts: 1, or what the filter says.
vec2 sample_place(uvec4 rng, out float weight) {
    uvec4 shift = pcg4d(uvec4(rng.x, 0xffffffffu, 0u, seed));
    vec2 pixel = vec2(rng.x % image_size.x, rng.x / image_size.x);
    vec2 jitter = pixel_jitter(rng.y, shift.xy);
    weight = 1.0;
#if PIXEL_FILTER
    return pixel + 0.5 + filter_offset(jitter, weight);
#else
    return pixel + jitter;
#endif
}

void finish_sample(inout Path p) {
    p.radiance += escaped_radiance(p);
    bool broken = any(isnan(p.radiance)) || any(isinf(p.radiance));
    broken_samples += uint(broken);
    float opacity = p.bounce > 0u ? 1.0 : 0.0;
    vec3 radiance = broken ? vec3(0.0) : p.radiance;
#if PIXEL_FILTER
    float weight;
    sample_place(p.rng, weight);
    radiance *= weight;
    film_add_filtered_opacity(film_place(p), weight * opacity);
#endif
    film_add_sample(film_place(p), radiance, opacity);
    finished_samples += 1u;
    p.mode = MODE_IDLE;
}

void start_camera_ray(inout Path p) {
    float weight;
    vec2 place = sample_place(p.rng, weight) / vec2(image_size) * 2.0 - 1.0;
#if CAMERA_DISTORTION
    place = undistorted(place);
#endif
    camera_ray(vec2(place.x, -place.y), p.origin, p.direction);
#if CAMERA_LENS
    lens_ray(unit_interval(random_bits(uvec4(p.rng.xy, LENS_DIMENSION, seed))).xy, p.origin, p.direction);
#endif
    p.direction = without_zeros(p.direction);
    p.radiance = vec3(0.0);
    p.throughput = vec3(1.0);
    p.bounce = 0u;
#if FIBER_CORRELATION
    p.left_axis = vec3(0.0);
    p.run = NO_FIBERS;
#endif
    p.phase_pdf = 0.0;
    p.rng.z = 0u;
    uvec4 bits = random_words(p.rng);
    p.depth_left = exponential(bits.x);
    p.next_free = p.depth_left;
#if EXTINCTION_RGB
    choose_color(p, bits.y);
#endif
    vec3 size = vec3(grid_cells * 8);
#if SURFACES
    p.t = 0.0;
    p.voxel = ivec3(floor(p.origin));
    start_seek(p, NO_END, MODE_FLIGHT);
#else
    p.t = enter_box(size, p.origin, p.direction);
    p.voxel = clamp(ivec3(floor(p.origin + p.direction * p.t)), ivec3(0), grid_cells * 8 - 1);
    p.mode = p.t < 0.0 ? MODE_ESCAPED : MODE_FLIGHT;
#endif
}

// The next sample of the lane's block of a pixel, or the first one of the next block nobody has taken: all pixels of a
// block of samples come before those of the next block.
void start_sample(inout Path p) {
    p.rng.y += 1u;
    bool block_done = (p.rng.y & ((1u << block_shift) - 1u)) == 0u || p.rng.y >= sample_end;
    if (p.rng.x == NO_PIXEL || block_done) {
        uint taken = atomicAdd(counters[COUNTER_PIXEL], 1u);
        if (taken >= film_pixel_count() * block_count) {
            p.rng.x = NO_PIXEL;
            p.mode = MODE_DONE;
            return;
        }
#if BRICK_POOL
        p.slot = taken;
#endif
        p.rng.x = nth_pixel(taken % film_pixel_count());
        p.rng.y = max(sample_begin, (first_block + taken / film_pixel_count()) << block_shift);
    }
    start_camera_ray(p);
}
