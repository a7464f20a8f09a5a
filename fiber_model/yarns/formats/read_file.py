"""Yarns from a file of any kind that is known: its suffix, or its first bytes, choose the reader."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from weft.fiber_model.yarns.config import USD_SUFFIXES, FileYarnsConfig
from weft.fiber_model.yarns.yarn_file import load_yarns
from weft.fiber_model.yarns.yarns import YarnSet

from .bcc import read_bcc, read_bccx
from .cyhair import read_cyhair
from .mitsuba_hair import read_mitsuba_hair
from .obj_lines import read_obj_lines
from .poly import read_poly
from .raw_file import begins_with
from .smobj_yarns import read_smobj_yarns
from .usd_curves import read_usd

READERS: dict[str, Any] = {
    ".mitshair": read_mitsuba_hair,
    ".obj": read_obj_lines,
    ".poly": read_poly,
    ".yarns": read_smobj_yarns,
}
"""Readers of files that name no unit and no up axis."""


def read_yarns(config: FileYarnsConfig) -> YarnSet:
    """The yarns of the file, with what the config adds to it or puts in place of it."""
    path, suffix = config.file, config.file.suffix.lower()
    if suffix == ".npz":
        yarns = load_yarns(path)
        if config.radius_mm is None:
            return yarns
        return replace(yarns, radius=np.full(yarns.yarn_count, config.radius_mm))
    options: dict[str, Any] = {
        "scale_to_mm": config.scale_to_mm,
        "radius_mm": config.radius_mm,
        "type_name": config.type_name,
    }
    if suffix in (".bcc", ".bccx"):
        return (read_bcc if suffix == ".bcc" else read_bccx)(path, **options)
    options["up_axis"] = {"y": 1, "z": 2}[config.up_axis]
    if suffix in USD_SUFFIXES:
        return read_usd(path, **options, frame=config.frame)
    return hair_reader(path)(path, **options) if suffix == ".hair" else READERS[suffix](path, **options)


def hair_reader(path: Path) -> Any:
    """The reader of a .hair file, which cyHair and Mitsuba both call theirs."""
    return read_cyhair if begins_with(path, b"HAIR") else read_mitsuba_hair
