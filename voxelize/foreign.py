"""Volumes that other programs wrote as .vdb: a density and a vector grid under any of their usual names.

Such files say nothing of fibers: the radius comes from the caller, and so does the unit, which .vdb has no
place for. They are read in the same child process, with its limits, as every .vdb file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.errors import InputError

from .config import ForeignVolumeConfig
from .grid import BRICK_SIZE, BRICK_VOXELS, COORDINATE_LIMIT, FiberGrid, FiberVolume, empty_values
from .vdb import read_grids

MEDIUM = "fiber"
FLOAT, VECTOR = "Tree_float_5_4_3", "Tree_vec3s_5_4_3"
DENSITY_NAMES = ("density", "Density", "fiber_density", "smoke", "fog")
DIRECTION_NAMES = (
    "fiber_dir",
    "fiber_direction",
    "direction",
    "dir",
    "tangentu",
    "tangent",
    "orientation",
    "orient",
    "vel",
    "velocity",
    "v",
    "N",
)
"""Houdini's rasterized curves carry `tangentu`, or whatever attribute stood for it; Blender's, `velocity`."""
LEVEL_SET = "level set"


def describe_grids(grids: Sequence[dict[str, Any]]) -> str:
    """Names and types, for messages."""
    short = {FLOAT: "float", VECTOR: "vec3s"}
    named = [f"{grid['name'] or '(no name)'} ({short.get(grid['type'], grid['type'])})" for grid in grids]
    return ", ".join(named) if named else "none"


def read_foreign(path: str | Path, config: ForeignVolumeConfig) -> FiberVolume:
    """The fiber volume in a .vdb file of another program; `InputError` for what it lacks."""
    path = Path(path)
    grids = read_grids(path)
    density = _choose(grids, FLOAT, config.density, DENSITY_NAMES, "density", path)
    direction = _choose(grids, VECTOR, config.direction, DIRECTION_NAMES, "direction", path)
    if density["metadata"].get("class") == LEVEL_SET:
        what = f"grid '{density['name']}' is a level set, a distance to a surface; a fog volume is needed"
        raise InputError(what, path=path, hint="Convert it there, as with Houdini's 'Convert VDB'.")
    size, start = _lattice(density, path)
    other_size, other_start = _lattice(direction, path)
    if not (np.isclose(size, other_size, rtol=1e-6) and np.allclose(start, other_start, atol=1e-3 * size)):
        raise InputError(
            f"grids '{density['name']}' and '{direction['name']}' have different transforms", path=path
        )
    rows, voxels, amounts = _filled(density, config, path)
    axes, missing = _axes(direction, density["leaves"]["origins"][rows], voxels, path)
    h = size * config.scale_to_mm
    # our voxels are cornered at multiples of their size, and theirs centered wherever the transform says
    place = start / size - 0.5
    shift = np.rint(place).astype(np.int64)
    local = np.stack(np.unravel_index(voxels, (BRICK_SIZE,) * 3), axis=1)
    coordinates = density["leaves"]["origins"][rows].astype(np.int64) + local + shift
    if np.abs(coordinates).max() >= COORDINATE_LIMIT - BRICK_SIZE:
        raise InputError("lies more than 2^30 voxels from the origin", path=path)
    grid = _to_grid(coordinates, amounts, axes, h, config.fiber_radius_mm)
    moved = ((shift - place) * h).tolist()
    about: dict[str, str | int | float] = {
        "density_grid": density["name"],
        "direction_grid": direction["name"],
        "voxels_without_direction": missing,
        "moved_to_lattice_mm": " ".join(f"{value:.3g}" for value in moved),
    }
    return FiberVolume({MEDIUM: grid}, about=about)


def _choose(
    grids: Sequence[dict[str, Any]],
    kind: str,
    asked: str | None,
    usual: Sequence[str],
    key: str,
    path: Path,
) -> dict[str, Any]:
    """The grid of that name; or of a usual name; or the only one of its type."""
    of_kind = {grid["name"]: grid for grid in grids if grid["type"] == kind}
    what = "float" if kind == FLOAT else "vec3s"
    if asked is not None:
        if asked not in of_kind:
            raise InputError(
                f"has no {what} grid '{asked}' ({key}); its grids: {describe_grids(grids)}", path=path
            )
        return of_kind[asked]
    for name in usual:
        if name in of_kind:
            return of_kind[name]
    if len(of_kind) != 1:
        found = f"several {what} grids" if of_kind else f"no {what} grid"
        hint = f"Name it as '{key}' in [render.foreign]." if of_kind else ""
        raise InputError(
            f"has {found} that might be the {key}; its grids: {describe_grids(grids)}", path=path, hint=hint
        )
    return next(iter(of_kind.values()))


def _lattice(grid: dict[str, Any], path: Path) -> tuple[float, np.ndarray]:
    """Voxel size, and the center of voxel (0, 0, 0), in the file's unit."""
    matrix = np.array(grid["index_to_world"], dtype=np.float64)
    if matrix.shape == (16,) and np.isfinite(matrix).all():
        matrix = matrix.reshape(4, 4)
        size = float(matrix[0, 0])
        if size > 0 and np.allclose(matrix[:3, :3], size * np.eye(3), rtol=0, atol=1e-6 * size):
            return size, matrix[3, :3]
    raise InputError(
        f"grid '{grid['name']}' has voxels that are turned, mirrored or not cubes", path=path,
        hint="Resample it there to cubes along the axes.",
    )  # fmt: skip


