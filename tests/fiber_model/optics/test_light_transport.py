"""What is true of light in any fiber: energy, reciprocity, the specular cone, the series of the round one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from weft.fiber_model.optics.analytic_cylinder import SmoothCylinder
from weft.fiber_model.optics.config import EllipseConfig
from weft.fiber_model.optics.cross_sections import build_outline
from weft.fiber_model.optics.histogram import ORDERS, ScatteringHistogram
from weft.fiber_model.optics.light_transport import FiberTracer, run

from .optics_cases import SHAPES, fiber

CERTAIN = 1e-6
"""Probability with which a correct tracer fails one statistical test here; the seeds are fixed."""


def _is_multinomial(counts: np.ndarray, expected: np.ndarray) -> float:
    """p value of Pearson's chi-square; cells that expect fewer than 10 are put together."""
    few = expected < 10
    counts = np.append(counts[~few], counts[few].sum())
    expected = np.append(expected[~few], expected[few].sum())
    keep = expected > 0
    statistic = ((counts - expected)[keep] ** 2 / expected[keep]).sum()
    return float(stats.chi2.sf(statistic, keep.sum() - 1))


def _worst_of(z: np.ndarray) -> float:
    """p value of the largest of many standard normals (Bonferroni)."""
    return float(2 * stats.norm.sf(np.abs(z).max()) * z.size)


@pytest.mark.parametrize("theta_deg", [0.0, 45.0, 75.0])
def test_round_fiber_is_the_fresnel_series(theta_deg: float) -> None:
    """Chi-square over order and azimuth; without absorption and floor, paths are counted one by one."""
    config = fiber(theta_i_deg=(theta_deg,), reflection_floor=0.0, phi_bin_deg=5, paths=400_000)
    result = run(config)
    series = SmoothCylinder(1.55).azimuthal_masses(np.radians(theta_deg), result.bins.phi_edges)
    counts = result.weight_sums[0, :, :, :, 0].sum(axis=1)
    assert np.all(counts == np.round(counts))
    assert _is_multinomial(counts, series / series.sum() * config.paths) > CERTAIN


@pytest.mark.parametrize("absorption", [(0.0, 0.4, 3.0), (2.5, 3.0, 4.0)], ids=["light", "dark"])
def test_absorption_follows_the_series(absorption: tuple[float, float, float]) -> None:
    """The dark fiber leaves light so faint in every channel that Russian roulette is played for it."""
    config = fiber(theta_i_deg=(40.0,), absorption_per_mm=absorption, paths=400_000)
    result = run(config)
    for channel, per_radius in enumerate(absorption):
        energies = SmoothCylinder(1.55, per_radius).energies(np.radians(40))
        z = (result.energies()[0, :, channel] - energies) / result.energy_errors()[0, :, channel]
        assert _worst_of(z) > CERTAIN


def test_the_reflection_floor_changes_no_mean() -> None:
    """Each bin with its own error: the masses of the series, from paths of unequal weight."""
    result = run(fiber(theta_i_deg=(30.0,), paths=400_000, seed=5))
    series = SmoothCylinder(1.55).azimuthal_masses(np.radians(30), result.bins.phi_edges)
    for k, order in enumerate(ORDERS[:3]):
        row = np.searchsorted(result.bins.theta_edges, -np.radians(30)) - 1
        value, error = (
            a[0, row, :, 0] * result.bins.solid_angles[row]
            for a in (result.phase_function(order), result.standard_errors(order))
        )
        many = series[k] * 400_000 > 100
        assert _worst_of((value - series[k])[many] / error[many]) > CERTAIN


@pytest.mark.parametrize("roughness", [0.0, 0.15, 0.5])
@pytest.mark.parametrize("cross_section", SHAPES)
def test_without_absorption_energy_is_one(cross_section: str, roughness: float) -> None:
    """Within 5 standard errors (2e-5 for both angles and three channels), and nothing is lost."""
    result = run(fiber(cross_section, roughness=roughness, theta_i_deg=(10.0, 65.0), paths=40_000))
    mean, error = result.albedo()
    assert np.all(np.abs(mean - 1) < 5 * error)
    assert np.all(error < 4e-3)
    assert not result.lost_counts.any()


@pytest.mark.parametrize("cross_section", SHAPES)
def test_smooth_fibers_scatter_onto_the_cone(cross_section: str) -> None:
    config = fiber(cross_section)
    ends = FiberTracer(config, build_outline(config.cross_section)).trace(0.6, 0, 0, 20_000)
    assert np.abs(ends.sin_theta + np.sin(0.6)).max() < 1e-12


