"""The chain: yarns -> (fibers) -> voxelize -> render, with scattering beside it. Each imports what it needs.

Fibers are a function of the yarns, so no stage stores them: `voxelize` makes them inside, `fibers` exports a
chosen part. Results are handed on as files, so that a picture shows what is on the disk, whoever made it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from weft.files.errors import InputError

from .camera_voxels import camera_settings, sized_by_camera
from .fit_stage import FIT
from .job import Job
from .messages import JobErrors, Problem, did_you_mean, shown
from .picture_volume import begin_picture_volume, level_hashes
from .pictures_of import jobs_of_pictures, picture_files
from .scattering_kinds import Scattering, by_medium, described
from .stage import Progress, Stage, StageInput, StageWork
from .stop_requests import StopRequests
from .warp_start import start_warp

if TYPE_CHECKING:
    from pathlib import Path

    from weft.fiber_model.fibers import FiberSet
    from weft.fiber_model.yarns.yarns import YarnSet
    from weft.renderer.scene import AnyVolume

OneKind = TypeVar("OneKind", bound=Scattering)
CHECKPOINT_SUFFIX = ".checkpoint.exr"
"""After the name of the picture."""
FIBERS_SHARE = 0.1
"""Part of the progress of `voxelize` and `fibers` that goes to laying out the fibers."""


def make_yarns(work: StageWork) -> dict[str, Any]:
    from weft.fiber_model.yarns.build import run
    from weft.fiber_model.yarns.catmull_rom import yarn_lengths
    from weft.fiber_model.yarns.yarn_file import save_yarns

    yarns = run(work.job.table("yarns"), progress=work.progress)
    save_yarns(yarns, work.outputs["yarns"])
    low, high = yarns.bounds
    length = float(yarn_lengths(yarns).sum())
    size = " x ".join(f"{extent:.4g}" for extent in high - low)
    return {
        "summary": f"{_count(yarns.yarn_count, 'yarn')}, {length / 1000:.3g} m, {size} mm{_stretch(yarns)}",
        "yarn_count": yarns.yarn_count,
        "point_count": yarns.point_count,
        "length_mm": length,
        "bounds_mm": [low.tolist(), high.tolist()],
        "types": list(yarns.type_names),
        **({"garment": _plain(yarns.report)} if yarns.report else {}),
    }


def _stretch(yarns: YarnSet) -> str:
    """What a garment's summary says besides."""
    report = yarns.report
    if report is None:
        return ""
    low, high = report.stretch_middle
    return f", stretched {low:.3g} to {high:.3g} times" + "".join(f"; {text}" for text in report.warnings)


def export_fibers(work: StageWork) -> dict[str, Any]:
    from weft.fiber_model.fiber_curves import FiberSelection, export_curves, write_curves

    from .config import ExportTable

    fibers = fiber_set(work)
    table = work.job.table("export") if work.job.has("export") else ExportTable()
    selection = FiberSelection(table.yarns, table.arc_length_mm, table.box_mm)
    curves = export_curves(fibers, selection)
    if not curves.curve_count:
        raise InputError(
            "[export]: no fiber lies in this part.", hint="Widen yarns, arc_length_mm or box_mm."
        )
    write_curves(curves, work.outputs["fibers"])
    return {
        "summary": f"{_count(curves.curve_count, 'curve')}, {_count(len(curves.points), 'point')}",
        "curve_count": curves.curve_count,
        "point_count": len(curves.points),
        "fibers": _plain(fibers.report),
    }


def make_volume(work: StageWork) -> dict[str, Any]:
    from weft.voxelize.stream import voxelize_to_files
    from weft.voxelize.tile_sums import DEVICE

    refuse_unwritable_formats(work.job)
    fibers = fiber_set(work)
    volume = voxelize_to_files(
        sized_by_camera(work.job, fibers),
        fibers,
        volume_paths(work.outputs),
        progress=_part(work.progress, FIBERS_SHARE, 1.0),
    )
    report = volume.report
    return {
        "summary": f"{_count(volume.brick_count, 'brick')}, {report.generated_length_mm / 1000:.4g} m of "
        f"fiber, held by the grid to {abs(report.relative_difference):.0e}"
        + "".join(
            f"; level {level.level}: {level.voxel_size_mm:g} mm, "
            f"extinction off by {level.extinction_error_rms:.2g}"
            for level in volume.levels
        ),
        **_plain(report),
        "device": DEVICE,
        "length_relative_difference": report.relative_difference,
        "content_sha256": volume.content_sha256,
        "media": list(volume.media),
        "bounds_mm": volume.bounds_mm.tolist(),
        "levels": [_plain(level) for level in volume.levels],
        "fibers": _plain(fibers.report),
    }