def _filled(
    density: dict[str, Any], config: ForeignVolumeConfig, path: Path
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, voxel and volume fraction of what is active and not zero."""
    leaves = density["leaves"]
    active = np.unpackbits(leaves["masks"].view(np.uint8), axis=1, bitorder="little").astype(bool)
    values = leaves["values"]
    if not np.isfinite(values[active]).all() or (values[active] < 0).any():
        raise InputError(f"grid '{density['name']}' holds negative or not finite values", path=path)
    rows, voxels = np.nonzero(active & (values > 0))
    if not len(rows):
        raise InputError(f"grid '{density['name']}' is empty", path=path)
    return rows, voxels, values[rows, voxels] * np.float32(config.density_scale)


def _axes(
    direction: dict[str, Any], origins: np.ndarray, voxels: np.ndarray, path: Path
) -> tuple[np.ndarray, int]:
    """Unit axes at these voxels, in the hemisphere z > 0, and how many voxels had none.

    Those take the main axis of all.
    """
    leaves = direction["leaves"]
    there = {tuple(origin): row for row, origin in enumerate(leaves["origins"].tolist())}
    unique, inverse = np.unique(origins, axis=0, return_inverse=True)
    rows = np.array([there.get(tuple(origin), -1) for origin in unique.tolist()])[inverse.reshape(-1)]
    axes = np.zeros((len(voxels), 3))
    axes[rows >= 0] = leaves["values"][rows[rows >= 0], voxels[rows >= 0]]
    if not np.isfinite(axes).all():
        raise InputError(f"grid '{direction['name']}' holds values that are not finite", path=path)
    length = np.linalg.norm(axes, axis=1)
    held = length > 1e-12
    if not held.any():
        raise InputError(f"grid '{direction['name']}' is zero wherever there is density", path=path)
    axes[held] /= length[held, None]
    axes[~held] = np.linalg.eigh(axes[held].T @ axes[held])[1][:, 2]
    last = np.where(axes[:, 2] != 0, axes[:, 2], np.where(axes[:, 1] != 0, axes[:, 1], axes[:, 0]))
    return np.where(last[:, None] < 0, -axes, axes).astype(np.float32), int((~held).sum())


def _to_grid(
    coordinates: np.ndarray, amounts: np.ndarray, axes: np.ndarray, size: float, radius: float
) -> FiberGrid:
    origins, brick = np.unique(coordinates // BRICK_SIZE * BRICK_SIZE, axis=0, return_inverse=True)
    row = brick.reshape(-1)
    voxel = (coordinates % BRICK_SIZE) @ np.array([64, 8, 1])
    density, direction = empty_values(len(origins), "density"), empty_values(len(origins), "direction")
    assert density.shape[1] == BRICK_VOXELS
    density[row, voxel] = amounts
    direction[row, voxel] = axes
    return FiberGrid(size, radius, origins.astype(np.int32), density, direction)
