"""Volumes and films at the edge of what makes sense: rendered right, or refused in one line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from weft.renderer.config import ConstantLight, OrthographicCamera, PerspectiveCamera, RenderConfig
from weft.renderer.render import run
from weft.renderer.simple_phases import IsotropicPhase

from .statistics import Z_LIMIT, z_score
from .test_transport import TABLE
from .volumes import VOXEL_MM, projected_extinction, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

LIGHT = {"lights": [ConstantLight()], "background": "environment"}


@pytest.mark.parametrize("correlation", ["none", "fibers"])
def test_a_camera_inside_of_a_white_volume_sees_white(correlation):
    """Its rays begin among fibers; error probability 1e-4."""
    middle = (0.6, 0.6, 0.6)
    config = RenderConfig(
        resolution=(24, 24),
        samples_per_pixel=64,
        max_bounces=10**6,
        camera=PerspectiveCamera(position_mm=middle, target_mm=(1.0, 0.7, 0.5), fov_deg=60),
        correlation=correlation,
        sampling="both_plain",  # with "both" every path brings 1 to the last digit
        **LIGHT,
    )
    result = run(config, volume(random_grid((3, 3, 3), seed=21, peak=0.4)), {"a": TABLE["reference"]})
    assert result.layers["A"].mean() > 0.1
    assert abs(z_score(result, 1.0)) < Z_LIMIT


@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_density_above_one_is_never_clipped(tracking):
    """Where generated fibers overlap: volume fraction 2.5 dims two and a half times as much as 1."""
    layer = uniform_grid((1, 1, 1), 2.5, (0.0, 1.0, 0.0), radius=0.5)
    config = RenderConfig(
        resolution=(64, 64),
        samples_per_pixel=16,
        camera=OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3),
        tracking=tracking,
        **LIGHT,
    )
    result = run(config, volume(layer), {"a": IsotropicPhase((0.0, 0.0, 0.0))})
    expected = math.exp(-projected_extinction(2.5, 0.0, 0.5) * 8 * VOXEL_MM)
    assert 0.2 < expected < 0.8
    assert abs(z_score(result, expected)) < Z_LIMIT


def test_a_volume_ten_thousand_times_too_dense_is_black_or_white_but_finite():
    config = RenderConfig(resolution=(8, 8), samples_per_pixel=2, max_bounces=50, **LIGHT)
    result = run(config, volume(uniform_grid((1, 1, 1), 1e4, (0, 1, 0))), {"a": TABLE["reference"]})
    assert all(np.isfinite(result.layers[name]).all() for name in "RGBA")
    assert result.statistics.broken_samples == 0


@pytest.mark.parametrize("resolution", [(0, 64), (64, 0), (-1, 64)])
def test_a_film_without_pixels_is_refused(resolution):
    with pytest.raises(ValidationError, match="greater than or equal to 1"):
        RenderConfig(resolution=resolution)


def test_a_crop_without_pixels_is_refused():
    with pytest.raises(ValidationError, match="greater than or equal to 1"):
        RenderConfig(crop=(3, 3, 0, 5))