def _reciprocity(config: Any) -> np.ndarray:
    """z of cos(theta_i) f_p(i -> o) against cos(theta_o) f_p(o -> i), for pairs of bins with enough light.

    Light is spread over the bins that it is measured in: rows of inclinations at the bins' middles, of
    narrow bins, so that what a bin averages differs little from what its middle says.
    """
    result = run(config)
    rows = [int(np.argmin(np.abs(result.bins.theta - theta))) for theta in result.theta_i]
    value = result.phase_function()[..., 0][:, rows] * np.cos(result.theta_i)[:, None, None]
    error = result.standard_errors()[..., 0][:, rows] * np.cos(result.theta_i)[:, None, None]
    # f_p(o -> i) seen from the other side: the azimuth changes its sign; column P - c mirrors column c
    mirrored = (-np.arange(value.shape[2])) % value.shape[2]
    other, other_error = value.transpose(1, 0, 2)[:, :, mirrored], error.transpose(1, 0, 2)[:, :, mirrored]
    pairs = np.triu_indices(len(rows), k=1)
    value, other, error, other_error = (a[pairs] for a in (value, other, error, other_error))
    enough = (error < 0.2 * value) & (other_error < 0.2 * other)
    assert enough.sum() > 100
    return ((value - other) / np.hypot(error, other_error))[enough]


@pytest.mark.parametrize("cross_section", ["circle", "notched"])
def test_rough_fibers_are_reciprocal(cross_section: str) -> None:
    """Chi-square of all pairs of bins; a scalene notched polygon has no symmetry to hide behind."""
    config = fiber(
        cross_section,
        roughness=0.6,
        theta_i_deg=(-60.0, -30.0, 0.0, 30.0, 60.0),
        theta_bin_deg=5,
        phi_bin_deg=15,
        absorption_per_mm=0.3,
        paths=100_000,
    )
    z = _reciprocity(config)
    assert stats.chi2.sf((z**2).sum(), z.size) > CERTAIN


def _azimuths(result: ScatteringHistogram) -> tuple[np.ndarray, np.ndarray]:
    """Mass of each azimuth and its variance, green channel."""
    solid = result.bins.solid_angles
    mass = (result.phase_function()[0, ..., 1] * solid).sum(axis=0)
    return mass, ((result.standard_errors()[0, ..., 1] * solid) ** 2).sum(axis=0)


def _two_agree(a: ScatteringHistogram, b: ScatteringHistogram) -> float:
    (one, variance), (other, other_variance) = _azimuths(a), _azimuths(b)
    return _worst_of((one - other) / np.sqrt(variance + other_variance))


def test_an_ellipse_with_equal_axes_is_a_circle() -> None:
    settings: dict[str, Any] = {"theta_i_deg": (35.0,), "roughness": 0.1}
    oval = fiber(cross_section="circle", **settings).model_copy(
        update={"cross_section": EllipseConfig(semi_axes_mm=(1, 1)), "seed": 12}
    )
    assert _two_agree(run(oval), run(fiber(**settings))) > CERTAIN


def test_rotation_of_the_fiber_averages_out() -> None:
    """A polygon and the same one turned by 40 degrees."""
    corners = np.array(SHAPES["notched"].vertices_mm)  # type: ignore[union-attr]
    turn = np.radians(40)
    turned = corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    one, other = (
        run(_with_shape({"kind": "polygon", "vertices_mm": tuple(map(tuple, vertices))}, seed))
        for seed, vertices in enumerate((corners, turned))
    )
    assert _two_agree(one, other) > CERTAIN


def test_smooth_fibers_scatter_alike_to_both_sides() -> None:
    """Even one without mirror symmetry: light turned back goes from phi to -phi, on the same cone."""
    mass, variance = _azimuths(run(fiber("notched", theta_i_deg=(20.0,), paths=400_000)))
    mirrored = (-np.arange(len(mass))) % len(mass)
    z = (mass - mass[mirrored])[1 : len(mass) // 2] / np.sqrt(variance + variance[mirrored])[
        1 : len(mass) // 2
    ]
    assert _worst_of(z) > CERTAIN


def _with_shape(shape: dict[str, Any], seed: int) -> Any:
    base = fiber(paths=400_000, seed=seed, theta_i_deg=(20.0,)).model_dump()
    return type(fiber())(**(base | {"cross_section": shape}))


def test_size_and_absorption_count_only_together() -> None:
    small = run(_with_shape({"kind": "circle", "radius_mm": 0.01}, 3))
    large = run(_with_shape({"kind": "circle", "radius_mm": 1.0}, 3))
    assert small.phase_function() == pytest.approx(large.phase_function(), rel=1e-6)


def test_same_seed_same_bits_another_seed_others() -> None:
    settings: dict[str, Any] = {"roughness": 0.2, "paths": 140_000}
    one, again = run(fiber("kidney", **settings)), run(fiber("kidney", **settings))
    assert one.weight_sums.tobytes() == again.weight_sums.tobytes()
    assert run(fiber("kidney", seed=12, **settings)).weight_sums.tobytes() != one.weight_sums.tobytes()


def test_paths_do_not_depend_on_how_many_are_traced_together() -> None:
    config = fiber("triangle", roughness=0.2)
    tracer = FiberTracer(config, build_outline(config.cross_section))
    whole, part = tracer.trace(0.4, 2, 0, 1000), tracer.trace(0.4, 2, 300, 200)
    assert part.phi.tobytes() == whole.phi[300:500].tobytes()
    assert part.weight.tobytes() == whole.weight[300:500].tobytes()


