"""What `weft inspect` says of yarns, curves of fibers and meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from weft.files.errors import InputError

from .facts import Facts, bounds, value_range
from .measurement_files import measurement_facts

MAX_TEXT_BYTES = 2**30


def arrays_facts(path: Path) -> Facts:
    """Yarns, curves of fibers, or measurements."""
    try:
        with np.load(path, allow_pickle=False, max_header_size=10_000) as archive:
            names = set(archive.files)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"is not a readable .npz file: {error}", path=path) from error
    except Exception as error:  # damaged archives make zipfile raise nearly anything
        raise InputError("is not a readable .npz file; is it damaged?", path=path) from error
    if "theta_i" in names:
        return measurement_facts(path)
    return _yarns(path) if "closed" in names else _fiber_curves(path)


def _yarns(path: Path) -> Facts:
    from weft.fiber_model.yarns.yarn_file import load_yarns

    return _yarn_facts(load_yarns(path))


def _yarn_facts(yarns: Any) -> Facts:
    from weft.fiber_model.yarns.catmull_rom import yarn_lengths

    types = {name: int((yarns.yarn_type == index).sum()) for index, name in enumerate(yarns.type_names)}
    return {
        "content": "yarns",
        "yarns": yarns.yarn_count,
        "closed yarns": int(yarns.closed.sum()),
        "points": yarns.point_count,
        "points per yarn": value_range(yarns.point_counts.astype(float)),
        "length [mm]": float(yarn_lengths(yarns).sum()),
        "radius [mm]": value_range(yarns.radius),
        "types": types,
        "twist": yarns.twist is not None,
        "surface uv": yarns.surface_uv is not None,
        **bounds(yarns.points),
    }


def _fiber_curves(path: Path) -> Facts:
    try:
        with np.load(path, allow_pickle=False, max_header_size=10_000) as archive:
            points, offsets, kind = archive["points"], archive["offsets"], archive["kind"]
    except Exception as error:  # damaged archives make zipfile and numpy raise nearly anything
        raise InputError("holds neither yarns nor curves of fibers", path=path) from error
    return {
        "content": "fiber curves",
        "curves": len(offsets) - 1,
        "points": len(points),
        "points in loops": int((kind == 1).sum()),
        "points in hairs": int((kind == 2).sum()),
        **bounds(points),
    }


def bcc_facts(path: Path) -> Facts:
    """In the file's own unit, which it does not name; it holds no radius either."""
    from weft.fiber_model.yarns.formats.bcc import read_bcc

    return _in_file_units(read_bcc(path, scale_to_mm=1.0, radius_mm=1.0), has_radius=False)


def _in_file_units(yarns: Any, *, has_radius: bool = True) -> Facts:
    facts = _yarn_facts(yarns)
    if not has_radius:
        del facts["radius [mm]"]
    return {name.replace("[mm]", "[file units]"): value for name, value in facts.items()}


def bccx_facts(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.bcc import read_bccx

    return _in_file_units(read_bccx(path, scale_to_mm=1.0))


def poly_facts(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.poly import read_poly

    return _in_file_units(read_poly(path, scale_to_mm=1.0, radius_mm=1.0), has_radius=False)


def smobj_yarns_facts(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.smobj_yarns import read_smobj_yarns

    return _in_file_units(read_smobj_yarns(path, scale_to_mm=1.0))


def hair_facts(path: Path) -> Facts:
    """Without the radius where the file has none, or not one for each strand."""
    from weft.fiber_model.yarns.formats.read_file import hair_reader

    read = hair_reader(path)
    try:
        return _in_file_units(read(path, scale_to_mm=1.0))
    except InputError:  # a damaged file is refused once more
        return _in_file_units(read(path, scale_to_mm=1.0, radius_mm=1.0), has_radius=False)


def usd_facts(path: Path) -> Facts:
    """The curves at the first frame; without the radius where the file has not one for each curve."""
    from weft.fiber_model.yarns.formats.usd_curves import summarize_usd

    has_radius = True
    try:
        summary = summarize_usd(path)
    except InputError:  # a damaged file is refused once more
        summary, has_radius = summarize_usd(path, radius_mm=1.0), False
    facts = _in_file_units(summary.yarns, has_radius=has_radius)
    if summary.unit_mm is not None:
        facts = {name.replace("[file units]", "[mm]"): value for name, value in facts.items()}
    return facts | {
        "unit [mm]": summary.unit_mm or "not named",
        "up axis": summary.up_axis or "not named",
        "frames": summary.frames or "none",
    }


def pyp_facts(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.pyp import read_pyp

    tile = read_pyp(path)
    lengths = np.linalg.norm(tile.edge_vectors(), axis=1)
    return {
        "content": "periodic yarn tile",
        "vertices": len(tile.points),
        "period [mm]": tile.period.tolist(),
        "radius [mm]": tile.radius,
        "yarn length in a tile [mm]": float(lengths.sum()),
        "twist": tile.twist is not None,
        **bounds(tile.points),
    }


def obj_facts(path: Path) -> Facts:
    """Counts by kind of line, and the box around the vertices, in the unit of the file."""
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise InputError("is larger than 1 GiB", path=path)
    counts = dict.fromkeys(("v", "l", "f", "g"), 0)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            words = line.split()
            if not words or words[0] not in counts:
                continue
            counts[words[0]] += 1
            if words[0] == "v":
                point = _vertex(words, path, number)
                low, high = np.minimum(low, point), np.maximum(high, point)
    facts = {"content": "OBJ", "vertices": counts["v"], "polylines": counts["l"], "faces": counts["f"]}
    return facts | ({"from": low.tolist(), "to": high.tolist()} if counts["v"] else {})


def _vertex(words: list[str], path: Path, line: int) -> np.ndarray:
    try:
        point = np.array([float(word) for word in words[1:4]])
    except ValueError:
        point = np.empty(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(
            f"'{' '.join(words)}' is not a vertex with three finite coordinates", path=path, place=line
        )
    return point
