"""UTIA tables: bit for bit through files, each number in its direction; what is damaged is refused."""

from dataclasses import replace

import numpy as np
import pytest

from tests.fitting.analytic_brdf import lambert_and_ggx
from tests.fitting.damage import MUTANTS, damaged_binary, read_damaged
from weft.files.errors import InputError
from weft.fitting.measurement_file import load_measurements, save_measurements
from weft.fitting.surface_directions import vectors
from weft.fitting.utia import FILE_BYTES, read_utia


@pytest.fixture
def file(tmp_path):
    """Numbers that say where they stand, some of them negative."""
    numbers = np.arange(3 * 288 * 288, dtype="<f8")
    numbers[5::1000] *= -0.1
    path = tmp_path / "synthetic.bin"
    numbers.tofile(path)
    return path


def test_each_number_belongs_to_its_direction(file):
    found = load_measurements(file)
    for plane, ti, pi, tv, pv in [(0, 0, 0, 0, 0), (1, 2, 30, 5, 47), (2, 5, 47, 0, 1)]:
        row = 288 * (48 * ti + pi) + 48 * tv + pv
        degrees = [15.0 * ti, 7.5 * pi, 15.0 * tv, 7.5 * pv]
        names = ("theta_i", "phi_i", "theta_o", "phi_o")
        assert np.allclose([np.rad2deg(getattr(found, name)[row]) for name in names], degrees)
        assert found.values[row, plane] == plane * 288 * 288 + row
    assert not found.scale_known
    assert (~found.usable).sum() == np.unique(np.arange(5, 3 * 288**2, 1000) % 288**2).size


def test_files_round_trip_bit_for_bit_in_any_order(file, tmp_path):
    found = load_measurements(file)
    order = np.random.default_rng(0).permutation(len(found))
    names = ("theta_i", "phi_i", "theta_o", "phi_o", "values", "usable")
    shuffled = replace(found, **{name: getattr(found, name)[order] for name in names})
    save_measurements(shuffled, tmp_path / "again.bin")
    assert (tmp_path / "again.bin").read_bytes() == file.read_bytes()
    assert file.stat().st_size == FILE_BYTES == 1_990_656


def test_a_table_filled_from_a_function_is_that_function(file, tmp_path):
    grid = load_measurements(file)
    light, detector = vectors(grid.theta_i, grid.phi_i), vectors(grid.theta_o, grid.phi_o)
    save_measurements(replace(grid, values=lambert_and_ggx(light, detector)), tmp_path / "f.bin")
    found = load_measurements(tmp_path / "f.bin")
    assert found.usable.all()
    assert np.array_equal(found.values, lambert_and_ggx(light, detector))


def test_directions_off_the_grid_are_refused(file, tmp_path):
    found = load_measurements(file)
    bent = replace(found, theta_o=found.theta_o + 1e-3)
    missing = replace(found, **{name: getattr(found, name)[1:] for name in
                                ("theta_i", "phi_i", "theta_o", "phi_o", "values", "usable")})  # fmt: skip
    for wrong, message in [
        (bent, "direction theta 0.0572958, phi 0 degrees is none of UTIA's grid"),
        (missing, "each of 82944 pairs of directions once; there are 82943"),
        (replace(found, quantity="bcsdf"), "holds a 'brdf' in three channels"),
    ]:
        with pytest.raises(InputError, match=message):
            save_measurements(wrong, tmp_path / "wrong.bin")
    assert not (tmp_path / "wrong.bin").exists()


def test_damaged_files_are_refused(file):
    whole = file.read_bytes()
    for data, message in [
        (whole[:-8], "a UTIA .bin file has 1990656 bytes, this file 1990648. Is it truncated?"),
        (
            whole[:80] + np.array([np.nan]).tobytes() + whole[88:],
            ":byte 80: found a number that is not finite",
        ),
    ]:
        file.write_bytes(data)
        with pytest.raises(InputError) as caught:
            load_measurements(file)
        assert message in str(caught.value)


@pytest.mark.parametrize("count", [50, pytest.param(MUTANTS, marks=pytest.mark.proof)])
def test_mutants_are_refused_or_read(file, count):
    refused, good = read_damaged(
        read_utia,
        file.read_bytes(),
        file,
        most_bytes=5 * FILE_BYTES,
        count=count,
        damage=damaged_binary(0),
    )
    print(f"{refused} refused, {good} read")
