"""Fiber length is conserved for every preset, at every voxel size, however the work is split."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.voxelize import run

PRESETS = sorted((Path(__file__).parents[2] / "configs" / "presets" / "fibers").glob("*.toml"))
THIN = 1.9
"""Voxel size in fiber radii, less than a diameter: a fiber is 61 lines."""


def crossing(preset: Path, half_mm: float):
    """Two crossing curved yarns of a preset as it was fitted."""
    from weft.fiber_model.config import FibersConfig
    from weft.fiber_model.fibers import run as lay_fibers
    from weft.fiber_model.yarns.yarns import YarnSet

    t = np.linspace(-half_mm, half_mm, 7)
    along_x = np.stack([t, 0.3 * np.cos(2 * t), 0.2 * np.sin(t)], axis=1)
    along_y = np.stack([0.3 * np.sin(2 * t), t, 0.5 - 0.2 * np.cos(t)], axis=1)
    yarns = YarnSet(
        points=np.concatenate([along_x, along_y]),
        offsets=np.array([0, 7, 14]),
        closed=np.array([False, False]),
        radius=np.array([0.2, 0.2]),
        yarn_type=np.zeros(2, np.int32),
        type_names=("yarn",),
    )
    values = tomllib.loads(preset.read_text())
    return lay_fibers(FibersConfig(**values, scale="as_fitted", seed=3), yarns)


@pytest.mark.parametrize("voxel_size", [0.5, 0.06, "thin"])
@pytest.mark.parametrize("preset", PRESETS, ids=lambda path: path.stem)
def test_length_is_conserved(preset, voxel_size):
    """To 1e-5, in tiles of 16 and of 128 voxels, and with the cloth cut in two: the same length each time."""
    fibers = crossing(preset, 0.02 if voxel_size == "thin" else 0.8)
    size = THIN * fibers.fiber_radius_mm[0] if voxel_size == "thin" else voxel_size
    expected = fibers.fiber_lengths_mm().sum()
    for tile, workers in ((16, 2), (128, 1)):
        config = VoxelizeConfig(voxel_size_mm=size, tile_voxels=tile)
        volume = run(config, fibers, worker_count=workers)
        assert volume.fiber_length_mm == pytest.approx(expected, rel=1e-5)
        assert volume.report.generated_length_mm == pytest.approx(expected, rel=1e-5)
    far = 1000 * size
    halves = [((-far, -far, -far), (0.0, far, far)), ((0.0, -far, -far), (far, far, far))]
    parts = [run(config.model_copy(update={"region_mm": half}), fibers) for half in halves]
    assert sum(part.fiber_length_mm for part in parts) == pytest.approx(expected, rel=1e-5)
