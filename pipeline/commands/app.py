"""The app that commands are added to."""

from __future__ import annotations

from importlib import metadata

from cyclopts import App

app = App(
    name="weft",
    help="Pictures of cloth from yarn curves: yarns, fibers, a sparse volume, scattering, path tracing.",
    version=lambda: metadata.version("weft"),
    suppress_keyboard_interrupt=False,
)
