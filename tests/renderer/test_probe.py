"""The probe itself: every argument type goes in and comes out as it was."""

from __future__ import annotations

import numpy as np
import pytest

from tests.renderer.probe import probe

pytestmark = pytest.mark.gl

PIECE = """
float scale(vec3 a, float s) { return s * (a.x + 10.0 * a.y + 100.0 * a.z); }
uint swap(inout uvec2 pair, int add, bool negate, out vec2 half_pair) {
    pair = pair.yx;
    half_pair = vec2(pair) * 0.5;
    return uint(negate ? -add : add);
}
mat3 columns(mat3 m) { return m; }
"""


def test_arguments_broadcast():
    scale = probe([], "float scale(vec3 a, float s)", prelude=PIECE)
    result = scale(np.array([[1.0, 2, 3], [4, 5, 6]])[:, None], np.array([1.0, 2, 3]))
    np.testing.assert_array_equal(result, [[321, 642, 963], [654, 1308, 1962]])


def test_out_parameters_follow_the_result():
    swap = probe([], "uint swap(inout uvec2 pair, int add, bool negate, out vec2 half_pair)", prelude=PIECE)
    result, pair, half = swap(np.array([[1, 2], [3, 4]]), 7, False)
    np.testing.assert_array_equal(result, [7, 7])
    np.testing.assert_array_equal(pair, [[2, 1], [4, 3]])
    np.testing.assert_array_equal(half, [[1, 0.5], [2, 1.5]])


def test_matrices_and_many_items():
    columns = probe([], "mat3 columns(mat3 m)", prelude=PIECE)
    matrices = np.random.default_rng(1).random((1 << 17, 3, 3), np.float32)
    np.testing.assert_array_equal(columns(matrices), matrices)
