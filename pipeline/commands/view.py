"""`weft view`: look development in the browser."""

from __future__ import annotations

from pathlib import Path

from .app import app
from .options import NO_JOB_OPTIONS, JobOptions


@app.command
def view(
    job: Path,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    pixels: int = 512,
    samples: int = 64,
    options: JobOptions = NO_JOB_OPTIONS,
) -> None:
    """Look at the volume that is there in a browser, and try camera, light and fibers. Writes nothing.

    Parameters
    ----------
    job
        The TOML file of the job.
    host
        Address to listen on. The default is seen from this machine only; whoever reaches the page sees the
        cloth and steers the renderer.
    port
        Port to listen on; where it is taken, the next free one.
    pixels
        At most so many along the longer side of the picture; fewer come faster.
    samples
        Paths per pixel after which a picture is finished.
    """
    from weft.pipeline.config import load
    from weft.pipeline.viewer.view import Beginning
    from weft.pipeline.viewer.view import view as show

    loaded = load(job, options.overrides, options.output)
    begin = Beginning(host, port, max(pixels, 1), max(samples, 1))
    show(loaded, begin, say=lambda text: print(text, flush=True))
