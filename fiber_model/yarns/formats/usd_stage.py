"""BasisCurves of one USD file as plain arrays; a program of its own, run by `usd_curves`.

USD's library can crash on a damaged file, fill the memory or not come back. So it reads in a process with
limits, and what it found is handed over as an .npz file. Arguments: the USD file, the .npz file to write, a
frame, "first", or "-" where there is one only. A user's mistake is printed as one line, exit code 2.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.errors import InputError

MEMORY_BYTES = 4 << 30
"""Address space beyond a multiple of the file's size; USD itself takes about half a GiB."""
MEMORY_PER_FILE_BYTE = 32
PROCESSOR_SECONDS = 60
"""At most, and one more for every MB. By the clock it may take longer, where disk or processors are busy."""
TEXT_FIELDS = ("path", "type", "basis", "wrap", "interpolation", "yarn_type")
RAGGED_FIELDS = {"counts": 1, "points": 3, "widths": 1, "yarn": 1, "twist": 1, "uv": 2}
"""Arrays of a prim, of any length, and their columns."""
OTHER_CURVES = ("NurbsCurves", "HermiteCurves")
PURPOSES = ("default", "render")

NO_CURVES = "no visible BasisCurves in this file"

Prim = dict[str, Any]
"""Fields of one BasisCurves prim, by name."""


def main(file: str, result: str, frame: str) -> int:
    """Read curves of `file` and write `result`; the exit code."""
    return write_fields(lambda: read_stage(file, frame), file, result)


def write_fields(read: Callable[[], dict[str, Any]], file: str, result: str) -> int:
    """Write what `read` finds in `file`, within limits of memory and time; the exit code."""
    size = Path(file).stat().st_size
    limit = MEMORY_BYTES + MEMORY_PER_FILE_BYTE * size
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    seconds = PROCESSOR_SECONDS + size // 1_000_000
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    try:
        fields = read()
    except InputError as error:
        print(" ".join(error.what.split()).encode("ascii", "backslashreplace").decode())
        return error.exit_code
    np.savez(result, **fields)
    return 0


def read_stage(file: str, frame: str) -> dict[str, Any]:
    """What is asked of the file, at one frame: unit, up axis, and the fields of every prim together."""
    from pxr import UsdGeom

    stage = open_stage(file)
    prims = _curve_prims(stage)
    frames = _frames(prims)
    time = _time_of(prims, frames, frame)
    transforms = UsdGeom.XformCache(time)
    found = [_read_prim(prim, time) for prim in prims]
    fields: dict[str, Any] = {
        "frames": np.array(frames),
        **unit_and_axis(stage),
        "transform": np.array([transforms.GetLocalToWorldTransform(prim) for prim in prims], np.float64),
    }
    for name in TEXT_FIELDS:
        fields[name] = np.array([prim[name] for prim in found], dtype=np.str_)
    for name, columns in RAGGED_FIELDS.items():
        fields[name] = np.concatenate([prim[name].reshape(-1, columns) for prim in found])
        fields[f"{name}_counts"] = np.array([len(prim[name].reshape(-1, columns)) for prim in found])
    return fields


def unit_and_axis(stage: Any) -> dict[str, Any]:
    """metersPerUnit and upAxis, not a number and empty where the stage names none."""
    from pxr import UsdGeom

    named = UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    axis = str(UsdGeom.GetStageUpAxis(stage)) if stage.HasAuthoredMetadata("upAxis") else ""
    return {
        "meters_per_unit": np.array(UsdGeom.GetStageMetersPerUnit(stage) if named else np.nan),
        "up_axis": np.array(axis),
    }


def open_stage(file: str) -> Any:
    """The stage of this file alone."""
    from pxr import Sdf, Tf, Usd

    try:
        layer = Sdf.Layer.OpenAsAnonymous(file)
        others = layer.GetCompositionAssetDependencies() if layer else []
        if others:
            shown = ", ".join(f"'{name}'" for name in others[:3])
            raise InputError(f"refers to other files ({shown}); flatten it into one file first")
        stage = Usd.Stage.Open(layer) if layer else None
    except Tf.ErrorException:
        stage = None
    if stage is None:
        raise InputError("USD cannot read this file; is it damaged?")
    return stage


