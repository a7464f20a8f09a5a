"""Fibers as a function: plies, fibers and fly-aways along yarns, made stretch by stretch where needed.

After Zhao, Luan and Bala 2016, laid along rotation-minimizing frames by arc length. A garment's fibers are
never stored; a `FiberSet` holds the yarns' nodes and a few numbers per fiber, from which every point follows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .config import FibersConfig
from .counter_random import seed_key
from .fiber_arrays import (
    build_colors,
    build_details,
    build_seats,
    build_stretches,
    build_yarns,
    seats_per_ply,
    yarn_configs,
    yarn_free_hairs,
)
from .fiber_report import (
    FiberReport,
    refuse_empty_yarns,
    refuse_too_many_fibers,
    refuse_too_many_nodes,
    refuse_unknown_types,
    report_fibers,
    segment_length,
)
from .split_launch import launch_split
from .yarn_colors import yarn_palettes
from .yarn_nodes import lay_nodes
from .yarns.yarns import YarnSet

if TYPE_CHECKING:
    from .fiber_tables import FiberTables

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class FiberSet:
    """Every fiber of a set of yarns, as a function of (stretch, strand, k).

    A stretch is a piece of one yarn, `stretch_segments` segments long. Its strands are first the body fibers
    (loops are periods of theirs), ply after ply, then the hairs that begin in it. Points come from Warp
    functions in `fiber_kernels`, given `tables(device)`.
    """

    config: FibersConfig
    type_names: tuple[str, ...]
    fiber_radius_mm: tuple[float, ...]
    """Radius of the fibers of each yarn type."""
    yarn_type: np.ndarray
    """Type of each yarn, int32, shape [yarn_count]."""
    yarn_reach_mm: np.ndarray
    """No body fiber goes farther from its yarn's center than this times thickness, float64, [yarn_count]."""
    report: FiberReport
    nodes: np.ndarray
    """`fiber_tables.YarnNode` records, all yarns."""
    yarns: np.ndarray
    """`fiber_tables.YarnParameters` records."""
    seats: np.ndarray
    """`fiber_tables.FiberSeat` records, all body fibers."""
    stretches: np.ndarray
    """`fiber_tables.Stretch` records."""
    free_hairs: np.ndarray
    """`fiber_tables.FreeHairParameters` records, one per yarn."""
    details: np.ndarray
    """`fiber_tables.NodeDetail` records of all nodes, or none where no yarn varies or has cords."""
    colors: np.ndarray
    """Colors of plies, linear RGB, float32, shape [n, 3]; see `fiber_colors.ply_color`."""

    @property
    def stretch_count(self) -> int:
        """Stretches of all yarns."""
        return len(self.stretches)

    def stretch_type(self) -> np.ndarray:
        """Yarn type of each stretch, int32, shape [stretch_count]."""
        return self.yarn_type[self.stretches["yarn"]].astype(np.int32)

    def stretch_strand_counts(self) -> np.ndarray:
        """Strands of each stretch, body fibers and hairs, int32, shape [stretch_count]."""
        body = self.yarns["plies"][self.stretches["yarn"]] * self.stretches["fibers_per_ply"]
        return (body + self.stretches["hairs"]).astype(np.int32)

    def stretch_point_counts(self) -> np.ndarray:
        """Points of all strands of each stretch, int64, shape [stretch_count]."""
        hairs = self.stretches["hairs"].astype(np.int64)
        body = self.stretch_strand_counts() - hairs
        return body * (self.stretches["segments"] + 1) + hairs * (self.config.hair_segments + 1)

    def stretch_bounds(self, device: str = "cpu", *, threads: int | None = None) -> np.ndarray:
        """Box around all strands of each stretch [mm], float32, shape [stretch_count, 2, 3].

        Hairs are bounded exactly, body fibers by the largest reach that a loop can have.
        """
        import warp as wp

        from .strand_kernels import bounds_kernel

        bounds = wp.empty((self.stretch_count, 2), dtype=wp.vec3, device=device)
        reach = wp.array(self.yarn_reach_mm, dtype=wp.float64, device=device)
        inputs = [self.tables(device), reach, bounds]
        launch_split(bounds_kernel, self.stretch_count, inputs, device=device, threads=threads)
        boxes = bounds.numpy()
        margin = 4 * np.spacing(np.abs(boxes).max(initial=1.0).astype(np.float32))
        return boxes + np.array([[-margin], [margin]], dtype=np.float32)

    def tables(self, device: str = "cpu") -> FiberTables:
        """The tables that the Warp functions read, on one device."""
        from .fiber_tables import to_device

        return to_device(
            seed_key(self.config.seed),
            self.config.hair_segments,
            device,
            nodes=self.nodes,
            yarns=self.yarns,
            seats=self.seats,
            stretches=self.stretches,
            free_hairs=self.free_hairs,
            details=self.details,
            colors=self.colors,
        )

    def fiber_lengths_mm(self, device: str = "cpu", *, threads: int | None = None) -> np.ndarray:
        """Length of the body fibers and of the hairs of each stretch, float64, shape [stretch_count, 2].

        The sum is the fiber length generated, which every grid made from this set must contain.
        """
        import warp as wp

        from .strand_kernels import length_kernel

        length = wp.empty((self.stretch_count, 2), dtype=wp.float64, device=device)
        launch_split(
            length_kernel, self.stretch_count, [self.tables(device), length], device=device, threads=threads
        )
        return length.numpy()


def run(config: FibersConfig, yarns: YarnSet, *, progress: Progress | None = None) -> FiberSet:
    """Lay plies, fibers and fly-aways along the yarns."""
    refuse_empty_yarns(yarns)
    refuse_unknown_types(config, yarns)
    configs = yarn_configs(config, yarns)
    segment = min(segment_length(own, radius) for own, radius in zip(configs, yarns.radius, strict=True))
    refuse_too_many_nodes(yarns, segment)
    seed, records = seed_key(config.seed), _record_types()
    laid = lay_nodes(configs, yarns, segment, seed, records["nodes"], progress=progress)
    plans, nodes = laid.plans, laid.nodes
    details = build_details(plans, laid.offsets, seed, records["details"])
    refuse_too_many_fibers(plans, details)
    stretches = build_stretches(plans, details, seed, records["stretches"])
    seats = seats_per_ply(plans, stretches)
    palettes = yarn_palettes(configs, yarns, seed)
    colors, first_color = build_colors(palettes)
    return FiberSet(
        config=config,
        type_names=yarns.type_names,
        fiber_radius_mm=tuple(config.for_type(name).fiber_radius_mm for name in yarns.type_names),
        yarn_type=yarns.yarn_type.astype(np.int32),
        yarn_reach_mm=np.array([plan.reach for plan in plans]),
        report=report_fibers(plans, yarns, nodes["bend"], details, stretches),
        nodes=nodes,
        yarns=build_yarns(
            plans, seats, first_color, [len(p) for p in palettes], laid.offsets, records["yarns"]
        ),
        seats=build_seats(plans, seats, yarns.yarn_type, seed, records["seats"]),
        stretches=stretches,
        free_hairs=yarn_free_hairs(plans, records["free_hairs"]),
        details=details,
        colors=colors,
    )


def _record_types() -> dict[str, np.dtype]:
    """Numpy's view of the structs that the Warp functions read, written once in `fiber_tables`."""
    from .fiber_tables import RECORDS

    return {name: np.dtype(struct.numpy_dtype()) for name, struct in RECORDS.items()}
