"""A chosen part of the fibers as polylines, and their files. A whole garment is for the voxelizer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .fiber_colors import has_colors
from .fibers import FiberSet
from .split_launch import launch_split

POINT_LIMIT = 100_000_000
"""Points of one export: 1.3 GB in memory, and about 3 GB of OBJ text."""
BODY, LOOP, HAIR = 0, 1, 2


@dataclass(frozen=True)
class FiberSelection:
    """Which fibers to export; all of the conditions hold. Default: all of them."""

    yarns: tuple[int, int] | None = None
    """First yarn and the one after the last."""
    arc_length_mm: tuple[float, float] | None = None
    """Part of each yarn, widened to whole segments; of hairs, those that begin in a stretch it touches."""
    box_mm: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Lower and upper corner; curves are cut where they leave the box, at whole segments."""


@dataclass(frozen=True)
class FiberCurves:
    """Fibers as polylines; curve i has the points offsets[i] to offsets[i + 1]."""

    points: np.ndarray
    """[mm], float32, shape [point_count, 3]."""
    kind: np.ndarray
    """Of each point: 0 body, 1 within a loop, 2 hair; uint8, shape [point_count]."""
    offsets: np.ndarray
    """int64, shape [curve_count + 1]."""
    ply: np.ndarray
    """Ply of each body fiber, -1 for hairs; int32, shape [curve_count]."""
    yarn: np.ndarray
    """int32, shape [curve_count]."""
    fiber_radius_mm: np.ndarray
    """float32, shape [curve_count]."""
    color: np.ndarray | None = None
    """Linear RGB of each point where the fibers have colors, float32, shape [point_count, 3]."""

    @property
    def curve_count(self) -> int:
        """Number of polylines."""
        return len(self.ply)


@dataclass(frozen=True)
class StrandPoints:
    """All points of some stretches: strand after strand, stretch after stretch."""

    points: np.ndarray
    """[mm], float32, shape [point_count, 3]."""
    kind: np.ndarray
    """0 body, 1 within a loop, 2 hair; uint8, shape [point_count]."""
    offsets: np.ndarray
    """First point of each stretch, int64, shape [stretch_count + 1]."""
    color: np.ndarray | None = None
    """Linear RGB where the fibers have colors, float32, shape [point_count, 3]."""


def strand_points(
    fiber_set: FiberSet, stretches: np.ndarray, *, device: str = "cpu", threads: int | None = None
) -> StrandPoints:
    """Make all strands of the stretches with these indices; `threads` as in `launch_split`."""
    import warp as wp

    from .color_kernels import colors_kernel
    from .strand_kernels import points_kernel

    tables = fiber_set.tables(device)
    counts = fiber_set.stretch_point_counts()[stretches]
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    points = _new_array((int(offsets[-1]), 3), np.float32, wp.vec3, device)
    kinds = _new_array((int(offsets[-1]),), np.uint8, wp.uint8, device)
    chosen = wp.array(np.asarray(stretches, dtype=np.int32), dtype=wp.int32, device=device)
    begin = wp.array(offsets[:-1], dtype=wp.int64, device=device)
    count = len(stretches)
    launch_split(points_kernel, count, [tables, chosen, begin, points, kinds], device=device, threads=threads)
    if not has_colors(fiber_set):
        return StrandPoints(points.numpy(), kinds.numpy(), offsets)
    colors = _new_array((int(offsets[-1]), 3), np.float32, wp.vec3, device)
    launch_split(colors_kernel, count, [tables, chosen, begin, colors], device=device, threads=threads)
    return StrandPoints(points.numpy(), kinds.numpy(), offsets, colors.numpy())


def _new_array(shape: tuple[int, ...], dtype: Any, warp_dtype: Any, device: str) -> Any:
    """An array to write to. On the CPU it is numpy's, which asks for large pages: 2.5 ns less per point."""
    import warp as wp

    if wp.get_device(device).is_cpu:
        return wp.array(np.empty(shape, dtype=dtype), dtype=warp_dtype, device=device, copy=False)
    return wp.empty(shape[0], dtype=warp_dtype, device=device)


def export_curves(
    fiber_set: FiberSet, selection: FiberSelection | None = None, *, device: str = "cpu"
) -> FiberCurves:
    """The selected fibers as polylines; a body fiber runs on through consecutive stretches."""
    selection = selection or FiberSelection()
    stretches = select_stretches(fiber_set, selection)
    count = int(fiber_set.stretch_point_counts()[stretches].sum())
    if count > POINT_LIMIT:
        raise InputError(
            f"fibers: the selection has {count:.3g} points; at most {POINT_LIMIT:.3g} are exported at a time",
            hint="Choose fewer yarns, a shorter arc length or a smaller box.",
        )
    made = strand_points(fiber_set, stretches, device=device)
    pieces = [
        piece
        for run in _consecutive(fiber_set, stretches)
        for piece in _curves_of_run(fiber_set, stretches[run], made, run, selection)
    ]
    curves = _join(pieces)
    return curves if selection.box_mm is None else _cut_to_box(curves, selection.box_mm)


