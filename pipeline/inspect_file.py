"""`weft inspect FILE`: what is in a file, in a few lines, whoever wrote it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from weft.files.errors import InputError

from .cache import stamp_of
from .inspect_measurements import measurement_facts
from .messages import did_you_mean
from .run_record import parse_record, read_record

if TYPE_CHECKING:
    from weft.voxelize.grid import FiberGrid

Facts = dict[str, Any]
"""What is said of a file, by name."""

MAX_TEXT_BYTES = 2**30


def describe(path: Path, *, verify: bool = False, as_json: bool = False) -> list[str]:
    """Lines for people, or one JSON object. Raises `InputError` for what cannot be read or has changed."""
    try:
        there = path.is_file()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from error
    if not there:
        raise InputError("is a folder; give a file" if path.is_dir() else "no such file", path=path)
    reader = READERS.get(_kind(path))
    if reader is None:
        what = f"weft cannot look into '{path.suffix}' files"
        raise InputError(what + did_you_mean(path.suffix, READERS), path=path)
    facts = {"file": str(path), "bytes": path.stat().st_size, **reader(path)}
    facts |= _against_record(path, verify=verify)
    if verify:
        facts |= _verified(path, facts)
    return [json.dumps(facts, default=str)] if as_json else _lines(facts)


def _kind(path: Path) -> str:
    return ".run.json" if path.name.endswith(".run.json") else path.suffix.lower()


def _lines(facts: Mapping[str, Any], indent: str = "") -> list[str]:
    width = max((len(name) for name in facts), default=0) + 2
    lines = []
    for name, value in facts.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{name}", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{name:<{width}}{_text(value)}")
    return lines


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(item) for item in value)
    return str(value)


def _against_record(path: Path, *, verify: bool) -> Facts:
    """What the run record beside a result says of it."""
    for file in sorted(path.parent.glob("*.run.json")):
        record = read_record(file)
        stamps = record.outputs.values() if record else ()
        stamp = next((stamp for stamp in stamps if stamp.path == path.name), None)
        if record and stamp:
            facts = {
                "made by": f"{record.written_by}, stage {record.stage}, {record.started}",
                "record": file.name,
            }
            if verify and stamp_of(path).sha256 != stamp.sha256:
                raise InputError(f"differs from what {file.name} says was written", path=path)
            return facts | ({"verified": f"content is as {file.name} says"} if verify else {})
    return {}


def _verified(path: Path, facts: Facts) -> Facts:
    """A check by the hash that the file itself carries, or the record beside it."""
    if "content hash" in facts:
        if path.suffix == ".vdb":
            from weft.voxelize.vdb import refuse_changed_file

            refuse_changed_file(path)
        return {"verified": "content agrees with the hash in the file"}
    if "verified" not in facts and "outputs" not in facts:
        raise InputError("carries no hash and has no run record beside it to verify against", path=path)
    return {}


def _range(values: np.ndarray) -> list[float]:
    finite = values[np.isfinite(values)]
    return [float(finite.min()), float(finite.max())] if finite.size else []


def _bounds(points: np.ndarray) -> Facts:
    if not len(points):
        return {}
    return {"from [mm]": points.min(axis=0).tolist(), "to [mm]": points.max(axis=0).tolist()}


def _npz(path: Path) -> Facts:
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
        "points per yarn": _range(yarns.point_counts.astype(float)),
        "length [mm]": float(yarn_lengths(yarns).sum()),
        "radius [mm]": _range(yarns.radius),
        "types": types,
        "twist": yarns.twist is not None,
        "surface uv": yarns.surface_uv is not None,
        **_bounds(yarns.points),
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
        **_bounds(points),
    }


def _bcc(path: Path) -> Facts:
    """In the file's own unit, which it does not name; it holds no radius either."""
    from weft.fiber_model.yarns.formats.bcc import read_bcc

    return _in_file_units(read_bcc(path, scale_to_mm=1.0, radius_mm=1.0), has_radius=False)


def _in_file_units(yarns: Any, *, has_radius: bool = True) -> Facts:
    facts = _yarn_facts(yarns)
    if not has_radius:
        del facts["radius [mm]"]
    return {name.replace("[mm]", "[file units]"): value for name, value in facts.items()}


