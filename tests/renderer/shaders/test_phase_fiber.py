"""The fiber's phase function in GLSL: equal to its numpy twin, exactly sampled, also after many bounces."""

from __future__ import annotations

import itertools
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy import stats

from tests.fiber_model.scattering.scattering_cases import CORNERS, PRESET_NAMES, gray, preset
from tests.fiber_model.scattering.sphere_bins import (
    angles_from_tt,
    direction,
    fiber_bins,
    fiber_means,
    gauss_points,
)
from tests.renderer.shaders.fiber_probes import draw_probe, fiber_probe, random_keys
from weft.fiber_model.scattering.longitudinal import gaussian_eval, gaussian_normalization
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import (
    fiber_phase_albedo,
    fiber_phase_eval,
    fiber_phase_pdf,
    fiber_phase_sample,
    lobe_energies,
    longitudinal_widths,
)

pytestmark = pytest.mark.gl

MEDIA: dict[str, FiberScatteringParameters] = {name: preset(name) for name in PRESET_NAMES} | CORNERS
LIST = list(MEDIA.values())
INDEX = {name: index for index, name in enumerate(MEDIA)}
ALPHA = 1e-4
"""Chance that a correct sampler fails one whole parametrized chi-square test (Bonferroni over its cases)."""

evaluate = fiber_probe(LIST, "vec3 evaluate(int medium, vec3 wo, vec3 wi)")
density = fiber_probe(LIST, "float density(int medium, vec3 wo, vec3 wi)")
albedo = fiber_probe(LIST, "vec3 albedo(int medium, vec3 wo)")
draw = draw_probe(LIST)
draw_philox = draw_probe(LIST, philox=True)


def random_directions(rng, count):
    w = rng.normal(size=(count, 3))
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


def peak(parameters, wo):
    """About the largest value of f_p for each wo: of points near the specular cone, ahead and behind.

    Toward the poles the factor cos²(theta_i) moves a lobe's maximum off the cone by up to sqrt(2) beta.
    """
    theta_o = np.arctan2(wo[:, 0], np.hypot(wo[:, 1], wo[:, 2]))
    azimuth = np.arctan2(wo[:, 2], wo[:, 1])
    widths = [
        np.broadcast_to(width, theta_o.shape) for width in (0.0, *longitudinal_widths(parameters, theta_o))
    ]
    equatorward = np.sign(theta_o) * np.minimum(np.abs(theta_o), np.stack(widths))
    at_cone = [direction(equatorward - theta_o, azimuth + turn) for turn in (0, np.pi)]
    return np.maximum(*(fiber_phase_eval(parameters, wo, wi) for wi in at_cone)).max(axis=(0, -1))


def compare_with_twin(name, count):
    """Largest error of eval and pdf relative to the peak for this wo, over random and over sampled wi."""
    parameters, rng = MEDIA[name], np.random.default_rng(INDEX[name])
    wo, wi = random_directions(rng, count), random_directions(rng, count)
    half = count // 2
    wi[:half] = fiber_phase_sample(parameters, wo[:half], rng.random((half, 4)))[0]
    wo64, wi64 = wo.astype(np.float64), wi.astype(np.float64)
    top = peak(parameters, wo64)
    value = evaluate(INDEX[name], wo, wi) - fiber_phase_eval(parameters, wo64, wi64)
    pdf = density(INDEX[name], wo, wi) - fiber_phase_pdf(parameters, wo64, wi64)
    return np.abs(value / top[:, None]).max(), np.abs(pdf / top).max()


@pytest.mark.parametrize("name", MEDIA)
def test_equals_its_twin(name):
    assert max(compare_with_twin(name, 10_000)) < 1e-5