def select_stretches(fiber_set: FiberSet, selection: FiberSelection) -> np.ndarray:
    """Indices of the stretches that may hold selected fibers, int64, ascending."""
    stretches = fiber_set.stretches
    chosen = np.ones(fiber_set.stretch_count, dtype=bool)
    if selection.yarns is not None:
        chosen &= (stretches["yarn"] >= selection.yarns[0]) & (stretches["yarn"] < selection.yarns[1])
    if selection.arc_length_mm is not None:
        step = fiber_set.yarns["step"][stretches["yarn"]]
        begin, end = stretches["first"] * step, (stretches["first"] + stretches["segments"]) * step
        chosen &= (begin < selection.arc_length_mm[1]) & (end > selection.arc_length_mm[0])
    if selection.box_mm is not None:
        low, high = np.asarray(selection.box_mm)
        bounds = fiber_set.stretch_bounds()
        chosen &= ((bounds[:, 0] <= high) & (bounds[:, 1] >= low)).all(axis=1)
    return np.flatnonzero(chosen)


def _consecutive(fiber_set: FiberSet, stretches: np.ndarray) -> Iterator[slice]:
    """Runs of neighboring stretches of one yarn, as slices of `stretches`."""
    yarn = fiber_set.stretches["yarn"][stretches]
    breaks = np.flatnonzero((np.diff(stretches) != 1) | (np.diff(yarn) != 0)) + 1
    edges = [0, *breaks.tolist(), len(stretches)]
    return (slice(a, b) for a, b in pairwise(edges) if b > a)


def _curves_of_run(
    fiber_set: FiberSet, stretches: np.ndarray, made: StrandPoints, run: slice, selection: FiberSelection
) -> Iterator[FiberCurves]:
    """The body fibers of consecutive stretches as whole curves, then their hairs.

    Fibers that are there in the same stretches make one block: where a yarn keeps its thickness, all of them.
    """
    records = fiber_set.stretches[stretches]
    yarn = int(records["yarn"][0])
    present = records["fibers_per_ply"]
    ends = np.unique(present).tolist()
    for low, high in pairwise([0, *ends]):
        there = np.flatnonzero(present >= high)
        for part in np.split(there, np.flatnonzero(np.diff(there) != 1) + 1):
            yield from _body_curves(
                fiber_set, records[part], made, run.start + int(part[0]), (low, high), selection
            )
    length = fiber_set.config.hair_segments + 1
    hair_points = np.concatenate(
        [
            np.arange(made.offsets[place + 1] - hairs * length, made.offsets[place + 1])
            for place, hairs in zip(
                range(run.start, run.stop), records["hairs"].astype(np.int64), strict=True
            )
        ]
    )
    index = hair_points.reshape(-1, length)
    yield _equal_curves(fiber_set, made, index, np.full(len(index), -1), yarn)


def _body_curves(
    fiber_set: FiberSet,
    records: np.ndarray,
    made: StrandPoints,
    begin: int,
    seats: tuple[int, int],
    selection: FiberSelection,
) -> Iterator[FiberCurves]:
    """The fibers with these seats of all plies, through consecutive stretches, from `begin` in `made` on."""
    yarn = int(records["yarn"][0])
    plies = int(fiber_set.yarns["plies"][yarn])
    pieces = []
    for number, record in enumerate(records):
        nodes, fibers = int(record["segments"]) + 1, int(record["fibers_per_ply"])
        first = made.offsets[begin + number] + np.arange(plies * fibers).reshape(plies, fibers) * nodes
        # the next stretch repeats the last point
        keep = nodes if number == len(records) - 1 else nodes - 1
        pieces.append(first[:, seats[0] : seats[1]].reshape(-1, 1) + np.arange(keep))
    index = np.concatenate(pieces, axis=1)
    if selection.arc_length_mm is not None:
        step, first_node = float(fiber_set.yarns["step"][yarn]), int(records["first"][0])
        low = max(int(np.floor(selection.arc_length_mm[0] / step)) - first_node, 0)
        high = max(int(np.ceil(selection.arc_length_mm[1] / step)) - first_node + 1, low)
        index = index[:, low:high]
    ply = np.repeat(np.arange(plies), seats[1] - seats[0])
    yield _equal_curves(fiber_set, made, index, ply, yarn)


