"""Small mathematics of the shaders, against numpy in double precision."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from tests.renderer.probe import probe
from weft.renderer.direction_encoding import DIRECTION_BITS, decode_axis

pytestmark = pytest.mark.gl


def directions(count):
    w = np.random.default_rng(1).normal(size=(count, 3))
    axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [1e-4, 0, -1]]
    w = np.concatenate([w, axes])
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


def test_arctangent_to_4e_7():
    arctangent = probe("math/arctangent.glsl", "float arctangent(float y, float x)")
    rng = np.random.default_rng(2)
    y, x = rng.normal(size=(2, 100_000)).astype(np.float32) * np.float32(10) ** rng.integers(
        -6, 3, (2, 100_000)
    )
    y, x = y.astype(np.float32), x.astype(np.float32)
    exact = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    assert np.abs(arctangent(y, x) - exact).max() < 4e-7
    small = np.abs(y) < 0.1 * x
    np.testing.assert_allclose(arctangent(y, x)[small], exact[small], rtol=3e-7)
    assert arctangent([0.0], [0.0]) == 0


def test_bessel_to_1e_6():
    bessel = probe("math/bessel.glsl", "vec3 bessel_i0e(vec3 x)")
    x = (
        np.concatenate([np.linspace(0, 20, 3000), np.geomspace(20, 2e4, 3000)])
        .astype(np.float32)
        .reshape(-1, 3)
    )
    np.testing.assert_allclose(bessel(x), special.i0e(x.astype(np.float64)), rtol=1e-6)


def test_fiber_frame_is_a_rotation_with_the_axis_first():
    axis = directions(10_000)
    frame = probe("math/frames.glsl", "mat3 fiber_frame(vec3 axis)")(axis)
    np.testing.assert_allclose(
        frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.det(frame), 1, atol=1e-6)
    np.testing.assert_array_equal(frame[:, 0], axis)


def test_axes_of_voxels_equal_their_twin():
    words = np.random.default_rng(5).integers(0, 2**32, 100_000, dtype=np.uint32)
    a, b = (words >> DIRECTION_BITS) & 1023, words & 1023
    words = words[(a < 1023) & (b < 1023)]  # the encoder leaves the last level out
    axis = probe("math/hemi_octahedral.glsl", "vec3 unscaled_axis(uint word)")(words)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    assert length.min() > 589
    np.testing.assert_allclose(axis / length, decode_axis(words), atol=1e-6)