def test_every_order_adds_up_to_all() -> None:
    result = run(fiber("kidney", roughness=0.1, absorption_per_mm=1.0))
    parts = sum(result.phase_function(order) for order in ORDERS)
    assert parts == pytest.approx(result.phase_function(), rel=1e-12)
    mass = (result.phase_function() * result.bins.solid_angles[..., None]).sum(axis=(1, 2))
    assert mass == pytest.approx(result.albedo()[0], rel=1e-12)


def test_progress_is_told() -> None:
    told: list[float] = []
    run(fiber(paths=300_000), progress=lambda done, what: told.append(done))
    assert told[0] == 0
    assert told == sorted(told)
    assert len(told) == 3


@pytest.mark.parametrize("cross_section", ["circle", "kidney", "notched"])
def test_mean_path_is_that_of_a_filled_cavity(cross_section: str) -> None:
    """Light from everywhere travels n² 4 area / (perimeter of the hull) inside a clear rough fiber.

    Where all of the inside can be reached, isotropic light fills it with n² times its radiance, whatever the
    roughness (Yablonovitch 1982, "Statistical ray optics"); absorption then sees n² times the volume. Within
    5 standard errors (6e-7).
    """
    absorption = 1e-7
    config = fiber(cross_section, roughness=0.6, absorption_per_mm=absorption, reflection_floor=0.0)
    outline = build_outline(config.cross_section)
    tracer = FiberTracer(config, outline)
    nodes, weights = np.polynomial.legendre.leggauss(32)
    theta = 0.25 * np.pi * (nodes + 1)
    weights = weights * np.cos(theta) ** 2 / (weights * np.cos(theta) ** 2).sum()
    mean, variance = 0.0, 0.0
    for stream, (angle, weight) in enumerate(zip(theta, weights, strict=True)):
        lengths = -np.log(tracer.trace(angle, stream, 0, 10_000).weight[:, 0]) / absorption
        mean += weight * lengths.mean()
        variance += weight**2 * lengths.var() / len(lengths)
    expected = 1.55**2 * 4 * outline.area / (np.pi * outline.mean_width)
    assert np.sqrt(variance) < 0.02 * expected
    assert abs(mean - expected) < 5 * np.sqrt(variance) + 1e-3 * expected


@pytest.mark.parametrize("cross_section", SHAPES)
def test_without_the_floor_every_path_keeps_all_its_light(cross_section: str) -> None:
    """Path by path: each comes out, with weight 1."""
    config = fiber(cross_section, roughness=0.3, reflection_floor=0.0)
    ends = FiberTracer(config, build_outline(config.cross_section)).trace(0.9, 0, 0, 30_000)
    assert np.all(ends.order >= 0)
    assert np.all(ends.weight == 1)


@pytest.mark.proof
@pytest.mark.parametrize("roughness", [0.0, 0.2])
@pytest.mark.parametrize("cross_section", SHAPES)
def test_without_absorption_energy_is_one_to_a_thousandth(cross_section: str, roughness: float) -> None:
    """7 million paths; 1e-3 is 5 standard errors (6e-7 for each of the 14)."""
    result = run(fiber(cross_section, roughness=roughness, theta_i_deg=(50.0,), paths=7_000_000))
    mean, error = result.albedo()
    assert np.all(error < 2e-4)
    assert np.all(np.abs(mean - 1) < 1e-3)


@pytest.mark.proof
@pytest.mark.parametrize("roughness", [0.15, 0.4])
@pytest.mark.parametrize("cross_section", ["ellipse", "kidney", "triangle", "notched"])
def test_rough_fibers_are_reciprocal_in_narrow_bins(cross_section: str, roughness: float) -> None:
    """As above with 2 million paths for each inclination and bins of 2 degrees."""
    config = fiber(
        cross_section,
        roughness=roughness,
        theta_i_deg=(-50.0, -20.0, 0.0, 30.0, 64.0),
        theta_bin_deg=2,
        phi_bin_deg=15,
        absorption_per_mm=0.3,
        paths=2_000_000,
    )
    z = _reciprocity(config)
    assert stats.chi2.sf((z**2).sum(), z.size) > CERTAIN


def test_light_that_meets_the_fiber_again_is_no_r() -> None:
    """An opaque fiber reflects only: once is R, again in its dent is the rest; a convex one has no rest."""
    opaque: dict[str, Any] = {"absorption_per_mm": 1e5, "theta_i_deg": (70.0,)}
    dented, convex = (run(fiber(name, **opaque)).energies()[0, :, 0] for name in ("notched", "triangle"))
    assert dented[0] > 0.1
    assert dented[3] > 0.005
    assert convex[0] > 0.2
    assert not dented[1:3].any()
    assert not convex[1:].any()
