"""The arrays behind a `FiberSet`: what depends on one yarn, node, fiber or stretch alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .config import FibersConfig
from .cross_section import sample_cross_section
from .flyaways import FlyawayShape, hair_counts, probability_threshold, scaled_flyaways
from .free_hairs import FreeHairShape, free_hair_counts, scaled_free_hairs
from .migration import migration_phase
from .plies import PlyShape, cord_phase, phase_at_nodes, ply_phase, scaled_plies, turns_along
from .variation import YarnPlace, lightness, thickness
from .yarn_colors import Palette
from .yarns.catmull_rom import cross
from .yarns.frames import YarnFrames
from .yarns.yarns import YarnSet

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class YarnPlan:
    """One yarn's plies and fly-aways, with the turns that its helices make over its length."""

    config: FibersConfig
    plies: PlyShape
    flyaways: FlyawayShape
    free_hairs: FreeHairShape
    ply_turns: float
    cord_turns: float
    fiber_turns: float
    migration_turns: float
    intervals: int
    step: float
    closed: bool

    @property
    def ply_count(self) -> int:
        """Plies of all cords together."""
        return self.config.cords * self.config.plies

    @property
    def fiber_count(self) -> int:
        """Body fibers of the yarn where it has its own thickness, all plies together."""
        return self.ply_count * self.plies.fibers_per_ply

    @property
    def hair_density(self) -> float:
        """Hairs of all kinds per mm of yarn."""
        return self.flyaways.hair_density + self.free_hairs.walk_density + self.free_hairs.droop_density

    @property
    def varies(self) -> bool:
        """Whether thickness or color changes along the yarn."""
        variation = self.config.variation
        return variation.thickness_sd > 0 or variation.slubs_per_m > 0 or variation.color_sd > 0

    @property
    def reach(self) -> float:
        """No body fiber or loop goes farther from the yarn's center than this times thickness [mm]."""
        largest = max(1.0, self.config.migration_max) * (1.0 + self.config.perturbation)
        largest = max(largest, self.flyaways.loop_reach * (1.0 + self.config.perturbation))
        outward = self.plies.center_radius + largest * self.plies.short
        widest = max(outward, float(np.hypot(self.plies.center_radius, largest * self.plies.long)), 0.0)
        return self.plies.cord_center_radius + widest


def plan_yarn(
    config: FibersConfig, radius: float, length: float, intervals: int, *, closed: bool
) -> YarnPlan:
    """Scale the model to a yarn of `radius` and `length` [mm], and round its turns where it is closed."""
    plies = scaled_plies(config, radius)
    fiber_turns = turns_along(length, plies.fiber_pitch, closed=closed)
    period = abs(plies.fiber_pitch) / config.migration_per_turn if config.migration_per_turn > 0 else 0.0
    migration_turns = turns_along(length, period, closed=closed)
    actual_period = length / migration_turns if migration_turns > 0 else 0.0
    return YarnPlan(
        config=config,
        plies=plies,
        flyaways=scaled_flyaways(config, plies, actual_period),
        free_hairs=scaled_free_hairs(config),
        ply_turns=turns_along(length, plies.ply_pitch, closed=closed),
        cord_turns=turns_along(length, plies.cord_pitch, closed=closed),
        fiber_turns=fiber_turns,
        migration_turns=migration_turns,
        intervals=intervals,
        step=length / intervals,
        closed=closed,
    )


def build_nodes(
    plans: list[YarnPlan], frames: YarnFrames, seed: int, dtype: np.dtype, *, first_yarn: int = 0
) -> np.ndarray:
    """One record per node of every yarn: frame, bend, and phases as (cosine, sine).

    The plans and frames may be of some consecutive yarns of a set, from number `first_yarn` on.
    """
    nodes = np.empty(int(frames.offsets[-1]), dtype=dtype)
    begin_phase = ply_phase(seed, first_yarn + np.arange(len(plans)))
    for yarn, plan in enumerate(plans):
        part = slice(frames.offsets[yarn], frames.offsets[yarn + 1])
        tangent, normal = frames.tangent[part], frames.normal[part]
        nodes["position"][part] = frames.position[part]
        nodes["normal"][part] = normal
        nodes["binormal"][part] = cross(tangent, normal)
        nodes["bend"][part] = tangent_derivative(tangent, plan.step, closed=plan.closed)
        nodes["ply"][part] = _on_circle(phase_at_nodes(plan.ply_turns, plan.intervals) + begin_phase[yarn])
        nodes["twist"][part] = _on_circle(phase_at_nodes(plan.fiber_turns, plan.intervals))
        nodes["migration"][part] = _on_circle(phase_at_nodes(plan.migration_turns, plan.intervals))
    return nodes


