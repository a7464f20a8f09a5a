"""`weft preview FILE…`: a window where there is a display, else a PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from weft.files.errors import InputError
from weft.pipeline.messages import shown

from .open_file import open_scene
from .options import PreviewOptions, parse_size
from .scene import View

MOST_PANELS = 6


def preview(
    files: Sequence[Path],
    options: PreviewOptions,
    *,
    out: Path | None = None,
    size: str | None = None,
    view: View | None = None,
    overrides: Sequence[str] = (),
    output: Path | None = None,
) -> list[str]:
    """Show the files side by side. Returns lines that say what was written, and what of it is not whole."""
    if not 1 <= len(files) <= MOST_PANELS:
        raise InputError(f"{len(files)} files; a preview shows 1 to {MOST_PANELS} side by side")
    pixels = parse_size(size, len(files))
    if out is not None and out.suffix.lower() != ".png":
        raise InputError(f"--out writes .png pictures, not '{out.suffix}'", path=out)
    scenes = [open_scene(file, options, overrides=overrides, output=output) for file in files]
    from . import plotter

    lines = [text for scene in scenes for text in (scene.title, *(f"  {note}" for note in scene.notes))]
    if out is None and plotter.has_display():
        plotter.show_window(scenes, size=pixels, view=view)
        return lines
    path = out or Path(f"{files[0].stem}.preview.png")
    plotter.write_png(scenes, path, size=pixels, view=view)
    return [*lines, f"wrote {shown(path)}" if out else f"no display here, so it wrote {shown(path)}"]
