"""The fiber's phase function on JAX: phase.py, longitudinal.py and azimuthal.py again, with exact gradients.

float64 throughout: importing this module switches JAX to 64 bits for the process, before it makes an array.
A fit evaluates the same few angles many times, so lobes are computed once for each distinct pair of
inclinations and each distinct azimuth (`DistinctDirections`), and G once for each distinct theta_o.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import ArrayLike

from .azimuthal_table import knot_masses
from .parameters import GRAZING, FiberScatteringParameters
from .phase import CENTERS, SYMMETRIC_MARGINALS

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402

from .symmetric_jax import symmetric_eval  # noqa: E402

_HALF_PI = np.pi / 2
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_REACH = 9.0
"""The quadrature of G spans this many widths on each side; beyond lies 2e-19 of a Gaussian."""
_SAME_ANGLE = 1e-12
"""Angles [rad] closer than this are one."""


class LobeKinds(NamedTuple):
    """What a compiled function is made for: the kinds of the lobes."""

    longitudinal: str
    azimuthal: str
    uniform_trt: bool
    grazing: bool = False
    """Whether widths and T go with theta_o toward the values named so."""


class LobeParameters(NamedTuple):
    """The parameters as arrays that JAX differentiates; radians. The colors have shape [channels]."""

    longitudinal_width_r: jax.Array
    longitudinal_width_tt: jax.Array
    longitudinal_width_trt: jax.Array
    azimuthal_width_tt: jax.Array
    azimuthal_width_trt: jax.Array
    """Ignored where `LobeKinds.uniform_trt`."""
    fresnel_r: jax.Array
    fresnel_tt: jax.Array
    color_r: jax.Array
    color_tt: jax.Array
    color_trt: jax.Array
    longitudinal_width_r_grazing: jax.Array | None = None
    """Ignored, as all that follow, where not `LobeKinds.grazing`."""
    longitudinal_width_tt_grazing: jax.Array | None = None
    longitudinal_width_trt_grazing: jax.Array | None = None
    azimuthal_width_tt_grazing: jax.Array | None = None
    azimuthal_width_trt_grazing: jax.Array | None = None
    fresnel_tt_grazing: jax.Array | None = None
    azimuthal_table_r: jax.Array | None = None
    """Densities of N_R, [rows, knots], in place of the uniform one; normalized where they are used."""
    azimuthal_table_tt: jax.Array | None = None
    azimuthal_table_trt: jax.Array | None = None
    tail_weight_r: jax.Array | None = None
    """Of each lobe's tail, as `FiberScatteringParameters` has them; without a weight there is none."""
    tail_weight_r_grazing: jax.Array | None = None
    tail_ratio_r: jax.Array | None = None
    tail_weight_tt: jax.Array | None = None
    tail_weight_tt_grazing: jax.Array | None = None
    tail_ratio_tt: jax.Array | None = None
    tail_weight_trt: jax.Array | None = None
    tail_weight_trt_grazing: jax.Array | None = None
    tail_ratio_trt: jax.Array | None = None

    @property
    def tables(self) -> tuple[jax.Array | None, ...]:
        """Of the four lobes."""
        return (
            self.azimuthal_table_r,
            self.azimuthal_table_tt,
            self.azimuthal_table_trt,
            self.azimuthal_table_r,
        )

    def at_inclination(self, kinds: LobeKinds, name: str, theta_o: jax.Array) -> jax.Array:
        """A width or T: one number, or of the shape of `theta_o` where it goes with it; as phase.py."""
        normal = getattr(self, name)
        if not kinds.grazing:
            return normal
        return normal + (getattr(self, f"{name}_grazing") - normal) * (1 - jnp.cos(theta_o))


class DistinctDirections(NamedTuple):
    """N directions as indices into their distinct angles [rad]."""

    theta_o: jax.Array
    """Distinct inclinations of `wo`, shape [k]."""
    pair_theta_o: jax.Array
    """Index into `theta_o` of each distinct pair of inclinations, shape [m]."""
    pair_theta_i: jax.Array
    """Inclination of `wi` of each pair, shape [m]."""
    phi: jax.Array
    """Distinct azimuths of `wi` from `wo`, in [-pi, pi], shape [q]."""
    pair: jax.Array
    """Of each direction, shape [N]: its pair of inclinations."""
    around: jax.Array
    """Of each direction, shape [N]: its azimuth."""
    turn_theta_o: jax.Array
    """Index into `theta_o` of each distinct pair of light and azimuth, shape [p]."""
    turn_phi: jax.Array
    """Index into `phi` of each such pair, shape [p]."""
    turn: jax.Array
    """Of each direction, shape [N]: its pair of light and azimuth."""


