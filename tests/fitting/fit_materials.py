"""Six textile fibers from physics to presets: simulate, fit, measure what the three lobes miss.

    python tests/fitting/fit_materials.py [--paths 4000000] [--constant] [--only silk] [--write]

prints a table of every material and cross-section; --write makes configs/presets/scattering/<material>.toml
of the usual cross-section and <material>_<cross_section>.toml of the others. Every lobe is fitted to its own
light first (material_lobes.py), which gives its energy and its table around the fiber; `weft fit` then fits
the sum of all orders, each width along the fiber within a fifth of what it was alone. The total variation of
f and g is ½ ∫ |f - g|, here over ∫ f.
"""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.fitting.material_lobes import (
    ORDERS,
    bin_probabilities,
    energies_alone,
    lobes_along,
    shapes_at_normal_incidence,
    tables_alone,
)
from weft.fiber_model.optics.light_transport import run as simulate
from weft.fiber_model.optics.materials import MATERIALS, material_optics
from weft.fiber_model.scattering.parameters import TABLES, TAILS
from weft.fiber_model.scattering.phase import azimuthal_densities, fiber_phase_albedo, fiber_phase_eval
from weft.files.atomic import atomic_write
from weft.fitting.config import FitConfig
from weft.fitting.fit import run as fit
from weft.fitting.measurements import Measurements
from weft.pipeline.warp_start import start_warp

PHI_BIN_DEG = 5.0
INSIDE_BIN = (np.arange(5) + 0.5) / 5 - 0.5
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
    """sigma as if paths were counted: the root of the value over the solid angle, common to all channels.

    Squares of such residuals are near a minimum of the total variation; squares of plain ones see peaks only.
    """
    values, phi = folded(result.phase_function(), result.bins.phi)
    light, theta, azimuth = (
        grid.ravel() for grid in np.meshgrid(result.theta_i, result.bins.theta, phi, indexing="ij")
    )
    values = values.reshape(-1, 3)
    counted = np.sqrt((values.mean(axis=1) + 1e-3 * values.max()) * values.max())
    sigma = 0.01 * counted / np.sqrt(np.maximum(np.cos(theta), 1e-3))
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


class Variations(NamedTuple):
    """Total variation for each light, shape [I]; green channel, absolute energies."""

    sphere: np.ndarray
    azimuth: np.ndarray
    """Of all light around the fiber, whatever its inclination."""
    lobes: np.ndarray
    """Of each lobe's own light around the fiber against the lobe's N, weighted by its energy and summed."""
    noise: np.ndarray
    """What the sphere's would be, by the simulation's noise alone, of a perfect model."""
    albedo: np.ndarray
    """The model's less the simulation's."""


def total_variations(result, parameters) -> Variations:
    found, bins = bin_probabilities(result, (None,)), result.bins
    theta, phi = np.meshgrid(bins.theta, bins.phi, indexing="ij")
    model = np.stack(
        [
            fiber_phase_eval(parameters, direction(light, 0 * phi), direction(theta, phi))[..., 1]
            for light in result.theta_i
        ]
    )
    model = model * bins.solid_angles
    all_light = found.sum((1, 2))
    sphere = 0.5 * np.abs(found - model).sum((1, 2)) / all_light
    azimuth = 0.5 * np.abs(found.sum(1) - model.sum(1)).sum(1) / all_light
    errors = result.standard_errors()[..., 1] * bins.solid_angles / np.sqrt(2)  # phi and -phi averaged
    noise = 0.5 * np.sqrt(2 / np.pi) * errors.sum((1, 2)) / all_light
    of_model = fiber_phase_albedo(parameters, direction(result.theta_i, 0.0))[..., 1]
    lobes = _of_lobes(result, parameters) / all_light
    return Variations(sphere, azimuth, lobes, noise, of_model - all_light)


def _of_lobes(result, parameters) -> np.ndarray:
    """Light in the wrong azimuth, [I], lobe by lobe."""
    misplaced = np.zeros(len(result.theta_i))
    inside = result.bins.phi[:, None] + np.radians(PHI_BIN_DEG) * INSIDE_BIN
    for k, orders in enumerate(ORDERS.values()):
        own = bin_probabilities(result, orders).sum(1)
        for i, light in enumerate(result.theta_i):
            shape = azimuthal_densities(parameters, light, inside)[k].mean(axis=1)
            misplaced[i] += 0.5 * np.abs(own[i] - own[i].sum() * shape / shape.sum()).sum()
    return misplaced


