"""Each order of scattering by itself: shapes of R, TT and TRT from the simulation's own histograms.

A fit to the sum of all orders may call any lobe by any name. Here every lobe is fitted to its own light, so
that the fit to the sum can start there and stay near; TRT stands for all that was reflected inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls

from weft.fiber_model.scattering.azimuthal import wrapped_normal_eval
from weft.fiber_model.scattering.azimuthal_table import knot_masses, row_shares, table_eval
from weft.fiber_model.scattering.tail import tail_eval

ORDERS = {"r": ("R",), "tt": ("TT",), "trt": ("TRT", "rest")}
CENTER = {"r": None, "tt": np.pi, "trt": 0.0}
ROWS, KNOTS, SMOOTHING = 2, 33, 1e-3
_INSIDE_BIN = (np.arange(5) + 0.5) / 5


def bin_probabilities(histogram, orders, *, channel=1):
    """Light per bin, shape [I, T, P]; phi and -phi averaged, so are theta and -theta for light at 0 deg."""
    parts = np.sum([histogram.phase_function(order)[..., channel] for order in orders], axis=0)
    p = parts * histogram.bins.solid_angles
    phi = histogram.bins.phi
    mirrored = np.argmin(np.abs(np.exp(1j * phi[:, None]) - np.exp(-1j * phi)), axis=1)
    p = 0.5 * (p + p[:, :, mirrored])
    upright = np.abs(histogram.theta_i) < 1e-9
    p[upright] = 0.5 * (p[upright] + p[upright, ::-1])
    return p


def along(theta_edges, theta_i, beta):
    """Probability of each bin of inclination under the Gaussian lobe."""
    theta = theta_edges[:-1, None] + np.diff(theta_edges)[:, None] * _INSIDE_BIN
    density = (np.exp(-0.5 * ((theta + theta_i) / beta) ** 2) * np.cos(theta) ** 2).mean(axis=1)
    mass = density * np.diff(theta_edges)
    return mass / mass.sum()


def around(phi, gamma, center):
    if center is None:
        return np.full(len(phi), 1 / len(phi))
    inside = phi[:, None] + (_INSIDE_BIN - 0.5) * (phi[1] - phi[0])
    mass = wrapped_normal_eval(inside - center, gamma).mean(axis=1)
    return mass / mass.sum()


def table_masses(table, phi, light):
    """Probability of each bin of azimuth under a table, for light at this inclination."""
    inside = phi[:, None] + (_INSIDE_BIN - 0.5) * (phi[1] - phi[0])
    mass = table_eval(inside, table, np.cos(light)).mean(axis=1)
    return mass / mass.sum()


def tables_alone(histogram, seen):
    """N of each lobe around its center, {lobe: [ROWS][KNOTS]}. The model is linear in the knots: they follow
    from non-negative least squares over the lights `seen`, by energy, with a slight price on curvature.
    """
    return {
        lobe: _table_of_one(histogram, orders, CENTER[lobe] or 0.0, seen) for lobe, orders in ORDERS.items()
    }


def _table_of_one(histogram, orders, center, seen):
    light = bin_probabilities(histogram, orders).sum(axis=1)[seen]
    energy = light.sum(axis=1)
    hats = _hats(histogram.bins.phi - center)
    shares = row_shares(ROWS, np.cos(histogram.theta_i[seen]))
    model = [np.sqrt(e) * np.kron(share, hats) for e, share in zip(energy, shares, strict=True)]
    found = [one / np.sqrt(e) for e, one in zip(energy, light, strict=True)]
    bend = SMOOTHING * np.sqrt(energy.sum()) * np.kron(np.eye(ROWS), np.diff(np.eye(KNOTS), 2, axis=0))
    whole = 1e3 * np.kron(np.eye(ROWS), knot_masses(KNOTS))  # each row integrates to one
    target = np.concatenate([*found, np.zeros(len(bend)), np.full(ROWS, 1e3)])
    knots = nnls(np.concatenate([*model, bend, whole]), target, maxiter=20_000)[0].reshape(ROWS, KNOTS)
    # four digits, as the presets have them
    return tuple(tuple(float(f"{value:.4g}") for value in row) for row in knots)


def _hats(phi):
    """Mean of the hat function of each knot over each bin, times the bin's size; shape [bins, knots]."""
    inside = phi[:, None] + (_INSIDE_BIN - 0.5) * (phi[1] - phi[0])
    place = np.abs(inside - 2 * np.pi * np.round(inside / (2 * np.pi))) * ((KNOTS - 1) / np.pi)
    hats = np.clip(1 - np.abs(place[..., None] - np.arange(KNOTS)), 0, None)
    return hats.mean(axis=1) * (phi[1] - phi[0])