def volume_paths(outputs: Mapping[str, Path]) -> list[Path]:
    """The files of the volume itself."""
    return [path for name, path in outputs.items() if " level " not in name and name != "picture"]


def plan_volume(job: Job) -> list[str]:
    """What `voxelize` would make, in a few lines, from the yarns that are there."""
    from weft.voxelize.outlook import foresee

    from .run import input_files

    refuse_unwritable_formats(job)
    work = StageWork(job, input_files(CHAIN["voxelize"], job, CHAIN), {}, lambda fraction, detail: None)
    fibers = fiber_set(work)
    return foresee(sized_by_camera(job, fibers), fibers).lines()


def make_scattering(work: StageWork) -> dict[str, Any]:
    from .scattering_file import write_scattering

    config = work.job.table("scattering")
    write_scattering(work.outputs["parameters"], scattering_by_medium(work.job))
    return {"summary": described(config)}


def scattering_by_medium(job: Job) -> dict[str, Scattering]:
    """What [scattering] says of each medium it names, and of all others."""
    from .scattering_file import EVERY_MEDIUM

    config = job.table("scattering")
    refuse_unknown_types(job, [name for name in config.by_type if name == EVERY_MEDIUM], ())
    return by_medium(config, EVERY_MEDIUM)


def make_image(work: StageWork) -> dict[str, Any]:
    begun = begin_picture_volume(work.job, work.inputs["volume"])  # while modules are read
    from weft.renderer.exposure import Keeping
    from weft.renderer.render import described_detail, run, save

    from .pictures_of import unfinished_picture
    from .scattering_file import read_scattering

    scattering, volume = read_scattering(work.inputs["scattering"]), begun()
    lobes = media_scattering(work.job, scattering, volume)
    checkpoint, stopping = work.outputs["image"].with_suffix(CHECKPOINT_SUFFIX), StopRequests()
    keeping = Keeping(checkpoint, work.job.config.output.checkpoint_s, work.resume)
    table = work.job.table("render")
    with unfinished_picture(work.outputs["image"], table.exposure) as watch:
        result = run(
            table, volume, lobes, progress=work.progress, watch=watch, keeping=keeping, stopping=stopping
        )
    if result.complete or result.layers["samples"].any():
        save(result, work.outputs["image"])
    if not result.complete:
        stopping.obey(f"weft: stopped; what is done is in {shown(checkpoint)}, and --resume goes on from it")
    statistics = result.statistics
    _, _, width, height = result.config.window
    return {
        "summary": f"{width} x {height}, {statistics.samples_per_pixel} samples per pixel, "
        f"{statistics.paths / max(statistics.seconds, 1e-9) / 1e6:.3g} M paths/s on {statistics.device}"
        + (f"; for want of memory {statistics.made_smaller}" if statistics.made_smaller else "")
        + "".join(f"; {part}" for part in described_detail(statistics)),
        **_plain(statistics),
    }


def fiber_set(work: StageWork) -> FiberSet:
    """The fibers of the yarns in the input file."""
    from weft.fiber_model.fibers import run
    from weft.fiber_model.yarns.yarn_file import load_yarns

    start_warp()
    return run(
        work.job.table("fibers"),
        load_yarns(work.inputs["yarns"]),
        progress=_part(work.progress, 0.0, FIBERS_SHARE),
    )


def media_scattering(job: Job, parameters: dict[str, OneKind], volume: AnyVolume) -> dict[str, OneKind]:
    """The scattering of each medium of the volume. Refuses entries that no medium has."""
    from weft.voxelize.grid_files import base_medium

    from .scattering_file import EVERY_MEDIUM

    refuse_unknown_types(job, [name for name in parameters if name != EVERY_MEDIUM], volume.media)
    # of a coarser level the second lobe scatters as its medium
    types = {name: base_medium(name, volume.media) for name in volume.media}
    return {name: parameters.get(types[name], parameters[EVERY_MEDIUM]) for name in volume.media}


def refuse_unwritable_formats(job: Job) -> None:
    """Before the work rather than after it: a .vdb file needs OpenVDB."""
    from weft.voxelize.openvdb_library import extension

    if "vdb" in job.table("voxelize").formats:
        extension()


def refuse_unknown_types(job: Job, names: Sequence[str], types: Sequence[str]) -> None:
    """Raises `JobErrors` for [scattering.by_type] tables of yarn types that there are not."""
    problems = []
    for name in names:
        if name not in types:
            key = ("scattering", "by_type", name)
            what = f"there is no yarn type of this name{did_you_mean(name, types)}"
            problems.append(Problem(job.document.origin(key), key, what))
    if problems:
        raise JobErrors(problems)


