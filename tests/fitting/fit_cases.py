"""Synthetic measurements that tests of the fit share."""

from __future__ import annotations

import numpy as np

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import fiber_phase_eval
from weft.fitting.config import FitConfig
from weft.fitting.measurements import Measurements
from weft.fitting.problem import FitProblem

LIGHTS_DEG = (0.0, 30.0, 60.0, 75.0)
AROUND_SPECULAR_DEG = (-20.0, -12.0, -8.0, -5.0, -3.0, -1.5, 0.0, 1.5, 3.0, 5.0, 8.0, 12.0, 20.0)


def direction(theta, phi):
    return np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=-1)


def sphere_grid(lights_deg=LIGHTS_DEG):
    """theta_i, theta_o, phi [rad] of a goniometer that looks closer around the specular cone."""
    rows = []
    for light in lights_deg:
        coarse = np.arange(-80.0, 81.0, 20.0)
        fine = -light + np.array(AROUND_SPECULAR_DEG)
        detector = np.unique(np.concatenate([coarse, fine[np.abs(fine) < 86]]))
        phi = np.concatenate([np.arange(0.0, 140.0, 20.0), np.arange(140.0, 181.0, 5.0)])
        theta_o, phi = np.meshgrid(detector, phi, indexing="ij")
        rows.append(np.stack([np.full(theta_o.size, light), theta_o.ravel(), phi.ravel()]))
    return np.radians(np.concatenate(rows, axis=1))


def model_values(parameters: FiberScatteringParameters, theta_i, theta_o, phi):
    return fiber_phase_eval(parameters, direction(theta_i, 0 * phi), direction(theta_o, phi))


def synthetic(
    parameters: FiberScatteringParameters,
    *,
    noise=0.02,
    floor=0.001,
    seed=0,
    channels=1,
    lights_deg=LIGHTS_DEG,
    state_sigma=True,
) -> Measurements:
    """Values of the model with Gaussian noise: sigma² = (noise value)² + (floor peak)²."""
    theta_i, theta_o, phi = sphere_grid(lights_deg)
    exact = model_values(parameters, theta_i, theta_o, phi)[:, :channels]
    sigma = np.hypot(noise * exact, floor * exact.max(axis=0))
    values = exact + (sigma * np.random.default_rng(seed).normal(size=exact.shape) if noise else 0)
    return Measurements(
        theta_i,
        np.zeros_like(phi),
        theta_o,
        phi,
        values,
        "phase_function",
        sigma=sigma if state_sigma and noise else None,
        source="synthetic",
    )


def random_truth(rng: np.random.Generator, *, gray=True) -> FiberScatteringParameters:
    """Widths from half of Khungurn's narrowest to wide, TRT wider than R as Marschner's relations have it."""

    def colors(low, high):
        return tuple(rng.uniform(low, high, 1).repeat(3) if gray else rng.uniform(low, high, 3))

    beta_r, beta_tt = np.exp(rng.uniform(np.log([1.0, 4.0]), np.log([15.0, 30.0])))
    beta_trt = beta_r * np.exp(rng.uniform(np.log(1.3), np.log(4.0)))
    gamma_tt, gamma_trt = np.exp(rng.uniform(np.log([15.0, 20.0]), np.log([120.0, 120.0])))
    color_tt = colors(0.3, 1.0)
    return FiberScatteringParameters(
        *np.radians([beta_r, beta_tt, beta_trt, gamma_tt]),
        fresnel_r=colors(0.01, 0.3),
        fresnel_tt=rng.uniform(0.4, 0.95),
        color_tt=color_tt,
        color_trt=tuple(np.array(color_tt) ** 1.9),
        azimuthal_width_trt=np.radians(gamma_trt),
    )


def config(**changes) -> FitConfig:
    """As from a job file, but the measurements are given as an object."""
    return FitConfig.model_validate({"measurements": [__file__], **changes})


def problem(measurements: Measurements, **changes):
    """Residual, parameterization and data for the parts of the fit."""
    made = FitProblem(config(**changes), measurements)
    return made.residual, made.parameterization, made.data


def vector_of(parameters: FiberScatteringParameters, channels=1):
    """All parameters in the order of parameterization.py."""
    p = parameters
    widths = (
        p.longitudinal_width_r,
        p.longitudinal_width_tt,
        p.longitudinal_width_trt,
        p.azimuthal_width_tt,
        p.azimuthal_width_trt or np.radians(300.0),
    )
    colors = (p.fresnel_r, p.color_r, p.color_tt, p.color_trt)
    return np.array([*widths, p.fresnel_tt, 1.0, *(c for color in colors for c in color[:channels])])
