"""The arrays behind a `FiberSet`: what depends on one yarn, node, fiber or stretch alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .config import FibersConfig
from .cross_section import sample_cross_section
from .flyaways import FlyawayShape, hair_counts, probability_threshold, scaled_flyaways
from .migration import migration_phase
from .plies import PlyShape, phase_at_nodes, ply_phase, scaled_plies, turns_along
from .yarns.frames import YarnFrames
from .yarns.yarns import YarnSet

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class YarnPlan:
    """One yarn's plies and fly-aways, with the turns that its helices make over its length."""

    config: FibersConfig
    plies: PlyShape
    flyaways: FlyawayShape
    ply_turns: float
    fiber_turns: float
    migration_turns: float
    intervals: int
    step: float
    closed: bool

    @property
    def fiber_count(self) -> int:
        """Body fibers of the yarn, all plies together."""
        return self.config.plies * self.plies.fibers_per_ply

    @property
    def reach(self) -> float:
        """No body fiber, loops included, goes farther from the yarn's center than this [mm]."""
        largest = max(1.0, self.config.migration_max) * (1.0 + self.config.perturbation)
        largest = max(largest, self.flyaways.loop_reach * (1.0 + self.config.perturbation))
        outward = self.plies.center_radius + largest * self.plies.short
        return max(outward, float(np.hypot(self.plies.center_radius, largest * self.plies.long)), 0.0)


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
        ply_turns=turns_along(length, plies.ply_pitch, closed=closed),
        fiber_turns=fiber_turns,
        migration_turns=migration_turns,
        intervals=intervals,
        step=length / intervals,
        closed=closed,
    )


def build_nodes(
    plans: list[YarnPlan], frames: YarnFrames, seed: int, dtype: np.dtype, progress: Progress | None
) -> np.ndarray:
    """One record per node of every yarn: frame, bend, and phases as (cosine, sine)."""
    nodes = np.empty(int(frames.offsets[-1]), dtype=dtype)
    begin_phase = ply_phase(seed, np.arange(len(plans)))
    for yarn, plan in enumerate(plans):
        part = slice(frames.offsets[yarn], frames.offsets[yarn + 1])
        tangent, normal = frames.tangent[part], frames.normal[part]
        nodes["position"][part] = frames.position[part]
        nodes["normal"][part] = normal
        nodes["binormal"][part] = np.cross(tangent, normal)
        nodes["bend"][part] = tangent_derivative(tangent, plan.step, closed=plan.closed)
        nodes["ply"][part] = _on_circle(phase_at_nodes(plan.ply_turns, plan.intervals) + begin_phase[yarn])
        nodes["twist"][part] = _on_circle(phase_at_nodes(plan.fiber_turns, plan.intervals))
        nodes["migration"][part] = _on_circle(phase_at_nodes(plan.migration_turns, plan.intervals))
        if progress is not None and yarn % 64 == 0:
            progress(part.stop / len(nodes), f"phases: yarn {yarn + 1} of {len(plans)}")
    return nodes


def build_seats(plans: list[YarnPlan], types: np.ndarray, seed: int, dtype: np.dtype) -> np.ndarray:
    """One record per fiber: its place in the ply's cross-section and where its migration begins.

    `types` is the type of each yarn; all fibers of one type are drawn together.
    """
    counts = np.array([plan.fiber_count for plan in plans], dtype=np.int64)
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


def build_yarns(plans: list[YarnPlan], frames: YarnFrames, dtype: np.dtype) -> np.ndarray:
    """One record of parameters per yarn."""
    records = np.zeros(len(plans), dtype=dtype)
    first_fiber = np.cumsum([0] + [plan.fiber_count for plan in plans])
    for yarn, plan in enumerate(plans):
        flyaways, config = plan.flyaways, plan.config
        length = plan.step * plan.intervals
        values = {
            "first_node": frames.offsets[yarn],
            "first_fiber": first_fiber[yarn],
            "intervals": plan.intervals,
            "closed": plan.closed,
            "plies": config.plies,
            "fibers_per_ply": plan.plies.fibers_per_ply,
            "step": plan.step,
            "center_radius": plan.plies.center_radius,
            "ellipse_short": plan.plies.short,
            "ellipse_long": plan.plies.long,
            "migration_low": config.migration_min,
            "migration_high": config.migration_max,
            "migration_turns": plan.migration_turns,
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


def build_stretches(plans: list[YarnPlan], seed: int, dtype: np.dtype) -> np.ndarray:
    """One record per stretch, yarn after yarn; the last stretch of a yarn may be shorter."""
    size = plans[0].config.stretch_segments if plans else 1
    intervals = np.array([plan.intervals for plan in plans], dtype=np.int64)
    counts = -(-intervals // size)
    yarn = np.repeat(np.arange(len(plans)), counts)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    stretches = np.empty(len(yarn), dtype=dtype)
    stretches["yarn"], stretches["number"], stretches["first"] = yarn, number, number * size
    stretches["segments"] = np.minimum(size, intervals[yarn] - number * size)
    hairs_per_segment = np.array([plan.flyaways.hair_density * plan.step for plan in plans])
    stretches["hairs"] = hair_counts(seed, yarn, number, hairs_per_segment[yarn] * stretches["segments"])
    return stretches


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