def targets(job: Job) -> list[str]:
    """The stages whose results `weft run` makes: those the job has a table for."""
    names = [name for name in CHAIN if job.has(OWN_TABLE.get(name, name))]
    if not names:
        raise InputError("asks for nothing: it has no table of a stage.", path=job.path)
    return names


def _volume_files(job: Job) -> dict[str, str]:
    formats = job.table("voxelize").formats
    if not formats:
        origin = job.document.origin(("voxelize", "formats"))
        raise JobErrors([Problem(origin, ("voxelize", "formats"), 'must name "vdb", "nvdb" or both')])
    names = {name: "volume" if i == 0 else f"volume as {name}" for i, name in enumerate(formats)}
    levels = range(1, job.table("voxelize").levels + 1)
    return (
        {names[name]: f"volume.{name}" for name in formats}
        | {
            f"{names[name]} level {level}": f"volume_level{level}.{name}"
            for name in formats
            for level in levels
        }
        | ({"picture": "volume.png"} if job.table("voxelize").picture else {})
    )


def _fiber_files(job: Job) -> dict[str, str]:
    return {"fibers": f"fibers.{job.table('export').format if job.has('export') else 'npz'}"}


def _part(progress: Progress, start: float, end: float) -> Progress:
    """Progress of a part of the work, from `start` to `end` of the whole."""

    def report(fraction: float, detail: str = "") -> None:
        progress(start + (end - start) * fraction, detail)

    return report


def _plain(report: Any) -> dict[str, Any]:
    return asdict(report) if is_dataclass(report) and not isinstance(report, type) else {}


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'s' * (number != 1)}"


FIBER_CODE = ("fiber_model",)
LOBE_CODE = (
    "fiber_model/scattering/phase.py",
    "fiber_model/scattering/symmetric.py",
    "fiber_model/scattering/tail.py",
    "fiber_model/scattering/azimuthal.py",
    "fiber_model/scattering/azimuthal_table.py",
    "fiber_model/scattering/longitudinal.py",
    "fiber_model/scattering/parameters.py",
)
GRID_CODE = tuple(
    f"voxelize/{name}.py"
    for name in (
        "foreign",
        "grid",
        "grid_files",
        "memory",
        "nanovdb",
        "native_tiles",
        "openvdb_library",
        "parts",
        "report",
        "stored",
        "tile_sums",
        "tiles",
        "vdb",
        "vdb_child",
        "vdb_reader",
        "vdb_stream",
    )
)
SCATTERING_CODE = (
    "fiber_model/scattering/azimuthal_table.py",
    "fiber_model/scattering/config.py",
    "fiber_model/scattering/parameters.py",
    "renderer/media_config.py",
    "renderer/simple_phases.py",
)

CHAIN: dict[str, Stage] = {
    stage.name: stage
    for stage in (
        FIT,
        Stage(
            name="yarns",
            tables=("yarns",),
            inputs={},
            outputs=lambda job: {"yarns": "yarns.npz"},
            work=make_yarns,
            code=("fiber_model/yarns",),
            libraries=("numpy", "scipy", "trimesh", "xatlas", "usd-core"),
        ),
        Stage(
            name="fibers",
            tables=("fibers",),
            optional_tables=("export",),
            inputs={"yarns": StageInput("yarns", "yarns")},
            outputs=_fiber_files,
            work=export_fibers,
            code=FIBER_CODE,
            libraries=("numpy", "warp-lang"),
        ),
        Stage(
            name="voxelize",
            tables=("voxelize", "fibers"),
            inputs={"yarns": StageInput("yarns", "yarns")},
            outputs=_volume_files,
            work=make_volume,
            code=(*FIBER_CODE, "voxelize"),
            other_settings=camera_settings,
            libraries=("numpy", "warp-lang"),
        ),
        Stage(
            name="scattering",
            tables=("scattering",),
            inputs={},
            outputs=lambda job: {"parameters": "scattering.json"},
            work=make_scattering,
            code=SCATTERING_CODE,
            made_when_needed=True,
        ),
        Stage(
            name="render",
            tables=("render",),
            inputs={
                "volume": StageInput("voxelize", "volume", lambda job: job.table("render").volume),
                "scattering": StageInput("scattering", "parameters"),
            },
            outputs=picture_files,
            parts=jobs_of_pictures,
            work=make_image,
            other_settings=level_hashes,
            code=("renderer", *LOBE_CODE, *GRID_CODE),
            libraries=("numpy", "moderngl", "OpenEXR", "pillow"),
        ),
    )
}
OWN_TABLE = {"fibers": "export"}
"""`weft run` exports fibers only where the job has an [export] table; [fibers] alone describes them."""
