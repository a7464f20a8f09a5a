"""Files: what is written reads back bit by bit; what is broken is refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from weft.files.errors import InputError
from weft.renderer.image import read_exr, read_rgb, srgb, write_exr, write_preview


def layers(height=5, width=7):
    rng = np.random.default_rng(1)
    names = ["R", "G", "B", "A", "variance.R", "T.X", "Z"]
    return {name: rng.random((height, width)).astype(np.float32) for name in names}


def test_exr_is_lossless_and_keeps_its_attributes(tmp_path):
    channels = layers()
    channels["Z"][0, 0] = np.inf
    write_exr(tmp_path / "a.exr", channels, {"weft.version": "1.2", "weft.samplesPerPixel": 7})
    read, attributes = read_exr(tmp_path / "a.exr")
    assert sorted(read) == sorted(channels)
    for name, data in channels.items():
        np.testing.assert_array_equal(read[name], data)
        assert read[name].dtype == np.float32
    assert attributes["weft.version"] == "1.2"
    assert attributes["weft.samplesPerPixel"] == 7


def test_the_callers_arrays_stay_arrays(tmp_path):
    channels = layers()
    before = dict(channels)
    write_exr(tmp_path / "a.exr", channels, {})
    assert all(channels[name] is before[name] for name in before)


@pytest.mark.parametrize("view", [np.s_[::-1], np.s_[:, ::2], np.s_[..., 1]], ids=str)
def test_strided_channels_are_written_as_they_look(tmp_path, view):
    data = np.random.default_rng(2).random((6, 8, 3)).astype(np.float32)
    channel = data[view] if data[view].ndim == 2 else data[view][..., 0]
    write_exr(tmp_path / "a.exr", {"R": channel}, {})
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr")[0]["R"], channel)


def test_a_truncated_file_is_refused(tmp_path):
    path = tmp_path / "a.exr"
    write_exr(path, layers(64, 64), {})
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match=r"a.exr: (an OpenEXR file with 0 readable parts|not a readable)"):
        read_exr(path)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.exr").write_text("not a picture")
    with pytest.raises(InputError, match=r"a.exr: not a readable OpenEXR file"):
        read_exr(tmp_path / "a.exr")
    with pytest.raises(InputError, match=r"b.exr: no such file"):
        read_exr(tmp_path / "b.exr")


def test_missing_channels_are_named(tmp_path):
    write_exr(tmp_path / "a.exr", {"R": np.ones((2, 2)), "Y": np.ones((2, 2))}, {})
    with pytest.raises(InputError, match=r"no channel G, B; found R, Y"):
        read_rgb(tmp_path / "a.exr")


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.exr"
    write_exr(path, layers(), {})
    before = path.read_bytes()
    with pytest.raises(Exception, match=r"."):
        write_exr(path, {"R": np.ones((2, 2)), "G": np.ones((3, 3))}, {})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


def test_preview_is_srgb(tmp_path):
    gray = np.full((2, 2, 3), 0.2158605, np.float32)  # 128 / 255 in sRGB
    write_preview(tmp_path / "a.png", gray)
    assert np.unique(np.asarray(Image.open(tmp_path / "a.png"))) == [128]
    write_preview(tmp_path / "a.png", gray / 2, exposure=1.0)
    assert np.unique(np.asarray(Image.open(tmp_path / "a.png"))) == [128]


def test_srgb_survives_what_is_not_finite():
    np.testing.assert_allclose(srgb(np.array([-1.0, 0.0, np.nan, np.inf, 2.0])), [0, 0, 0, 1, 1], atol=1e-15)