def build_details(plans: list[YarnPlan], offsets: np.ndarray, seed: int, dtype: np.dtype) -> np.ndarray:
    """One record per node where any yarn varies along its length or has cords, else none."""
    if not any(plan.varies or plan.config.cords > 1 for plan in plans):
        return np.empty(0, dtype=dtype)
    details = np.empty(int(offsets[-1]), dtype=dtype)
    begin_phase = cord_phase(seed, np.arange(len(plans)))
    for yarn, plan in enumerate(plans):
        part = slice(offsets[yarn], offsets[yarn + 1])
        place = YarnPlace(yarn, plan.step * plan.intervals, plan.closed)
        s = np.arange(plan.intervals + 1) * plan.step
        details["thickness"][part] = thickness(seed, place, s, plan.config.variation)
        details["lightness"][part] = lightness(seed, place, s, plan.config.variation)
        details["cord"][part] = _on_circle(
            phase_at_nodes(plan.cord_turns, plan.intervals) + begin_phase[yarn]
        )
    return details


def build_seats(
    plans: list[YarnPlan], seats_per_ply: np.ndarray, types: np.ndarray, seed: int, dtype: np.dtype
) -> np.ndarray:
    """One record per fiber: its place in the ply's cross-section and where its migration begins.

    `types` is the type of each yarn; all fibers of one type are drawn together.
    """
    counts = seats_per_ply * np.array([plan.ply_count for plan in plans], dtype=np.int64)
    yarn = np.repeat(np.arange(len(plans)), counts)
    fiber = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    seats = np.empty(len(yarn), dtype=dtype)
    radius, angle = np.empty(len(yarn)), np.empty(len(yarn))
    for kind in np.unique(types):
        config = plans[int(np.argmax(types == kind))].config
        chosen = types[yarn] == kind
        radius[chosen], angle[chosen] = sample_cross_section(
            seed,
            yarn[chosen],
            fiber[chosen],
            epsilon=config.cross_section_epsilon,
            beta=config.cross_section_beta,
        )
    turns = migration_phase(seed, yarn, fiber)
    seats["radius"] = radius
    seats["angle"] = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    seats["migration"] = _on_circle(turns)
    seats["migration_turns"] = turns
    return seats


def build_colors(palettes: list[Palette]) -> tuple[np.ndarray, np.ndarray]:
    """All different color lists one after the other, float32, shape [n, 3], and where each yarn's begins."""
    lists = dict.fromkeys(palettes)
    starts = np.cumsum([0] + [len(colors) for colors in lists])
    begin = dict(zip(lists, starts[:-1].tolist(), strict=True))
    table = np.array([color for colors in lists for color in colors], dtype=np.float32).reshape(-1, 3)
    return table, np.array([begin[palette] for palette in palettes])


def build_yarns(
    plans: list[YarnPlan],
    seats_per_ply: np.ndarray,
    first_color: np.ndarray,
    color_count: list[int],
    offsets: np.ndarray,
    dtype: np.dtype,
) -> np.ndarray:
    """One record of parameters per yarn."""
    records = np.zeros(len(plans), dtype=dtype)
    detailed = any(plan.varies or plan.config.cords > 1 for plan in plans)
    first_fiber = np.cumsum([0] + [p.ply_count * int(n) for p, n in zip(plans, seats_per_ply, strict=True)])
    for yarn, plan in enumerate(plans):
        flyaways, config = plan.flyaways, plan.config
        length = plan.step * plan.intervals
        values = {
            "first_node": offsets[yarn],
            "first_fiber": first_fiber[yarn],
            "intervals": plan.intervals,
            "closed": plan.closed,
            "plies": plan.ply_count,
            "plies_per_cord": config.plies,
            "fibers_per_ply": seats_per_ply[yarn],
            "detailed": detailed,
            "cords": config.cords,
            "cord_radius": plan.plies.cord_center_radius,
            "first_color": first_color[yarn],
            "colors": color_count[yarn],
            "step": plan.step,
            "center_radius": plan.plies.center_radius,
            "ellipse_short": plan.plies.short,
            "ellipse_long": plan.plies.long,
            "migration_low": config.migration_min,
            "migration_high": config.migration_max,
            "migration_turns": plan.migration_turns,
            "migration_rate": plan.migration_turns / plan.intervals,
            "loops": flyaways.loop_probability > 0,
            "loop_threshold": probability_threshold(flyaways.loop_probability),
            "loop_radius": flyaways.loop_radius,
            "hair_radius": flyaways.hair_radius,
            "hair_radius_span": flyaways.hair_radius_span,
            "hair_angle_span": flyaways.hair_angle_span,
            "hair_z_span": flyaways.hair_z_span,
            "hair_root_limit": flyaways.hair_root_limit,
            "perturbation": config.perturbation,
            "perturbation_cells": max(round(length / config.perturbation_length_mm), 1),
        }
        for name, value in values.items():
            records[name][yarn] = value
    return records


