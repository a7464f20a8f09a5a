"""What can be asked of `weft yarns`: yarns from a file, a weave, a knit, or a periodic tile."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from weft.files.input_file import InputFile, TextFromFile
from weft.files.when_met import ByKind

from .garments.surface_config import SurfaceConfig

Positive = Annotated[float, Field(gt=0, le=1e7, allow_inf_nan=False)]
Size = tuple[Positive, Positive]
Coordinate = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]
Corner = tuple[Coordinate, Coordinate, Coordinate]
TypeName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}$")]
DraftName = Literal[
    "plain",
    "twill_2_1",
    "twill_3_1",
    "twill_2_2",
    "broken_twill_3_1",
    "broken_twill_2_2",
    "herringbone_2_2",
    "satin_5",
    "satin_8",
    "basket_2_2",
]
ChartName = Literal[
    "stockinette",
    "reverse_stockinette",
    "garter",
    "rib_1_1",
    "rib_2_2",
    "seed",
    "cable_4_front",
    "cable_4_back",
]
ChartRow = Annotated[str, Field(min_length=1, max_length=4096)]
BitRow = Annotated[list[Literal[0, 1]], Field(min_length=1, max_length=256)]


def _bits_of_text(rows: Any) -> Any:
    """Rows of 'x' and '.' as rows of 1 and 0; anything else as it is."""
    if not (isinstance(rows, list) and rows and all(isinstance(row, str) for row in rows)):
        return rows
    for row in rows:
        if wrong := row.strip("xX."):
            raise ValueError(f"found '{wrong[0]}' in '{row}'; a draft has 'x' (warp on top) and '.' only")
    return [[int(mark != ".") for mark in row] for row in rows]


DraftRows = Annotated[
    list[BitRow],
    Field(min_length=1, max_length=256),
    BeforeValidator(_bits_of_text, json_schema_input_type=list[str] | list[BitRow]),
]
Frame = Annotated[int, Field(ge=-1_000_000, le=10_000_000)]
FRAME_PATTERN = re.compile(r"%(0?)(\d?)d")
"""Where the number of a frame stands in the name of a file of a sequence, as in `frame_%04d.bcc`."""

NOT_IN_FILE: dict[str, tuple[str, ...]] = {
    ".bcc": ("scale_to_mm", "radius_mm"),
    ".bccx": ("scale_to_mm",),
    ".hair": ("scale_to_mm",),
    ".mitshair": ("scale_to_mm",),
    ".npz": (),
    ".obj": ("scale_to_mm", "radius_mm"),
    ".poly": ("scale_to_mm", "radius_mm"),
    ".usd": (),
    ".usda": (),
    ".usdc": (),
    ".yarns": ("scale_to_mm",),
}
"""What files of each kind never hold, so that the config must give it. A file may lack more."""
USD_SUFFIXES = (".usd", ".usda", ".usdc")


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class FileYarnsConfig(_Config):
    """Yarns from a .bcc, .bccx, .hair, .mitshair, .obj, .poly, .usd or .yarns file, or our own .npz."""

    kind: Literal["file"]
    file: InputFile
    """Path to the file; its suffix tells the format. Of a sequence: `frame_%04d.bcc`, with `frame`."""
    frame: Frame | None = None
    """The frame to read: number of the file where its name holds `%04d`, else time code of a .usd file."""
    rest: InputFile | None = None
    """The same yarns in a frame that all others share, so that fibers turn with their yarn."""
    scale_to_mm: Positive | None = None
    """Length of one unit of the file in mm. Only .npz (in mm) and most .usd files name their unit."""
    radius_mm: Positive | None = None
    """Yarn radius. Needed for .bcc, .obj and .poly, which hold none; replaces the radius of other files."""
    up_axis: Literal["y", "z"] = "y"
    """Axis that points up in a file that does not name it; .bcc, .bccx and most .usd files do."""
    type_name: TypeName = "yarn"
    """Name of the yarn type, and so of the medium it becomes; .npz and weft's .usd files keep their own."""

    @model_validator(mode="before")
    @classmethod
    def _choose_file_of_sequence(cls, table: Any) -> Any:
        if not isinstance(table, dict) or not isinstance(table.get("file"), (str, Path)):
            return table
        text, frame = str(table["file"]), table.get("frame")
        if not FRAME_PATTERN.search(Path(text).name):
            return table
        if frame is None:
            raise ValueError(f"'{Path(text).name}' is the name of a sequence, so 'frame' must be given")
        if not isinstance(frame, int) or isinstance(frame, bool):
            return table
        name = FRAME_PATTERN.sub(lambda found: format(frame, f"{found[1]}{found[2]}d"), Path(text).name)
        chosen = str(Path(text).with_name(name))
        folder = getattr(table["file"], "folder", None)
        return table | {"file": chosen if folder is None else TextFromFile(chosen, folder), "frame": None}

    @model_validator(mode="after")
    def _needs_unit_and_radius(self) -> Self:
        suffix = self.file.suffix.lower()
        if suffix not in NOT_IN_FILE:
            hint = "; for a .pyp tile use kind = 'tile'" if suffix == ".pyp" else ""
            raise ValueError(f"cannot read yarns from '{suffix}' files, only {', '.join(NOT_IN_FILE)}{hint}")
        for key in NOT_IN_FILE[suffix]:
            if getattr(self, key) is None:
                raise ValueError(f"{suffix} files do not hold it, so '{key}' must be given")
        if self.rest is not None and self.rest.suffix.lower() != suffix:
            raise ValueError(f"'rest' must be a {suffix} file as well")
        if self.frame is not None and suffix not in USD_SUFFIXES:
            raise ValueError(f"'frame' needs a place in the name, as in 'frame_%04d{suffix}'")
        if suffix == ".npz" and self.scale_to_mm is not None:
            raise ValueError("an .npz yarn file is in mm; remove 'scale_to_mm'")
        return self


