"""The fiber's phase function: lobes R, TT, TRT, exactly normalized and exactly sampled (thesis section 6.2).

f_p(wo, wi) = Σ a_k(theta_o) M_k(theta_o, theta_i) N_k(phi) per steradian; ∫ f_p dwi = Σ a_k for every wo.
Local frame: the fiber is the x axis, theta the inclination from its normal plane, phi the azimuth around it;
wo and wi both point away from the scattering point. Colors last: values have shape [..., 3], linear RGB.
numpy twin of renderer/shaders/phase/fiber.glsl.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .azimuthal import (
    von_mises_eval,
    von_mises_sample,
    wrapped_normal_eval,
    wrapped_normal_sample,
)
from .longitudinal import gaussian_eval, gaussian_sample, vmf_eval, vmf_sample
from .parameters import FiberScatteringParameters

Array = NDArray[np.float64]

R, TT, TRT = 0, 1, 2


def fiber_phase_eval(parameters: FiberScatteringParameters, wo: ArrayLike, wi: ArrayLike) -> Array:
    """f_p [1/sr], shape [..., 3]."""
    energies = lobe_energies(parameters, wo)
    densities = lobe_densities(parameters, wo, wi)
    return (energies * densities[..., None]).sum(axis=-2)


def fiber_phase_pdf(parameters: FiberScatteringParameters, wo: ArrayLike, wi: ArrayLike) -> Array:
    """Density [1/sr] of the directions `fiber_phase_sample` draws, shape [...]."""
    chance = lobe_probabilities(lobe_energies(parameters, wo))
    return (chance * lobe_densities(parameters, wo, wi)).sum(axis=-1)


def fiber_phase_albedo(parameters: FiberScatteringParameters, wo: ArrayLike) -> Array:
    """∫ f_p dwi = Σ a_k(theta_o), shape [..., 3]."""
    return lobe_energies(parameters, wo).sum(axis=-2)


def fiber_phase_sample(
    parameters: FiberScatteringParameters, wo: ArrayLike, u: ArrayLike
) -> tuple[Array, Array, Array]:
    """Directions wi [..., 3], weights f_p / pdf [..., 3] and pdf [...] from four uniform numbers u [..., 4].

    u, within (0, 1): lobe, longitudinal (two), azimuthal. The lobe is chosen by its largest color channel;
    every lobe is sampled exactly, so a gray fiber has weight = albedo for every sample.
    """
    wo, u = np.asarray(wo, dtype=np.float64), np.asarray(u, dtype=np.float64)
    energies = lobe_energies(parameters, wo)
    chance = lobe_probabilities(energies)
    # normalize the last edge: rounding must not leave numbers above the sum of the chances
    edges = np.cumsum(chance, axis=-1) / chance.sum(axis=-1, keepdims=True)
    lobe = (u[..., 0, None] >= edges[..., :2]).sum(axis=-1)
    wi = _sample_lobes(parameters, wo, lobe, u)
    densities = lobe_densities(parameters, wo, wi)
    pdf = (chance * densities).sum(axis=-1)
    value = (energies * densities[..., None]).sum(axis=-2)
    weight = np.divide(value, pdf[..., None], out=np.zeros_like(value), where=pdf[..., None] > 0)
    return wi, weight, pdf


def lobe_energies(parameters: FiberScatteringParameters, wo: ArrayLike) -> Array:
    """a_k(theta_o) of the lobes R, TT, TRT, shape [..., 3 lobes, 3 colors].

    F is Schlick's; T = `fresnel_tt` of what enters leaves at once, the rest after one inner reflection.
    """
    cos_o = np.hypot(*_yz(wo))
    base = np.asarray(parameters.fresnel_r)
    fresnel = base + (1 - base) * (1 - np.minimum(cos_o, 1.0)[..., None]) ** 5
    entering, t = 1 - fresnel, parameters.fresnel_tt
    energy_r = np.asarray(parameters.color_r) * fresnel
    energy_tt = np.asarray(parameters.color_tt) * entering * t
    energy_trt = np.asarray(parameters.color_trt) * entering * (1 - t)
    return np.stack([energy_r, energy_tt, energy_trt], axis=-2)


def lobe_probabilities(energies: ArrayLike) -> Array:
    """Chance of each lobe, by its largest channel: no weight exceeds Σ max(a_k). A black fiber takes R."""
    strength = np.asarray(energies, dtype=np.float64).max(axis=-1)
    total = strength.sum(axis=-1, keepdims=True)
    black = np.zeros_like(strength)
    black[..., R] = 1.0
    return np.divide(strength, total, out=black, where=total > 0)


def lobe_densities(parameters: FiberScatteringParameters, wo: ArrayLike, wi: ArrayLike) -> Array:
    """M_k N_k [1/sr] of the lobes, shape [..., 3]; each integrates to one over the sphere."""
    wo, wi = np.asarray(wo, dtype=np.float64), np.asarray(wi, dtype=np.float64)
    theta_o, theta_i = _inclination(wo), _inclination(wi)
    evaluate = gaussian_eval if parameters.longitudinal == "gaussian" else vmf_eval
    phi = _azimuth(wi) - _azimuth(wo)
    around_tt = _azimuthal_eval(parameters.azimuthal, phi - np.pi, parameters.azimuthal_width_tt)
    around_trt = _azimuthal_eval(parameters.azimuthal, phi, parameters.azimuthal_width_trt)
    along = [evaluate(theta_o, theta_i, beta) for beta in longitudinal_widths(parameters)]
    return np.stack([along[R] / (2 * np.pi), along[TT] * around_tt, along[TRT] * around_trt], axis=-1)


def longitudinal_widths(parameters: FiberScatteringParameters) -> tuple[float, float, float]:
    return (
        parameters.longitudinal_width_r,
        parameters.longitudinal_width_tt,
        parameters.longitudinal_width_trt,
    )


def _sample_lobes(parameters: FiberScatteringParameters, wo: Array, lobe: Array, u: Array) -> Array:
    theta_o = np.broadcast_to(_inclination(wo), lobe.shape)
    azimuth_o = np.broadcast_to(_azimuth(wo), lobe.shape)
    theta, phi = np.empty(lobe.shape), np.empty(lobe.shape)
    centers = (0.0, np.pi, 0.0)
    around = (None, parameters.azimuthal_width_tt, parameters.azimuthal_width_trt)
    for k, beta in enumerate(longitudinal_widths(parameters)):
        of_lobe = lobe == k
        v = u[of_lobe]
        if parameters.longitudinal == "gaussian":
            theta[of_lobe] = gaussian_sample(theta_o[of_lobe], beta, v[:, 1])
        else:
            theta[of_lobe] = vmf_sample(theta_o[of_lobe], beta, v[:, 1], v[:, 2])
        phi[of_lobe] = centers[k] + _azimuthal_sample(parameters.azimuthal, around[k], v[:, 3])
    return _direction(theta, azimuth_o + phi)


def _azimuthal_eval(kind: str, phi: Array, gamma: float | None) -> Array:
    if gamma is None:
        return np.full(phi.shape, 1 / (2 * np.pi))
    return wrapped_normal_eval(phi, gamma) if kind == "wrapped_normal" else von_mises_eval(phi, gamma)


def _azimuthal_sample(kind: str, gamma: float | None, u: Array) -> Array:
    if gamma is None:
        return 2 * np.pi * u
    return wrapped_normal_sample(gamma, u) if kind == "wrapped_normal" else von_mises_sample(gamma, u)


def _yz(w: ArrayLike) -> tuple[Array, Array]:
    w = np.asarray(w, dtype=np.float64)
    return w[..., 1], w[..., 2]


def _inclination(w: Array) -> Array:
    return np.arctan2(w[..., 0], np.hypot(*_yz(w)))


def _azimuth(w: Array) -> Array:
    y, z = _yz(w)
    return np.arctan2(z, y)


def _direction(theta: Array, azimuth: Array) -> Array:
    cos_theta = np.cos(theta)
    return np.stack([np.sin(theta), cos_theta * np.cos(azimuth), cos_theta * np.sin(azimuth)], axis=-1)
