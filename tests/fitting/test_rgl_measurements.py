"""A BRDF of the RGL database as measurements: its grid's values in the directions they were taken in."""

import numpy as np
import pytest

from tests.files.measured.test_rgl import synthetic
from weft.files.errors import InputError
from weft.files.measured.rgl import RglBrdf, write_rgl
from weft.fitting.measurement_file import load_measurements
from weft.fitting.surface_directions import vectors


def test_values_stand_in_their_directions(tmp_path):
    brdf = synthetic(isotropic=True)
    write_rgl(brdf, tmp_path / "felt.bsdf")
    found = load_measurements(tmp_path / "felt.bsdf")
    assert found.quantity == "brdf"
    assert found.channels[:2] == ("360nm", "451.429nm")
    assert found.source == "RGL file felt.bsdf\nsynthetic felt"
    assert np.allclose(np.unique(found.theta_i), brdf.fields["theta_i"], atol=1e-6)
    assert max(found.theta_i.max(), found.theta_o.max()) < np.pi / 2
    light, detector = vectors(found.theta_i, found.phi_i), vectors(found.theta_o, found.phi_o)
    tilted = np.hypot(*(light + detector)[:, :2].T) > 1e-3
    assert np.allclose(brdf.evaluate(light, detector)[tilted], found.values[tilted], rtol=1e-6)


def test_a_file_with_nothing_above_the_surface_is_refused(tmp_path):
    fields = dict(synthetic(isotropic=True).fields)
    fields["theta_i"] = fields["theta_i"][:1] + np.float32(np.pi / 2 + 1e-6)
    fields |= {name: fields[name][:, :1] for name in ("vndf", "spectra")}
    write_rgl(RglBrdf(fields), tmp_path / "dark.bsdf")
    with pytest.raises(InputError, match=r"dark\.bsdf: no direction of this file lies above"):
        load_measurements(tmp_path / "dark.bsdf")
