"""`weft doctor`: what this machine offers, what is missing, and what to install.

Each library is tried in a process of its own, since a broken driver may end the process that loads it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .progress import duration
from .run_record import library_versions, machine

PROBE_SECONDS = 120
OPENEXR_FLOOR = (3, 4, 14)
"""Earlier versions have known holes (15 CVEs were mended in 3.4.14)."""
LOW_DISK_GIB = 2.0

GL_PACKAGES = "apt install libegl1 libgl1 libgl1-mesa-dri, or a GPU driver with EGL"
OPENVDB_PACKAGES = (
    "apt install g++ libopenvdb-dev libboost-dev libtbb-dev libimath-dev, then install weft again; "
    'until then use voxelize.formats = ["nvdb"]'
)
LIBRARIES = ("numpy", "scipy", "pydantic", "cyclopts", "rich", "moderngl", "pillow", "trimesh", "pyvista")
EXTRAS = {
    "xatlas": "weft[garments]",
    "usd-core": "weft[usd]",
    "viser": "weft[view]",
    "distributed": "distributed",
}
"""Packages that only some work needs, and what installs them: meshes without (u, v), USD files, `weft view`,
and rendering on several machines."""

PROBE = "import sys; from weft.pipeline.doctor import print_probe; print_probe(sys.argv[1])"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    name: str
    good: bool
    found: str
    cure: str = ""
    """What to do where it is not good."""
    needed: bool = True
    """Whether rendering needs it."""


def examine(*, as_json: bool = False) -> int:
    """Print what was found. Returns 0, or 2 where something that rendering needs is missing."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        probed = list(pool.map(_probe_apart, PROBES))
    findings = [*system_findings(), *probed, *library_findings()]
    if as_json:
        print(json.dumps({finding.name: asdict(finding) for finding in findings}, indent=2))
    else:
        for finding in findings:
            print("\n".join(_lines(finding)))
    return 0 if all(finding.good or not finding.needed for finding in findings) else 2


def _lines(finding: Finding) -> list[str]:
    mark = "ok" if finding.good else ("MISSING" if finding.needed else "missing")
    first, *others = finding.found.splitlines() or [""]
    lines = [f"{mark:<8}{finding.name:<11}{first}", *(f"{'':19}{line}" for line in others)]
    return lines if finding.good else [*lines, f"{'':19}-> {finding.cure}"]


def system_findings() -> list[Finding]:
    here = machine()
    free = shutil.disk_usage(os.getcwd()).free / 2**30
    return [
        Finding("weft", True, f"{library_versions(['weft'])['weft']} on Python {sys.version.split()[0]}"),
        Finding("machine", True, f"{here['processor']}, {here['cores']} cores, {here['memory_gib']} GiB"),
        Finding("memory", True, f"{_available_memory_gib():.1f} GiB available"),
        Finding("disk", free > LOW_DISK_GIB, f"{free:.1f} GiB free here", "free some disk space", False),
    ]


def _available_memory_gib() -> float:
    found = re.search(r"MemAvailable:\s+(\d+) kB", Path("/proc/meminfo").read_text())
    return int(found[1]) / 2**20 if found else float("nan")


def library_findings() -> list[Finding]:
    """Installed versions of what needs no trying."""
    versions = library_versions(LIBRARIES)
    missing = [name for name, version in versions.items() if version == "not installed"]
    found = ", ".join(f"{name} {version}" for name, version in versions.items())
    libraries = Finding("libraries", not missing, found, f"pip install {' '.join(missing)}")
    return [libraries, *(_extra_finding(name, cure) for name, cure in EXTRAS.items())]


def _extra_finding(name: str, extra: str) -> Finding:
    version = library_versions([name])[name]
    good = version != "not installed"
    cure = f"pip install '{extra}', or pip install {name}" if extra != name else f"pip install {name}"
    return Finding(name, good, version, cure, needed=False)


def _probe_apart(name: str) -> Finding:
    """The finding of one probe, run in its own process."""
    needed, cure = NEEDED[name], CURES[name]
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROBE, name],
            capture_output=True,
            text=True,
            timeout=PROBE_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Finding(name, False, f"no answer within {duration(PROBE_SECONDS)}", cure, needed)
    answers = [line for line in done.stdout.splitlines() if line.startswith('{"probe"')]
    if not answers:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return Finding(name, False, f"ended with code {done.returncode}: {last}", cure, needed)
    answer = json.loads(answers[-1])
    return Finding(name, answer["good"], answer["found"], answer["cure"] or cure, needed)


def print_probe(name: str) -> None:
    """In the probe's process: try one library and print the answer as one line."""
    try:
        good, found, cure = PROBES[name]()
    except Exception as error:  # whatever is wrong with a library, the doctor reports it
        good, found, cure = False, f"{type(error).__name__}: {error}", ""
    print(json.dumps({"probe": name, "good": good, "found": found, "cure": cure}))


def _probe_gl() -> tuple[bool, str, str]:
    from weft.renderer.gpu.context import device_name, shared_context

    context = shared_context()
    limits: dict[str, Any] = context.info
    shown = {
        "shader storage block": _mebibytes(limits.get("GL_MAX_SHADER_STORAGE_BLOCK_SIZE")),
        "storage blocks": limits.get("GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"),
        "3D texture": limits.get("GL_MAX_3D_TEXTURE_SIZE"),
        "work group": limits.get("GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS"),
    }
    lines = ", ".join(f"{name} {value}" for name, value in shown.items() if value not in (None, 0))
    return True, f"{device_name(context)}\n{lines}".strip(), ""


def _mebibytes(count: int | None) -> str | None:
    return f"{count / 2**20:.0f} MiB" if count else None


def _probe_warp() -> tuple[bool, str, str]:
    import warp

    from .warp_start import start_warp

    start_warp()
    return True, f"{warp.__version__} on {', '.join(str(device) for device in warp.get_devices())}", ""


def _probe_jax() -> tuple[bool, str, str]:
    import jax

    return True, f"{jax.__version__} on {', '.join(str(device) for device in jax.devices())}", ""


def _probe_openvdb() -> tuple[bool, str, str]:
    from weft.voxelize.openvdb_library import library_version

    version = library_version()
    return version is not None, version or "was not there when weft was installed", ""


def _probe_openexr() -> tuple[bool, str, str]:
    import OpenEXR

    version = str(OpenEXR.__version__)
    numbers = tuple(int(number) for number in re.findall(r"\d+", version)[:3])
    good = numbers >= OPENEXR_FLOOR
    floor = ".".join(map(str, OPENEXR_FLOOR))
    return good, version if good else f"{version}, which has known holes; need {floor} or newer", ""


PROBES: dict[str, Callable[[], tuple[bool, str, str]]] = {
    "opengl": _probe_gl,
    "warp": _probe_warp,
    "openvdb": _probe_openvdb,
    "openexr": _probe_openexr,
    "jax": _probe_jax,
}
NEEDED = {"opengl": True, "warp": True, "openvdb": False, "openexr": True, "jax": False}
CURES = {
    "opengl": GL_PACKAGES,
    "warp": "pip install warp-lang",
    "openvdb": OPENVDB_PACKAGES,
    "openexr": 'pip install "OpenEXR>=3.4.14"',
    "jax": "pip install jax (only fitting needs it)",
}
