"""Faults to inject into media beside the fibers, estimators and random numbers; see mutations.py."""

from __future__ import annotations

from tests.faults import Mutation

from .mutations import shader_fault

MEDIA = "tests/renderer/test_media.py::"
TRACKERS = "tests/renderer/test_trackers.py::"
RAYS = "tests/renderer/test_rays.py::"
RANDOM = "tests/renderer/shaders/test_rng.py::"

MEDIA_MUTATIONS: tuple[Mutation, ...] = (
    shader_fault(
        "colors not weighed where a flight ends without collision",
        "path/segments.glsl",
        "settle_colors(p, vec3(1.0));",
        "",
        MEDIA + "test_each_color_passes_a_slab_by_its_own_extinction",
    ),
    shader_fault(
        "balance heuristic without the extinction met",
        "medium/collide.glsl",
        "settle_colors(p, chosen.extinction);",
        "settle_colors(p, Extinction(1.0));",
        MEDIA + "test_each_color_scatters_once_in_a_slab_as_its_closed_form",
    ),
    shader_fault(
        "channel chosen evenly, weighed as if by throughput",
        "medium/colors.glsl",
        "float target = unit_float(bits) * (p.throughput.x + p.throughput.y + p.throughput.z);",
        "float target = 0.0;",
        MEDIA + "test_each_color_passes_a_slab_by_its_own_extinction",
    ),
    shader_fault(
        "shadow rays dimmed alike in all colors",
        "path/segments.glsl",
        "p.light *= color_transmittance(p.depths);",
        "",
        MEDIA + "test_each_color_scatters_once_in_a_slab_as_its_closed_form",
    ),
    shader_fault(
        "a step goes past the bound of a medium",
        "medium/media.glsl",
        "if (met && t < span.x) t_exit = min(t_exit, span.x);",
        "",
        MEDIA + "test_a_ball_dims_by_its_chord",
    ),
    shader_fault(
        "a medium 1 % wide of its box",
        "medium/media.glsl",
        "vec3 b = (bound_upper[i].xyz - origin) / direction;",
        "vec3 b = (1.02 * bound_upper[i].xyz - origin) / direction;",
        MEDIA + "test_each_color_passes_a_slab_by_its_own_extinction",
    ),
    shader_fault(
        "first of overlapping media taken at every collision",
        "medium/collide.glsl",
        "chosen.target *= -u;",
        "chosen.target = 0.0;",
        MEDIA + "test_media_in_any_order_give_one_picture",
    ),
    shader_fault(
        "color of a flight lost on resuming",
        "path/state.glsl",
        "uvec4(floatBitsToUint(p.depths), p.color);",
        "uvec4(floatBitsToUint(p.depths), 0u);",
        MEDIA + "test_no_scheduling_changes_a_bit_among_colored_media",
    ),
    shader_fault(
        "control not taken where a collision comes",
        "medium/residual_step.glsl",
        "1e-30)) - control * length;",
        "1e-30));",
        TRACKERS + "test_estimators_agree_to_a_few_thousandths",
    ),
    shader_fault(
        "residual rays given up before their end",
        "medium/residual_step.glsl",
        "if (over && p.depth_left < 0.0) {",
        "if (p.depth_left < 0.0) {",
        RAYS + "test_residual_rays_pass_where_their_bricks_are_empty",
    ),
    shader_fault(
        "marching begins at a whole step",
        "path/segments.glsl",
        "p.next_free = march_step * unit_float(random_words(p.rng).x);",
        "p.next_free = march_step;",
        TRACKERS + "test_marching_through_an_even_block_by_one_step_has_its_closed_form",
    ),
    shader_fault(
        "a step of MD5 turned by one bit too few",
        "rng/md5.glsl",
        "0xeb86d391u, 21)",
        "0xeb86d391u, 20)",
        RANDOM + "test_md5_is_that_of_the_key_s_16_bytes",
    ),
    shader_fault(
        "Sobol's second dimension like the first",
        "rng/sobol.glsl",
        "scramble_reversed(pascal(order), seeds.z)",
        "scramble_reversed(order, seeds.z)",
        RANDOM + "test_sobol_pairs_are_nets",
    ),
    shader_fault(
        "pairs of one dimension in one order",
        "rng/sobol.glsl",
        "uvec3(one.w, two.xy)",
        "one.xyz",
        RANDOM + "test_sobol_is_uniform_over_pixels_and_independent_over_dimensions",
    ),
)
