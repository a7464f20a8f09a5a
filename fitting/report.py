"""The fit's report: JSON that `[scattering] fit` takes, Markdown for people. The same fit, the same bytes."""

from __future__ import annotations

from importlib import metadata
from typing import Any

import numpy as np

from weft.fiber_model.scattering.config import LobesConfig
from weft.fiber_model.scattering.parameter_file import (
    ParameterCovariance,
    ScatteringParameterFile,
    scalar_names,
)
from weft.fiber_model.scattering.parameters import TABLES, TAILS

from .config import COLORS
from .result import LEVELS, FitResult, FittedParameter

LIBRARIES = ("weft", "jax", "jaxlib", "optimistix", "numpy", "scipy")


def parameter_file(result: FitResult) -> ScatteringParameterFile:
    """Parameters, errors and covariance as parameter files have them; the whole report as provenance."""
    errors, covariance = _errors_by_name(result)
    return ScatteringParameterFile(
        lobes=_lobes(result),
        provenance={
            "source": result.seen.source
            or ", ".join(name for name, _ in result.data_sha256)
            or "measurements",
            "method": "weft fit: least squares of the three lobes to measured directions",
            "data_sha256": dict(result.data_sha256),
            "versions": {name: metadata.version(name) for name in LIBRARIES},
            "fit": _fit(result),
            "config": result.config.model_dump(mode="json", exclude={"measurements"}),
        },
        standard_errors=errors,
        covariance=covariance,
    )


def _lobes(result: FitResult) -> LobesConfig:
    p = result.parameters
    value = {number.name: number.value for number in result.fitted}
    widths = {name: _within(value[name], name) for name in value if name.endswith("_deg")}
    if p.azimuthal_width_trt is None:
        widths.pop("azimuthal_width_trt_deg")
        widths.pop("azimuthal_width_trt_grazing_deg", None)
    return LobesConfig(
        **widths,
        fresnel_tt=p.fresnel_tt,
        fresnel_tt_grazing=p.fresnel_tt_grazing,
        longitudinal=p.longitudinal,
        azimuthal=p.azimuthal,
        **{name: getattr(p, name) for name in (*COLORS, *TABLES, *TAILS)},
    )


def _within(degrees: float, name: str) -> float:
    """A bound in radians and back may miss itself by a rounding."""
    low, high = (0.5, 60.0) if name.startswith("longitudinal") else (2.0, 300.0)
    return min(max(degrees, low), high)


def _errors_by_name(result: FitResult) -> tuple[dict[str, float], ParameterCovariance]:
    """Of the numbers that the file knows: a gray fit's stand for all channels, the scale has no place."""
    known = [name for name in scalar_names() if _source_of(name, result) is not None]
    errors: dict[str, float] = {}
    rows = []
    for name in known:
        index = _source_of(name, result)
        assert index is not None
        error = result.fitted[index].standard_error
        if error is not None and result.fitted[index].at_bound is None:
            errors[name] = error
        if error:
            rows.append((name, index))
    names, entries = tuple(name for name, _ in rows), [index for _, index in rows]
    return errors, ParameterCovariance(names, result.covariance[np.ix_(entries, entries)])


def _source_of(name: str, result: FitResult) -> int | None:
    fitted = [number.name for number in result.fitted]
    for candidate in (name, name.split(".")[0]):
        if candidate in fitted:
            if candidate == "azimuthal_width_trt_deg" and result.parameters.azimuthal_width_trt is None:
                return None
            return fitted.index(candidate)
    return None


def _fit(result: FitResult) -> dict[str, Any]:
    return {
        "chi2": result.chi2,
        "degrees_of_freedom": result.degrees_of_freedom,
        "variance_scale": result.variance_scale,
        "condition": result.condition if np.isfinite(result.condition) else None,
        "distance_to_minimum": result.edm,
        "starts": result.starts,
        "starts_at_best": result.starts_at_best,
        "values": int(result.seen.values.size),
        "scale": result.scale,
        "parameters": [_parameter(number) for number in result.fitted],
        "correlations": _strong_correlations(result),
        "degeneracies": [
            {"name": d.name, "parameters": list(d.parameters), "exact": d.exact, "remedy": d.remedy}
            for d in result.degeneracies
        ],
        "held_out": [
            {
                "theta_i_deg": h.theta_i_deg,
                "values": h.value_count,
                "relative_rms": h.relative_rms,
                "chi2_per_value": h.chi2_per_value if np.isfinite(h.chi2_per_value) else None,
            }
            for h in result.held_out
        ],
    }


