"""A volume holds all fiber of slubs, cords and free hairs, whatever the split of the work."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.yarns.yarns import YarnSet
from weft.voxelize import voxelize
from weft.voxelize.config import VoxelizeConfig

from .conftest import COTTON

VARIED = {
    "variation": {
        "thickness_sd": 0.2,
        "thickness_length_mm": 2.0,
        "slubs_per_m": 80.0,
        "slub_length_mm": 6.0,
    },
    "walk_hairs": {"density_per_mm": 2.0, "length_mm": 1.5, "persistence_mm": 0.5},
    "droop_hairs": {"density_per_mm": 2.0, "length_mm": 2.0, "bend_mm": 1.0},
}


@pytest.fixture(scope="module")
def varied() -> FiberSet:
    """A loop of two cords and an open single, each with slubs and hairs of all kinds."""
    t = np.arange(24) * 2 * np.pi / 24
    loop = 2.5 * np.stack([np.cos(t), np.sin(t), 0.2 * np.sin(2 * t)], axis=1)
    line = np.stack([np.linspace(-4, 4, 9), np.zeros(9), 1.5 + np.zeros(9)], axis=1)
    yarns = YarnSet.checked(
        [loop, line], closed=[True, False], radius=0.4, yarn_type=[0, 1], type_names=("cable", "single")
    )
    config = FibersConfig(**COTTON, **VARIED, cords=2, by_type={"single": {"cords": 1, "plies": 1}})
    return run(config, yarns)


def test_varied_yarns_conserve_length(varied) -> None:
    volume = voxelize.run(VoxelizeConfig(voxel_size_mm=0.15), varied)
    lengths = varied.fiber_lengths_mm().sum(axis=1)
    for medium, (name, grid) in enumerate(volume.grids.items()):
        expected = lengths[varied.stretch_type() == medium].sum()
        assert grid.fiber_length_mm == pytest.approx(expected, rel=1e-5), name
        grid.check_values()


def test_bits_of_varied_yarns_do_not_depend_on_tiles_or_workers(varied) -> None:
    hashes = {
        voxelize.run(
            VoxelizeConfig(voxel_size_mm=0.1, tile_voxels=tile), varied, worker_count=workers
        ).content_sha256
        for tile, workers in ((128, 1), (16, 2), (48, 5))
    }
    assert len(hashes) == 1