def yarn_free_hairs(plans: list[YarnPlan], dtype: np.dtype) -> np.ndarray:
    """One record of walks and droops per yarn."""
    records = np.empty(len(plans), dtype=dtype)
    for name in dtype.names or ():
        records[name] = [getattr(plan.free_hairs, name) for plan in plans]
    return records


def build_stretches(plans: list[YarnPlan], details: np.ndarray, seed: int, dtype: np.dtype) -> np.ndarray:
    """One record per stretch, yarn after yarn; the last stretch of a yarn may be shorter."""
    size = plans[0].config.stretch_segments if plans else 1
    intervals = np.array([plan.intervals for plan in plans], dtype=np.int64)
    counts = -(-intervals // size)
    yarn = np.repeat(np.arange(len(plans)), counts)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    stretches = np.empty(len(yarn), dtype=dtype)
    stretches["yarn"], stretches["number"], stretches["first"] = yarn, number, number * size
    stretches["segments"] = np.minimum(size, intervals[yarn] - number * size)
    stretches["fibers_per_ply"] = _fibers_of_stretches(plans, stretches, details)
    arcs, walks, droops = (
        np.array([density * plan.step for plan, density in zip(plans, densities, strict=True)])
        for densities in (
            [plan.flyaways.hair_density for plan in plans],
            [plan.free_hairs.walk_density for plan in plans],
            [plan.free_hairs.droop_density for plan in plans],
        )
    )
    segments = stretches["segments"]
    stretches["hairs"] = hair_counts(seed, yarn, number, arcs[yarn] * segments)
    free = free_hair_counts(seed, yarn, number, walks[yarn] * segments, droops[yarn] * segments)
    stretches["walks"], stretches["droops"] = free
    stretches["hairs"] += stretches["walks"] + stretches["droops"]
    return stretches


def _fibers_of_stretches(plans: list[YarnPlan], stretches: np.ndarray, details: np.ndarray) -> np.ndarray:
    """Fibers per ply in each stretch: as many as its mean section asks for, or always the same."""
    own = np.array([plan.plies.fibers_per_ply for plan in plans])[stretches["yarn"]]
    follows = np.array([plan.config.variation.thick_places == "more_fibers" for plan in plans])
    if not len(details):
        return own
    first_node = (
        np.cumsum([0] + [plan.intervals + 1 for plan in plans])[stretches["yarn"]] + stretches["first"]
    )
    ends = np.stack([first_node, first_node + stretches["segments"] + 1], axis=1).ravel()
    square = np.append(details["thickness"].astype(np.float64) ** 2, 0.0)
    section = np.add.reduceat(square, ends)[::2] / (stretches["segments"] + 1)
    return np.where(follows[stretches["yarn"]], np.maximum(np.round(own * section), 1), own).astype(np.int64)


def seats_per_ply(plans: list[YarnPlan], stretches: np.ndarray) -> np.ndarray:
    """Most fibers that a ply of each yarn has anywhere, int64, shape [yarn_count]."""
    most = np.zeros(len(plans), dtype=np.int64)
    np.maximum.at(most, stretches["yarn"], stretches["fibers_per_ply"])
    return most


def tangent_derivative(tangent: np.ndarray, step: float, *, closed: bool) -> np.ndarray:
    """Derivative of the unit tangent by arc length [1/mm], by central differences, shape [n, 3]."""
    padded = (
        np.concatenate([tangent[-2:-1], tangent, tangent[1:2]])
        if closed
        else np.pad(tangent, ((1, 1), (0, 0)), mode="edge")
    )
    spacing = np.full((len(tangent), 1), 2.0 * step)
    if not closed:
        spacing[[0, -1]] = step
    return (padded[2:] - padded[:-2]) / spacing


def yarn_configs(config: FibersConfig, yarns: YarnSet) -> list[FibersConfig]:
    """The settings of each yarn, by its type."""
    by_type = [config.for_type(name) for name in yarns.type_names]
    return [by_type[kind] for kind in yarns.yarn_type]


def _on_circle(turns: np.ndarray) -> np.ndarray:
    """(cosine, sine) of phases in turns, shape [..., 2]."""
    angle = 2.0 * np.pi * turns
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
