"""Reader for the BasisCurves of USD files (.usd, .usda, .usdc); `usd_export` writes them.

Catmull-Rom curves that are pinned or periodic are yarns as they stand, and the points of linear curves
become control points; all others are followed to a tolerance. Widths are diameters, in the space of their
prim. Unit and up axis come from the stage where it names them.
"""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from weft.fiber_model.yarns.catmull_rom import CatmullRom
from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet, refuse_too_many_points
from weft.files.errors import InputError

from .bcc import turned_to_y_up
from .follow import BASES, follow_curves
from .raw_file import one_radius_each, refuse_few_points
from .usd_stage import RAGGED_FIELDS, TEXT_FIELDS

TIMEOUT_S = 300.0
"""For USD to read a file, and a second more for each of its megabytes."""
TYPE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
MISSING = "USD files need the package usd-core, which is not installed."
CURE = "pip install 'weft[usd]', or pip install usd-core"


@dataclass(frozen=True)
class _Prim:
    """One BasisCurves prim, in mm, y up."""

    path: str
    basis: str
    """A cubic basis, or linear."""
    wrap: str
    curves: list[np.ndarray]
    radius: np.ndarray
    yarn_type: str
    fields: dict[str, np.ndarray]
    """What `usd_export` adds: yarn, twist, uv."""

    @property
    def closed(self) -> bool:
        return self.wrap == "periodic"


def read_usd(
    path: str | Path,
    *,
    scale_to_mm: float | None = None,
    radius_mm: float | None = None,
    up_axis: int = 1,
    type_name: str = "yarn",
    frame: int | None = None,
) -> YarnSet:
    """Read yarns at a frame. `scale_to_mm` and `radius_mm` replace unit and radius of the file.

    `up_axis`, 1 (y) or 2 (z), is that of a file that names none. Prims without a `weft:yarnType`, which
    `write_usd` gives them, are of type `type_name`.
    """
    path = Path(path)
    fields = _read_fields(path, "-" if frame is None else str(frame))
    return _from_fields(fields, path, scale_to_mm, radius_mm, up_axis, type_name)


@dataclass(frozen=True)
class UsdSummary:
    """What a USD file says of itself, and its yarns at the first frame."""

    yarns: YarnSet
    """In mm if the file names its unit, else in its unit."""
    unit_mm: float | None
    up_axis: str
    """Y, Z or, where the file names none, nothing."""
    frames: list[float]
    """First and last, or none."""


def summarize_usd(path: str | Path, *, radius_mm: float | None = None) -> UsdSummary:
    """For `weft inspect`; `radius_mm` as in `read_usd`."""
    path = Path(path)
    fields = _read_fields(path, "first")
    named = not np.isnan(float(fields["meters_per_unit"]))
    yarns = _from_fields(fields, path, None if named else 1.0, radius_mm, 1, "yarn")
    unit = unit_in_mm(fields, None, path) if named else None
    return UsdSummary(yarns, unit, str(fields["up_axis"]), fields["frames"].tolist())


def _from_fields(
    fields: dict[str, np.ndarray],
    path: Path,
    scale_to_mm: float | None,
    radius_mm: float | None,
    up_axis: int,
    type_name: str,
) -> YarnSet:
    scale = unit_in_mm(fields, scale_to_mm, path)
    axis = upward_axis(fields, up_axis, path)
    refuse_too_many_points(len(fields["points"]), "the file", path=path)
    prims = [_prim(part, scale, axis, radius_mm, type_name, path) for part in _parts(fields)]
    return _yarns(prims, path)


def refuse_without_usd(path: Path) -> None:
    """Raise where usd-core is not installed."""
    if importlib.util.find_spec("pxr") is None:
        raise InputError(MISSING, path=path, hint=f"{CURE}.")


def _read_fields(path: Path, frame: str) -> dict[str, np.ndarray]:
    return read_in_process(path, f"{__package__}.usd_stage", frame)


def read_in_process(path: Path, module: str, *arguments: str) -> dict[str, np.ndarray]:
    """Run `usd_stage`, or a module like it, on the file, within limits of time and memory."""
    refuse_without_usd(path)
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "found.npz"
        program = [sys.executable, "-P", "-m", module]
        command = [*program, os.path.abspath(path), str(result), *arguments]
        environment = os.environ | {"PXR_WORK_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1"}
        limit = TIMEOUT_S + path.stat().st_size / 1e6
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=limit, check=False)
        except subprocess.TimeoutExpired:
            what = f"USD did not come back within {limit:.0f} s; is the file damaged?"
            raise InputError(what, path=path) from None
        if done.returncode == InputError.exit_code:
            raise InputError(done.stdout.decode().strip(), path=path)
        if done.returncode == -signal.SIGXCPU:
            raise InputError("USD did not come to an end with this file; is it damaged?", path=path)
        if done.returncode != 0 or not result.is_file():
            what = f"USD failed on this file (exit code {done.returncode}); is it damaged?"
            raise InputError(what, path=path)
        with np.load(result, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}


