"""BRDFs of the RGL database: as Mitsuba evaluates them, and on their own grid what stands in the file."""

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.mutants import mutant
from tests.fitting.damage import MUTANTS, read_damaged
from weft.files.errors import InputError
from weft.files.measured.rgl import RglBrdf, read_rgl, write_rgl
from weft.files.measured.warp_table import WarpTable, bilinear, corners

WAVELENGTHS = np.linspace(360, 1000, 8).astype(np.float32)


def synthetic(*, isotropic, rgb=False, seed=1):
    """Rough random tables, nothing a surface would do: whatever is mixed up shows."""
    rng = np.random.default_rng(seed)

    def table(*shape):
        return (0.5 + rng.random(shape)).astype(np.float32)

    phi_i = np.array([0.0] if isotropic else np.linspace(-np.pi, np.pi, 5), dtype=np.float32)
    theta_i = np.linspace(0.0, 1.4, 6).astype(np.float32)
    slices = (len(phi_i), len(theta_i))
    fields = {
        "description": np.frombuffer(b"synthetic felt", dtype=np.uint8),
        "theta_i": theta_i,
        "phi_i": phi_i,
        "ndf": table(9, 7),
        "sigma": np.repeat(table(1, 5), 6, axis=0) if isotropic else table(6, 5),
        "vndf": table(*slices, 8, 9),
        "luminance": table(*slices, 6, 6),
        "jacobian": np.ones(1, dtype=np.uint8),
    }
    if rgb:
        return RglBrdf(fields | {"rgb": table(*slices, 3, 6, 6)})
    return RglBrdf(fields | {"wavelengths": WAVELENGTHS, "spectra": table(*slices, 8, 6, 6)})


def random_directions(count, seed):
    rng = np.random.default_rng(seed)
    z, azimuth = rng.uniform(0.05, 1, (2, count)), rng.uniform(-np.pi, np.pi, (2, count))
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=-1)


@pytest.mark.parametrize("isotropic", [True, False])
def test_mitsuba_evaluates_the_same_file_to_the_same_numbers(tmp_path, isotropic):
    """Its `measured` plugin works in float32; at four of the file's wavelengths.

    Version 3.9.1 may turn isotropic samples by half a turn (a member of the plugin that it does not set);
    so their areas must not depend on the azimuth, as in real files.
    """
    mi = pytest.importorskip("mitsuba")
    before = mi.variant()
    mi.set_variant("scalar_spectral")
    try:
        path = tmp_path / "synthetic.bsdf"
        write_rgl(synthetic(isotropic=isotropic), path)
        plugin = mi.load_dict({"type": "measured", "filename": str(path)})
        light, detector = random_directions(300, 3)
        found = []
        for wi, wo in zip(light, detector, strict=True):
            si = mi.SurfaceInteraction3f()
            si.wi = mi.Vector3f(*wi)
            si.wavelengths = WAVELENGTHS[[1, 2, 4, 6]].tolist()
            found.append([float(value) for value in plugin.eval(mi.BSDFContext(), si, mi.Vector3f(*wo))])
    finally:
        if before:
            mi.set_variant(before)
    expected = read_rgl(path).evaluate(light, detector)[:, [1, 2, 4, 6]]
    assert np.allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize("isotropic", [True, False])
@pytest.mark.parametrize("rgb", [True, False])
def test_at_its_grid_the_brdf_is_what_stands_in_the_file(isotropic, rgb):
    """The warp and its inverse meet. Not asked: half vectors at the normal, whose azimuth is lost, and
    lights at the seam of the azimuth or at the normal, which belong to several slices."""
    brdf = synthetic(isotropic=isotropic, rgb=rgb)
    light, detector, values = brdf.measured()
    half = light + detector
    tilted = np.hypot(half[:, 0], half[:, 1]) > 1e-3 * half[:, 2]
    seam = (light[:, 2] > 0.9999) | (light[:, 0] < -0.9999 * np.hypot(light[:, 0], light[:, 1]))
    chosen = tilted if isotropic else tilted & ~seam
    assert chosen.sum() > 90
    assert np.allclose(brdf.evaluate(light, detector)[chosen], values[chosen], rtol=1e-6)
    assert values.shape[1] == len(brdf.channels) == (3 if rgb else 8)


