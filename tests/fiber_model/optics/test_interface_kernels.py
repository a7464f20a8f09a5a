"""The rough surface's parts: visible normals follow their density, twins agree, light keeps its place."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from scipy import stats

from weft.fiber_model.counter_random import pcg4d, uniform
from weft.fiber_model.optics import interface_kernels
from weft.fiber_model.optics.dielectric import fresnel

CERTAIN = 1e-6


@wp.kernel
def normals_kernel(
    view: wp.vec3d,
    alpha: wp.float64,
    u: wp.array(dtype=wp.vec2d),  # type: ignore[valid-type]
    normals: wp.array(dtype=wp.vec3d),  # type: ignore[valid-type]
) -> None:
    i = wp.tid()
    normals[i] = interface_kernels.visible_normal(view, alpha, u[i][0], u[i][1])


@wp.kernel
def interface_kernel(
    cosine: wp.array(dtype=wp.float64),  # type: ignore[valid-type]
    eta: wp.float64,
    reflectance: wp.array(dtype=wp.float64),  # type: ignore[valid-type]
    refracted: wp.array(dtype=wp.vec3d),  # type: ignore[valid-type]
) -> None:
    i = wp.tid()
    view = wp.vec3d(wp.sqrt(wp.float64(1.0) - cosine[i] * cosine[i]), wp.float64(0.0), cosine[i])
    normal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    reflectance[i] = interface_kernels.fresnel(cosine[i], eta)
    refracted[i] = interface_kernels.refract(view, normal, eta)


def _visible_density(view: np.ndarray, alpha: float, normals: np.ndarray) -> np.ndarray:
    """D(m) <view, m> / sigma(view) per steradian, with Walter et al. 2007's D and Smith's Lambda."""
    z = normals[..., 2]
    slope = (1 - z**2) / z**2
    d = 1 / (np.pi * alpha**2 * z**4 * (1 + slope / alpha**2) ** 2)
    tangent = (1 - view[2] ** 2) / view[2] ** 2
    smith = 0.5 * (np.sqrt(1 + alpha**2 * tangent) - 1)
    sigma = abs(view[2]) * (1 + smith if view[2] > 0 else smith)
    return d * np.maximum(normals @ view, 0) / sigma


def _cell_masses(view: np.ndarray, alpha: float, edges_z: np.ndarray, edges_phi: np.ndarray) -> np.ndarray:
    """Integrals of the density over cells of (cos, azimuth), midpoint rule on 24 x 24 points in each."""
    parts = (np.arange(24) + 0.5) / 24
    z = (edges_z[:-1, None] + np.diff(edges_z)[:, None] * parts).ravel()
    phi = (edges_phi[:-1, None] + np.diff(edges_phi)[:, None] * parts).ravel()
    r = np.sqrt(1 - z**2)[:, None]
    zz = np.broadcast_to(z[:, None], (len(z), len(phi)))
    normals = np.stack([r * np.cos(phi), r * np.sin(phi), zz], axis=-1)
    density = _visible_density(view, alpha, normals).reshape(len(edges_z) - 1, 24, len(edges_phi) - 1, 24)
    return density.mean(axis=(1, 3)) * np.diff(edges_z)[:, None] * np.diff(edges_phi)


@pytest.mark.parametrize("alpha", [0.2, 0.7])
@pytest.mark.parametrize("elevation_deg", [80, 20, -15, -60])
def test_visible_normals_follow_their_density(alpha: float, elevation_deg: float) -> None:
    """Chi-square; also from below, where light travels up through the microsurface."""
    count = 200_000
    angle = np.radians(elevation_deg)
    view = np.array([np.cos(angle) * np.cos(0.4), np.cos(angle) * np.sin(0.4), np.sin(angle)])
    words = pcg4d(np.arange(count), 1, 2, 3)
    u = np.stack([uniform(words[0]), uniform(words[1])], axis=1)
    normals = wp.empty(count, dtype=wp.vec3d, device="cpu")
    inputs = [wp.vec3d(*view), alpha, wp.array(u, dtype=wp.vec2d, device="cpu"), normals]
    wp.launch(normals_kernel, count, inputs=inputs, device="cpu")
    found = normals.numpy()
    assert np.linalg.norm(found, axis=1) == pytest.approx(1, abs=1e-12)
    edges_z, edges_phi = np.linspace(0, 1, 31) ** 0.5, np.linspace(-np.pi, np.pi, 25)
    azimuth = np.arctan2(found[:, 1], found[:, 0])
    counts = np.histogram2d(found[:, 2], azimuth, [edges_z, edges_phi])[0]
    masses = _cell_masses(view, alpha, edges_z, edges_phi)
    assert masses.sum() == pytest.approx(1, abs=2e-3)
    expected = masses / masses.sum() * count
    many = expected > 20
    statistic = ((counts - expected)[many] ** 2 / expected[many]).sum()
    assert stats.chi2.sf(statistic, many.sum()) > CERTAIN


@pytest.mark.parametrize("eta", [1.55, 1 / 1.55])
def test_reflectance_and_refraction_follow_fresnel_and_snell(eta: float) -> None:
    cosine = (np.arange(1000) + 0.5) / 1000
    reflectance = wp.empty(1000, dtype=wp.float64, device="cpu")
    refracted = wp.empty(1000, dtype=wp.vec3d, device="cpu")
    inputs = [wp.array(cosine, dtype=wp.float64, device="cpu"), eta, reflectance, refracted]
    wp.launch(interface_kernel, 1000, inputs=inputs, device="cpu")
    assert reflectance.numpy() == pytest.approx(fresnel(cosine, eta), abs=1e-14)
    passing = fresnel(cosine, eta) < 1
    out = refracted.numpy()[passing]
    assert np.linalg.norm(out, axis=1) == pytest.approx(1, abs=1e-12)
    assert -out[:, 0] * eta == pytest.approx(np.sqrt(1 - cosine[passing] ** 2), abs=1e-12)
    assert np.all(out[:, 2] < 0)