def unit_in_mm(fields: dict[str, np.ndarray], scale_to_mm: float | None, path: Path) -> float:
    """Length of a unit of the stage [mm]: what was given, or else what the stage says of itself."""
    if scale_to_mm is not None:
        return scale_to_mm
    meters = float(fields["meters_per_unit"])
    if np.isnan(meters):
        hint = "Give 'scale_to_mm' (USD's default unit is a cm: 10)."
        raise InputError("the file does not name its unit (metersPerUnit).", path=path, hint=hint)
    if not 0 < meters < 1e7:
        raise InputError(f"metersPerUnit is {meters:g}; need a positive number", path=path)
    return meters * 1000.0


def upward_axis(fields: dict[str, np.ndarray], up_axis: int, path: Path) -> int:
    """1 or 2, from the stage; `up_axis` where it names none."""
    axis = {"": up_axis, "Y": 1, "Z": 2}.get(str(fields["up_axis"]))
    if axis is None:
        raise InputError(f"up axis '{fields['up_axis']}'; need Y or Z", path=path)
    return axis


def _parts(fields: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """The fields of each prim by itself."""
    parts: list[dict[str, Any]] = [
        {name: str(fields[name][index]) for name in TEXT_FIELDS} | {"transform": transform}
        for index, transform in enumerate(fields["transform"])
    ]
    for name in RAGGED_FIELDS:
        split = np.split(fields[name], np.cumsum(fields[f"{name}_counts"])[:-1])
        for part, values in zip(parts, split, strict=True):
            part[name] = values if RAGGED_FIELDS[name] > 1 else values[:, 0]
    return parts


def _prim(
    part: dict[str, Any], scale: float, axis: int, radius_mm: float | None, type_name: str, path: Path
) -> _Prim:
    """Check a prim's fields against each other; coordinates to mm, y up."""
    where, counts = part["path"], part["counts"]
    basis = "linear" if part["type"] == "linear" else part["basis"]
    if part["type"] not in ("linear", "cubic") or basis not in ("linear", *BASES):
        raise InputError(f"{where}: curves of type '{part['type']}', basis '{basis}'", path=path)
    if part["wrap"] not in ("nonperiodic", "periodic", "pinned"):
        raise InputError(f"{where}: wrap '{part['wrap']}'", path=path)
    if not len(counts) or (counts <= 0).any() or counts.sum() != len(part["points"]):
        what = f"'curveVertexCounts' add up to {counts.sum()}, but there are {len(part['points'])} points"
        raise InputError(f"{where}: {what}", path=path)
    if part["yarn_type"] and not TYPE_NAME.fullmatch(part["yarn_type"]):
        raise InputError(f"{where}: '{part['yarn_type'][:40]}' is no name of a yarn type", path=path)
    matrix = part["transform"]
    if not np.isfinite(matrix).all():
        raise InputError(f"{where}: its transform is not finite", path=path)
    with np.errstate(invalid="ignore", over="ignore"):
        points = part["points"] @ matrix[:3, :3] + matrix[3, :3]
        points = turned_to_y_up(points, axis) * scale
    curves = np.split(points, np.cumsum(counts)[:-1])
    for index, curve in enumerate(curves):
        _refuse_count(len(curve), basis, part["wrap"], f"{where}: curve {index}", path)
    radius = np.full(len(counts), radius_mm) if radius_mm is not None else _radius(part, basis, scale, path)
    added = {name: part[name] for name in ("yarn", "twist", "uv")}
    return _Prim(where, basis, part["wrap"], curves, radius, part["yarn_type"] or type_name, added)


def _refuse_count(count: int, basis: str, wrap: str, where: str, path: Path) -> None:
    """Refuse numbers of points that the basis does not allow."""
    fewest = 2 if wrap == "pinned" and basis != "bezier" else 3 if wrap == "periodic" else MIN_POINTS
    rest = count % 3 if wrap == "periodic" else (count - 1) % 3
    if basis != "linear" and (count < fewest or (basis == "bezier" and rest)):
        raise InputError(f"{where} has {count} points, which a {wrap} {basis} curve cannot", path=path)


def _radius(part: dict[str, Any], basis: str, scale: float, path: Path) -> np.ndarray:
    """Half the width of each curve [mm]."""
    where, widths, counts = part["path"], part["widths"], part["counts"]
    stretch = np.linalg.svd(part["transform"][:3, :3], compute_uv=False)
    needed = {
        "constant": np.ones(1, np.int64),
        "uniform": np.ones(len(counts), np.int64),
        "varying": _varying_counts(counts, basis, part["wrap"]),
        "vertex": counts,
    }.get(part["interpolation"], counts)
    if not len(widths):
        raise InputError(f"{where} has no 'widths', so 'radius_mm' must be given", path=path)
    if len(widths) != needed.sum():
        what = f"{where} has {len(widths)} widths; '{part['interpolation']}' takes {needed.sum()}"
        raise InputError(f"{what}. Mend it or give 'radius_mm'", path=path)
    if not stretch.max() - stretch.min() <= 1e-4 * stretch.max():
        what = f"{where} is scaled differently along its axes, so widths mean nothing; give 'radius_mm'"
        raise InputError(what, path=path)
    radius = 0.5 * scale * float(stretch.mean()) * widths
    radius = one_radius_each(radius, np.concatenate([[0], np.cumsum(needed)]), path)
    return np.broadcast_to(radius, (len(counts),)).copy()


def _varying_counts(counts: np.ndarray, basis: str, wrap: str) -> np.ndarray:
    """Values of a 'varying' primvar on each curve: one at each end of a segment."""
    if basis == "linear":
        return counts
    step = 3 if basis == "bezier" else 1
    if wrap == "periodic":
        return counts // step
    return counts if wrap == "pinned" and basis != "bezier" else (counts - 4) // step + 2


def _yarns(prims: list[_Prim], path: Path) -> YarnSet:
    """All curves as one set, in the order that `usd_export` noted, or as they stand."""
    radius = np.concatenate([prim.radius for prim in prims])
    closed = np.repeat([prim.closed for prim in prims], [len(prim.curves) for prim in prims])
    curves = [(prim, curve) for prim in prims for curve in prim.curves]
    ready = np.array([_is_ready(prim, curve) for prim, curve in curves])
    names = tuple(dict.fromkeys(prim.yarn_type for prim in prims))
    controls = [curve for _, curve in curves]
    others = np.flatnonzero(~ready)
    if len(others):
        segments = [
            _segments(curves[index][1], curves[index][0].basis, curves[index][0].wrap) for index in others
        ]
        offsets = np.cumsum([0] + [len(part) for part in segments])
        followed = follow_curves(
            CatmullRom(np.concatenate(segments), offsets), closed[others], radius[others], source=path
        )
        for index, points in zip(others, followed, strict=True):
            controls[index] = points
    for yarn, points in enumerate(controls):
        refuse_few_points(len(points), yarn, MIN_POINTS, path)
    order = _order(prims, len(curves))
    types = [names.index(prim.yarn_type) for prim, _ in curves]
    counts = [len(points) for points in controls]
    twist, uv = (_per_point(prims, name, counts, ready) for name in ("twist", "uv"))
    return YarnSet.checked(
        [controls[index] for index in order],
        closed=[bool(closed[index]) for index in order],
        radius=radius[order].tolist(),
        yarn_type=[types[index] for index in order],
        type_names=names,
        twist=None if twist is None else [twist[index] for index in order],
        surface_uv=None if uv is None else [uv[index] for index in order],
        source=path,
    )


def _is_ready(prim: _Prim, curve: np.ndarray) -> bool:
    """Whether the curve's points are those of a yarn."""
    own_kind = prim.basis == "catmullRom" and prim.wrap != "nonperiodic" and len(curve) >= MIN_POINTS
    return prim.basis == "linear" or own_kind


def _segments(points: np.ndarray, basis: str, wrap: str) -> np.ndarray:
    """Coefficients of the segments of one curve, shape [segments, 4 (power of u), 3]."""
    step = 3 if basis == "bezier" else 1
    if wrap == "pinned" and basis != "bezier":
        points = np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])
    count = len(points) // step if wrap == "periodic" else (len(points) - 4) // step + 1
    index = np.arange(count)[:, None] * step + np.arange(4)
    return np.einsum("pk,skx->spx", BASES[basis], points[index % len(points)])


def _order(prims: list[_Prim], count: int) -> np.ndarray:
    noted = np.concatenate([prim.fields["yarn"] for prim in prims])
    if len(noted) == count and (np.sort(noted) == np.arange(count)).all():
        return np.argsort(noted)
    return np.arange(count)


def _per_point(
    prims: list[_Prim], name: str, counts: list[int], ready: np.ndarray
) -> list[np.ndarray] | None:
    """A field of each control point, yarn by yarn, where every prim has one."""
    if not ready.all() or any(len(prim.fields[name]) != sum(map(len, prim.curves)) for prim in prims):
        return None
    return np.split(np.concatenate([prim.fields[name] for prim in prims]), np.cumsum(counts)[:-1])
