"""Reader for the curves of fibers that `fiber_curves.write_curves` writes as .npz."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from weft.files.errors import InputError

from .fiber_curves import POINT_LIMIT, FiberCurves

FIELDS: dict[str, tuple[type, int]] = {
    "points": (np.float32, 2),
    "kind": (np.uint8, 1),
    "offsets": (np.int64, 1),
    "ply": (np.int32, 1),
    "yarn": (np.int32, 1),
    "fiber_radius_mm": (np.float32, 1),
}
"""Type and number of dimensions of each array."""
OPTIONAL_FIELDS: dict[str, tuple[type, int]] = {"color": (np.float32, 2)}
"""The same of what a file may lack."""


def read_curves(path: str | Path) -> FiberCurves:
    """Read a file that weft wrote; anything else is an `InputError` that names the file."""
    path = Path(path)
    try:
        _refuse_too_large(path)
        with np.load(path, allow_pickle=False, max_header_size=10_000) as archive:
            missing = [name for name in FIELDS if name not in archive.files]
            if missing:
                raise InputError(f"holds no curves of fibers: '{missing[0]}' is missing", path=path)
            fields = FIELDS | {n: kind for n, kind in OPTIONAL_FIELDS.items() if n in archive.files}
            arrays = {name: archive[name] for name in fields}
    except InputError:
        raise
    except Exception as error:  # damaged archives make zipfile and numpy raise nearly anything
        raise InputError("is not a readable .npz file; is it damaged?", path=path) from error
    for name, (kind, dimensions) in fields.items():
        if arrays[name].dtype != kind or arrays[name].ndim != dimensions:
            what = f"'{name}' is {arrays[name].dtype} of {arrays[name].ndim} dimensions"
            raise InputError(f"{what}; need {np.dtype(kind)} of {dimensions}", path=path)
    curves = FiberCurves(**arrays)
    _check(curves, path)
    return curves


def _refuse_too_large(path: Path) -> None:
    """Raise before anything is unpacked."""
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    if unpacked > 64 * POINT_LIMIT:
        raise InputError(f"unpacks to {unpacked / 2**30:.3g} GiB; not an export of weft", path=path)


def _check(curves: FiberCurves, path: Path) -> None:
    count = len(curves.offsets) - 1
    points, offsets = curves.points, curves.offsets
    if points.shape != (len(curves.kind), 3):
        raise InputError(f"points have shape {list(points.shape)}; need [{len(curves.kind)}, 3]", path=path)
    if count < 0 or offsets[0] != 0 or offsets[-1] != len(points) or (np.diff(offsets) < 1).any():
        raise InputError(f"offsets must rise from 0 to the number of points, {len(points)}", path=path)
    for name in ("ply", "yarn", "fiber_radius_mm"):
        if len(getattr(curves, name)) != count:
            raise InputError(f"'{name}' has {len(getattr(curves, name))} values; need {count}", path=path)
    if curves.color is not None:
        if curves.color.shape != points.shape:
            raise InputError(
                f"colors have shape {list(curves.color.shape)}; need {list(points.shape)}", path=path
            )
        if not (np.isfinite(curves.color) & (curves.color >= 0)).all():
            raise InputError("a color is not a number of at least 0", path=path)
    if not np.isfinite(points).all():
        curve = int(np.searchsorted(offsets, np.argmin(np.isfinite(points).all(axis=1)), side="right")) - 1
        raise InputError(f"curve {curve} has a point that is not finite", path=path)
    if not (np.isfinite(curves.fiber_radius_mm) & (curves.fiber_radius_mm > 0)).all():
        raise InputError("a fiber radius is not a positive number", path=path)
