"""The fiber's phase function: lobes R, TT, TRT, exactly normalized and exactly sampled (thesis section 6.2).

f_p(wo, wi) = Σ a_k(theta_o) M_k(theta_o, theta_i) N_k(phi) per steradian; ∫ f_p dwi = Σ a_k for every wo.
Local frame: the fiber is the x axis, theta the inclination from its normal plane, phi the azimuth around it;
wo and wi both point away from the scattering point. Colors last: values have shape [..., 3], linear RGB.
With the longitudinal kind `symmetric` the R lobe is two: its part at normal incidence, and, as a fourth lobe,
what Schlick's term adds toward grazing. Widths and T may vary with theta_o; ∫ f_p dwi = Σ a_k all the same.
numpy twin of renderer/shaders/phase/fiber.glsl.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .azimuthal import (
    von_mises_eval,
    von_mises_sample,
    wrapped_normal_eval,
    wrapped_normal_sample,
)
from .azimuthal_table import table_eval, table_sample
from .longitudinal import gaussian_eval, gaussian_sample, vmf_eval, vmf_sample
from .parameters import FiberScatteringParameters, Table
from .symmetric import symmetric_eval, symmetric_sample
from .tail import tail_eval, tail_sample

Array = NDArray[np.float64]

R, TT, TRT, R_GRAZING = 0, 1, 2, 3
CENTERS = (0.0, np.pi, 0.0, 0.0)
"""Azimuth [rad] from wo of the center of each lobe."""
SYMMETRIC_MARGINALS = ("base", "entering", "entering", "grazing")
"""How the energy of each lobe goes with theta, for the kind `symmetric`."""


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
    lobe = (u[..., 0, None] >= edges[..., :-1]).sum(axis=-1)
    wi = _sample_lobes(parameters, wo, lobe, u)
    densities = lobe_densities(parameters, wo, wi)
    pdf = (chance * densities).sum(axis=-1)
    value = (energies * densities[..., None]).sum(axis=-2)
    weight = np.divide(value, pdf[..., None], out=np.zeros_like(value), where=pdf[..., None] > 0)
    return wi, weight, pdf


def lobe_energies(parameters: FiberScatteringParameters, wo: ArrayLike) -> Array:
    """a_k(theta_o) of the lobes R, TT, TRT, shape [..., 3 lobes, 3 colors]; 4 lobes for the kind `symmetric`.

    F is Schlick's; T = `fresnel_tt` of what enters leaves at once, the rest after one inner reflection.
    """
    cos_o = np.hypot(*_yz(wo))
    base = np.asarray(parameters.fresnel_r)
    grazing = (1 - base) * (1 - np.minimum(cos_o, 1.0)[..., None]) ** 5
    fresnel = base + grazing
    entering, t = 1 - fresnel, np.asarray(at_inclination(parameters, "fresnel_tt", cos_o))[..., None]
    energy_r = np.asarray(parameters.color_r) * fresnel
    energy_tt = np.asarray(parameters.color_tt) * entering * t
    energy_trt = np.asarray(parameters.color_trt) * entering * (1 - t)
    if parameters.longitudinal != "symmetric":
        return np.stack([energy_r, energy_tt, energy_trt], axis=-2)
    color_r = np.asarray(parameters.color_r)
    at_normal = np.broadcast_to(color_r * base, energy_tt.shape)
    return np.stack([at_normal, energy_tt, energy_trt, color_r * grazing], axis=-2)


def lobe_probabilities(energies: ArrayLike) -> Array:
    """Chance of each lobe, by its largest channel: no weight exceeds Σ max(a_k). A black fiber takes R."""
    strength = np.asarray(energies, dtype=np.float64).max(axis=-1)
    total = strength.sum(axis=-1, keepdims=True)
    black = np.zeros_like(strength)
    black[..., R] = 1.0
    return np.divide(strength, total, out=black, where=total > 0)


def lobe_densities(parameters: FiberScatteringParameters, wo: ArrayLike, wi: ArrayLike) -> Array:
    """M_k N_k [1/sr] of the lobes, in the order and number of `lobe_energies`; each integrates to one."""
    wo, wi = np.asarray(wo, dtype=np.float64), np.asarray(wi, dtype=np.float64)
    theta_o, theta_i = _inclination(wo), _inclination(wi)
    phi = _azimuth(wi) - _azimuth(wo)
    along = longitudinal_densities(parameters, theta_o, theta_i)
    around = azimuthal_densities(parameters, theta_o, phi)
    return np.stack([m * n for m, n in zip(along, around, strict=False)], axis=-1)


def azimuthal_densities(
    parameters: FiberScatteringParameters, theta_o: ArrayLike, phi: ArrayLike
) -> list[Array]:
    """N_k of four lobes, phi the azimuth of wi from that of wo; ∫ N_k dphi = 1."""
    phi, cos_o = np.asarray(phi, dtype=np.float64), np.cos(theta_o)
    gammas, tables = azimuthal_widths(parameters, theta_o), azimuthal_tables(parameters)
    return [
        _azimuthal_eval(parameters.azimuthal, phi - center, gamma)
        if table is None
        else table_eval(phi - center, table, cos_o)
        for center, gamma, table in zip(CENTERS, gammas, tables, strict=True)
    ]


def azimuthal_tables(parameters: FiberScatteringParameters) -> tuple[Table | None, ...]:
    """Of the four lobes: where one is given, it takes the place of the width."""
    return *parameters.tables, parameters.azimuthal_table_r


def longitudinal_densities(
    parameters: FiberScatteringParameters, theta_o: ArrayLike, theta_i: ArrayLike
) -> list[Array]:
    """M_k of the lobes; ∫ M_k cos(theta_i) dtheta_i = 1."""
    widths = longitudinal_widths(parameters, theta_o)
    if parameters.longitudinal == "symmetric":
        lobes = zip((*widths, widths[R]), SYMMETRIC_MARGINALS, strict=True)
        return [symmetric_eval(theta_o, theta_i, beta, marginal) for beta, marginal in lobes]
    evaluate = gaussian_eval if parameters.longitudinal == "gaussian" else vmf_eval
    bodies = [evaluate(theta_o, theta_i, beta) for beta in widths]
    return [
        body if tail is None else body + tail.weight * (tail_eval(theta_o, theta_i, tail.width) - body)
        for body, tail in zip(bodies, tails(parameters, theta_o), strict=False)
    ]


class Tail(NamedTuple):
    """Of one lobe: one number each, or of the shape of theta_o."""

    weight: Any
    """Part of M that lies in the tail."""
    width: Any
    """Radians."""


def tails(parameters: FiberScatteringParameters, theta_o: ArrayLike) -> list[Tail | None]:
    """Of the four lobes; None where a lobe has no tail."""
    found: list[Tail | None] = []
    for lobe, beta in zip(("r", "tt", "trt"), longitudinal_widths(parameters, theta_o), strict=True):
        weight = at_inclination(parameters, f"tail_weight_{lobe}", np.cos(theta_o))
        ratio = getattr(parameters, f"tail_ratio_{lobe}")
        found.append(None if weight is None else Tail(weight, ratio * beta))
    return [*found, None]


def longitudinal_widths(
    parameters: FiberScatteringParameters, theta_o: ArrayLike = 0.0
) -> tuple[Any, Any, Any]:
    """beta [rad] of R, TT, TRT: one number each, or of the shape of `theta_o` where it varies with it."""
    r, tt, trt = (
        at_inclination(parameters, f"longitudinal_width_{lobe}", np.cos(theta_o))
        for lobe in ("r", "tt", "trt")
    )
    return r, tt, trt


def azimuthal_widths(parameters: FiberScatteringParameters, theta_o: ArrayLike) -> tuple[Any, ...]:
    """gamma [rad] of the four lobes, as `longitudinal_widths`; None where a lobe is uniform."""
    tt, trt = (
        at_inclination(parameters, f"azimuthal_width_{lobe}", np.cos(theta_o)) for lobe in ("tt", "trt")
    )
    return None, tt, trt, None


def at_inclination(parameters: FiberScatteringParameters, name: str, cos_o: ArrayLike) -> Any:
    """A width or T at this inclination: linear in 1 - cos(theta_o) from the normal to the grazing value."""
    normal, grazing = getattr(parameters, name), getattr(parameters, f"{name}_grazing")
    return normal if grazing is None else normal + (grazing - normal) * (1 - np.minimum(cos_o, 1.0))


def _sample_lobes(parameters: FiberScatteringParameters, wo: Array, lobe: Array, u: Array) -> Array:
    theta_o = np.broadcast_to(_inclination(wo), lobe.shape)
    azimuth_o = np.broadcast_to(_azimuth(wo), lobe.shape)
    theta, phi = np.empty(lobe.shape), np.empty(lobe.shape)
    widths = longitudinal_widths(parameters, theta_o)
    gammas, tables = azimuthal_widths(parameters, theta_o), azimuthal_tables(parameters)
    all_tails = tails(parameters, theta_o)
    for k, (all_betas, all_gammas) in enumerate(zip((*widths, widths[R]), gammas, strict=True)):
        of_lobe = lobe == k
        beta, gamma = (width[of_lobe] if np.ndim(width) else width for width in (all_betas, all_gammas))
        v, tail, at = u[of_lobe], all_tails[k], theta_o[of_lobe]
        if tail is None:
            theta[of_lobe] = _longitudinal_sample(parameters.longitudinal, k, at, beta, v)
        else:
            weight, width = (np.broadcast_to(value, lobe.shape)[of_lobe] for value in tail)
            in_tail, v = _into_tail(weight, v)
            body = _longitudinal_sample(parameters.longitudinal, k, at, beta, v)
            theta[of_lobe] = np.where(in_tail, tail_sample(at, width, v[:, 1], v[:, 2]), body)
        table = tables[k]
        if table is None:
            around = _azimuthal_sample(parameters.azimuthal, gamma, v[:, 3])
        else:
            around = table_sample(table, np.cos(theta_o[of_lobe]), v[:, 3])
        phi[of_lobe] = CENTERS[k] + around
    return _direction(theta, azimuth_o + phi)


def _into_tail(weight: Array, u: Array) -> tuple[NDArray[np.bool_], Array]:
    """Which samples lie in the tail, by the third number; what is left of it is uniform again."""
    in_tail = u[:, 2] < weight
    part, first = np.where(in_tail, weight, 1 - weight), np.where(in_tail, 0.0, weight)
    left = u.copy()
    left[:, 2] = (u[:, 2] - first) / part
    return in_tail, left


def _longitudinal_sample(kind: str, lobe: int, theta_o: Array, beta: float | Array, u: Array) -> Array:
    if kind == "gaussian":
        return gaussian_sample(theta_o, beta, u[:, 1])
    if kind == "vmf":
        return vmf_sample(theta_o, beta, u[:, 1], u[:, 2])
    assert isinstance(beta, float)  # the kind takes no grazing widths
    return symmetric_sample(theta_o, beta, SYMMETRIC_MARGINALS[lobe], u[:, 1])


def _azimuthal_eval(kind: str, phi: Array, gamma: float | Array | None) -> Array:
    if gamma is None:
        return np.full(phi.shape, 1 / (2 * np.pi))
    return wrapped_normal_eval(phi, gamma) if kind == "wrapped_normal" else von_mises_eval(phi, gamma)


def _azimuthal_sample(kind: str, gamma: float | Array | None, u: Array) -> Array:
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
