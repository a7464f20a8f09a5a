"""`weft inspect` shows what measurements cover, whatever their format."""

from dataclasses import replace

import pytest

from tests.files.measured.test_rgl import synthetic
from tests.fitting.test_measurement_file import some_measurements
from weft.files.errors import InputError
from weft.files.measured.rgl import write_rgl
from weft.fitting.measurement_file import READERS as FORMATS
from weft.fitting.measurement_file import save_measurements
from weft.pipeline.inspection.describe import READERS, describe


def facts(path):
    lines = [line.strip().split("  ", 1) for line in describe(path)]
    return {line[0]: line[1].strip() for line in lines if len(line) == 2}


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".alta"])
def test_our_own_and_alta(tmp_path, suffix):
    rows = some_measurements(quantity="brdf")
    if suffix == ".alta":
        rows = replace(rows, sigma=None, usable=None)
    save_measurements(rows, tmp_path / f"m{suffix}")
    found = facts(tmp_path / f"m{suffix}")
    assert found["content"] == "measurements"
    assert found["quantity"] == "brdf"
    assert found["directions"] == "200"
    assert found["usable"] == str(200 if rows.usable is None else rows.usable.sum())
    assert found["scale"] == ("known" if suffix == ".alta" else "free")
    assert (found["sigma"] == "not stated") == (suffix == ".alta")
    assert "goniometer" in found["source"]


def test_many_channels_are_counted(tmp_path):
    write_rgl(synthetic(isotropic=True), tmp_path / "m.bsdf")
    assert facts(tmp_path / "m.bsdf")["angles of the light"] == "6"


def test_every_format_of_measurements_is_known(tmp_path):
    assert set(FORMATS) <= set(READERS)
    (tmp_path / "m.csv").write_text("no numbers")
    with pytest.raises(InputError, match=r"m\.csv:1: unknown column"):
        describe(tmp_path / "m.csv")
