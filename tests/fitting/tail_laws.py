"""Which law along the fiber follows a rough fiber's lobes: the study behind the tails (fitting/FIT.md).

    python tests/fitting/tail_laws.py [--paths 4000000] [nylon:circle cotton:kidney ...]

prints the total variation over the sphere for each law. Each lobe has its own light's energy and its table
around the fiber; its law is fitted to its own light, then all three together to all light, without 30 and 60
degrees. A law is a density over inclinations; numbers of it beyond beta at both ends of the inclination are
its ratio, part, power of the cosine and so on, as its line says.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from tests.fitting.fit_materials import HELD_OUT_DEG, simulated
from tests.fitting.material_lobes import CENTER, ORDERS, bin_probabilities, table_masses, tables_alone
from weft.fiber_model.scattering.longitudinal import vmf_eval
from weft.fiber_model.scattering.tail import tail_eval
from weft.pipeline.warp_start import start_warp

FIBERS = ("nylon:circle", "cotton:kidney", "silk:ellipse", "polyester:trilobal")
COSINES = {"r": 1, "tt": 2, "trt": 1}
"""Powers of cos(theta_i) for the laws that say so; all others have 2."""
INSIDE = (np.arange(5) + 0.5) / 5


class Bins(NamedTuple):
    """Inclinations [bins, 5] inside each bin, and the bins' sizes [bins]."""

    theta: np.ndarray
    size: np.ndarray


def shares(density, bins):
    mass = density.mean(axis=1) * bins.size
    return mass / mass.sum()


def gaussian(bins, light, beta, *, cosines=2, lag=1.0):
    x = (bins.theta + lag * light) / beta
    return shares(np.exp(-0.5 * x**2) * np.maximum(np.cos(bins.theta), 1e-9) ** cosines, bins)


def student(bins, light, beta, freedom, *, cosines=2):
    x = (bins.theta + light) / beta
    falloff = (1 + x**2 / freedom) ** (-0.5 * (freedom + 1))
    return shares(falloff * np.maximum(np.cos(bins.theta), 1e-9) ** cosines, bins)


def vmf(bins, light, beta):
    return shares(vmf_eval(light, bins.theta, beta) * np.cos(bins.theta), bins)


def cauchy(bins, light, beta):
    return shares(tail_eval(light, bins.theta, beta) * np.cos(bins.theta), bins)


def mixed(one, other, part):
    return (1 - part) * one + part * other


