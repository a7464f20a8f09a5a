"""The compiled OpenVDB extension, where it was built; the only module that imports it."""

from __future__ import annotations

from importlib.util import find_spec
from types import ModuleType

from weft.files.errors import InputError

PACKAGES = "g++ libopenvdb-dev libboost-dev libtbb-dev libimath-dev"


def extension() -> ModuleType:
    """The compiled module; `InputError` naming the packages where it was not built."""
    try:
        from . import _openvdb  # type: ignore[attr-defined]
    except ImportError as error:
        raise InputError(
            ".vdb needs OpenVDB, which was not there when weft was installed;",
            hint=f"run 'apt-get install {PACKAGES}' and install weft again, "
            'or write .nvdb with voxelize.formats = ["nvdb"].',
        ) from error
    return _openvdb


def refuse_missing_openvdb() -> None:
    """The same error, without loading 10 MB of library where it is another process that will read."""
    if find_spec(f"{__package__}._openvdb") is None:
        extension()


def library_version() -> str | None:
    """Version of libopenvdb, or None where the extension was not built."""
    try:
        return str(extension().version)
    except InputError:
        return None