def split_parameters(parameters: FiberScatteringParameters) -> tuple[LobeKinds, LobeParameters]:
    uniform = parameters.azimuthal_width_trt is None
    kinds = LobeKinds(parameters.longitudinal, parameters.azimuthal, uniform, parameters.varies_with_angle)
    values = {name: getattr(parameters, name) for name in LobeParameters._fields}
    values |= {name: parameters.at_grazing(name.removesuffix("_grazing")) for name in GRAZING}
    if uniform:
        values |= {"azimuthal_width_trt": 1.0, "azimuthal_width_trt_grazing": 1.0}
    given = {name: value for name, value in values.items() if value is not None}
    return kinds, LobeParameters(**{name: jnp.asarray(value, float) for name, value in given.items()})


def distinct_directions(theta_o: ArrayLike, theta_i: ArrayLike, phi: ArrayLike) -> DistinctDirections:
    """From angles [rad] of N directions; `phi` is the azimuth of `wi` minus that of `wo`."""
    theta_o, theta_i, phi = (np.asarray(angle, dtype=np.float64) for angle in (theta_o, theta_i, phi))
    wrapped = phi - 2 * np.pi * np.round(phi / (2 * np.pi))
    of_o, o_index = _distinct(theta_o)
    of_i, i_index = _distinct(theta_i)
    of_phi, around = _distinct(wrapped)
    codes, pair = np.unique(o_index * len(of_i) + i_index, return_inverse=True)
    pair_o, pair_i = np.divmod(codes, len(of_i))
    turns, turn = np.unique(o_index * len(of_phi) + around, return_inverse=True)
    parts = (of_o, pair_o, of_i[pair_i], of_phi, pair, around, *np.divmod(turns, len(of_phi)), turn)
    return DistinctDirections(*map(jnp.asarray, parts))