class Along(NamedTuple):
    """One lobe along the fiber: beta [rad] and the tail's part, at normal incidence and along the fiber."""

    beta: float
    beta_along: float
    ratio: float
    weight: float
    weight_along: float


START = Along(*np.radians([8.0, 10.0]), 1.2, 0.4, 0.4)
LOWEST = Along(*np.radians([2.0, 2.0]), 0.25, 0.0, 0.0)
HIGHEST = Along(*np.radians([60.0, 45.0]), 4.0, 1.0, 1.0)


def lobes_along(histogram, seen, tables, energies) -> dict[str, Along]:
    """Shapes along the fiber, N by the tables: each lobe to its own light, then all together with the model's
    energies to all light, the widths within a fifth of what they were. Of lights `seen`; least squares of
    roots of probabilities, near a minimum of the total variation, but smooth.
    """
    lights, bins = histogram.theta_i[seen], histogram.bins
    own = {lobe: bin_probabilities(histogram, orders)[seen] for lobe, orders in ORDERS.items()}
    turns = {
        lobe: [table_masses(tables[lobe], bins.phi - (CENTER[lobe] or 0.0), light) for light in lights]
        for lobe in ORDERS
    }

    of_model = modeled_energies(energies, lights)

    def shapes(x):
        return np.array([tailed_along(bins.theta_edges, light, Along(*x)) for light in lights])

    def alone(lobe):
        light = own[lobe].sum(2)
        energy, root = light.sum(1, keepdims=True), np.sqrt(light)
        return least_squares(
            lambda x: (np.sqrt(energy * shapes(x)) - root).ravel(),
            START,
            bounds=(LOWEST, HIGHEST),
            x_scale=START,
        ).x

    def together(x):
        parts = [
            (of_model[lobe][:, None] * shapes(of_lobe))[:, :, None] * np.array(turns[lobe])[:, None, :]
            for lobe, of_lobe in zip(ORDERS, x.reshape(3, -1), strict=True)
        ]
        return (np.sqrt(sum(parts)) - all_light).ravel()

    all_light = np.sqrt(sum(own.values()))
    start = np.array([alone(lobe) for lobe in ORDERS])
    low, high = np.array([LOWEST] * 3), np.array([HIGHEST] * 3)
    low[:, :2] = np.maximum(low, start / 1.2)[:, :2]
    high[:, :2] = np.minimum(high, start * 1.2)[:, :2]
    start = np.clip(start, low + 1e-9, high - 1e-9).ravel()
    scale = np.maximum(start, 0.05)
    found = least_squares(
        together, start, bounds=(low.ravel(), high.ravel()), x_scale=scale, ftol=1e-5, max_nfev=15
    )
    # tails as the presets have them; `weft fit` refines the widths
    rounded = [[*of_lobe[:2], *np.round(of_lobe[2:], 4)] for of_lobe in found.x.reshape(3, -1)]
    return {lobe: Along(*map(float, values)) for lobe, values in zip(ORDERS, rounded, strict=True)}


