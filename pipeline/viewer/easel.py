"""The picture of a look: what changed since the last one goes to the device, and the picture is refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.renderer.camera import rotation
from weft.renderer.config import RenderConfig
from weft.renderer.image import srgb
from weft.renderer.progressive import ProgressiveRender, Refinement
from weft.renderer.turned_lights import turned_lights
from weft.voxelize.grid import FiberVolume

from .look import Look, edited_lobes, eye_of, frame_of


class Easel:
    """Holds the scene on the device. All calls from one thread."""

    def __init__(
        self, config: RenderConfig, volume: FiberVolume, lobes: Mapping[str, FiberScatteringParameters]
    ) -> None:
        self.config, self.lobes = config, lobes
        self.render = ProgressiveRender(config, volume, lobes)
        self.lens = self.render.scene.camera
        self.middle = np.asarray(volume.bounds_mm).mean(axis=0)
        self.lights = turned_lights(config.lights, config.lights_turn_deg, self.middle)
        self.shown: Look | None = None

    def first_look(self) -> Look:
        """The job's own."""
        camera = self.config.camera
        turn = rotation("xyz".index(camera.orbit_axis), math.radians(camera.orbit_deg))
        target = self.middle
        if camera.target_mm is not None:
            target = target + turn @ (np.array(camera.target_mm) - target)
        return Look(eye_of(self.lens, target), self.config.resolution, exposure=self.config.exposure)

    def draw(self, look: Look, stop: Callable[[], bool]) -> Iterator[Refinement]:
        """Better and better pictures of a look, until it has its samples or `stop()`."""
        before, self.shown = self.shown, look
        if before is None or before.edits != look.edits:
            self.render.scatter(edited_lobes(self.lobes, look.edits))
        if before is None or _light(before) != _light(look):
            self._light(look)
        self.render.look(frame_of(look, self.lens), look.resolution)
        return self.render.refine(look.samples, stop)

    def _light(self, look: Look) -> None:
        axes = frame_of(look, self.lens).axes if look.lights_follow else self.lens.axes
        lights = turned_lights(self.lights, look.light_turn_deg, self.middle)
        self.render.light(lights, axes @ rotation(1, math.radians(look.light_turn_deg)).T)


def _light(look: Look) -> object:
    return look.light_turn_deg, look.eye if look.lights_follow else None


def developed(radiance: np.ndarray, exposure: float) -> np.ndarray:
    """8-bit sRGB of linear radiance, brightened by `exposure` stops, shape [height, width, 3]."""
    return np.rint(srgb(radiance * 2.0**exposure) * 255).astype(np.uint8)