def _bccx(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.bcc import read_bccx

    return _in_file_units(read_bccx(path, scale_to_mm=1.0))


def _poly(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.poly import read_poly

    return _in_file_units(read_poly(path, scale_to_mm=1.0, radius_mm=1.0), has_radius=False)


def _smobj_yarns(path: Path) -> Facts:
    from weft.fiber_model.yarns.formats.smobj_yarns import read_smobj_yarns

    return _in_file_units(read_smobj_yarns(path, scale_to_mm=1.0))


def _hair(path: Path) -> Facts:
    """Without the radius where the file has none, or not one for each strand."""
    from weft.fiber_model.yarns.formats.read_file import hair_reader

    read = hair_reader(path)
    try:
        return _in_file_units(read(path, scale_to_mm=1.0))
    except InputError:  # a damaged file is refused once more
        return _in_file_units(read(path, scale_to_mm=1.0, radius_mm=1.0), has_radius=False)


def _usd(path: Path) -> Facts:
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


def _pyp(path: Path) -> Facts:
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
        **_bounds(tile.points),
    }


def _obj(path: Path) -> Facts:
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


def _volume(path: Path) -> Facts:
    from .stages import load_volume

    if path.suffix.lower() == ".vdb":
        from weft.voxelize.vdb import is_from_weft, read_summaries

        summaries = read_summaries(path)
        if not is_from_weft(summaries):
            return _foreign_facts(summaries)
    volume = load_volume(path)
    media = {
        name: {
            "bricks": grid.brick_count,
            "voxels": grid.voxel_count,
            "volume fraction": _range(grid.density),
            "fiber radius [mm]": grid.fiber_radius_mm,
            "fiber length [mm]": grid.fiber_length_mm,
            **_mean_color(grid),
        }
        for name, grid in volume.grids.items()
    }
    return {
        "content": "fiber volume",
        "voxel size [mm]": volume.voxel_size_mm,
        **_bounds(volume.bounds_mm),
        "media": media,
        **{name.replace("_", " "): value for name, value in volume.about.items()},
        # reading refuses files whose content and hash disagree
        "content hash": volume.content_sha256,
    }


def _mean_color(grid: FiberGrid) -> Facts:
    if grid.albedo is None:
        return {}
    weight = grid.density.astype(np.float64)
    return {"mean color": (np.einsum("bv,bvc->c", weight, grid.albedo) / max(weight.sum(), 1e-300)).tolist()}


def _foreign_facts(summaries: list[dict[str, Any]]) -> Facts:
    """Of a .vdb file of another program, in the unit of the file."""
    grids = {}
    for index, grid in enumerate(summaries):
        matrix = np.array(grid["index_to_world"]).reshape(-1, 4)
        sizes = np.linalg.norm(matrix[:3, :3], axis=1).tolist() if len(matrix) == 4 else []
        grids[grid["name"] or f"(grid {index})"] = {
            "type": grid["type"],
            "class": grid["metadata"].get("class", "unknown"),
            "voxel size [file units]": sizes[0] if sizes and np.ptp(sizes) < 1e-6 * sizes[0] else sizes,
            **{
                name: grid["metadata"][name]
                for name in ("creator", "file_voxel_count")
                if name in grid["metadata"]
            },
        }
    return {
        "content": "volume of another program",
        "grids": grids,
        "to render it": "[render.foreign] with fiber_radius_mm; density, direction where names are unusual",
    }


def _exr(path: Path) -> Facts:
    from weft.renderer.image import read_exr

    channels, attributes = read_exr(path)
    shape = next(iter(channels.values())).shape if channels else (0, 0)
    simple = {name: value for name, value in attributes.items() if isinstance(value, (str, int, float))}
    return {
        "content": "image",
        "size": f"{shape[1]} x {shape[0]}",
        "channels": {name: _range(np.asarray(data, dtype=np.float64)) for name, data in channels.items()},
        "not finite": int(sum((~np.isfinite(data)).sum() for data in channels.values())),
        "attributes": simple,
    }


def _png(path: Path) -> Facts:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path, formats=["PNG"]) as image:
            image.verify()
            return {"content": "image", "size": f"{image.width} x {image.height}", "mode": image.mode}
    except (OSError, SyntaxError, ValueError, UnidentifiedImageError) as error:
        raise InputError(f"is not a readable PNG file: {error}", path=path) from error


def _job(path: Path) -> Facts:
    from .cache import flattened
    from .config import load

    job = load(path)
    names = [name for name in type(job.config).model_fields if job.has(name) and name != "include"]
    resolved = {name: flattened(getattr(job.config, name), ()) for name in names}
    return {
        "content": "job",
        "results in": str(job.output),
        **{name: keys for name, keys in resolved.items() if keys},
    }


def _record(path: Path) -> Facts:
    record = parse_record(path)
    facts = {
        "content": "run record",
        "stage": record.stage,
        "made by": record.written_by,
        "started": record.started,
        "seconds": record.seconds,
        "command": " ".join(record.command),
        "report": record.report,
        "seeds": record.seeds,
        "versions": record.versions,
        "machine": record.machine,
        "inputs": {name: f"{stamp.path} {stamp.sha256[:12]}" for name, stamp in record.inputs.items()},
    }
    return facts | {"outputs": {stamp.path: _state(path.parent, stamp) for stamp in record.outputs.values()}}


def _state(folder: Path, stamp: Any) -> str:
    file = folder / stamp.path
    if not file.is_file():
        return "is gone"
    return "unchanged" if stamp_of(file).sha256 == stamp.sha256 else "was changed since"


def _scattering(path: Path) -> Facts:
    from dataclasses import asdict

    from .scattering_file import read_scattering

    return {
        "content": "scattering parameters",
        **{name: asdict(p) for name, p in read_scattering(path).items()},
    }


READERS: dict[str, Callable[[Path], Facts]] = {
    ".npz": _npz,
    ".bcc": _bcc,
    ".bccx": _bccx,
    ".hair": _hair,
    ".mitshair": _hair,
    ".poly": _poly,
    ".yarns": _smobj_yarns,
    ".usd": _usd,
    ".usda": _usd,
    ".usdc": _usd,
    ".pyp": _pyp,
    ".obj": _obj,
    ".vdb": _volume,
    ".nvdb": _volume,
    ".csv": measurement_facts,
    ".alta": measurement_facts,
    ".bsdf": measurement_facts,
    ".binary": measurement_facts,
    ".bin": measurement_facts,
    ".exr": _exr,
    ".png": _png,
    ".toml": _job,
    ".run.json": _record,
    ".json": _scattering,
}
