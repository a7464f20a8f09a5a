from __future__ import annotations

import subprocess
import sys

import pytest
from pydantic import ValidationError

from weft.files.key_texts import DescribedSchema
from weft.voxelize.config import VoxelizeConfig


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"voxel_size_mm": 0}, "greater than or equal to"),
        ({"voxel_size_mm": 1e30}, "less than or equal to 1000"),
        ({"voxel_size_mm": float("nan")}, "finite"),
        ({"voxel_size_mm": float("inf")}, "finite"),
        ({"voxel_size_mm": 1, "region_mm": ((0, 0, 0), (1, 0, 1))}, "first corner must lie below"),
        ({"voxel_size_mm": 1, "region_mm": ((0, 0, 0), (1, float("inf"), 1))}, "finite"),
        ({"voxel_size_mm": 1, "memory_mb": 0}, "greater than 0"),
        ({"voxel_size_mm": 1, "tile_voxels": 20}, "multiple of 8"),
        ({"voxel_size_mm": 1, "tile_voxels": 1024}, "less than or equal to 256"),
        ({"voxel_size_mm": 1, "formats": ["obj"]}, "vdb"),
        ({"voxel_size_mm": 1, "formats": []}, "at least 1"),
        ({"voxel_size_mm": 1, "formats": ["vdb", "vdb"]}, "named twice"),
        ({"voxel_size_mm": 1, "voxel_size": 1}, "Extra inputs"),
        ({}, "either voxel_size_mm or voxels_per_fiber_diameter or voxels_per_pixel"),
    ],
)
def test_wrong_settings_are_refused(values, message):
    with pytest.raises(ValidationError, match=message):
        VoxelizeConfig.model_validate(values)


def test_every_setting_is_described():
    schema = VoxelizeConfig.model_json_schema(schema_generator=DescribedSchema)
    assert all(field.get("description") for field in schema["properties"].values())


@pytest.mark.parametrize("module", ["config", "grid", "vdb", "nanovdb"])
def test_readers_start_without_warp(module):
    code = f"import sys, weft.voxelize.{module}; sys.exit('warp' in sys.modules or 'jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