def _parameter(number: FittedParameter) -> dict[str, Any]:
    intervals = number.intervals
    return {
        "name": number.name,
        "value": number.value,
        "role": number.role,
        "standard_error": number.standard_error,
        "at_bound": number.at_bound,
        "near_bound": number.near_bound,
        "intervals": None
        if intervals is None
        else {f"{100 * level:g}%": list(bounds) for level, bounds in zip(LEVELS, intervals, strict=True)},
    }


def _strong_correlations(result: FitResult, least: float = 0.5) -> list[list[Any]]:
    names = [number.name for number in result.fitted]
    above = np.argwhere(np.triu(np.abs(result.correlations) >= least, k=1))
    pairs = [[names[i], names[j], float(result.correlations[i, j])] for i, j in above]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))


def markdown(result: FitResult, plots: dict[str, str]) -> str:
    """`plots`: file names by title."""
    parts = [
        "# Fitted scattering",
        _summary(result),
        "## Parameters",
        _parameter_table(result),
        "## What the data cannot tell",
        _degeneracy_list(result),
    ]
    correlations = _strong_correlations(result)
    if correlations:
        rows = [f"| {a} | {b} | {value:+.3f} |" for a, b, value in correlations]
        parts += ["## Correlations of 0.5 and more", "\n".join(["| | | |", "|---|---|---|", *rows])]
    if result.held_out:
        rows = [
            f"| {h.theta_i_deg:g} | {h.value_count} | {100 * h.relative_rms:.2f} % | {h.chi2_per_value:.2f} |"
            for h in result.held_out
        ]
        head = ["| theta_i [deg] | values | relative rms | chi² per value |", "|---|---|---|---|"]
        parts += ["## Held-out angles", "\n".join([*head, *rows])]
    parts += [f"## {title}\n\n![{title}]({file})" for title, file in plots.items()]
    return "\n\n".join([*parts, _provenance(result)]) + "\n"


def _summary(result: FitResult) -> str:
    ratio = result.chi2 / result.degrees_of_freedom
    errors = (
        "taken at its word" if result.variance_scale == 1 else f"scaled by {result.variance_scale**0.5:.3g}"
    )
    return (
        f"{result.seen.values.size} values, chi² per degree of freedom {ratio:.4g} (sigma {errors}). "
        f"{result.starts_at_best} of {result.starts} random starts ended in this minimum; a further step "
        f"would lower chi² by {result.edm:.0e} of its size per value. Scale {result.scale:.6g}."
    )


def _parameter_table(result: FitResult) -> str:
    rows = ["| parameter | value | standard error | 68 % | 95 % | |", "|---|---|---|---|---|---|"]
    for number in result.fitted:
        error = "undetermined" if number.standard_error is None else f"{number.standard_error:.2g}"
        if number.role == "fixed":
            error = ""
        bounds = ["", ""]
        if number.intervals is not None:
            bounds = [f"{low:.5g} … {high:.5g}" for low, high in number.intervals]
        remark = number.role if number.role != "free" else ""
        if number.at_bound:
            remark = f"**at its {number.at_bound} bound**"
        elif number.near_bound:
            remark = "within three standard errors of a bound"
        rows.append(
            f"| {number.name} | {number.value:.6g} | {error} | {bounds[0]} | {bounds[1]} | {remark} |"
        )
    return "\n".join(rows)


def _degeneracy_list(result: FitResult) -> str:
    if not result.degeneracies:
        return f"Every free parameter is determined (condition number {result.condition:.3g})."
    return "\n".join(
        f"- **{d.name}** ({'exact' if d.exact else 'nearly'}): {', '.join(d.parameters)}. {d.remedy}"
        for d in result.degeneracies
    )


def _provenance(result: FitResult) -> str:
    hashes = [f"- {name}: sha256 {digest}" for name, digest in result.data_sha256]
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in LIBRARIES)
    return "\n".join(["## Made from", "", *hashes, f"- seed {result.config.seed}", f"- {versions}"])