@pytest.mark.proof
@pytest.mark.parametrize("name", MEDIA)
def test_equals_its_twin_on_a_million_inputs(name):
    """A million over all media."""
    assert max(compare_with_twin(name, 1_000_000 // len(MEDIA))) < 1e-5


@pytest.mark.parametrize("name", MEDIA)
def test_albedo_equals_its_twin(name):
    wo = direction(np.linspace(-np.pi / 2, np.pi / 2, 1001), 0.7).astype(np.float32)
    expected = fiber_phase_albedo(MEDIA[name], wo)
    np.testing.assert_allclose(albedo(INDEX[name], wo), expected, rtol=2e-6)


def test_normalization_is_exact_for_every_width():
    """1 / G(theta_o) from the packed constants, against the closed form, to 3e-6."""
    betas = np.radians(np.concatenate([np.linspace(0.5, 30, 60), np.linspace(31, 60, 15)]))
    media = [replace(gray(), longitudinal_width_r=float(beta)) for beta in betas]
    scale = fiber_probe(media, "vec3 scale(int medium, float theta_o)")
    theta = np.concatenate([np.linspace(0, 1.57, 300), np.pi / 2 - np.geomspace(1e-6, 0.1, 100)])
    values = scale(np.arange(len(media))[:, None], theta)[..., 0]
    for value, beta in zip(values, betas, strict=True):
        exact = 1 / (beta * np.sqrt(2 * np.pi) * gaussian_normalization(theta.astype(np.float32), beta))
        np.testing.assert_allclose(value, exact, rtol=3e-6)


CHI_SQUARE = list(itertools.product([*CORNERS, "reference", "khungurn2015_silk"], (50.0, -89.0)))


def chi_square(name, theta_o, count, draw_from=draw):
    wo = direction(radians(theta_o), 0.0)
    wi = draw_from(INDEX[name], wo, random_keys(count, seed=17))[0]
    return fiber_bins(MEDIA[name], radians(theta_o)).p_value(*angles_from_tt(wi.astype(np.float64)))


@pytest.mark.parametrize("case", CHI_SQUARE)
def test_samples_follow_the_pdf(case):
    assert chi_square(*case, 100_000) > ALPHA / len(CHI_SQUARE)


MOMENTS = (
    lambda theta, phi: np.sin(theta),
    lambda theta, phi: np.sin(theta) ** 2,
    lambda theta, phi: np.cos(phi),
    lambda theta, phi: np.cos(2 * phi),
    lambda theta, phi: np.sin(phi),
    lambda theta, phi: np.cos(theta) * np.cos(phi),
)


@pytest.mark.parametrize("name", MEDIA)
def test_samples_have_the_pdf_s_moments(name):
    """z-tests of six means, phi from the center of TT; all 20 media together fail by chance below 1e-4."""
    parameters, theta_o = MEDIA[name], radians(-40)
    wo = direction(theta_o, 0.0)
    means = fiber_means(parameters, theta_o, lambda theta, phi: [moment(theta, phi) for moment in MOMENTS])
    wi = draw(INDEX[name], wo, random_keys(100_000, seed=41))[0].astype(np.float64)
    for moment, mean in zip(MOMENTS, means, strict=True):
        values = moment(*angles_from_tt(wi))
        assert abs(values.mean() - mean) < 5 * values.std() / np.sqrt(len(values)) + 2e-6


def test_samples_of_philox_follow_the_pdf():
    assert chi_square("reference", 50.0, 100_000, draw_philox) > ALPHA


@pytest.mark.parametrize("name", CORNERS)
def test_rejection_ends_soon(name):
    """Two tries per turn, each accepted with probability 0.65 (symmetric: 0.49) or more: 16 turns leave 1e-9.

    Turns are read off the dimension counter. Of 40,000 samples at worst (1 - acceptance)² need a second turn,
    4,900 or 10,404; 5 standard errors are 330 or 440.
    """
    wo = np.concatenate([np.tile(direction(radians(theta), 0.0), (10_000, 1)) for theta in (0, 60, 85, 89.9)])
    keys = random_keys(len(wo), seed=29)
    moved = draw(INDEX[name], wo, keys)[1][:, 2].astype(int)
    parameters = MEDIA[name]
    given = [table is not None for table in parameters.tables]
    one_path = all(given) or not any(given)  # a table takes one dimension more
    if parameters.longitudinal != "vmf" and parameters.azimuthal == "wrapped_normal" and one_path:
        turns = moved - 1 - any(given)
        assert turns.min() == 1
        assert (turns > 1).sum() < (5_230 if parameters.longitudinal == "gaussian" else 10_844)
    assert moved.max() < 20


@pytest.mark.proof
@pytest.mark.parametrize("case", list(itertools.product(MEDIA, (0.0, 30.0, 60.0, -75.0, -89.0))), ids=str)
def test_a_million_samples_follow_the_pdf(case):
    assert chi_square(*case, 1_000_000) > ALPHA / (5 * len(MEDIA))


@pytest.mark.parametrize("name", MEDIA)
def test_weight_is_eval_over_pdf(name):
    """weight x pdf = f_p of the twin; a gray fiber's weight is its albedo, for every sample."""
    parameters = MEDIA[name]
    wo = random_directions(np.random.default_rng(8), 20_000)
    wi, _, weight, pdf = draw(INDEX[name], wo, random_keys(len(wo), seed=3))
    wo64, wi64 = wo.astype(np.float64), wi.astype(np.float64)
    top = peak(parameters, wo64)[:, None]
    error = np.abs(weight * pdf[:, None] - fiber_phase_eval(parameters, wo64, wi64)) / top
    assert error.max() < 1e-5
    assert np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 3e-7
    energies = lobe_energies(parameters, wo64)
    if np.all(energies == energies[..., :1]):
        np.testing.assert_allclose(weight, fiber_phase_albedo(parameters, wo64), rtol=2e-6)
    else:
        assert weight.max() <= energies.max(axis=-1).sum(axis=-1).max() * 1.00001


def test_eighty_bounces_keep_a_white_fiber_white():
    """Mean product of 80 weights is one to rounding: nothing heavy-tailed hides in the weights."""
    names = ["reference", "rougher", "shinier", "narrow", "vmf corners", "von Mises"]
    medium = np.repeat([INDEX[name] for name in names], 4000)
    wo = np.concatenate([random_directions(np.random.default_rng(1), 4000)] * len(names))
    rng, throughput = random_keys(len(wo), seed=5), np.ones((len(wo), 3))
    for _ in range(80):
        wi, rng, weight, _ = draw(medium, wo, rng)
        throughput *= weight
        wo = -wi
    np.testing.assert_allclose(throughput, 1, rtol=2e-5)


def bounce_kernels(parameters, edges):
    """Transfer over one bounce between inclinations of travel, [color, from, to], and the inclinations.

    A path that travels at theta scatters with theta_o = -theta; a_k M_k cos is Nystrom-sampled between edges.
    """
    theta, weight = gauss_points(edges)
    theta, weight = theta.ravel(), weight.ravel()
    energies = lobe_energies(parameters, direction(-theta, 0.0))
    lobes = [
        gaussian_eval(-theta[:, None], theta[None, :], beta) * np.cos(theta) * weight
        for beta in longitudinal_widths(parameters)
    ]
    return np.einsum("ikc,kij->cij", energies, np.stack(lobes)), theta


@pytest.mark.parametrize(
    ("name", "bounces"), [("reference", 80), ("rougher", 80), ("khungurn2015_fleece", 12)]
)
def test_many_bounces_equal_the_powers_of_the_kernel(name, bounces):
    """Throughput and inclination of 50,000 paths against a deterministic solution of the same chain.

    This sees what no single bounce shows: an inexact sampler adds up. Each z-test fails by chance below 1e-6,
    the chi-square below 1e-4.
    """
    parameters = MEDIA[name]
    edges = np.linspace(-np.pi / 2, np.pi / 2, 61)
    kernels, theta = bounce_kernels(parameters, edges)
    start = np.argmin(np.abs(theta - 0.9))
    expected = np.array([(np.linalg.matrix_power(kernel, bounces)[start]) for kernel in kernels])

    wo = np.broadcast_to(-direction(theta[start], 0.3), (50_000, 3))
    rng, throughput = random_keys(len(wo), seed=23), np.ones((len(wo), 3))
    for _ in range(bounces):
        wi, rng, weight, _ = draw(INDEX[name], wo, rng)
        throughput *= weight
        wo = -wi
    error = throughput.std(axis=0) / np.sqrt(len(throughput))
    assert np.all(np.abs(throughput.mean(axis=0) - expected.sum(axis=1)) < 5 * error + 2e-5)
    if name != "khungurn2015_fleece":
        masses = expected[0].reshape(len(edges) - 1, -1).sum(axis=1).reshape(20, 3).sum(axis=1)
        landed = np.histogram(np.arctan2(wi[:, 0], np.hypot(wi[:, 1], wi[:, 2])), edges[::3])[0]
        assert stats.chisquare(landed, masses / masses.sum() * landed.sum()).pvalue > 1e-4


def test_a_program_for_symmetric_media_alone_samples_as_one_for_all_kinds():
    """FIBER_SYMMETRIC 2 against 1: code left out changes no direction beyond rounding."""
    wo = random_directions(np.random.default_rng(6), 5000)
    keys = random_keys(len(wo), seed=7)
    alone = draw_probe([CORNERS["symmetric"]])(0, wo, keys)
    among = draw(INDEX["symmetric"], wo, keys)
    for ours, theirs in zip(alone[:3], among[:3], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-5)


def test_light_along_the_fiber_is_finite():
    wo = np.array([[1, 0, 0], [-1, 0, 0], [1, 1e-20, 0], [1, 1e-7, -1e-7]], np.float32)
    medium = np.arange(len(LIST))[:, None]
    wi, _, weight, pdf = draw(medium, wo, random_keys(4, seed=1))
    for values in (wi, weight, pdf, evaluate(medium, wo, -wo), evaluate(medium, wo, wo)):
        assert np.all(np.isfinite(values))
    assert weight.max() < 2


def test_a_black_fiber_scatters_nothing():
    black = replace(gray(), color_r=(0.0,) * 3, color_tt=(0.0,) * 3, color_trt=(0.0,) * 3)
    wo = random_directions(np.random.default_rng(2), 100)
    wi, _, weight, pdf = draw_probe([black])(0, wo, random_keys(100, seed=1))
    assert np.all(weight == 0)
    assert np.all(np.isfinite(wi))
    assert np.all(pdf > 0)
