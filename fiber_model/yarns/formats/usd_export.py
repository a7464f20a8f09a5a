"""Writer for yarns as USD BasisCurves: pinned or periodic Catmull-Rom, which are just our curves.

One prim for each yarn type and kind (open, loops), as renderers want them, in mm, y up. Widths are constant
where the yarns of a prim are equally thick, else uniform. Float32, as the schema asks. Custom attributes
`weft:yarnType`, `weft:yarn` (place in the set) and `primvars:weft:twist` let `read_usd` restore the set.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .usd_curves import refuse_without_usd

SUFFIXES = (".usd", ".usda", ".usdc")


def write_usd(yarns: YarnSet, path: str | Path) -> None:
    """Write all yarns: .usda as text, .usd and .usdc binary."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"a USD file ends in {', '.join(SUFFIXES)}", path=path)
    refuse_without_usd(path)
    from pxr import Sdf, Usd, UsdGeom

    layer = Sdf.Layer.CreateAnonymous(path.suffix)
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageMetersPerUnit(stage, 0.001)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/yarns").GetPrim())
    for index, name in enumerate(yarns.type_names):
        for closed in (False, True):
            chosen = np.flatnonzero((yarns.yarn_type == index) & (yarns.closed == closed))
            if len(chosen):
                _write_prim(stage, yarns, chosen, name, closed)
    with atomic_write(path) as temporary:
        if not layer.Export(str(temporary)):
            raise InputError("USD could not write this file", path=path)


def _write_prim(stage: Any, yarns: YarnSet, chosen: np.ndarray, name: str, closed: bool) -> None:
    """One BasisCurves prim of the chosen yarns."""
    from pxr import Sdf, UsdGeom, Vt

    curves = UsdGeom.BasisCurves.Define(stage, f"/yarns/{name}_{'loops' if closed else 'open'}")
    index = np.concatenate([np.arange(yarns.offsets[yarn], yarns.offsets[yarn + 1]) for yarn in chosen])
    points = np.ascontiguousarray(yarns.points[index], np.float32)
    widths = 2 * yarns.radius[chosen].astype(np.float32)
    constant = bool((widths == widths[0]).all())
    curves.CreateTypeAttr("cubic")
    curves.CreateBasisAttr("catmullRom")
    curves.CreateWrapAttr("periodic" if closed else "pinned")
    curves.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(yarns.point_counts[chosen].astype(np.int32)))
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    curves.CreateWidthsAttr(Vt.FloatArray.FromNumpy(widths[:1] if constant else widths))
    curves.SetWidthsInterpolation("constant" if constant else "uniform")
    curves.CreateExtentAttr(UsdGeom.BasisCurves.ComputeExtent(curves.GetPointsAttr().Get(), widths))
    prim, types = curves.GetPrim(), Sdf.ValueTypeNames
    prim.CreateAttribute("weft:yarnType", types.String).Set(name)
    prim.CreateAttribute("weft:yarn", types.IntArray).Set(Vt.IntArray.FromNumpy(chosen.astype(np.int32)))
    primvars = UsdGeom.PrimvarsAPI(prim)
    if yarns.twist is not None:
        twist = primvars.CreatePrimvar("weft:twist", types.DoubleArray, "vertex")
        twist.Set(Vt.DoubleArray.FromNumpy(np.ascontiguousarray(yarns.twist[index])))
    if yarns.surface_uv is not None:
        uv = np.ascontiguousarray(yarns.surface_uv[index], np.float32)
        primvars.CreatePrimvar("st", types.TexCoord2fArray, "vertex").Set(Vt.Vec2fArray.FromNumpy(uv))
