"""`weft view`: load a job's results, open the page, and draw what is wanted until one is told to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from weft.fiber_model.scattering.config import ScatteringConfig
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.files.errors import InputError
from weft.pipeline.job import Job
from weft.pipeline.messages import placed_in
from weft.pipeline.picture_volume import load_volume
from weft.pipeline.run import input_files
from weft.pipeline.scattering_file import EVERY_MEDIUM
from weft.pipeline.stages import CHAIN, media_scattering

from .browser import Browser, load_viser
from .desk import Desk
from .easel import Easel, developed

IDLE_SECONDS = 0.25
"""How long a wait for changes lasts, so that signals are heard in between."""


@dataclass(frozen=True)
class Beginning:
    """Where the page is, and how fine its pictures are at first."""

    host: str
    port: int
    pixels: int
    """Along the longer side, at most."""
    samples: int


def view(job: Job, begin: Beginning, *, say: Callable[[str], None]) -> None:
    """Serve the job's cloth until interrupted. Nothing is written. Raises `InputError` as `render` does."""
    load_viser()
    easel = load_easel(job)
    desk = Desk(replace(easel.first_look(), longest_side=begin.pixels, samples=begin.samples))
    width, height = easel.config.resolution
    browser = Browser(desk, easel.lobes, host=begin.host, port=begin.port, job_aspect=width / height)
    say(f"view: {browser.address} (Ctrl-C ends it)")
    try:
        while True:
            draw_and_wait(easel, desk, browser)
    except KeyboardInterrupt:
        say("view: ended")
    finally:
        browser.stop()
        easel.render.release()


def load_easel(job: Job) -> Easel:
    """The job's volume on the device, with the fibers and lights that it says now."""
    for table in ("scattering", "render"):
        if not job.has(table):
            raise InputError(f"'view' needs the table [{table}], which the job lacks", path=job.path)
    stage = CHAIN["render"]
    # the scattering parameters come from the job itself: nothing is written
    volume_alone = replace(stage, name="view", inputs={"volume": stage.inputs["volume"]})
    files = input_files(volume_alone, job, CHAIN)
    with placed_in(job.document):
        volume = load_volume(files["volume"], job.table("render").foreign)
        return Easel(job.table("render"), volume, media_scattering(job, _lobes(job), volume))


def _lobes(job: Job) -> dict[str, FiberScatteringParameters]:
    config = job.table("scattering")
    if not isinstance(config, ScatteringConfig):
        raise InputError(f"'view' shows fibers; [scattering] is of kind {config.kind!r}", path=job.path)
    types = {name: config.parameters_for(name) for name in config.by_type}
    return {EVERY_MEDIUM: config.to_parameters()} | types


def draw_and_wait(easel: Easel, desk: Desk, browser: Browser) -> None:
    """Draw the wanted look; when it is done, wait for another one. Exposure needs no new picture."""
    look, version = desk.take()

    def another() -> bool:
        return desk.look.drawing != look.drawing

    last = None
    for last in easel.draw(look, another):
        browser.tell(last, look.samples)
        browser.show(developed(last.radiance, desk.look.exposure), finished=last.samples == look.samples)
    while not another():
        if desk.wait_past(version, IDLE_SECONDS) and last is not None:
            now, version = desk.take()
            browser.show(developed(last.radiance, now.exposure), finished=True)
