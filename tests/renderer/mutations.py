"""Faults to inject into the renderer, each with a test that must turn red (test_mutations.py)."""

from __future__ import annotations

from tests.faults import Mutation

SHADERS = "renderer/shaders/"
TRACKING = "tests/renderer/test_tracking.py::"
TRANSPORT = "tests/renderer/test_transport.py::"
FIBER = "tests/renderer/shaders/test_phase_fiber.py::"
QUARTER_PERCENT = TRACKING + "test_extinction_is_right_to_a_quarter_percent"


def shader_fault(name: str, file: str, right: str, wrong: str, test: str) -> Mutation:
    return Mutation(name, SHADERS + file, right, wrong, test)


TRACKING_MUTATIONS = (
    shader_fault(
        "extinction 1 % low",
        "medium/volume.glsl",
        "float extinction = float(word >> 20) * extinction_per_level;",
        "float extinction = float(word >> 20) * extinction_per_level * 0.99;",
        QUARTER_PERCENT,
    ),
    shader_fault(
        "majorant 2 % low",
        "medium/volume.glsl",
        "majorant * (1.0 + 1e-6)",
        "majorant * 0.98",
        TRACKING + "test_transmittance_follows_the_angle_to_the_fibers",
    ),
    shader_fault(
        "missing null event",
        "medium/track_delta.glsl",
        "} else if (unit_float(bits.y) < real) {",
        "} else {",
        TRACKING + "test_transmittance_of_a_random_volume",
    ),
    shader_fault(
        "ratio tracking without its ratio",
        "medium/track_delta.glsl",
        "log(max(1.0 - real, 1e-30))",
        "-real",
        TRANSPORT + "test_shadow_estimators_agree_to_a_few_thousandths",
    ),
    shader_fault(
        "fiber axis not normalized in the extinction",
        "medium/volume.glsl",
        "1.0 - cosine * cosine / dot(axis, axis)",
        "1.0 - cosine * cosine",
        TRACKING + "test_transmittance_follows_the_angle_to_the_fibers",
    ),
    shader_fault(
        "free flights 2 % long",
        "path/state.glsl",
        "return -log((float(bits) + 0.5) * 2.3283064365386963e-10);",
        "return -1.02 * log((float(bits) + 0.5) * 2.3283064365386963e-10);",
        TRACKING + "test_free_flight_distribution",
    ),
    shader_fault(
        "the same random numbers for every sample",
        "rng/random.glsl",
        "return pcg4d(key);",
        "return pcg4d(uvec4(key.x, 0u, key.zw));",
        "tests/renderer/shaders/test_rng.py::test_uniform_and_uncorrelated_along_an_index",
    ),
    shader_fault(
        "state lost on resuming",
        "path/state.glsl",
        "uvec4(p.rng.x, p.rng.y, floatBitsToUint(p.next_free), wanted)",
        "uvec4(p.rng.x, p.rng.y, 0u, wanted)",
        "tests/renderer/test_kernel.py::test_delta_tracking_is_as_deterministic",
    ),
    shader_fault(
        "dropped last bounce",
        "path/scatter.glsl",
        "if (p.bounce >= max_bounces) {",
        "if (p.bounce + 1u >= max_bounces) {",
        TRANSPORT + "test_single_scattering_in_a_slab",
    ),
    shader_fault(
        "light counted twice",
        "path/samples.glsl",
        "phase_weight(environment.w, p.phase_pdf)",
        "1.0",
        TRANSPORT + "test_white_furnace",
    ),
    shader_fault(
        "roulette without its weight",
        "path/scatter.glsl",
        "survives ? p.throughput / survival : vec3(0.0)",
        "survives ? p.throughput : vec3(0.0)",
        TRANSPORT + "test_russian_roulette_keeps_the_mean",
    ),
    shader_fault(
        "shadow rays given up without their survivors' weight",
        "path/segments.glsl",
        "max(exp(p.depth_left - p.shadow_depth), SHADOW_ROULETTE)",
        "exp(p.depth_left - p.shadow_depth)",
        TRANSPORT + "test_single_scattering_in_a_slab",
    ),
    shader_fault(
        "first medium taken at every collision",
        "medium/volume.glsl",
        "float target = u * sum;",
        "float target = 0.0;",
        TRANSPORT + "test_the_order_of_media_does_not_matter",
    ),
    shader_fault(
        "phase weight 1 % high",
        "phase/fiber.glsl",
        "fiber_lobes_value(lobes, densities) / pdf : vec3(0.0)",
        "fiber_lobes_value(lobes, densities) / pdf * 1.01 : vec3(0.0)",
        TRANSPORT + "test_white_furnace_by_phase_sampling_alone_is_exact",
    ),
    shader_fault(
        "theta_o and -theta_o swapped",
        "phase/fiber_longitudinal.glsl",
        "float sin_sum = sin_i * cos_o + cos_i * sin_o;",
        "float sin_sum = sin_i * cos_o - cos_i * sin_o;",
        FIBER + "test_equals_its_twin",
    ),
    shader_fault(
        "TT sampled toward the light",
        "phase/fiber.glsl",
        "phi += is_tt ? PI : 0.0;",
        "phi += 0.0;",
        FIBER + "test_samples_follow_the_pdf",
    ),
    shader_fault(
        "Schlick's fifth power a fourth",
        "phase/fiber.glsl",
        "(1.0 - grazing2 * grazing2 * grazing);",
        "(1.0 - grazing2 * grazing2);",
        FIBER + "test_albedo_equals_its_twin",
    ),
    shader_fault(
        "wrong envelope of the rejection",
        "phase/fiber_longitudinal.glsl",
        "float variance = 1.0 / (1.0 / (beta * beta) + 2.0);",
        "float variance = beta * beta;",
        FIBER + "test_samples_follow_the_pdf",
    ),
    shader_fault(
        "tails drawn 10 % too wide",
        "phase/fiber_tail.glsl",
        "float drop = min(2.0, 2.0 * spread * u.x / (spread + 2.0 * (1.0 - u.x)));",
        "float drop = min(2.0, 2.4 * spread * u.x / (spread + 2.0 * (1.0 - u.x)));",
        FIBER + "test_samples_follow_the_pdf[case38]",
    ),
    shader_fault(
        "tails drawn, but not weighed",
        "phase/fiber.glsl",
        "wi.x, cos_i), lobes.tail_weight);",
        "wi.x, cos_i), vec3(0.0));",
        FIBER + "test_equals_its_twin[tails]",
    ),
    shader_fault(
        "tails as often at every angle",
        "phase/fiber.glsl",
        "lobes.tail_weight = s.tail_weight.xyz + grazing * s.grow_tail.xyz;",
        "lobes.tail_weight = s.tail_weight.xyz;",
        FIBER + "test_equals_its_twin[tails]",
    ),
    shader_fault(
        "Henyey and Greenstein backward",
        "phase/henyey_greenstein.glsl",
        "vec3 sum = wo + wi;",
        "vec3 sum = wo - wi;",
        "tests/renderer/shaders/test_phase_henyey_greenstein.py",
    ),
    shader_fault(
        "hash with another constant",
        "rng/philox.glsl",
        "0x9E3779B9u",
        "0x9E3779B8u",
        "tests/renderer/shaders/test_rng.py",
    ),
    shader_fault(
        "no jitter within the pixel",
        "camera/camera.glsl",
        "return vec2(bits >> 8) * (1.0 / 16777216.0);",
        "return vec2(0.5);",
        TRANSPORT + "test_edges_are_smoothed",
    ),
    shader_fault(
        "environment mirrored where it is sampled",
        "light/lights.glsl",
        "vec3(radius * sin(phi), y, -radius * cos(phi))",
        "vec3(-radius * sin(phi), y, -radius * cos(phi))",
        "tests/renderer/test_lights.py",
    ),
    shader_fault(
        "lens 1 % small",
        "camera/lens.glsl",
        "vec2 place = lens.x *",
        "vec2 place = 0.99 * lens.x *",
        "tests/renderer/test_lens.py",
    ),
    shader_fault(
        "ends of flakes not seen",
        "medium/volume.glsl",
        "cosine *= sqrt(1.0 - flake_roughness * flake_roughness);",
        "",
        "tests/renderer/test_simple_media.py::test_flakes_hide_their_projected_area",
    ),
    shader_fault(
        "emission counted without what dims it",
        "path/scatter.glsl",
        "p.radiance += p.throughput * phase_emission(phase);",
        "p.radiance += phase_emission(phase) * 1.02;",
        "tests/renderer/test_simple_media.py::test_a_glowing_slab_has_its_closed_form",
    ),
    shader_fault(
        "own fiber met again",
        "medium/correlated_step.glsl",
        "s.others = s.fibers - max(p.run.own, 0.0);",
        "s.others = s.fibers;",
        "tests/renderer/test_fiber_correlation.py::test_the_volume_is_about_as_bright_as_its_fibers",
    ),
    shader_fault(
        "paths leave the middle of a fiber",
        "medium/fiber_front.glsl",
        "    p.t = t;",
        "",
        "tests/renderer/test_fiber_correlation.py::test_the_volume_is_about_as_bright_as_its_fibers",
    ),
    shader_fault(
        "a slanted fiber counted more than once",
        "medium/volume.glsl",
        "max(axis.x, max(axis.y, axis.z)) / (2.0",
        "(axis.x + axis.y + axis.z) / (2.0",
        "tests/renderer/test_fiber_correlation.py::test_a_slanted_fiber_hides_its_width",
    ),
    shader_fault(
        "a fiber in two voxels taken for two",
        "medium/correlated_step.glsl",
        "if (p.run.fibers >= 1.0) p.run",
        "p.run",
        "tests/renderer/test_fiber_correlation.py::test_half_a_fiber_in_each_of_two_layers_is_one",
    ),
    Mutation(
        "half a voxel's shift",
        "renderer/scene.py",
        "tuple((camera.position - pool.corner_mm) / pool.voxel_size_mm)",
        "tuple((camera.position - pool.corner_mm) / pool.voxel_size_mm + 0.5)",
        TRACKING + "test_transmittance_of_a_random_volume",
    ),
    Mutation(
        "empty boxes one cell too wide",
        "renderer/brick_pool.py",
        "np.clip(distance - 1, 0, 0xFFFF)",
        "np.clip(distance, 0, 0xFFFF)",
        "tests/renderer/test_brick_pool.py",
    ),
    Mutation(
        "fiber volume of a brick not kept",
        "renderer/brick_pool.py",
        "step = density.sum(axis=1, dtype=np.float64) / np.maximum(levels.sum(axis=1), 1)",
        "step = peak[:, 0] / DENSITY_LEVELS * 1.001",
        "tests/renderer/test_brick_pool.py",
    ),
    Mutation(
        "extinction without its 2/pi",
        "renderer/scene.py",
        "return 2 * size / (math.pi * radius)",
        "return size / radius",
        TRACKING + "test_transmittance_follows_the_angle_to_the_fibers",
    ),
)