class WeaveConfig(_Config):
    """A woven rectangle in the x, y plane around the origin: warp along y, weft along x, face toward +z."""

    kind: Literal["weave"]
    size_mm: Size
    """Width (along x) and height (along y) of the cloth."""
    draft: DraftName | DraftRows = "plain"
    """A named weave, or rows, top row as seen on the face first: 1 or 'x' where the warp is on top, 0 or '.'
    where the weft is, as in [[1, 0], [0, 1]] or ["x.", ".x"]."""
    warp_per_cm: Positive = 12.0
    """Warp yarns per cm of width."""
    weft_per_cm: Positive = 12.0
    """Weft yarns per cm of height."""
    warp_radius_mm: Positive = 0.22
    """Radius of the warp yarns."""
    weft_radius_mm: Positive = 0.22
    """Radius of the weft yarns."""
    warp_crimp: Annotated[float, Field(ge=0, le=1)] | None = None
    """The warp's share of the crimp; by default the possible share nearest to a half."""
    points_per_crossing: Annotated[int, Field(ge=4, le=64, multiple_of=2)] = 16
    """Control points of a yarn from one crossing to the next. Four take a quarter of the memory of 16."""
    type_names: Annotated[list[TypeName], Field(min_length=1, max_length=2)] = ["yarn"]
    """One yarn type for both systems, or two: warp and weft, which can then differ in fiber and color."""


class KnitConfig(_Config):
    """A rectangle of knit in the x, y plane around the origin, its face toward +z."""

    kind: Literal["knit"]
    size_mm: Size
    """Width (along the courses, x) and height (y), made of whole wales and courses."""
    chart: ChartName | Annotated[list[ChartRow], Field(min_length=1, max_length=1024)] = "stockinette"
    """A named knit, or the rows of a stitch chart, top row as seen on the face first, with k, p and cables
    such as c4f and c4b: ["p2 k4 p2", "p2 c4f p2"]. The chart repeats in both directions."""
    stitch_width_mm: Positive
    """Width of one stitch (a wale), which sets the gauge across the cloth. Other knits: of a stockinette loop
    of as much yarn."""
    wale_spacing_mm: Positive | None = None
    """Distance between wales, which sets the gauge across. Default one stitch width; ribs draw in to less."""
    course_spacing_mm: Positive | None = None
    """Height of one stitch (a course), which sets the gauge along the cloth. Default 0.65 stitch widths;
    0.5 in garter, 0.58 in seed stitch, 0.68 in ribs."""
    radius_mm: Positive | None = None
    """Yarn radius. Default an eighth of the stitch width, at which neighboring strands just touch."""
    type_name: TypeName = "yarn"
    """Name of the yarn type, and so of the medium it becomes."""

    @model_validator(mode="after")
    def _loops_must_fit(self) -> Self:
        radius = self.radius_mm or 0.0
        if radius > self.stitch_width_mm / 6:
            most = f"{self.stitch_width_mm / 6:.3g}"
            raise ValueError(f"'radius_mm' = {radius:g} is too thick for this stitch width; at most {most}")
        course = self.course_spacing_mm
        if course is not None and not 0.4 <= course / self.stitch_width_mm <= 1.5:
            raise ValueError(f"'course_spacing_mm' = {course:g} must be 0.4 to 1.5 times 'stitch_width_mm'")
        wale = self.wale_spacing_mm
        if wale is not None and self.chart == "stockinette":
            raise ValueError("wales of stockinette are 'stitch_width_mm' apart; remove 'wale_spacing_mm'")
        if wale is not None and not 0.5 <= wale / self.stitch_width_mm <= 1.5:
            raise ValueError(f"'wale_spacing_mm' = {wale:g} must be 0.5 to 1.5 times 'stitch_width_mm'")
        return self


