"""What can be said before any fiber is made: what to refuse, what to warn of, how fine to cut."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from weft.files.errors import InputError

from .config import FibersConfig
from .fiber_arrays import YarnPlan
from .plies import PlyShape, fitted_outer_radius, scaled_plies
from .yarns.groups import yarn_groups, yarns_of
from .yarns.yarns import YarnSet

NODE_LIMIT = 2**28
"""Nodes of all yarns together, 72 bytes each and as much again while they are made."""
CHUNK = 1 << 16
"""Nodes looked at together."""
SEAT_LIMIT = 2**28
"""Body fibers of all yarns together, 24 bytes each."""
STRAND_LIMIT = 2**24
"""Strands of one stretch."""
GOOD_RADIUS_RATIO = (0.7, 1.3)
"""Yarn radius over the preset's own, outside of which cloth shows holes or its yarns run into each other."""


@dataclass(frozen=True)
class FiberReport:
    """What a person should know about the fibers of a job."""

    yarn_length_mm: float
    node_count: int
    segment_mm: float
    """Longest segment, measured along the yarn."""
    body_fiber_count: int
    """Body fibers of all yarns, each counted where it has most of them."""
    body_fiber_length_mm: float
    """Number of body fibers times length of yarn: without twist, crimp and hairs."""
    hair_count: int
    """Hairs of all kinds."""
    folded_node_count: int
    """Nodes where curvature times the plies' radius passes 1: the inner fibers are squeezed."""
    radius_ratio: tuple[float, float]
    """Smallest and largest yarn radius over the outer radius of the plies as fitted."""
    loop_demand: float
    """Largest share of migration periods that would have to be loops; above 1 loops are missing."""
    warnings: tuple[str, ...] = ()


def report_fibers(
    plans: list[YarnPlan], yarns: YarnSet, bend: np.ndarray, details: np.ndarray, stretches: np.ndarray
) -> FiberReport:
    """Sum up what was planned; `bend` is the tangent's derivative [1/mm], shape [node_count, 3]."""
    lengths = np.array([plan.step * plan.intervals for plan in plans])
    plies, step = (np.array([getattr(plan, key) for plan in plans]) for key in ("ply_count", "step"))
    of_stretch = plies[stretches["yarn"]] * stretches["fibers_per_ply"].astype(np.int64)
    fibers = np.zeros(len(plans), dtype=np.int64)
    np.maximum.at(fibers, stretches["yarn"], of_stretch)
    body_length = of_stretch * stretches["segments"] * step[stretches["yarn"]]
    radius = np.array([_outer_radius(plan) for plan in plans])
    ratios = yarns.radius / np.array([fitted_outer_radius(plan.config) for plan in plans])
    at_node = np.repeat(radius, [plan.intervals + 1 for plan in plans])
    if len(details):
        at_node = at_node * details["thickness"]
    folded = sum(
        int((np.linalg.norm(bend[i : i + CHUNK], axis=1) * at_node[i : i + CHUNK] > 1.0).sum())
        for i in range(0, len(bend), CHUNK)
    )
    demand = max(plan.flyaways.loop_demand for plan in plans)
    return FiberReport(
        yarn_length_mm=float(lengths.sum()),
        node_count=len(bend),
        segment_mm=max(plan.step for plan in plans),
        body_fiber_count=int(fibers.sum()),
        body_fiber_length_mm=float(body_length.sum()),
        hair_count=int(stretches["hairs"].sum()),
        folded_node_count=folded,
        radius_ratio=(float(ratios.min()), float(ratios.max())),
        loop_demand=demand,
        warnings=tuple(_warnings(plans, ratios, folded, demand)),
    )


def _outer_radius(plan: YarnPlan) -> float:
    """Where the plies touch the yarn's surface [mm]."""
    plies = plan.plies
    return plies.cord_center_radius + plies.center_radius + plies.short


def _warnings(plans: list[YarnPlan], ratios: np.ndarray, folded: int, demand: float) -> list[str]:
    found = []
    fitted = np.array([plan.config.scale == "as_fitted" for plan in plans])
    low, high = GOOD_RADIUS_RATIO
    off = fitted & ((ratios < low) | (ratios > high))
    if off.any():
        worst = ratios[off][np.argmax(np.abs(np.log(ratios[off])))]
        found.append(
            f"{off.sum()} of {len(plans)} yarns have {worst:.2g} times the radius of the plies as "
            f"fitted; cloth looks right from {low} to {high}. Set fibers.scale = 'fit_radius', or change the "
            "yarns' radius."
        )
    if folded:
        found.append(
            f"at {folded} nodes the yarn bends tighter than its own radius; fibers on the inner side "
            "were squeezed together there. Check the yarns' radius and units."
        )
    if demand > 1.0:
        found.append(
            f"{demand:.2g} loops are asked for in each migration period of a fiber, and one fits; "
            f"{1 / demand:.0%} of the loops are made. Lower fibers.fuzz or fibers.loop_density_per_mm."
        )
    return found