def tailed_along(theta_edges, light, shape: Along):
    """Probability of each bin of inclination under a lobe with a tail."""
    u = 1 - np.cos(light)
    beta = shape.beta + (shape.beta_along - shape.beta) * u
    weight = shape.weight + (shape.weight_along - shape.weight) * u
    theta = theta_edges[:-1, None] + np.diff(theta_edges)[:, None] * _INSIDE_BIN
    tail = (tail_eval(light, theta, shape.ratio * beta) * np.cos(theta)).mean(axis=1) * np.diff(theta_edges)
    return (1 - weight) * along(theta_edges, light, beta) + weight * tail / tail.sum()


def energies_alone(histogram, seen):
    """F_R, T at both ends, C_TT and C_TRT (RGB) from the light of each lobe: the albedo is the simulation's.

    A fit of the shapes would put light where the lobes do not reach, and a cloth of fibers shows each percent
    that is lost, many times over.
    """
    u = 1 - np.cos(histogram.theta_i[seen])
    s = u**5
    light = np.array(
        [
            [bin_probabilities(histogram, orders, channel=c).sum((1, 2))[seen] for c in range(3)]
            for orders in ORDERS.values()
        ]
    )

    def residuals(x):
        fresnel = x[0] + (1 - x[0]) * s
        t = x[1] + (x[2] - x[1]) * u
        r = np.tile(fresnel, (3, 1))
        tt, trt = x[3:6, None] * (1 - fresnel) * t, x[6:, None] * (1 - fresnel) * (1 - t)
        model = np.stack([r, tt, trt])
        return np.concatenate([(model - light).ravel(), 10 * (model - light).sum(axis=0).ravel()])

    start = [0.08, 0.7, 0.3, *[0.95] * 6]
    x = least_squares(residuals, start, bounds=([0.0] * 9, [1.0] * 9), xtol=1e-12).x
    return {
        "fresnel_r": float(x[0]),
        "fresnel_tt": float(x[1]),
        "fresnel_tt_grazing": float(x[2]),
        "color_tt": tuple(x[3:6]),
        "color_trt": tuple(x[6:]),
    }


def modeled_energies(energies, lights):
    """Light of each lobe, green, by what `energies_alone` found; {lobe: [I]}."""
    u = 1 - np.cos(lights)
    fresnel = energies["fresnel_r"] + (1 - energies["fresnel_r"]) * u**5
    t = energies["fresnel_tt"] + (energies["fresnel_tt_grazing"] - energies["fresnel_tt"]) * u
    tt, trt = energies["color_tt"][1] * t, energies["color_trt"][1] * (1 - t)
    return {"r": fresnel, "tt": (1 - fresnel) * tt, "trt": (1 - fresnel) * trt}


def shapes_at_normal_incidence(histogram, *, blur_deg=0.0):
    """Total variation of R, TT, TRT around the fiber against the best simple lobe of each; of the three by
    energy; that with TRT uniform. Light at 0 deg, without orders beyond TRT; blurred if asked.
    """
    phi, energies, best, uniform = histogram.bins.phi, [], [], []
    for order, center in (("R", None), ("TT", np.pi), ("TRT", 0.0)):
        light = bin_probabilities(histogram, (order,))[0].sum(0)
        shape = _blurred(light / light.sum(), phi, blur_deg)
        gammas = [None] if center is None else np.radians(np.geomspace(8, 300, 120))
        distances = [0.5 * np.abs(shape - around(phi, gamma, center)).sum() for gamma in gammas]
        energies.append(light.sum())
        best.append(min(distances))
        uniform.append(0.5 * np.abs(shape - 1 / len(phi)).sum())
    share = np.array(energies) / sum(energies)
    return [*best, share @ best, share @ [*best[:2], uniform[2]]]


def _blurred(shape, phi, blur_deg):
    if not blur_deg:
        return shape
    kernel = wrapped_normal_eval(phi - phi[0], np.radians(blur_deg))
    return np.real(np.fft.ifft(np.fft.fft(shape) * np.fft.fft(kernel / kernel.sum())))
