"""Measurement files: what is written comes back bit for bit; mistakes are refused with line and column."""

import io
import tracemalloc
import zipfile
from dataclasses import fields, replace

import numpy as np
import pytest

from tests.fitting.damage import read_damaged
from weft.files.errors import InputError
from weft.fitting.measurement_csv import degrees_text, radians_from
from weft.fitting.measurement_file import READERS, load_measurements, save_measurements
from weft.fitting.measurements import Measurements


def some_measurements(count=200, *, quantity="phase_function", channels=("r", "g", "b"), seed=3):
    rng = np.random.default_rng(seed)
    width = max(len(channels), 1)
    values = rng.lognormal(size=(count, width)) * 10.0 ** rng.integers(-20, 20, (count, width))
    return Measurements(
        theta_i=rng.uniform(0, np.pi / 2, count),
        phi_i=rng.uniform(-np.pi, np.pi, count),
        theta_o=rng.uniform(0, np.pi / 2, count),
        phi_o=rng.uniform(0, 2 * np.pi, count),
        values=values,
        sigma=0.02 * values + 1e-300,
        quantity=quantity,
        scale_known=False,
        usable=rng.random(count) < 0.9,
        channels=channels,
        source="a goniometer, ünïcode\nsecond line: with a colon, a comma and a # sign",
    )


def assert_identical(found, expected):
    for field in fields(Measurements):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(other, np.ndarray):
            assert one.dtype == other.dtype, field.name
            assert one.tobytes() == other.tobytes(), field.name
            assert one.shape == other.shape, field.name
        else:
            assert one == other, field.name


PLAIN = {"sigma": None, "usable": None, "source": "", "scale_known": True}


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".CSV"])
@pytest.mark.parametrize("changes", [{}, PLAIN], ids=["full", "plain"])
@pytest.mark.parametrize("channels", [("r", "g", "b"), (), ("400nm", "550.5nm")])
@pytest.mark.parametrize("quantity", ["phase_function", "bcsdf", "brdf"])
def test_what_is_written_comes_back_bit_for_bit(tmp_path, suffix, changes, channels, quantity):
    measurements = replace(some_measurements(quantity=quantity, channels=channels), **changes)
    path, again = tmp_path / f"one{suffix}", tmp_path / f"two{suffix}"
    save_measurements(measurements, path)
    loaded = load_measurements(path)
    assert_identical(loaded, measurements)
    save_measurements(loaded, again)
    assert path.suffix == ".npz" or path.read_bytes() == again.read_bytes()


def test_several_unnamed_channels_stay_unnamed(tmp_path):
    measurements = replace(some_measurements(), channels=())
    save_measurements(measurements, tmp_path / "m.csv")
    assert_identical(load_measurements(tmp_path / "m.csv"), measurements)


def test_every_angle_has_a_text_in_degrees_that_reads_back_to_it():
    rng = np.random.default_rng(8)
    tiny = 10.0 ** rng.uniform(-300, 0, 500) * rng.choice([-1.0, 1.0], 500)
    special = [0.0, -0.0, np.pi, -np.pi, np.pi / 2, np.nextafter(np.pi / 2, 0), 5e-324]
    radians = np.concatenate([rng.uniform(-2 * np.pi, 2 * np.pi, 20_000), tiny, special])
    found = radians_from(degrees_text(radians))
    assert found.tobytes() == radians.tobytes()


def test_round_angles_are_written_as_people_write_them():
    degrees = [0.0, 7.5, 15.0, 33.3, -45.0, 60.0, 89.9, 90.0, 137.52, 359.9999]
    assert degrees_text(np.deg2rad(degrees)) == [repr(angle) for angle in degrees]


WHOLE = """\
# weft measurements, version 1
# quantity: phase_function
# scale: free
# source: by hand
theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,value_r,value_g,sigma_r,sigma_g,usable
30,0,-30,180,0.5,0.25,0.01,0.005,1

# a remark between rows
 45 , 0.0, -44.5, 1.8e2, .5, 2.5e-1, 1e-2, 0.005, 0
"""


