"""ALTA's text: every kind of coordinates gives the directions it stands for; round trip; damage."""

from dataclasses import replace

import numpy as np
import pytest

from tests.fitting.analytic_brdf import lambert_and_ggx
from tests.fitting.damage import read_damaged
from weft.files.errors import InputError
from weft.fitting.alta import read_alta
from weft.fitting.measurement_file import load_measurements, save_measurements
from weft.fitting.measurements import Measurements
from weft.fitting.surface_directions import angles, vectors

COUNT = 300


@pytest.fixture(scope="module")
def light_and_view():
    rng = np.random.default_rng(4)
    pairs = []
    for _ in range(2):
        z, azimuth = rng.uniform(0.05, 0.99, COUNT), rng.uniform(-np.pi, np.pi, COUNT)
        r = np.sqrt(1 - z**2)
        pairs.append(np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1))
    return pairs


def half_angles(light, view):
    """theta_h, phi_h, theta_d, phi_d of Rusinkiewicz, by turning the view so that the half vector is z."""
    half = (light + view) / np.linalg.norm(light + view, axis=1, keepdims=True)
    theta_h, phi_h = angles(half)
    c, s = np.cos(phi_h), np.sin(phi_h)
    x, y, z = c * view[:, 0] + s * view[:, 1], c * view[:, 1] - s * view[:, 0], view[:, 2]
    c, s = np.cos(theta_h), np.sin(theta_h)
    return theta_h, phi_h, *angles(np.stack([c * x - s * z, y, s * x + c * z], axis=1))


def coordinates(name, light, view):
    (tl, pl), (tv, pv) = angles(light), angles(view)
    th, ph, td, pd = half_angles(light, view)
    return {
        "CARTESIAN": [*view.T, *light.T],
        "SPHERICAL_TL_PL_TV_PV": [tl, pl, tv, pv],
        "RUSIN_TH_PH_TD_PD": [th, ph, td, pd],
        "RUSIN_TH_TD_PD": [th, td, pd],
        "ISOTROPIC_TV_TL_DPHI": [tv, tl, np.arctan2(np.sin(pl - pv), np.cos(pl - pv))],
    }[name]


def alta_text(name, columns, kind, values, *, extra=()):
    rows = np.stack([*columns, *values.T, *extra], axis=1).tolist()
    head = f"# made by a test\n#DIM {len(columns)} {values.shape[1]}\n#PARAM_IN  {name}\n#PARAM_OUT {kind}\n"
    return head + (f"#VS {len(extra)}\n") + "".join("\t".join(map(repr, row)) + "\n" for row in rows)


NAMES = ["CARTESIAN", "SPHERICAL_TL_PL_TV_PV", "RUSIN_TH_PH_TD_PD", "RUSIN_TH_TD_PD", "ISOTROPIC_TV_TL_DPHI"]


@pytest.mark.parametrize("name", NAMES)
def test_coordinates_give_the_directions_they_stand_for(tmp_path, light_and_view, name):
    light, view = light_and_view
    path = tmp_path / "m.alta"
    path.write_text(
        alta_text(name, coordinates(name, light, view), "RGB_COLOR", lambert_and_ggx(light, view))
    )
    found = load_measurements(path)
    found_light, found_view = vectors(found.theta_i, found.phi_i), vectors(found.theta_o, found.phi_o)
    if name in ("CARTESIAN", "SPHERICAL_TL_PL_TV_PV", "RUSIN_TH_PH_TD_PD"):
        assert np.allclose(found_light, light, atol=1e-12)
        assert np.allclose(found_view, view, atol=1e-12)
    # the others leave a turn around the normal open
    assert np.allclose(found_light[:, 2], light[:, 2], atol=1e-12)
    assert np.allclose((found_light * found_view).sum(axis=1), (light * view).sum(axis=1), atol=1e-12)
    assert np.allclose(found.values, lambert_and_ggx(found_light, found_view), rtol=1e-9)
    assert found.usable is None
    assert found.source == "ALTA file m.alta\nmade by a test"


@pytest.mark.parametrize("name", ["COS_TH", "COS_TH_TD", "RUSIN_TH_TD"])
def test_coordinates_of_the_half_vector_keep_its_angles(tmp_path, name):
    cos_h, cos_d = np.random.default_rng(1).uniform(0.75, 1.0, (2, 50))
    columns = {
        "COS_TH": [cos_h],
        "COS_TH_TD": [cos_h, cos_d],
        "RUSIN_TH_TD": [np.arccos(cos_h), np.arccos(cos_d)],
    }[name]
    path = tmp_path / "m.alta"
    path.write_text(alta_text(name, columns, "INV_STERADIAN", cos_h[:, None]))
    found = load_measurements(path)
    light, view = vectors(found.theta_i, found.phi_i), vectors(found.theta_o, found.phi_o)
    half = (light + view) / np.linalg.norm(light + view, axis=1, keepdims=True)
    assert np.allclose(half[:, 2], cos_h, atol=1e-12)
    assert np.allclose((half * light).sum(axis=1), 1.0 if name == "COS_TH" else cos_d, atol=1e-12)