def _curve_prims(stage: Any) -> list[Any]:
    """All visible BasisCurves that are meant for rendering, instances included."""
    from pxr import Usd, UsdGeom

    prims = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.GetTypeName() in OTHER_CURVES:
            what = f"{prim.GetPath()} is of type {prim.GetTypeName()}; convert it to BasisCurves"
            raise InputError(what)
        if prim.IsA(UsdGeom.BasisCurves):
            image = UsdGeom.Imageable(prim)
            if image.ComputePurpose() in PURPOSES and image.ComputeVisibility() != "invisible":
                prims.append(prim)
    if not prims:
        raise InputError(NO_CURVES)
    return prims


def _frames(prims: list[Any]) -> list[float]:
    """The first and the last frame between which points or transforms move; empty where they stand still."""
    from pxr import UsdGeom

    spans = [prim.GetAttribute("points").GetTimeSamples() for prim in prims]
    above = {prim.GetPath(): prim for prim in prims}
    for prim in prims:
        while (prim := prim.GetParent()) and prim.GetPath() not in above:
            above[prim.GetPath()] = prim
    spans += [
        UsdGeom.Xformable(prim).GetTimeSamples() for prim in above.values() if prim.IsA(UsdGeom.Xformable)
    ]
    spans = [span for span in spans if span]
    return [min(span[0] for span in spans), max(span[-1] for span in spans)] if spans else []


def _time_of(prims: list[Any], frames: list[float], frame: str) -> Any:
    """The time to read at; what moves needs a frame between the first and the last that the file has."""
    from pxr import Usd

    if frame not in ("-", "first"):
        if frames and not frames[0] <= int(frame) <= frames[1]:
            raise InputError(f"no frame {frame}; the file has {frames[0]:g} to {frames[1]:g}")
        return Usd.TimeCode(int(frame))
    if not frames:
        return Usd.TimeCode.Default()
    if frame == "first" or frames[0] == frames[1]:
        return Usd.TimeCode(frames[0])
    raise InputError(f"the curves move from frame {frames[0]:g} to {frames[1]:g}; choose one with 'frame'")


def _read_prim(prim: Any, time: Any) -> Prim:
    from pxr import UsdGeom

    curves = UsdGeom.BasisCurves(prim)
    numbers = {
        "counts": (prim.GetAttribute("curveVertexCounts"), np.int64),
        "points": (prim.GetAttribute("points"), np.float64),
        "widths": (prim.GetAttribute("widths"), np.float64),
        "yarn": (prim.GetAttribute("weft:yarn"), np.int64),
        "twist": (prim.GetAttribute("primvars:weft:twist"), np.float64),
        "uv": (prim.GetAttribute("primvars:st"), np.float64),
    }
    found: Prim = {
        name: _array(attribute, time, dtype, RAGGED_FIELDS[name], prim)
        for name, (attribute, dtype) in numbers.items()
    }
    for name in ("type", "basis", "wrap"):
        found[name] = str(prim.GetAttribute(name).Get(time))
    return found | {
        "path": str(prim.GetPath()),
        "interpolation": str(curves.GetWidthsInterpolation()),
        "yarn_type": str(_value(prim.GetAttribute("weft:yarnType"), time) or ""),
    }


def _value(attribute: Any, time: Any) -> Any:
    return attribute.Get(time) if attribute and attribute.HasValue() else None


def _array(attribute: Any, time: Any, dtype: type, columns: int, prim: Any) -> np.ndarray:
    """The attribute's value, shape [n * columns]; empty where there is none."""
    value = _value(attribute, time)
    try:
        array: np.ndarray = np.array([] if value is None else value, dtype).reshape(-1)
    except (TypeError, ValueError):
        array = np.empty(1, dtype)
    if len(array) % columns:
        raise InputError(f"{prim.GetPath()}: '{attribute.GetName()}' is of an unknown kind")
    return array


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