def near(energies, alone) -> dict[str, dict]:
    """Energies held, every width along the fiber within a fifth of what it is alone."""
    bounds: dict[str, dict] = {name: {"fixed": value} for name, value in energies.items()}
    for lobe, shape in alone.items():
        beta, beta_along = np.degrees(shape[:2])
        bounds[f"longitudinal_width_{lobe}_deg"] = _within_a_fifth(beta, 0.5, 60)
        # not below half of the largest beta: the model takes no more
        bounds[f"longitudinal_width_{lobe}_grazing_deg"] = _within_a_fifth(beta_along, 0.6 * beta, 45)
    return bounds


def tails_of(shapes) -> dict[str, float]:
    values = {}
    for lobe, shape in shapes.items():
        values |= {
            f"tail_weight_{lobe}": shape.weight,
            f"tail_weight_{lobe}_grazing": shape.weight_along,
            f"tail_ratio_{lobe}": shape.ratio,
        }
    return values


def _within_a_fifth(width: float, least: float, most: float) -> dict[str, float]:
    low = min(max(width / 1.2, least), most / 1.2)
    return {"lower": low, "upper": min(max(width * 1.2, 1.2 * low), most)}


def preset_name(material: str, shape: str) -> str:
    usual = next(iter(MATERIALS[material].cross_sections))
    return material if shape == usual else f"{material}_{shape}"


def simulated(name: str, shape: str, paths: int, lights_deg=LIGHTS_DEG, *, seed: int = 1):
    optics = material_optics(
        name, shape, paths=paths, theta_i_deg=lights_deg, seed=seed, phi_bin_deg=PHI_BIN_DEG
    )
    return optics, simulate(optics)


def fit_material(name: str, shape: str, paths: int, *, constant: bool):
    optics, result = simulated(name, shape, paths)
    seen = ~np.isin(np.round(np.degrees(result.theta_i)), HELD_OUT_DEG)
    settings = {"starts": 12}
    if not constant:
        tables = tables_alone(result, seen)
        energies = energies_alone(result, seen)
        shapes = lobes_along(result, seen, tables, energies)
        parameters = near(energies, shapes)
        settings = {"grazing": True, "parameters": parameters, "starts": 1} | tails_of(shapes)
        settings |= {f"azimuthal_table_{lobe}": table for lobe, table in tables.items()}
    asked = FitConfig.model_validate(
        {"measurements": [__file__], "held_out_theta_i_deg": HELD_OUT_DEG, "errors": "scaled"} | settings
    )
    return optics, result, fit(asked, as_measurements(result))


def preset_text(name: str, shape: str, optics, fitted, variations: Variations) -> str:
    material, p = MATERIALS[name], fitted.parameters
    held = ", ".join(f"{100 * h.relative_rms:.0f} % at {h.theta_i_deg:g} deg" for h in fitted.held_out)
    at_normal, lobes = variations.lobes[0], variations.lobes.mean()
    around, sphere = variations.azimuth.mean(), variations.sphere.mean()
    comment = [
        f"{name}: a clean, undyed fiber, from physics: light transport through its cross-section ({shape}),",
        f"refractive index {material.refractive_index:g}, roughness {material.roughness:g}, absorption "
        f"{optics.absorption_per_mm} per mm; sources in fiber_model/optics/materials.py",
        "(Morton and Hearle, chapter 24). Three lobes that change with the angle, fitted to it by",
        "tests/fitting/fit_materials.py: total variation around the fiber, lobe by lobe, "
        f"{at_normal:.3f} at normal",
        f"incidence and {lobes:.3f} on average over 0 to 75 deg; of all light together {around:.3f} around",
        f"the fiber and {sphere:.3f} over the sphere; relative rms at angles held out {held}.",
        "The widths around the fiber are those of the nearest simple lobes; the tables take their place.",
        "Dye the fibers with color_tt and color_trt.",
    ]
    values = {number.name: number.value for number in fitted.fitted}
    lines = [f"# {line}" for line in comment] + [""]
    keys = [key for key in values if key.endswith("_deg") or key.startswith("fresnel_tt")]
    lines += [f"{key} = {round(values[key], 6):.4g}" for key in keys]
    for key in ("fresnel_r", "color_r", "color_tt", "color_trt"):
        lines.append(f"{key} = [{', '.join(f'{value:.4g}' for value in getattr(p, key))}]")
    lines += [f"{name} = {getattr(p, name):.4g}" for name in TAILS if getattr(p, name) is not None]
    for name_of_table in TABLES:
        lines += table_lines(name_of_table, getattr(p, name_of_table) or ())
    return "\n".join(lines) + "\n"