class TileConfig(_Config):
    """A periodic yarn tile (.pyp) repeated over a rectangle in the x, y plane around the origin."""

    kind: Literal["tile"]
    tile: InputFile
    """Path to the .pyp file."""
    size_mm: Size
    """Width and height of the cloth. Yarns are cut where they cross its border, and never slit lengthwise."""
    scale_to_mm: Positive = 1000.0
    """Length of one unit of the file in mm, a meter by default. Smaller values shrink yarn and loops."""
    radius_mm: Positive | None = None
    """Yarn radius; by default the scaled radius that the file names."""
    type_name: TypeName = "yarn"
    """Name of the yarn type, and so of the medium it becomes."""


class _Pattern(_Config):
    """Cloth for a garment, whose surface decides the size."""

    @model_validator(mode="after")
    def _size_comes_from_the_surface(self) -> Self:
        if "size_mm" in self.model_fields_set:
            raise ValueError("the surface decides the size of the cloth; remove 'size_mm'")
        return self


class WeavePattern(WeaveConfig, _Pattern):
    """A weave for a garment: warp along v, weft along u."""

    size_mm: Size = (1.0, 1.0)
    """Not to be given: the surface decides it."""


class KnitPattern(KnitConfig, _Pattern):
    """Plain knit for a garment: courses along u."""

    size_mm: Size = (1.0, 1.0)
    """Not to be given: the surface decides it."""


class TilePattern(TileConfig, _Pattern):
    """A periodic yarn tile for a garment: its x along u, its y along v."""

    size_mm: Size = (1.0, 1.0)
    """Not to be given: the surface decides it."""


class GarmentConfig(_Config):
    """A pattern laid on a surface, by its (u, v)."""

    kind: Literal["garment"]
    surface: SurfaceConfig
    """What the cloth lies on."""
    pattern: Annotated[WeavePattern | KnitPattern | TilePattern | FileYarnsConfig, ByKind()]
    """The cloth. Yarns from a file are flat cloth in x, y, laid once in the middle of each chart."""
    offset_mm: Annotated[float, Field(ge=-1e3, le=1e3, allow_inf_nan=False)] = 0.0
    """Distance of the middle of the cloth from the surface, outward."""
    scale: Literal["chart", "mesh"] = "chart"
    """What is scaled to the area of its surface where (u, v) has no unit: each chart, or all alike."""
    grain: Literal["auto", "uv", "up"] = "auto"
    """uv: the cloth's y runs along v. up: every chart is turned upright. auto: up where unwrapped here."""
    join_seams: bool = True
    """Yarns that meet in line at a seam go on as one; otherwise all end there."""
    hem_mm: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] = 0.0
    """Depth of overcast stitches around free borders and over seams where yarns end; 0 leaves them bare."""
    region_mm: tuple[Corner, Corner] | None = None
    """For close-ups: only cloth in and a little beyond this box, [[x0, y0, z0], [x1, y1, z1]], is laid.
    Stripes stay where they are; random numbers go by the yarns that are left, so fibers differ."""

    @model_validator(mode="after")
    def _region_has_volume(self) -> Self:
        region = self.region_mm
        if region is not None and not all(low < high for low, high in zip(*region, strict=True)):
            raise ValueError("the first corner of 'region_mm' must lie below the second on every axis")
        return self


YarnsConfig = Annotated[FileYarnsConfig | WeaveConfig | KnitConfig | TileConfig | GarmentConfig, ByKind()]
"""The [yarns] table of a job; `kind` chooses the source."""
