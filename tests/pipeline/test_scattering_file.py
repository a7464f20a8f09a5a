"""scattering.json gives back what was written, and refuses what is no table of numbers."""

import json
import tomllib

import pytest

from weft.fiber_model.scattering.config import ScatteringConfig
from weft.files.errors import InputError
from weft.pipeline.presets import CONFIGS, preset_names
from weft.pipeline.scattering_file import read_scattering, write_scattering


def preset(name):
    text = (CONFIGS / "presets" / "scattering" / f"{name}.toml").read_text(encoding="utf-8")
    return ScatteringConfig(**tomllib.loads(text)).to_parameters()


@pytest.mark.parametrize("name", preset_names("scattering"))
def test_every_preset_comes_back_as_it_was(tmp_path, name):
    write_scattering(tmp_path / "s.json", {"a": preset(name)})
    assert read_scattering(tmp_path / "s.json") == {"a": preset(name)}


@pytest.mark.parametrize("wrong", [7, [1.0, 2.0], [["a"]], [[1.0, None]], [[[1.0]]]])
def test_what_is_no_table_is_refused(tmp_path, wrong):
    path = tmp_path / "s.json"
    write_scattering(path, {"a": preset("cotton")})
    document = json.loads(path.read_text(encoding="utf-8"))
    document["media"]["a"]["azimuthal_table_tt"] = wrong
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match="azimuthal_table_tt needs rows of finite numbers"):
        read_scattering(path)