def _equal_curves(
    fiber_set: FiberSet, made: StrandPoints, index: np.ndarray, ply: np.ndarray, yarn: int
) -> FiberCurves:
    """Curves of one yarn with equally many points; `index` of each point, shape [curve_count, n]."""
    count, nodes = index.shape
    flat = index.ravel()
    radius = fiber_set.fiber_radius_mm[fiber_set.yarn_type[yarn]]
    return FiberCurves(
        points=made.points[flat],
        kind=made.kind[flat],
        offsets=np.arange(count + 1, dtype=np.int64) * nodes,
        ply=ply.astype(np.int32),
        yarn=np.full(count, yarn, dtype=np.int32),
        fiber_radius_mm=np.full(count, radius, dtype=np.float32),
        color=None if made.color is None else made.color[flat],
    )


def _join(pieces: list[FiberCurves]) -> FiberCurves:
    """All curves of all pieces, in order."""
    counts = [np.diff(piece.offsets) for piece in pieces]
    empty = (np.empty((0, 3), np.float32), np.empty(0, np.uint8), np.empty(0, np.int32))
    return FiberCurves(
        points=np.concatenate([empty[0], *(piece.points for piece in pieces)]),
        kind=np.concatenate([empty[1], *(piece.kind for piece in pieces)]),
        offsets=np.concatenate([[0], np.cumsum(np.concatenate([empty[2], *counts]))]).astype(np.int64),
        ply=np.concatenate([empty[2], *(piece.ply for piece in pieces)]),
        yarn=np.concatenate([empty[2], *(piece.yarn for piece in pieces)]),
        fiber_radius_mm=np.concatenate(
            [np.empty(0, np.float32), *(piece.fiber_radius_mm for piece in pieces)]
        ),
        color=_joined_colors(pieces),
    )


def _joined_colors(pieces: list[FiberCurves]) -> np.ndarray | None:
    colors = [piece.color for piece in pieces if piece.color is not None]
    return np.concatenate(colors) if colors else None


def _cut_to_box(curves: FiberCurves, box_mm: tuple[tuple[float, ...], tuple[float, ...]]) -> FiberCurves:
    """Keep the segments that have an end in the box; a curve that leaves and returns becomes two."""
    low, high = np.asarray(box_mm)
    inside = ((curves.points >= low) & (curves.points <= high)).all(axis=1)
    curve = np.repeat(np.arange(curves.curve_count), np.diff(curves.offsets))
    joined = curve[1:] == curve[:-1]
    kept = joined & (inside[1:] | inside[:-1])  # segments
    point = np.zeros(len(inside), dtype=bool)
    point[1:] |= kept
    point[:-1] |= kept
    begins = point & ~np.concatenate([[False], kept])
    first = np.flatnonzero(begins)
    order = np.cumsum(point) - 1
    owner = curve[first]
    return FiberCurves(
        points=curves.points[point],
        kind=curves.kind[point],
        offsets=np.append(order[first], point.sum()).astype(np.int64),
        ply=curves.ply[owner],
        yarn=curves.yarn[owner],
        fiber_radius_mm=curves.fiber_radius_mm[owner],
        color=None if curves.color is None else curves.color[point],
    )


def write_curves(curves: FiberCurves, path: str | Path) -> None:
    """Write .npz (all fields by name) or .obj (polylines, grouped by yarn, without colors)."""
    path = Path(path)
    writers = {".npz": _write_npz, ".obj": _write_obj}
    if path.suffix not in writers:
        raise InputError(
            f"fiber curves cannot be written as {path.suffix!r}", path=path, hint="Use .npz or .obj."
        )
    with atomic_write(path) as temporary:
        writers[path.suffix](curves, temporary)


def _write_npz(curves: FiberCurves, path: Path) -> None:
    with open(path, "wb") as file:
        fields = {name: value for name, value in vars(curves).items() if value is not None}
        np.savez_compressed(file, allow_pickle=False, units=np.array("mm"), **fields)


def _write_obj(curves: FiberCurves, path: Path) -> None:
    with open(path, "w", encoding="ascii") as file:
        file.write("# fibers, millimeters\n")
        for begin in range(0, len(curves.points), 65536):
            block = curves.points[begin : begin + 65536].tolist()
            file.write("".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in block))
        yarn = -1
        for index in range(curves.curve_count):
            if curves.yarn[index] != yarn:
                yarn = int(curves.yarn[index])
                file.write(f"g yarn_{yarn}\n")
            numbers = range(int(curves.offsets[index]) + 1, int(curves.offsets[index + 1]) + 1)
            file.write(f"l {' '.join(map(str, numbers))}\n")
