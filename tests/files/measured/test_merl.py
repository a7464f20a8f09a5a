"""MERL tables: bit for bit through files; the value of a direction is that of the cell it falls in."""

import struct

import numpy as np
import pytest

from tests.fitting.analytic_brdf import lambert_and_ggx
from tests.fitting.damage import MUTANTS, damaged_binary, read_damaged
from weft.files.errors import InputError
from weft.files.measured.merl import (
    CELLS,
    FILE_BYTES,
    HEADER_BYTES,
    SCALE,
    MerlTable,
    cell_of,
    center_directions,
    read_merl,
    write_merl,
)

ALL = np.arange(CELLS[0] * CELLS[1] * CELLS[2])


def cells(light, detector):
    return np.ravel_multi_index(cell_of(light, detector), CELLS)


@pytest.fixture(scope="module")
def table():
    """Lambert and GGX in the cells whose center lies above the surface; the others not measured."""
    light, detector = center_directions()
    above = (light[:, 2] > 0) & (detector[:, 2] > 0)
    planes = np.full((3, len(ALL)), -1.0)
    planes[:, above] = (lambert_and_ggx(light[above], detector[above]) / SCALE).T
    return MerlTable(planes.reshape(3, *CELLS))


def test_files_round_trip_bit_for_bit(tmp_path, table):
    one, two = tmp_path / "one.binary", tmp_path / "two.binary"
    write_merl(table, one)
    assert one.stat().st_size == FILE_BYTES == 34_992_012
    found = read_merl(one)
    assert found.planes.tobytes() == table.planes.tobytes()
    write_merl(found, two)
    assert one.read_bytes() == two.read_bytes()


def test_numbers_lie_where_the_format_has_them(tmp_path, table):
    """phi_d + 180 (theta_d + 90 theta_h), plane after plane, behind three int32."""
    path = tmp_path / "one.binary"
    write_merl(table, path)
    data = path.read_bytes()
    assert struct.unpack("<3i", data[:12]) == (90, 90, 180)
    for plane, h, d, phi in [(0, 0, 0, 0), (1, 3, 5, 7), (2, 89, 88, 179)]:
        at = 12 + 8 * (plane * 1458000 + phi + 180 * (d + 90 * h))
        assert struct.unpack_from("<d", data, at)[0] == table.planes[plane, h, d, phi]


def test_stored_numbers_have_the_scales_of_the_database(table):
    up = np.array([[0.0, 0.0, 1.0]])
    ones = MerlTable(np.full_like(table.planes, 1500.0))
    assert np.allclose(ones.evaluate(up, up), [[1.0, 1.15, 1.66]])
    assert np.allclose(ones.brdf()[40, 50, 60], [1.0, 1.15, 1.66])


def turned(vectors, azimuth):
    x, y, z = vectors.T
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


@pytest.mark.parametrize("exchanged", [False, True])
@pytest.mark.parametrize("azimuth", [0.0, 1.0, -2.5])
def test_every_center_falls_in_its_cell(exchanged, azimuth):
    """Also with light and detector exchanged (reciprocity), and turned around the normal (isotropy)."""
    light, detector = (turned(directions, azimuth) for directions in center_directions())
    assert np.array_equal(cells(detector, light) if exchanged else cells(light, detector), ALL)


def test_the_half_vector_of_a_cell_lies_at_its_angles():
    light, detector = center_directions()
    half = light + detector
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    h, d, _ = np.unravel_index(ALL, CELLS)
    theta_h, theta_d = np.arccos(half[:, 2]), np.arccos(np.minimum((half * light).sum(axis=1), 1.0))
    assert np.allclose(90 * np.sqrt(theta_h / (np.pi / 2)), h + 0.5, atol=1e-4)
    assert np.allclose(90 * theta_d / (np.pi / 2), d + 0.5, atol=1e-9)
    assert np.allclose(np.linalg.norm(detector, axis=1), 1.0, atol=1e-12)


def test_a_light_beside_its_detector_has_azimuth_zero():
    """In the plane of incidence with the light farther from the normal: phi_d = 0, as in measured.func."""
    theta = np.deg2rad([50.0, 20.0])
    light, detector = (np.array([[np.sin(t), 0.0, np.cos(t)]]) for t in theta)
    h, d, phi = cell_of(light, detector)
    assert (h[0], d[0], phi[0]) == (int(90 * np.sqrt(35 / 90)), 15, 0)
    sideways = np.array([[0.1, 0.3, 0.9], [0.1, -0.3, 0.9]]) / np.sqrt(0.91)
    assert cell_of(sideways[:1], sideways[1:])[2][0] == 90


def test_the_table_follows_the_function_it_was_filled_from(table):
    """At centers up to rounding; elsewhere as far as it changes within half a cell (8 % where steepest)."""
    rng = np.random.default_rng(2)
    light, detector = center_directions()
    above = (light[:, 2] > 0) & (detector[:, 2] > 0)
    at = rng.choice(np.flatnonzero(above), 20_000, replace=False)
    expected = lambert_and_ggx(light[at], detector[at])
    assert np.allclose(table.evaluate(light[at], detector[at]), expected, rtol=1e-14)
    z, azimuth = rng.uniform(np.cos(1.2), 1, (2, 20_000)), rng.uniform(0, 2 * np.pi, (2, 20_000))
    r = np.sqrt(1 - z**2)
    light, detector = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=-1)
    expected, found = lambert_and_ggx(light, detector), table.evaluate(light, detector)
    error = np.abs(found / expected - 1)[found[:, 0] > 0]
    assert len(error) > 19_500
    assert error.mean() < 0.01
    assert error.max() < 0.1


def test_below_the_surface_and_unmeasured_is_zero(table):
    down = np.array([[0.6, 0.0, -0.8]])
    up = np.array([[0.0, 0.0, 1.0]])
    assert not table.evaluate(down, up).any()
    assert not table.evaluate(up, down).any()
    nothing = MerlTable(np.full_like(table.planes, -1.0))
    assert not nothing.evaluate(up, up).any()
    assert (table.evaluate(up, up) > 0).all()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data[:-5], "a MERL .binary file has 34992012 bytes, this file 34992007. Is it"),
        (lambda data: data + b"\0", "has 34992012 bytes, this file 34992013. Is it another format?"),
        (lambda data: struct.pack("<3i", 90, 180, 90) + data[12:], ":byte 0: a table of 90 x 180 x 90 cells"),
        (
            lambda data: data[:20] + struct.pack("<d", np.inf) + data[28:],
            ":byte 20: found a number that is not finite",
        ),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path, table, spoil, message):
    path = tmp_path / "one.binary"
    write_merl(table, path)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(InputError) as caught:
        read_merl(path)
    assert message in str(caught.value)


def test_a_table_with_numbers_not_finite_is_not_written(tmp_path, table):
    planes = table.planes.copy()
    planes[1, 2, 3, 4] = np.nan
    with pytest.raises(InputError, match="finite"):
        write_merl(MerlTable(planes), tmp_path / "one.binary")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("count", [20, pytest.param(MUTANTS, marks=pytest.mark.proof)])
def test_mutants_are_refused_or_read(tmp_path, table, count):
    path = tmp_path / "one.binary"
    write_merl(table, path)
    refused, good = read_damaged(
        read_merl,
        path.read_bytes(),
        path,
        most_bytes=2 * FILE_BYTES,
        count=count,
        damage=damaged_binary(HEADER_BYTES),
    )
    print(f"{refused} refused, {good} read")
