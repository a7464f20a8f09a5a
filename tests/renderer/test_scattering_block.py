"""The struct of scattering constants: the GLSL text is the generated one, rows have its size."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fiber_model.scattering.scattering_cases import CORNERS
from weft.fiber_model.scattering.longitudinal import gaussian_normalization
from weft.renderer.scattering_block import (
    BLOCK_SHADER,
    FLOATS_PER_MEDIUM,
    _normalization,
    fiber_block_glsl,
    pack_scattering,
)


def test_the_shader_file_is_the_generated_text():
    """When this fails: python -m weft.renderer.scattering_block."""
    assert BLOCK_SHADER.read_text(encoding="utf-8") == fiber_block_glsl()


@pytest.mark.parametrize("name", CORNERS)
def test_packs_finite_rows(name):
    rows = pack_scattering([CORNERS[name], CORNERS["wide"]])
    assert rows.shape == (2, FLOATS_PER_MEDIUM)
    assert rows.dtype == np.float32
    assert np.all(np.isfinite(rows))


@pytest.mark.parametrize("beta", [0.02, 0.1, 0.6, 1.2])
def test_the_normalization_is_the_closed_form(beta):
    theta = np.linspace(0, np.pi / 2, 50)
    growing = beta * (1 + np.cos(theta))
    np.testing.assert_allclose(_normalization(theta, beta), gaussian_normalization(theta, beta), rtol=1e-12)
    np.testing.assert_allclose(
        _normalization(theta, growing), gaussian_normalization(theta, growing), rtol=1e-12
    )
