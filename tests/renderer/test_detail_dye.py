"""Dye in coarser levels: drawn from the level that a brick is drawn at."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.config import BoxFilter
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase, build_scene
from weft.renderer.volume_levels import VolumeLevels
from weft.voxelize.grid import FiberVolume

from .test_detail import ALONG, BLACK, bar, independent_levels, leveled, looking, with_dye, written_finely
from .volumes import volume


@pytest.mark.gl
def test_dye_is_that_of_the_voxel_at_every_level():
    """Against the same voxels written finely: color, first and once scattered, pixel by pixel."""
    grids = [with_dye(level.grids["a"], seed) for seed, level in enumerate(independent_levels().levels)]
    levels = VolumeLevels(tuple(volume(grid) for grid in grids))
    config = looking(ALONG, 3.0, filter=BoxFilter(), max_bounces=1)
    phase = {"a": IsotropicPhase((0.9, 0.9, 0.9))}
    mixed = run(config, levels, phase)
    fine = run(config.model_copy(update={"detail_pixels": None}), written_finely(levels, config), phase)
    assert sum(share.brick_count > 0 for share in mixed.statistics.detail) >= 3
    for name in ("albedo.R", "albedo.G", "albedo.B"):
        assert fine.layers[name].std() > 0.02
        assert np.isclose(mixed.layers[name], fine.layers[name], atol=2e-3).mean() > 0.98


@pytest.mark.gl
def test_one_dye_draws_the_same_picture_as_a_phase_of_that_color():
    """Bit by bit but for rounding, from the finest level to the coarsest."""
    dye = np.square(np.float32([300, 700, 1000]) / 1023)
    plain = bar()
    albedo = (plain.density > 0)[..., None] * dye
    dyed = leveled(volume(dataclasses.replace(plain, albedo=albedo.astype(np.float32))), count=4)
    config = looking(ALONG, 3.0)
    one = run(config, dyed, {"a": IsotropicPhase((1.0, 1.0, 1.0))})
    other = run(config, leveled(volume(plain), count=4), {"a": IsotropicPhase(tuple(map(float, dye)))})
    assert sum(share.brick_count > 0 for share in one.statistics.detail) >= 3
    assert np.isclose(one.radiance, other.radiance, rtol=1e-3).mean() > 0.995


def test_levels_of_which_only_some_have_dye_are_refused():
    levels = leveled(volume(with_dye(bar(), 1)))
    coarser = volume(*(dataclasses.replace(grid, albedo=None) for grid in levels.levels[1].grids.values()))
    mixture = VolumeLevels((levels.levels[0], FiberVolume({"a": coarser.grids["a"]})))
    with pytest.raises(InputError, match=r"only some of the volume's levels have colors"):
        build_scene(looking(ALONG, 1.0), mixture, BLACK)