def some(channels=3, **changes):
    rng = np.random.default_rng(6)
    rows = Measurements(
        theta_i=rng.uniform(0, np.pi / 2, 40),
        phi_i=rng.uniform(-np.pi, np.pi, 40),
        theta_o=rng.uniform(0, np.pi / 2, 40),
        phi_o=rng.uniform(0, 2 * np.pi, 40),
        values=rng.lognormal(size=(40, channels)),
        quantity="brdf",
        channels=("r", "g", "b") if channels == 3 else (),
        source="by a test",
    )
    return replace(rows, **changes)


@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_written_comes_back_bit_for_bit(tmp_path, channels):
    rows = some(channels, sigma=np.full((40, 1), 0.1) if channels == 1 else None)
    save_measurements(rows, tmp_path / "m.alta")
    found = load_measurements(tmp_path / "m.alta")
    for name in ("theta_i", "phi_i", "theta_o", "phi_o", "values", "sigma"):
        one, two = getattr(rows, name), getattr(found, name)
        assert (one is None and two is None) or one.tobytes() == two.tobytes()
    again = tmp_path / "again" / "m.alta"
    save_measurements(replace(found, source=rows.source), again)
    assert again.read_bytes() == (tmp_path / "m.alta").read_bytes()


def test_what_alta_cannot_hold_is_refused(tmp_path):
    for wrong, message in [
        (some(quantity="bcsdf"), "holds a 'brdf' in one or three channels"),
        (some(channels=2), "holds a 'brdf' in one or three channels"),
        (some(sigma=np.ones((40, 3))), "holds sigma for one channel only"),
    ]:
        with pytest.raises(InputError, match=message):
            save_measurements(wrong, tmp_path / "m.alta")
    assert not list(tmp_path.iterdir())


def test_only_usable_rows_are_written_and_below_the_surface_is_not_usable(tmp_path):
    usable = np.arange(40) % 4 > 0
    save_measurements(some(usable=usable), tmp_path / "m.alta")
    assert len(load_measurements(tmp_path / "m.alta")) == 30
    below = some(theta_o=np.where(usable, 0.3, 2.0))
    save_measurements(below, tmp_path / "m.alta")
    assert np.array_equal(load_measurements(tmp_path / "m.alta").usable, usable)


WHOLE = """\
# some felt
#DIM 3 3
#PARAM_IN RUSIN_TH_TD_PD
#PARAM_OUT RGB_COLOR
#VS 0
0.1 0.2 0.3 1.0 2.0 3.0
0.1 0.2 0.4 1.0 2.0 3.0
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("#DIM 3 3\n", "", ": no line '#DIM' before the first row"),
        ("#DIM 3 3", "#DIM 4 3", ":2: 'RUSIN_TH_TD_PD' and 'RGB_COLOR' need '#DIM 3 3', found '4 3'"),
        ("TH_TD_PD", "TH_TD_PT", ":3: coordinates 'RUSIN_TH_TD_PT' cannot be read; did you mean"),
        ("RGB_COLOR", "RGB_COLOUR", ":4: values of kind 'RGB_COLOUR' cannot be read; did you mean 'RGB"),
        ("#VS 0", "#VS 2", ":5: '#VS 2' with 3 values cannot be read; '#VS 0', or '#VS 1' with one"),
        ("#VS 0", "#FORMAT binary", ":5: format 'binary' cannot be read, only text"),
        ("0.3 1.0", "1.0", ":6: 5 numbers in this row; need 6"),
        ("0.4", "nan", ":7: found what is no finite number"),
        ("0.4", "0,4", ":7: found what is no finite number"),
        (WHOLE[WHOLE.index("0.1") :], "", ": no rows of measurements in this file"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path, old, new, message):
    path = tmp_path / "m.alta"
    assert old in WHOLE
    path.write_text(WHOLE.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_measurements(path)
    assert str(caught.value).startswith(f"{path}{message}")


def test_coordinates_of_no_direction_are_refused(tmp_path):
    path = tmp_path / "m.alta"
    for name, row in [
        ("COS_TH", "1.5"),
        ("CARTESIAN", "0 0 1 0 0 1.1"),
        ("SPHERICAL_TL_PL_TV_PV", "0 0 4 0"),
    ]:
        path.write_text(f"#DIM {len(row.split())} 1\n#PARAM_IN {name}\n#PARAM_OUT INV_STERADIAN\n{row} 1.0\n")
        with pytest.raises(InputError) as caught:
            load_measurements(path)
        assert str(caught.value) == f"{path}:4: these coordinates are of no direction"


def test_mutants_are_refused_or_read(tmp_path, light_and_view):
    light, view = light_and_view
    text = alta_text("CARTESIAN", [*view.T, *light.T], "RGB_COLOR", lambert_and_ggx(light, view))
    path = tmp_path / "m.alta"
    refused, good = read_damaged(read_alta, text.encode(), path, most_bytes=4 << 20)
    print(f"{refused} refused, {good} read")


def test_the_real_felt_is_read(shared_data):
    found = load_measurements(shared_data / "measurements" / "pink-felt-1d.alta")
    assert len(found) == 90
    assert np.array_equal(found.theta_i, found.theta_o)
    assert np.allclose(np.cos(found.theta_i[0]), 0.999984567305837, atol=1e-15)
    assert found.values[0].tolist() == [0.109704419970512, 0.0794405192136765, 0.0616232864558697]
    assert "pink-felt" in found.source
