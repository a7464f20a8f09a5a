"""Pictures of volumes: drawn band by band, the same whatever the bands."""

from __future__ import annotations

import numpy as np

from weft.voxelize import picture


def test_bands_do_not_show(monkeypatch):
    rng = np.random.default_rng(1)
    transmittance, light, height = rng.random((3, 40, 30), dtype=np.float32)
    transmittance[:5] = transmittance[:, -3:] = 1
    layers = transmittance, light * (1 - transmittance), 50 * height * (1 - transmittance)
    drawn = []
    for band in (1, 7, 40):
        monkeypatch.setattr(picture, "BAND", band)
        drawn.append(picture._shade(*layers, 1.0))
    assert drawn[0].shape == (27, 35, 3)
    assert drawn[0].std() > 10
    assert all(np.array_equal(drawn[0], other) for other in drawn[1:])