def test_an_isotropic_brdf_does_not_turn_with_the_sample():
    brdf = synthetic(isotropic=True)
    light, detector = random_directions(200, 4)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    assert np.allclose(brdf.evaluate(light @ turn.T, detector @ turn.T), brdf.evaluate(light, detector))


def test_the_warp_follows_the_density():
    """The uniform point of (x, y) has as its area the integral of the density up to there."""
    rng = np.random.default_rng(6)
    table = WarpTable.of(rng.random((1, 5, 6)) + 0.1)
    at = corners((np.zeros(1), np.zeros(1)), (np.zeros(50), np.zeros(50)))
    x, y = rng.random((2, 50))
    step = 1e-5
    s, t = table.unwarp(x, y, at)
    s_x, t_x = table.unwarp(x + step, y, at)
    s_y, t_y = table.unwarp(x, y + step, at)
    jacobian = ((s_x - s) * (t_y - t) - (s_y - s) * (t_x - t)) / step**2
    assert np.allclose(jacobian, 20.0 * bilinear(table.density[0], x, y), rtol=1e-2)
    warped_x, warped_y = table.warp_grid(0, 7, 9)
    at = corners((np.zeros(1), np.zeros(1)), (np.zeros(63), np.zeros(63)))
    s, t = table.unwarp(warped_x.ravel(), warped_y.ravel(), at)
    assert np.allclose(s.reshape(7, 9), np.linspace(0, 1, 9), atol=1e-7)
    assert np.allclose(t.reshape(7, 9), np.linspace(0, 1, 7)[:, None], atol=1e-7)


def test_files_round_trip_bit_for_bit(tmp_path):
    one, two = tmp_path / "one.bsdf", tmp_path / "two.bsdf"
    write_rgl(synthetic(isotropic=False), one)
    write_rgl(read_rgl(one), two)
    assert one.read_bytes() == two.read_bytes()


def changed(name, change):
    fields = dict(synthetic(isotropic=False).fields)
    if change is None:
        del fields[name]
    else:
        fields[name] = change(fields[name].copy())
    return RglBrdf(fields)


def spoil(value, at=0):
    def change(array):
        array.flat[at] = value
        return array

    return change


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("sigma", None, "no field 'sigma'; not a BRDF of the RGL database"),
        ("spectra", None, "no field 'spectra'"),
        ("ndf", lambda a: a.astype(np.float64), "field 'ndf': need float32 in 2 dimensions, found float64"),
        ("ndf", lambda a: a[:1], "field 'ndf': a grid of [1, 7] points; need at least 2 x 2"),
        ("spectra", spoil(np.nan, 77), "field 'spectra': found a number that is not finite"),
        ("vndf", lambda a: a[1:], "field 'vndf' has (4, 6) slices, phi_i and theta_i (5, 6)"),
        ("spectra", lambda a: a[:, :, :5], "field 'spectra' has 5 channels; need 8"),
        ("phi_i", lambda a: a / 2, "field 'phi_i': the light's azimuths do not go full circle"),
        ("theta_i", lambda a: a[::-1], "field 'theta_i': need ascending angles up to 1.571 radians"),
        ("vndf", spoil(-1.0), "field 'vndf': need densities of at least 0 that are not all 0"),
        ("sigma", spoil(0.0), "fields 'sigma' and 'ndf': need areas above 0 and densities of at least 0"),
        ("wavelengths", spoil(360.0, 1), "field 'wavelengths': need different ones above 0"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path, name, change, message):
    path = tmp_path / "one.bsdf"
    write_rgl(changed(name, change), path)
    with pytest.raises(InputError) as caught:
        read_rgl(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def damaged_header(whole, rng):
    """Most of a file is numbers; this damages what says how they are to be read."""
    data = bytearray(whole)
    for _ in range(rng.integers(1, 4)):
        data[rng.integers(300)] = rng.integers(256)
    return bytes(data)


@pytest.mark.parametrize("damage", [mutant, damaged_header])
@pytest.mark.parametrize("count", [100, pytest.param(MUTANTS, marks=pytest.mark.proof)])
def test_mutants_are_refused_or_read(tmp_path, damage, count):
    path = tmp_path / "one.bsdf"
    write_rgl(synthetic(isotropic=True), path)

    def read(path):
        _, _, values = read_rgl(path).measured()
        assert np.isfinite(values).all()

    refused, good = read_damaged(
        read, path.read_bytes(), path, most_bytes=8 << 20, count=count, damage=damage
    )
    print(f"{refused} refused, {good} read")