def _distinct(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values, and the index of each angle's."""
    order = np.argsort(angles, kind="stable")
    rises = np.diff(angles[order]) > _SAME_ANGLE
    index = np.empty(len(angles), dtype=np.int64)
    index[order] = np.concatenate([[0], np.cumsum(rises)]) if len(angles) else []
    return angles[order][np.concatenate([[True], rises])] if len(angles) else angles, index


def lobe_densities(kinds: LobeKinds, parameters: LobeParameters, directions: DistinctDirections) -> jax.Array:
    """M_k N_k [1/sr] of the lobes R, TT, TRT, shape [N, 3]; for the kind `symmetric` four, as in phase.py."""
    turn = directions.turn if _turns(kinds, parameters) else directions.around
    return jnp.stack(
        [
            along[directions.pair] * around[turn]
            for along, around in zip(
                _along(kinds, parameters, directions),
                _around(kinds, parameters, directions),
                strict=False,
            )
        ],
        axis=-1,
    )


def _along(
    kinds: LobeKinds, parameters: LobeParameters, directions: DistinctDirections
) -> tuple[jax.Array, ...]:
    """M_k of each distinct pair of inclinations, shape [m] each."""
    widths = [
        parameters.at_inclination(kinds, f"longitudinal_width_{lobe}", directions.theta_o)
        for lobe in ("r", "tt", "trt")
    ]
    theta_o, theta_i = directions.theta_o[directions.pair_theta_o], directions.pair_theta_i
    if kinds.longitudinal == "symmetric":
        return tuple(
            symmetric_eval(directions.theta_o, directions.pair_theta_o, theta_i, beta, marginal)
            for beta, marginal in zip((*widths, widths[0]), SYMMETRIC_MARGINALS, strict=True)
        )
    if kinds.longitudinal == "vmf":
        lobes = [vmf_eval(theta_o, theta_i, _per_pair(beta, directions)) for beta in widths]
    else:
        lobes = [
            _gaussian_cos(theta_o, theta_i, _per_pair(beta, directions))
            / gaussian_normalization(directions.theta_o, beta)[directions.pair_theta_o]
            for beta in widths
        ]
    return tuple(
        _with_tail(parameters, name, lobe, theta_o, theta_i, _per_pair(beta, directions))
        for name, lobe, beta in zip(("r", "tt", "trt"), lobes, widths, strict=True)
    )


def _with_tail(
    parameters: LobeParameters,
    name: str,
    lobe: jax.Array,
    theta_o: jax.Array,
    theta_i: jax.Array,
    beta: jax.Array,
) -> jax.Array:
    """M of a lobe with what lies in its tail, as phase.py."""
    weight, grazing, ratio = (
        getattr(parameters, f"tail_{part}")
        for part in (f"weight_{name}", f"weight_{name}_grazing", f"ratio_{name}")
    )
    if weight is None:
        return lobe
    if grazing is not None:
        weight = weight + (grazing - weight) * (1 - jnp.cos(theta_o))
    return lobe + weight * (tail_eval(theta_o, theta_i, ratio * beta) - lobe)


def _per_pair(width: jax.Array, directions: DistinctDirections) -> jax.Array:
    return width[directions.pair_theta_o] if width.ndim else width


def _turns(kinds: LobeKinds, parameters: LobeParameters) -> bool:
    """Whether N goes with theta_o."""
    return kinds.grazing or any(table is not None and len(table) > 1 for table in parameters.tables)


def _around(
    kinds: LobeKinds, parameters: LobeParameters, directions: DistinctDirections
) -> tuple[jax.Array, ...]:
    """N_k of each distinct azimuth, shape [q], or of each `turn`, shape [p], where N goes with theta_o.

    The last only where `_along` gives four lobes.
    """
    phi = directions.phi[directions.turn_phi] if _turns(kinds, parameters) else directions.phi
    theta_o = directions.theta_o[directions.turn_theta_o]
    gamma_tt, gamma_trt = (
        parameters.at_inclination(kinds, f"azimuthal_width_{lobe}", theta_o) for lobe in ("tt", "trt")
    )
    evaluate = wrapped_normal_eval if kinds.azimuthal == "wrapped_normal" else von_mises_eval
    uniform = jnp.full(phi.shape, 1 / (2 * np.pi))
    simple = (
        lambda: uniform,
        lambda: evaluate(phi - np.pi, gamma_tt),
        lambda: uniform if kinds.uniform_trt else evaluate(phi, gamma_trt),
        lambda: uniform,
    )
    return tuple(
        n() if table is None else table_eval(phi - center, table, jnp.cos(theta_o))
        for n, table, center in zip(simple, parameters.tables, CENTERS, strict=True)
    )


def lobe_energies(kinds: LobeKinds, parameters: LobeParameters, cos_o: jax.Array) -> jax.Array:
    """a_k(theta_o) of the lobes R, TT, TRT, shape [..., 3 lobes, channels]."""
    base = parameters.fresnel_r
    fresnel = base + (1 - base) * schlick(cos_o)[..., None]
    entering, t = 1 - fresnel, parameters.fresnel_tt
    if kinds.grazing:
        grazing = jnp.asarray(parameters.fresnel_tt_grazing)
        t = (t + (grazing - t) * (1 - cos_o))[..., None]
    return jnp.stack(
        [
            parameters.color_r * fresnel,
            parameters.color_tt * entering * t,
            parameters.color_trt * entering * (1 - t),
        ],
        axis=-2,
    )


def symmetric_lobe_energies(kinds: LobeKinds, parameters: LobeParameters, cos_o: jax.Array) -> jax.Array:
    """a_k(theta_o) of the four lobes of the kind `symmetric`, shape [..., 4 lobes, channels]."""
    three = lobe_energies(kinds, parameters, cos_o)
    grazing = parameters.color_r * (1 - parameters.fresnel_r) * schlick(cos_o)[..., None]
    at_normal = jnp.broadcast_to(parameters.color_r * parameters.fresnel_r, grazing.shape)
    return jnp.stack([at_normal, three[..., 1, :], three[..., 2, :], grazing], axis=-2)


def schlick(cos_o: jax.Array) -> jax.Array:
    """(1 - cos theta_o)^5, Schlick's rise of the Fresnel term to grazing light."""
    return (1 - jnp.minimum(cos_o, 1.0)) ** 5


def fiber_phase_eval(
    kinds: LobeKinds, parameters: LobeParameters, directions: DistinctDirections
) -> jax.Array:
    """f_p [1/sr] of each direction, shape [N, channels]."""
    energies_of = symmetric_lobe_energies if kinds.longitudinal == "symmetric" else lobe_energies
    energies = energies_of(kinds, parameters, jnp.cos(directions.theta_o))
    densities = lobe_densities(kinds, parameters, directions)
    of_direction = energies[directions.pair_theta_o[directions.pair]]
    return (of_direction * densities[..., None]).sum(axis=-2)


def gaussian_normalization(theta_o: jax.Array, beta: jax.Array) -> jax.Array:
    """G(theta_o) = ∫ g(theta; -theta_o, beta) cos²(theta) dtheta over the half circle, shape of `theta_o`.

    By 64 Gauss-Legendre points where the Gaussian is not negligible; JAX has no erf of complex argument.
    """
    mean, beta = -jnp.asarray(theta_o)[..., None], jnp.asarray(beta)[..., None]
    low = jnp.maximum(mean - _REACH * beta, -_HALF_PI)
    high = jnp.minimum(mean + _REACH * beta, _HALF_PI)
    theta = 0.5 * (low + high) + 0.5 * (high - low) * _NODES
    values = _normal(theta - mean, beta) * jnp.cos(theta) ** 2
    return 0.5 * (high - low)[..., 0] * (values * _WEIGHTS).sum(axis=-1)


def _gaussian_cos(theta_o: jax.Array, theta_i: jax.Array, beta: jax.Array) -> jax.Array:
    return _normal(theta_i + theta_o, beta) * jnp.cos(theta_i)


def _normal(x: jax.Array, width: jax.Array) -> jax.Array:
    return jnp.exp(-0.5 * (x / width) ** 2) / (width * np.sqrt(2 * np.pi))


def vmf_eval(theta_o: jax.Array, theta_i: jax.Array, beta: jax.Array) -> jax.Array:
    """exp(-sin sin / v) I0(cos cos / v) / (2 v sinh(1/v)) with v = beta², arranged not to overflow."""
    v = beta**2
    exponent = -2 * jnp.sin(0.5 * (theta_i + theta_o)) ** 2 / v
    bessel = jax.scipy.special.i0e(jnp.cos(theta_o) * jnp.cos(theta_i) / v)
    return jnp.exp(exponent) * bessel / (v * -jnp.expm1(-2 / v))


def tail_eval(theta_o: jax.Array, theta_i: jax.Array, width: jax.Array) -> jax.Array:
    """As tail.py."""
    s = width**2
    near = s + 2 * jnp.sin(0.5 * (theta_o + theta_i)) ** 2
    far = s + 2 * jnp.cos(0.5 * (theta_o - theta_i)) ** 2
    return 0.25 * s * (s + 2) * (near + far) / (near * far) ** 1.5


def wrapped_normal_eval(phi: jax.Array, gamma: jax.Array) -> jax.Array:
    """Sum of Gaussians 2 pi apart where it converges fast, its Fourier series elsewhere."""
    phi = (phi - 2 * np.pi * jnp.round(phi / (2 * np.pi)))[..., None]
    of_each = jnp.asarray(gamma)[..., None]
    images = _normal(phi + 2 * np.pi * np.arange(-3, 4), of_each).sum(axis=-1)
    n = np.arange(1, 8)
    waves = (jnp.exp(-0.5 * (n * of_each) ** 2) * jnp.cos(n * phi)).sum(axis=-1)
    return jnp.where(gamma < np.sqrt(np.pi), images, (1 + 2 * waves) / (2 * np.pi))


def von_mises_eval(phi: jax.Array, gamma: jax.Array) -> jax.Array:
    kappa = gamma**-2
    drop = 2 * jnp.sin(0.5 * phi) ** 2  # 1 - cos(phi) without cancellation
    return jnp.exp(-kappa * drop) / (2 * np.pi * jax.scipy.special.i0e(kappa))


def table_eval(phi: jax.Array, table: jax.Array, cos_o: jax.Array) -> jax.Array:
    """N of a table [rows, knots] at each phi and, where it has several rows, cos_o; as azimuthal_table.py."""
    rows, knots = table.shape
    densities = table / (table @ knot_masses(knots))[:, None]
    place = jnp.abs(phi - 2 * np.pi * jnp.round(phi / (2 * np.pi))) * ((knots - 1) / np.pi)
    cell = jnp.minimum(place.astype(int), knots - 2)
    part = place - cell
    of_rows = densities[:, cell] * (1 - part) + densities[:, cell + 1] * part
    if rows == 1:
        return of_rows[0]
    shares = jnp.clip(1 - jnp.abs((rows - 1) * (1 - cos_o) - np.arange(rows)[:, None]), 0, None)
    return (shares * of_rows).sum(axis=0)