def segment_length(config: FibersConfig, yarn_radius: float) -> float:
    """Longest segment along a yarn [mm] that keeps within a part of a fiber radius of the true fiber.

    From the curvature of the helices at the border of a ply, and of a yarn bent to twice its own radius: the
    sagitta of a segment of length h is curvature h^2 / 8.
    """
    if config.segment_mm is not None:
        return config.segment_mm
    plies = scaled_plies(config, yarn_radius)
    curvature = 0.5 / yarn_radius
    if config.cords > 1:
        curvature += _cabled_curvature(plies)
    else:
        for radius, pitch in ((plies.center_radius, plies.ply_pitch), (plies.mean_radius, plies.fiber_pitch)):
            if pitch != 0:
                rate = 2.0 * np.pi / pitch
                curvature += radius * rate**2 / (1.0 + (radius * rate) ** 2)
    return float(np.sqrt(8.0 * config.sagitta_in_fiber_radii * config.fiber_radius_mm / curvature))


def _cabled_curvature(plies: PlyShape) -> float:
    """Of three helices that turn each other, against length along the yarn: radius times rate squared."""
    turning, curvature = 0.0, 0.0
    for radius, pitch in (
        (plies.cord_center_radius, plies.cord_pitch),
        (plies.center_radius, plies.ply_pitch),
        (plies.mean_radius, plies.fiber_pitch),
    ):
        turning += 2.0 * np.pi / pitch if pitch != 0 else 0.0
        curvature += radius * turning**2
    return curvature


def refuse_unknown_types(config: FibersConfig, yarns: YarnSet) -> None:
    """Values for a yarn type that the yarns do not have are a mistake."""
    for name in config.by_type:
        if name not in yarns.type_names:
            near = get_close_matches(name, yarns.type_names, n=1)
            raise InputError(
                f"fibers.by_type.{name}: no such yarn type; the yarns have {', '.join(yarns.type_names)}",
                hint=f"Did you mean {near[0]!r}?" if near else "",
            )


def refuse_empty_yarns(yarns: YarnSet) -> None:
    """Fibers need yarns."""
    if len(yarns.radius) == 0:
        raise InputError("fibers: there are no yarns to lay fibers along", hint="Check the [yarns] table.")


def refuse_too_many_nodes(yarns: YarnSet, segment_mm: float) -> None:
    """Before anything is allocated; the control polygon is about as long as the yarn."""
    chord = 0.0
    for group in yarn_groups(yarns.point_counts):
        points, ends = yarns_of(yarns, group).points, yarns.offsets[group.start + 1 : group.stop]
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        chords[ends - yarns.offsets[group.start] - 1] = 0.0  # from one yarn's end to the next one's beginning
        chord += float(chords.sum())
    nodes = chord / segment_mm
    if not nodes <= NODE_LIMIT:
        raise InputError(
            f"fibers: segments of {segment_mm:.3g} mm cut the yarns into {nodes:.3g} pieces; "
            f"at most {NODE_LIMIT} are possible",
            hint="Raise fibers.segment_mm, or check the unit of the yarns.",
        )


def refuse_too_many_fibers(plans: list[YarnPlan], details: np.ndarray) -> None:
    """Before anything is allocated per fiber."""
    counts = np.array([float(plan.fiber_count) for plan in plans])
    if len(details):
        first = np.cumsum([0] + [plan.intervals + 1 for plan in plans])[:-1]
        counts *= np.maximum(np.maximum.reduceat(details["thickness"].astype(np.float64), first), 1.0) ** 2
    fibers, most = counts.sum(), counts.max()
    hairs = max(plan.hair_density * plan.step * plan.config.stretch_segments for plan in plans)
    if fibers > SEAT_LIMIT or most > STRAND_LIMIT or hairs > STRAND_LIMIT:
        raise InputError(
            f"fibers: {fibers:.3g} fibers in all, up to {most:.3g} in one yarn and {hairs:.3g} hairs in one "
            f"stretch; at most {SEAT_LIMIT}, {STRAND_LIMIT} and {STRAND_LIMIT} are possible",
            hint="Lower fibers.fiber_count_scale, fibers.fibers_per_ply or fibers.fuzz.",
        )
