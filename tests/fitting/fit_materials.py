"""Six textile fibers from physics to presets: simulate, fit, measure what the three lobes miss.

    python tests/fitting/fit_materials.py [--paths 400000] [--usual] [--write]

prints a table of every material and cross-section; --write makes configs/presets/scattering/<material>.toml
of the usual cross-section. Total variation of two densities f, g is ½ ∫ |f - g|, here over ∫ f.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from weft.fiber_model.optics.light_transport import run as simulate
from weft.fiber_model.optics.materials import MATERIALS, material_optics
from weft.fiber_model.scattering.azimuthal import wrapped_normal_eval
from weft.fiber_model.scattering.phase import fiber_phase_eval
from weft.files.atomic import atomic_write
from weft.fitting.config import FitConfig
from weft.fitting.fit import run as fit
from weft.fitting.measurements import Measurements
from weft.pipeline.stages import start_warp

LIGHTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
HELD_OUT_DEG = (30.0, 60.0)
PRESETS = Path(__file__).resolve().parents[2] / "configs" / "presets" / "scattering"


def direction(theta, phi):
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=-1)


def folded(values, phi):
    """Mean of phi and -phi, which the rotating fiber cannot tell apart: [..., P, C] to phi in [0, pi]."""
    mirrored = np.argmin(np.abs(np.exp(1j * phi[:, None]) - np.exp(-1j * phi)), axis=1)
    kept = np.flatnonzero(np.sin(phi) >= -1e-9)
    return 0.5 * (values + values[:, :, mirrored])[:, :, kept], phi[kept]


def as_measurements(result) -> Measurements:
    """Each bin weighs by its solid angle: the simulation's noise is small beside what the model misses."""
    values, phi = folded(result.phase_function(), result.bins.phi)
    light, theta, azimuth = (
        grid.ravel() for grid in np.meshgrid(result.theta_i, result.bins.theta, phi, indexing="ij")
    )
    values = values.reshape(-1, 3)
    sigma = 0.01 * values.max() / np.sqrt(np.maximum(np.cos(theta), 1e-3))
    inside = np.abs(theta) < np.radians(88)
    return Measurements(
        light[inside],
        np.zeros(inside.sum()),
        theta[inside],
        azimuth[inside],
        values[inside],
        "phase_function",
        sigma=np.repeat(sigma[inside, None], 3, axis=1),
        source="light transport through one fiber",
    )


def total_variations(result, parameters):
    """Of the green channel per light: over the sphere, over azimuth alone, and of TRT's azimuth alone."""
    found = result.phase_function()[..., 1]
    theta, phi = np.meshgrid(result.bins.theta, result.bins.phi, indexing="ij")
    solid = np.broadcast_to(result.bins.solid_angles, found.shape)
    model = np.stack(
        [
            fiber_phase_eval(parameters, direction(light, 0 * phi), direction(theta, phi))[..., 1]
            for light in result.theta_i
        ]
    )
    sphere = 0.5 * (np.abs(found - model) * solid).sum((1, 2)) / (found * solid).sum((1, 2))
    around, model_around = (found * solid).sum(1), (model * solid).sum(1)
    azimuth = 0.5 * np.abs(around - model_around).sum(1) / around.sum(1)
    trt = (result.phase_function("TRT")[..., 1] * solid).sum(1)
    trt /= trt.sum(1, keepdims=True)
    lobe = wrapped_normal_eval(result.bins.phi, parameters.azimuthal_width_trt)
    of_trt = 0.5 * np.abs(trt - lobe / lobe.sum()).sum(1)
    uniform = 0.5 * np.abs(trt - 1 / trt.shape[1]).sum(1)
    return sphere, azimuth, of_trt, uniform


def fit_material(name: str, shape: str, paths: int):
    optics = material_optics(name, shape, paths=paths, theta_i_deg=LIGHTS_DEG, seed=1)
    result = simulate(optics)
    config = FitConfig.model_construct(
        **{
            **{field: info.default for field, info in FitConfig.model_fields.items()},
            "measurements": [],
            "held_out_theta_i_deg": list(HELD_OUT_DEG),
            "errors": "scaled",
            "starts": 6,
        }
    )
    fitted = fit(config, as_measurements(result))
    return optics, result, fitted


def preset_text(name: str, shape: str, optics, fitted, variations) -> str:
    material, p = MATERIALS[name], fitted.parameters
    held = ", ".join(f"{100 * h.relative_rms:.0f} % at {h.theta_i_deg:g} deg" for h in fitted.held_out)
    low, high = variations[0].min(), variations[0].max()
    comment = [
        f"{name}: a clean, undyed fiber, from physics: light transport through its cross-section ({shape}),",
        f"refractive index {material.refractive_index:g}, roughness {material.roughness:g}, absorption "
        f"{optics.absorption_per_mm} per mm; sources in fiber_model/optics/materials.py",
        "(Morton and Hearle, chapter 24). The three lobes fitted to it by tests/fitting/fit_materials.py:",
        f"total variation {low:.2f} to {high:.2f} over the sphere; relative rms",
        f"at angles held out {held}. Dye the fibers with color_tt and color_trt.",
    ]
    values = {number.name: number.value for number in fitted.fitted}
    lines = [f"# {line}" for line in comment] + [""]
    lines += [f"{key} = {value:.4g}" for key, value in values.items() if key.endswith("_deg")]
    lines += [f"fresnel_tt = {p.fresnel_tt:.4g}"]
    for key in ("fresnel_r", "color_r", "color_tt", "color_trt"):
        lines.append(f"{key} = [{', '.join(f'{value:.4g}' for value in getattr(p, key))}]")
    return "\n".join(lines) + "\n"


def row(name: str, shape: str, fitted, variations) -> str:
    sphere, azimuth, of_trt, uniform = variations
    p = fitted.parameters
    widths = (
        p.longitudinal_width_r,
        p.longitudinal_width_tt,
        p.longitudinal_width_trt,
        p.azimuthal_width_tt,
        p.azimuthal_width_trt,
    )
    held = " ".join(f"{100 * h.relative_rms:.0f} %" for h in fitted.held_out)
    bounds = ", ".join(number.name for number in fitted.fitted if number.at_bound)
    return (
        f"| {name} {shape} | {' '.join(f'{np.degrees(width):.1f}' for width in widths)} | {held} "
        f"| {' '.join(f'{v:.2f}' for v in sphere)} | {' '.join(f'{v:.2f}' for v in azimuth)} "
        f"| {' '.join(f'{v:.2f}' for v in of_trt)} | {uniform.mean():.2f} | {bounds} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=400_000)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--only", help="a material")
    parser.add_argument("--usual", action="store_true", help="only the usual cross-section of each")
    chosen = parser.parse_args()
    start_warp()
    print(
        "| fiber | β R TT TRT, γ TT TRT [°] | held-out rms 30° 60° | TV sphere 0…75° | TV azimuth |",
        end="",
    )
    print(" TV of TRT | TRT uniform | at bound |\n|---|---|---|---|---|---|---|---|", flush=True)
    for name, material in MATERIALS.items():
        for index, shape in enumerate(material.cross_sections):
            if (chosen.only and chosen.only != name) or (chosen.usual and index > 0):
                continue
            optics, result, fitted = fit_material(name, shape, chosen.paths)
            variations = total_variations(result, fitted.parameters)
            print(row(name, shape, fitted, variations), flush=True)
            if chosen.write and index == 0:
                with atomic_write(PRESETS / f"{name}.toml") as temporary:
                    text = preset_text(name, shape, optics, fitted, variations)
                    temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