def table_lines(name: str, table) -> list[str]:
    """At most 110 characters each."""
    if not table:
        return []
    rows = []
    for numbers in table:
        text = ", ".join(f"{value:.4g}" for value in numbers)
        rows += [
            "    [",
            *textwrap.wrap(text, 100, initial_indent=8 * " ", subsequent_indent=8 * " "),
            "    ],",
        ]
    return [f"{name} = [", *rows, "]"]


def row(name: str, shape: str, fitted, variations: Variations) -> str:
    values = {number.name: number.value for number in fitted.fitted}

    def width(key: str) -> str:
        grazing = values.get(f"{key}_grazing_deg")
        return f"{values[f'{key}_deg']:.1f}" + ("" if grazing is None else f"–{grazing:.1f}")

    beta = " ".join(width(f"longitudinal_width_{lobe}") for lobe in ("r", "tt", "trt"))
    gamma = " ".join(width(f"azimuthal_width_{lobe}") for lobe in ("tt", "trt"))
    t = f"{values['fresnel_tt']:.2f}–{values.get('fresnel_tt_grazing', values['fresnel_tt']):.2f}"
    held = " ".join(f"{100 * h.relative_rms:.0f} %" for h in fitted.held_out)
    sphere, azimuth, lobes = (
        f"{' '.join(f'{one:.2f}' for one in tv)}, {tv.mean():.3f}" for tv in variations[:3]
    )
    noise, albedo = f"{variations.noise.mean():.3f}", f"{np.abs(variations.albedo).max():.3f}"
    cells = (beta, gamma, t, held, sphere, azimuth, lobes, noise, albedo)
    return f"| {name} {shape} | {' | '.join(cells)} |"


HEADER = (
    "| fiber | β R, TT, TRT [°] | γ TT, TRT [°] | T | held-out rms 30° 60° | TV sphere 0…75° (mean) "
    "| TV azimuth | TV azimuth, lobe by lobe | noise | albedo off by |\n" + 10 * "|---" + "|"
)


def print_shapes(paths: int) -> None:
    """R, TT and TRT around the fiber at normal incidence, each against its best simple lobe."""
    print("| fiber | R, TT, TRT | weighted by energy | TRT uniform | blurred by 15° |\n|---|---|---|---|---|")
    for name, material in MATERIALS.items():
        for shape in material.cross_sections:
            _, result = simulated(name, shape, paths, (0.0,))
            *lobes, together, uniform = shapes_at_normal_incidence(result)
            blurred = shapes_at_normal_incidence(result, blur_deg=15.0)[3]
            each = ", ".join(f"{one:.3f}" for one in lobes)
            print(f"| {name} {shape} | {each} | {together:.3f} | {uniform:.3f} | {blurred:.3f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=4_000_000)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--only", help="a material")
    parser.add_argument("--constant", action="store_true", help="widths and T as in the thesis")
    parser.add_argument("--shapes", action="store_true", help="only the azimuthal shapes at normal incidence")
    chosen = parser.parse_args()
    start_warp()
    if chosen.shapes:
        print_shapes(chosen.paths)
        return
    print(HEADER, flush=True)
    for name, material in MATERIALS.items():
        for shape in material.cross_sections:
            if chosen.only and chosen.only != name:
                continue
            optics, result, fitted = fit_material(name, shape, chosen.paths, constant=chosen.constant)
            variations = total_variations(result, fitted.parameters)
            print(row(name, shape, fitted, variations), flush=True)
            if chosen.write:
                with atomic_write(PRESETS / f"{preset_name(name, shape)}.toml") as temporary:
                    text = preset_text(name, shape, optics, fitted, variations)
                    temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
