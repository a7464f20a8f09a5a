"""Files that an input reads in its turn decide the result, too."""

from __future__ import annotations

import pytest
import trimesh

from weft.files.errors import InputError
from weft.pipeline.cache import stage_key
from weft.pipeline.config import load
from weft.pipeline.stages import CHAIN

JOB = """[yarns]
kind = "garment"
[yarns.surface]
kind = "mesh"
file = "ball.gltf"
[yarns.pattern]
kind = "knit"
stitch_width_mm = 20.0
"""


def test_a_changed_buffer_of_a_gltf_changes_the_key(tmp_path):
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.icosphere()))
    for name, data in files.items():
        (tmp_path / ("ball.gltf" if name == "model.gltf" else name)).write_bytes(data)
    (tmp_path / "job.toml").write_text(JOB)
    buffer = next(tmp_path.glob("*.bin"))

    def key():
        return stage_key(CHAIN["yarns"], load(tmp_path / "job.toml", (), None), {}).digest

    before = key()
    assert key() == before
    data = bytearray(buffer.read_bytes())
    data[5] ^= 1
    buffer.write_bytes(data)
    assert key() != before
    buffer.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        key()
