"""`weft inspect` knows every kind of yarn file, and says what it can of the radius and the unit."""

import pytest

from tests.fiber_model.yarns.formats.test_mitsuba_hair import binary
from tests.fiber_model.yarns.formats.test_read_file import WALK, write
from weft.fiber_model.yarns.config import NOT_IN_FILE
from weft.files.errors import InputError
from weft.pipeline.inspection.describe import READERS, describe


@pytest.mark.parametrize("suffix", sorted(set(NOT_IN_FILE) - {".npz", ".bcc", ".obj"}))
def test_every_kind_of_yarn_file(tmp_path, suffix):
    assert suffix in READERS
    write(tmp_path / f"walk{suffix}")
    lines = dict(
        line.strip().split("  ", 1) for line in describe(tmp_path / f"walk{suffix}") if "  " in line.strip()
    )
    unit = "mm" if suffix.startswith(".usd") else "file units"
    assert lines["yarns"].strip() == "1"
    assert (f"radius [{unit}]" in lines) == (suffix not in (".poly", ".mitshair"))
    if suffix.startswith(".usd"):
        assert (lines["unit [mm]"].strip(), lines["up axis"].strip()) == ("1", "Y")
    (tmp_path / f"walk{suffix}").write_bytes((tmp_path / f"walk{suffix}").read_bytes()[:100])
    with pytest.raises(InputError):
        describe(tmp_path / f"walk{suffix}")


def test_hair_of_mitsuba_without_radius(tmp_path):
    (tmp_path / "w.hair").write_bytes(binary([WALK]))
    assert not any("radius" in line for line in describe(tmp_path / "w.hair"))
