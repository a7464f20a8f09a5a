"""Reconstruction filters: samples and weights together make the filter, and pictures are its convolution."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import integrate

from weft.renderer.config import (
    BoxFilter,
    ConstantLight,
    GaussianFilter,
    LanczosFilter,
    OrthographicCamera,
    RenderConfig,
)
from weft.renderer.pixel_filter import CELLS, KINDS, filter_uniforms, filter_value
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .probe import probe
from .volumes import uniform_grid, volume

FILTERS = [
    GaussianFilter(),
    GaussianFilter(radius_px=2, sigma_px=0.8),
    LanczosFilter(),
    LanczosFilter(radius_px=3),
]
PRELUDE = f"uniform float filter_edges[{CELLS + 1}];\nuniform vec4 filter_shape;\n"


def place(pixel_filter, u):
    call = probe(
        "film/filter.glsl",
        "float filter_place(float u, out float weight)",
        prelude=PRELUDE,
        constants={"PIXEL_FILTER": KINDS[pixel_filter.kind], "FILTER_CELLS": CELLS},
        uniforms=filter_uniforms(pixel_filter),
    )
    return (values.astype(float) for values in call(u))


def normalized(pixel_filter):
    """The filter with integral 1, and that integral's moments, by adaptive quadrature."""
    radius = pixel_filter.radius_px
    total = integrate.quad(lambda x: filter_value(pixel_filter, np.array(x)), -radius, radius, limit=200)[0]
    return lambda x: filter_value(pixel_filter, x) / total


@pytest.mark.gl
@pytest.mark.parametrize("pixel_filter", FILTERS, ids=str)
def test_weighted_places_make_the_filter(pixel_filter):
    """Sums of weights per interval are the filter's integrals over it; even numbers leave 2e-5 of error."""
    u = (np.arange(1 << 18) + 0.5) / (1 << 18)
    x, weight = place(pixel_filter, u.astype(np.float32))
    radius = pixel_filter.radius_px
    assert np.abs(x).max() <= radius
    edges = np.linspace(-radius, radius, 41)
    seen = np.histogram(x, edges, weights=weight)[0] / len(u)
    f = normalized(pixel_filter)
    exact = [integrate.quad(f, a, b)[0] for a, b in itertools.pairwise(edges)]
    np.testing.assert_allclose(seen, exact, atol=1e-4)
    assert weight.mean() == pytest.approx(1, abs=2e-5)
    assert (weight < 0).any() == (pixel_filter.kind == "lanczos")


@pytest.mark.gl
@pytest.mark.parametrize("pixel_filter", [BoxFilter(), *FILTERS], ids=str)
def test_an_edge_becomes_the_filters_integral(pixel_filter):
    """Opacity across the straight edge of an opaque sheet, through the middle of a pixel.

    The error of a column's mean is taken from its 64 pixels; 1e-4 for all columns of a picture.
    """
    grid = uniform_grid((2, 2, 1), 500.0, (1, 0, 0))  # ends at x = 0.8 mm
    size, pixels = 0.01, 9
    camera = OrthographicCamera(
        position_mm=(0.8, 0.4, 5.0), target_mm=(0.8, 0.4, 0.0), frame_width_mm=size * pixels
    )
    config = RenderConfig(
        resolution=(pixels, 64),
        samples_per_pixel=256,
        camera=camera,
        lights=[ConstantLight()],
        background=(1, 1, 1),
        max_bounces=1,
        filter=pixel_filter,
    )
    result = run(config, volume(grid), {"a": IsotropicPhase((0, 0, 0))})
    seen = result.layers["A"].astype(float)
    if pixel_filter.kind == "box":
        expected = np.array([1, 1, 1, 1, 0.5, 0, 0, 0, 0])
    else:
        f, radius = normalized(pixel_filter), pixel_filter.radius_px
        middles = np.arange(pixels) - pixels // 2
        expected = np.array([integrate.quad(f, -radius, np.clip(-m, -radius, radius))[0] for m in middles])
    # black cloth before a white background: what is not covered is seen
    for image, truth in ((seen, expected), (result.radiance[..., 0].astype(float), 1 - expected)):
        error = image.std(axis=0, ddof=1) / 8
        assert error.max() < 0.01
        assert np.abs((image.mean(axis=0) - truth) / np.maximum(error, 1e-5)).max() < 4.8


@pytest.mark.gl
def test_the_filter_reaches_along_both_axes():
    """The same edge, lying: rows instead of columns, each with the sign of both weights."""
    grid, pixels, chosen = uniform_grid((2, 2, 1), 500.0, (1, 0, 0)), 9, LanczosFilter()
    camera = OrthographicCamera(position_mm=(0.4, 0.8, 5.0), target_mm=(0.4, 0.8, 0.0), frame_width_mm=0.32)
    config = RenderConfig(
        resolution=(64, pixels),
        samples_per_pixel=256,
        camera=camera,
        lights=[ConstantLight()],
        max_bounces=1,
        filter=chosen,
    )
    seen = run(config, volume(grid), {"a": IsotropicPhase((0, 0, 0))}).layers["A"][::-1].astype(float)
    f, radius = normalized(chosen), chosen.radius_px
    middles = np.arange(pixels) - pixels // 2
    expected = np.array([integrate.quad(f, -radius, np.clip(-m, -radius, radius))[0] for m in middles])
    error = seen.std(axis=1, ddof=1) / 8
    assert np.abs((seen.mean(axis=1) - expected) / np.maximum(error, 1e-5)).max() < 4.8


@pytest.mark.gl
def test_a_crop_has_the_bits_of_the_whole():
    grid = volume(uniform_grid((2, 2, 1), 0.3, (1, 2, 0)))
    config = RenderConfig(resolution=(24, 40), samples_per_pixel=3, filter=GaussianFilter())
    whole = run(config, grid, {"a": IsotropicPhase()})
    part = run(config.model_copy(update={"crop": (5, 7, 11, 20)}), grid, {"a": IsotropicPhase()})
    assert part.statistics.paths == 11 * 20 * 3
    for name, layer in part.layers.items():
        np.testing.assert_array_equal(layer, whole.layers[name][7:27, 5:16], err_msg=name)


def test_a_crop_outside_of_the_picture_is_refused():
    with pytest.raises(ValidationError, match=r"crop ends at \(17, 16\), outside of the picture, 16 x 16"):
        RenderConfig(resolution=(16, 16), crop=(9, 8, 8, 8))


@pytest.mark.gl
def test_layers_count_samples_and_cut_paths():
    grid = volume(uniform_grid((3, 3, 3), 0.8, (0, 1, 0)))
    config = RenderConfig(resolution=(16, 16), samples_per_pixel=16, max_bounces=8, lights=[ConstantLight()])
    result = run(config, grid, {"a": IsotropicPhase()})
    assert (result.layers["samples"] == 16).all()
    assert result.layers["cut"].sum() == result.statistics.cut_paths > 100
