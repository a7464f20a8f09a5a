"""Faults to inject into surfaces and the lights that are shapes; see mutations.py."""

from __future__ import annotations

from tests.faults import Mutation

from .mutations import shader_fault

PRINCIPLED = "tests/renderer/test_principled.py::"
MERL = "tests/renderer/test_merl.py::"
LIGHT_SHAPES = "tests/renderer/test_light_sampling.py::"
SURFACES = "tests/renderer/test_surfaces.py::"

SURFACE_MUTATIONS: tuple[Mutation, ...] = (
    shader_fault(
        "density of visible normals without its half",
        "surface/principled.glsl",
        "0.5 * smith_gtr2(wo, alpha) * gtr2(h, alpha)",
        "0.49 * smith_gtr2(wo, alpha) * gtr2(h, alpha)",
        PRINCIPLED + "test_samples_follow_their_density",
    ),
    shader_fault(
        "clearcoat's density without its half vector's",
        "surface/principled.glsl",
        "gtr1(h, clearcoat_alpha(m)) * h.z / (4.0 * dot(wo, h))",
        "gtr1(h, clearcoat_alpha(m)) * h.z / (2.0 * dot(wo, h))",
        PRINCIPLED + "test_samples_follow_their_density",
    ),
    shader_fault(
        "clearcoat sampled by half its sheet",
        "surface/principled.glsl",
        "pow(a2, 1.0 - u.x)",
        "pow(a2, 1.0 - u.x * u.x)",
        PRINCIPLED + "test_samples_follow_their_density",
    ),
    shader_fault(
        "sheen not tinted",
        "surface/principled.glsl",
        "m.sheen * mix(vec3(1.0), tint, m.sheen_tint)",
        "m.sheen * vec3(1.0)",
        PRINCIPLED + "test_equals_its_twin_and_is_reciprocal",
    ),
    shader_fault(
        "anisotropy the other way around",
        "surface/principled.glsl",
        "vec2(a / aspect, a * aspect)",
        "vec2(a * aspect, a / aspect)",
        PRINCIPLED + "test_equals_its_twin_and_is_reciprocal",
    ),
    shader_fault(
        "metal keeps its diffuse part",
        "surface/principled.glsl",
        "m.color + sheen) * (1.0 - m.metallic);",
        "m.color + sheen);",
        PRINCIPLED + "test_equals_its_twin_and_is_reciprocal",
    ),
    shader_fault(
        "density of measured half vectors 2 % high",
        "surface/merl.glsl",
        "cell.x / (4.0 * dot(wo, h))",
        "1.02 * cell.x / (4.0 * dot(wo, h))",
        MERL + "test_samples_follow_their_density",
    ),
    shader_fault(
        "alias of a measured cell not followed",
        "surface/merl.glsl",
        "chosen = place - float(chosen) < link.y ? chosen : floatBitsToUint(link.z);",
        "",
        MERL + "test_samples_follow_their_density",
    ),
    shader_fault(
        "solid angle of a mesh light's triangle 2 % high",
        "light/triangle.glsl",
        "return solid_angle > 0.0 ? 1.0 / solid_angle",
        "return solid_angle > 0.0 ? 0.98 / solid_angle",
        LIGHT_SHAPES + "test_samples_follow_their_density_and_lie_on_the_light",
    ),
    shader_fault(
        "area lights met by scattered rays not weighed",
        "path/surface.glsl",
        "p.throughput * emitted * phase_weight(pdf, p.phase_pdf);",
        "p.throughput * emitted;",
        LIGHT_SHAPES + "test_a_mesh_of_two_triangles_gives_the_closed_form_of_the_quad",
    ),
    shader_fault(
        "sampled lights at surfaces not weighed",
        "path/surface.glsl",
        "light.value * light_weight(light.pdf, eval_pdf);",
        "light.value;",
        SURFACES + "test_how_directions_are_chosen_does_not_change_the_mean",
    ),
)
