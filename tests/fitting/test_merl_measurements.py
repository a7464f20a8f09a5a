"""A MERL table as measurements: the analytic values at the centers, and the same file written from them."""

import numpy as np
import pytest

from tests.fitting.analytic_brdf import lambert_and_ggx
from weft.files.errors import InputError
from weft.files.measured.merl import CELLS, SCALE, MerlTable, center_directions, read_merl, write_merl
from weft.fitting.measurement_file import load_measurements, save_measurements
from weft.fitting.measurements import Measurements
from weft.fitting.surface_directions import vectors


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    light, detector = center_directions()
    above = (light[:, 2] > 0) & (detector[:, 2] > 0)
    planes = np.full((3, len(light)), -1.0)
    planes[:, above] = (lambert_and_ggx(light[above], detector[above]) / SCALE).T
    planes = planes.reshape(3, *CELLS)
    planes[:, :40, 3, 100] = -2.5  # above the surface, but not measured
    path = tmp_path_factory.mktemp("merl") / "synthetic.binary"
    write_merl(MerlTable(planes), path)
    return path


def test_values_are_the_function_at_the_centers(file):
    found = load_measurements(file)
    assert found.quantity == "brdf"
    assert found.channels == ("r", "g", "b")
    assert len(found) > 1_000_000
    assert max(found.theta_i.max(), found.theta_o.max()) < np.pi / 2
    light, detector = vectors(found.theta_i, found.phi_i), vectors(found.theta_o, found.phi_o)
    expected = lambert_and_ggx(light, detector)
    assert (~found.usable).sum() == 40
    assert np.allclose(found.values[found.usable], expected[found.usable], rtol=1e-9)


def test_from_file_to_measurements_to_file(file, tmp_path):
    """The cells above the surface keep their values bit for bit; the others are not measured in either."""
    once = load_measurements(file)
    save_measurements(once, tmp_path / "again.binary")
    twice = load_measurements(tmp_path / "again.binary")
    for name in ("theta_i", "phi_i", "theta_o", "phi_o", "values", "usable"):
        assert getattr(once, name).tobytes() == getattr(twice, name).tobytes()
    one, two = read_merl(file).planes, read_merl(tmp_path / "again.binary").planes
    assert np.array_equal(one < 0, two < 0)
    assert np.allclose(one, two, rtol=1e-15)


def test_what_does_not_fit_a_table_is_refused(tmp_path):
    angles = {"theta_i": np.full(2, 0.3), "phi_i": np.zeros(2), "theta_o": np.full(2, 0.4)}
    rows = Measurements(**angles, phi_o=np.zeros(2), values=np.ones((2, 3)), quantity="brdf")
    with pytest.raises(InputError, match="two directions fall in one cell"):
        save_measurements(rows, tmp_path / "m.binary")
    rows = Measurements(**angles, phi_o=np.zeros(2), values=np.ones((2, 3)), quantity="bcsdf")
    with pytest.raises(InputError, match="a MERL table holds a 'brdf'"):
        save_measurements(rows, tmp_path / "m.binary")
    assert not list(tmp_path.iterdir())