class Law(NamedTuple):
    """`shape(lobe, bins, light, u, beta, *numbers)`, u = 1 - cos(light); start and bounds of the numbers."""

    shape: Callable
    start: tuple[float, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()


NARROW = {"start": (2.5, 0.25), "low": (1.05, 0.0), "high": (12.0, 1.0)}
ANY = {"start": (1.2, 0.4), "low": (0.3, 0.0), "high": (12.0, 1.0)}
LAWS = {
    "one Gaussian": Law(lambda lobe, bins, light, u, b: gaussian(bins, light, b)),
    "two Gaussians, one mean": Law(
        lambda lobe, bins, light, u, b, r, w: mixed(
            gaussian(bins, light, b), gaussian(bins, light, r * b), w
        ),
        **NARROW,
    ),
    "two Gaussians, the mean a factor times theta_o": Law(
        lambda lobe, bins, light, u, b, r, w, k: mixed(
            gaussian(bins, light, b, lag=k), gaussian(bins, light, r * b, lag=k), w
        ),
        (2.5, 0.25, 1.0),
        (1.05, 0.0, 0.0),
        (12.0, 1.0, 2.0),
    ),
    "two Gaussians, R and TRT with cos": Law(
        lambda lobe, bins, light, u, b, r, w: mixed(
            gaussian(bins, light, b, cosines=COSINES[lobe]),
            gaussian(bins, light, r * b, cosines=COSINES[lobe]),
            w,
        ),
        **NARROW,
    ),
    "Student's t": Law(
        lambda lobe, bins, light, u, b, n: student(bins, light, b, n), (4.0,), (0.8,), (100.0,)
    ),
    "Student's t, R and TRT with cos": Law(
        lambda lobe, bins, light, u, b, n: student(bins, light, b, n, cosines=COSINES[lobe]),
        (4.0,),
        (0.8,),
        (100.0,),
    ),
    "two von Mises-Fisher": Law(
        lambda lobe, bins, light, u, b, r, w: mixed(vmf(bins, light, b), vmf(bins, light, r * b), w), **NARROW
    ),
    "Gaussian and von Mises-Fisher": Law(
        lambda lobe, bins, light, u, b, r, w: mixed(gaussian(bins, light, b), vmf(bins, light, r * b), w),
        **ANY,
    ),
    "spherical Cauchy": Law(lambda lobe, bins, light, u, b: cauchy(bins, light, b)),
    "Gaussian and spherical Cauchy": Law(
        lambda lobe, bins, light, u, b, r, w: mixed(gaussian(bins, light, b), cauchy(bins, light, r * b), w),
        **ANY,
    ),
    "the same, its part going with the angle": Law(
        lambda lobe, bins, light, u, b, r, w, along: mixed(
            gaussian(bins, light, b), cauchy(bins, light, r * b), w + (along - w) * u
        ),
        (1.2, 0.4, 0.4),
        (0.3, 0.0, 0.0),
        (12.0, 1.0, 1.0),
    ),
}


def print_fiber(name, shape, paths):
    _, result = simulated(name, shape, paths)
    seen = np.flatnonzero(~np.isin(np.round(np.degrees(result.theta_i)), HELD_OUT_DEG))
    mask = np.isin(np.arange(len(result.theta_i)), seen)
    tables, edges = tables_alone(result, mask), result.bins.theta_edges
    bins = Bins(edges[:-1, None] + np.diff(edges)[:, None] * INSIDE, np.diff(edges))
    found = {lobe: bin_probabilities(result, orders) for lobe, orders in ORDERS.items()}
    total = sum(found.values())
    turns = {
        lobe: np.array(
            [table_masses(tables[lobe], result.bins.phi - (CENTER[lobe] or 0.0), t) for t in result.theta_i]
        )
        for lobe in ORDERS
    }

    def variation(model):
        return (0.5 * np.abs(model - total).sum((1, 2)) / total.sum((1, 2))).mean()

    for title, law in LAWS.items():
        print(
            f"{name} {shape}: {title}: {variation(fitted(law, bins, result.theta_i, seen, found, turns)):.3f}"
        )
    exact = sum(found[lobe].sum(2)[:, :, None] * turns[lobe][:, None, :] for lobe in ORDERS)
    print(f"{name} {shape}: every lobe's own: {variation(exact):.3f}", flush=True)


def fitted(law, bins, lights, seen, found, turns):
    """The model's light in every bin, of all lights."""
    start = np.array([*np.radians([6.0, 8.0]), *law.start])
    low, high = (
        np.array([*np.radians([0.5, 0.5]), *law.low]),
        np.array([*np.radians([45.0, 60.0]), *law.high]),
    )

    def along(lobe, i, x):
        u = 1 - np.cos(lights[i])
        shape = law.shape(lobe, bins, lights[i], u, x[0] + (x[1] - x[0]) * u, *x[2:])
        return found[lobe][i].sum() * shape

    def model(x, which):
        return np.array(
            [
                sum(
                    np.outer(along(lobe, i, of_lobe), turns[lobe][i])
                    for lobe, of_lobe in zip(ORDERS, x.reshape(3, -1), strict=True)
                )
                for i in which
            ]
        )

    def alone(lobe):
        roots = np.sqrt(found[lobe].sum(2))
        return least_squares(
            lambda x: np.concatenate([np.sqrt(along(lobe, i, x)) - roots[i] for i in seen]),
            start,
            bounds=(low, high),
            x_scale=start,
            max_nfev=60,
        ).x

    x = np.array([alone(lobe) for lobe in ORDERS])
    least, most = np.tile(low, (3, 1)), np.tile(high, (3, 1))
    least[:, :2], most[:, :2] = np.maximum(low, x / 1.2)[:, :2], np.minimum(high, 1.2 * x)[:, :2]
    x = np.clip(x, least + 1e-9, most - 1e-9).ravel()
    roots = np.sqrt(sum(found.values())[seen])
    x = least_squares(
        lambda x: (np.sqrt(model(x, seen)) - roots).ravel(),
        x,
        bounds=(least.ravel(), most.ravel()),
        x_scale=np.maximum(x, 0.05),
        max_nfev=15,
        ftol=1e-5,
    ).x
    return model(x, range(len(lights)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=4_000_000)
    parser.add_argument("fibers", nargs="*", default=FIBERS)
    chosen = parser.parse_args()
    start_warp()
    for fiber in chosen.fibers:
        print_fiber(*fiber.split(":"), chosen.paths)


if __name__ == "__main__":
    main()
