"""An analytic BRDF to fill tables with: Lambert plus a GGX lobe (Walter et al. 2007), Schlick's Fresnel."""

import numpy as np

DIFFUSE = np.array([0.3, 0.2, 0.1])
ALPHA = 0.3
F0 = 0.04


def lambert_and_ggx(light, detector):
    """[1/sr], shape [N, 3], of unit vectors of shape [N, 3]; reciprocal."""
    half = light + detector
    half = half / np.linalg.norm(half, axis=1, keepdims=True)
    cos_h, cos_d = half[:, 2], np.abs((half * light).sum(axis=1))
    d = ALPHA**2 / (np.pi * (cos_h**2 * (ALPHA**2 - 1) + 1) ** 2)
    f = F0 + (1 - F0) * (1 - cos_d) ** 5
    g1 = [2 / (1 + np.sqrt(1 + ALPHA**2 * (1 / w[:, 2] ** 2 - 1))) for w in (light, detector)]
    lobe = d * f * g1[0] * g1[1] / (4 * np.abs(light[:, 2] * detector[:, 2]))
    return DIFFUSE / np.pi + lobe[:, None]
