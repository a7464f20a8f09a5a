"""A chosen part of the fibers as polylines, and their files. A whole garment is for the voxelizer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .fibers import FiberSet

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


def strand_points(fiber_set: FiberSet, stretches: np.ndarray, *, device: str = "cpu") -> StrandPoints:
    """Make all strands of the stretches with these indices."""
    import warp as wp

    from .strand_kernels import points_kernel

    counts = fiber_set.stretch_point_counts()[stretches]
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    points = wp.empty(int(offsets[-1]), dtype=wp.vec3, device=device)
    kinds = wp.empty(int(offsets[-1]), dtype=wp.uint8, device=device)
    chosen = wp.array(np.asarray(stretches, dtype=np.int32), dtype=wp.int32, device=device)
    begin = wp.array(offsets[:-1], dtype=wp.int64, device=device)
    wp.launch(
        points_kernel,
        len(stretches),
        inputs=[fiber_set.tables(device), chosen, begin, points, kinds],
        device=device,
    )
    return StrandPoints(points.numpy(), kinds.numpy(), offsets)


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
    """The body fibers of consecutive stretches as whole curves, then their hairs."""
    records = fiber_set.stretches[stretches]
    yarn = int(records["yarn"][0])
    body = int(fiber_set.yarns["plies"][yarn] * fiber_set.yarns["fibers_per_ply"][yarn])
    radius = fiber_set.fiber_radius_mm[fiber_set.yarn_type[yarn]]
    points, kinds, hairs, hair_kinds = [], [], [], []
    for place, record in zip(range(run.start, run.stop), records, strict=True):
        part = slice(made.offsets[place], made.offsets[place + 1])
        nodes = int(record["segments"]) + 1
        keep = nodes if place == run.stop - 1 else nodes - 1  # the next stretch repeats the last point
        points.append(made.points[part][: body * nodes].reshape(body, nodes, 3)[:, :keep])
        kinds.append(made.kind[part][: body * nodes].reshape(body, nodes)[:, :keep])
        hairs.append(made.points[part][body * nodes :])
        hair_kinds.append(made.kind[part][body * nodes :])
    joined, joined_kinds = np.concatenate(points, axis=1), np.concatenate(kinds, axis=1)
    if selection.arc_length_mm is not None:
        step, first = float(fiber_set.yarns["step"][yarn]), int(records["first"][0])
        begin = max(int(np.floor(selection.arc_length_mm[0] / step)) - first, 0)
        end = max(int(np.ceil(selection.arc_length_mm[1] / step)) - first + 1, begin)
        joined, joined_kinds = joined[:, begin:end], joined_kinds[:, begin:end]
    ply = np.arange(body) // int(fiber_set.yarns["fibers_per_ply"][yarn])
    yield _equal_curves(joined, joined_kinds, ply, yarn, radius)
    hair_points = np.concatenate(hairs).reshape(-1, fiber_set.config.hair_segments + 1, 3)
    no_ply = np.full(len(hair_points), -1)
    yield _equal_curves(hair_points, np.concatenate(hair_kinds), no_ply, yarn, radius)


def _equal_curves(
    points: np.ndarray, kind: np.ndarray, ply: np.ndarray, yarn: int, radius: float
) -> FiberCurves:
    """Curves of one yarn with equally many points, shape [curve_count, n, 3]."""
    count, nodes = points.shape[:2]
    return FiberCurves(
        points=points.reshape(-1, 3),
        kind=kind.reshape(-1),
        offsets=np.arange(count + 1, dtype=np.int64) * nodes,
        ply=ply.astype(np.int32),
        yarn=np.full(count, yarn, dtype=np.int32),
        fiber_radius_mm=np.full(count, radius, dtype=np.float32),
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
    )


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
    )


def write_curves(curves: FiberCurves, path: str | Path) -> None:
    """Write .npz (all fields by name) or .obj (polylines, grouped by yarn)."""
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
        np.savez_compressed(file, allow_pickle=False, units=np.array("mm"), **vars(curves))


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