def test_a_file_written_by_hand_is_read(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("\ufeff" + WHOLE.replace("\n", "\r\n"), encoding="utf-8", newline="")
    found = load_measurements(path)
    expected = Measurements(
        theta_i=np.deg2rad([30.0, 45.0]),
        phi_i=np.zeros(2),
        theta_o=np.deg2rad([-30.0, -44.5]),
        phi_o=np.full(2, np.pi),
        values=np.array([[0.5, 0.25], [0.5, 0.25]]),
        sigma=np.array([[0.01, 0.005], [0.01, 0.005]]),
        usable=np.array([True, False]),
        quantity="phase_function",
        scale_known=False,
        channels=("r", "g"),
        source="by hand",
    )
    assert_identical(found, expected)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version 1", "version 2", ":1: 'weft measurements, version 2' found; this weft reads"),
        ("# quantity: phase_function\n", "", ": no line '# quantity: phase_function | bcsdf | brdf'"),
        ("# scale", "# scales", ": no line '# scale: known | free'; did you mean 'scales'?"),
        ("phase_function", "phase_funktion", ":2: quantity 'phase_funktion'; did you mean 'phase_function'?"),
        ("# scale: free\n", "", ": no line '# scale: known | free'"),
        ("free", "unknown", ":3: scale 'unknown'; did you mean 'known'?"),
        ("theta_o_deg", "theta_o", ":5: unknown column 'theta_o'; did you mean 'theta_o_deg'?"),
        ("theta_o_deg,", "", ":5: no column 'theta_o_deg'"),
        ("sigma_g", "sigma_b", ":5: unknown column 'sigma_b'; did you mean 'sigma_r'?"),
        (",sigma_g", "", ":5: no column 'sigma_g'"),
        ("value_g", "value_r", ":5: column 'value_r' stands twice"),
        ("value_r,value_g,sigma_r,sigma_g,usable", "usable", ":5: no column 'value', nor 'value_'"),
        ("30,0,-30", "30,0", ":6: 8 numbers in this row, but 9 columns"),
        ("0.25,0.01", "nan,0.01", ":6: value_g: found 'nan'; need a finite number"),
        ("0.25,0.01", "0.2x5,0.01", ":6: value_g: found '0.2x5'; need a finite number"),
        ("2.5e-1", "1e999", ":9: value_g: found '1e999'; need a finite number"),
        ("0.25,0.01", "0.25,-0.01", ":6: sigma_r: found '-0.01'; need a positive number"),
        ("0.25,0.01", "0.25,0", ":6: sigma_r: found '0'; need a positive number"),
        ("30,0,-30", "30,0,-130", ":6: theta_o_deg: found '-130'; need degrees from -90 to 90"),
        ("1.8e2", "1.8e3", ":9: phi_o_deg: found '1.8e3'; need degrees from -360 to 360"),
        ("0.005,1", "0.005,2", ":6: usable: found '2'; need 0 or 1"),
        ("phase_function", "brdf", ": theta of a 'brdf' is measured from the normal: 0 to 90 degrees"),
    ],
)  # fmt: skip
def test_mistakes_are_named_with_line_and_column(tmp_path, old, new, message):
    path = tmp_path / "m.csv"
    assert old in WHOLE
    path.write_text(WHOLE.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_measurements(path)
    assert str(caught.value).startswith(f"{path}{message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "# quantity: brdf\n", WHOLE[: WHOLE.index("30,0")]])
def test_empty_files_are_refused(tmp_path, text):
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.raises(InputError, match="no rows of measurements"):
        load_measurements(path)


def test_files_that_are_not_there_or_of_another_kind_are_refused(tmp_path):
    for name, message in [
        ("m.csv", "m.csv: cannot be read: No such file"),
        ("m.npz", "m.npz: no such file"),
        ("m.cvs", "m.cvs: measurements cannot be read from '.cvs' files; did you mean '.csv'?"),
    ]:
        with pytest.raises(InputError) as caught:
            load_measurements(tmp_path / name)
        assert message in str(caught.value)
    with pytest.raises(InputError, match=r"cannot be written to '\.exr'"):
        save_measurements(some_measurements(), tmp_path / "m.exr")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_a_missing_file_and_a_folder_are_refused_in_every_format(tmp_path, suffix):
    (tmp_path / f"folder{suffix}").mkdir()
    for name in (f"missing{suffix}", f"folder{suffix}"):
        with pytest.raises(InputError) as caught:
            load_measurements(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert "\n" not in str(caught.value)


def test_an_archive_that_claims_more_than_it_can_hold_is_refused_before_allocation(tmp_path):
    """A header of 8 TB, and a directory that says the bytes are there."""
    save_measurements(some_measurements(), tmp_path / "m.npz")
    with zipfile.ZipFile(tmp_path / "m.npz") as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    header = {"descr": "<f8", "fortran_order": False, "shape": (2**40,)}
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, header)
    members["theta_i.npy"] = buffer.getvalue()
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
        archive.getinfo("theta_i.npy").file_size = 2**44
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="is it damaged") as caught:
            load_measurements(tmp_path / "bomb.npz")
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()
    assert "implausible size" in str(caught.value.__cause__)


def test_channels_without_a_name_for_a_column_are_refused(tmp_path):
    for name in ("a,b", "1", "a b", ""):
        with pytest.raises(InputError, match="channel name"):
            save_measurements(replace(some_measurements(), channels=("r", name, "b")), tmp_path / "m.csv")
    assert not list(tmp_path.iterdir())


def test_archives_of_another_kind_are_refused(tmp_path):
    path = tmp_path / "m.npz"
    np.savez(path, points=np.zeros(3))
    with pytest.raises(InputError, match="not a file of measurements written by weft"):
        load_measurements(path)
    path.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"not a readable \.npz"):
        load_measurements(path)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_mutants_are_refused_or_read(tmp_path, suffix):
    path = tmp_path / f"m{suffix}"
    save_measurements(some_measurements(60), path)
    refused, good = read_damaged(load_measurements, path.read_bytes(), path, most_bytes=4 << 20)
    print(f"{refused} refused, {good} read")
