"""What one can change while looking: camera, size, exposure, light, fibers. Plain values, no browser."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.renderer.camera import CameraFrame
from weft.renderer.distortion import reaches

Edits = Mapping[str, Mapping[str, Any]]
"""Changed scattering parameters: by medium, by the name of the field."""


@dataclass(frozen=True)
class Eye:
    """Where one looks from."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    """Roughly."""
    vertical_fov: float
    """[rad]"""

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(np.subtract(self.target, self.position)))


@dataclass(frozen=True)
class Look:
    """All that decides what is seen of the cloth."""

    eye: Eye
    size: tuple[int, int]
    """Of the canvas [pixels]."""
    longest_side: int = 512
    """At most so many pixels are rendered along it."""
    samples: int = 64
    exposure: float = 0.0
    """Stops."""
    light_turn_deg: float = 0.0
    lights_follow: bool = False
    """Whether all lights turn with the camera, as those of a studio do in a job."""
    edits: Edits = field(default_factory=dict)

    @property
    def resolution(self) -> tuple[int, int]:
        """The canvas, made smaller to `longest_side`."""
        factor = min(1.0, self.longest_side / max(self.size))
        return max(round(self.size[0] * factor), 1), max(round(self.size[1] * factor), 1)

    @property
    def drawing(self) -> Look:
        """Without what changes the shown picture alone."""
        return replace(self, exposure=0.0)

    def edited(self, medium: str, **values: Any) -> Look:
        """With other scattering parameters of a medium."""
        before = self.edits.get(medium, {})
        return replace(self, edits={**self.edits, medium: {**before, **values}})


def eye_of(frame: CameraFrame, target: np.ndarray) -> Eye:
    """The eye of a job's camera. Parallel rays become those of a long lens that frames the same."""
    up = frame.up / np.linalg.norm(frame.up)
    if frame.perspective:
        half = math.atan(float(np.linalg.norm(frame.up)))
        return Eye(_three(frame.position), _three(target), _three(up), 2 * half)
    half = math.radians(5.0)
    away = float(np.linalg.norm(frame.up)) / math.tan(half)
    return Eye(_three(target - frame.forward * away), _three(target), _three(up), 2 * half)


def frame_of(look: Look, lens: CameraFrame) -> CameraFrame:
    """The camera of a look; aperture as that of `lens`, focused on the target."""
    eye = look.eye
    forward = np.subtract(eye.target, eye.position) / eye.distance
    right = np.cross(forward, eye.up)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    slope = math.tan(eye.vertical_fov / 2)
    width, height = look.resolution
    frame = CameraFrame(True, np.array(eye.position), forward, right * slope * width / height, up * slope)
    return replace(
        frame,
        distortion=lens.distortion
        if reaches(*lens.distortion, math.hypot(slope * width / height, slope))
        else (0.0, 0.0),
        aperture_radius=lens.aperture_radius,
        aperture_blades=lens.aperture_blades,
        aperture_rotation=lens.aperture_rotation,
        focus_distance=eye.distance,
    )


def edited_lobes(
    lobes: Mapping[str, FiberScatteringParameters], edits: Edits
) -> dict[str, FiberScatteringParameters]:
    """The parameters of each medium with what was changed."""
    return {name: replace(one, **edits.get(name, {})) for name, one in lobes.items()}


def as_toml(look: Look, *, job_aspect: float, every_medium: bool) -> str:
    """The tables of a job that would look like this; `job_aspect`: width / height of its picture.

    `every_medium`: the cloth is of one medium, so that its parameters go into [scattering] itself.
    """
    eye = look.eye
    across = 2 * math.degrees(math.atan(math.tan(eye.vertical_fov / 2) * job_aspect))
    lines = ["[render]", f"exposure = {look.exposure:g}", "", "[render.camera]", 'kind = "perspective"']
    lines += [f"position_mm = {_shown(eye.position)}", f"target_mm = {_shown(eye.target)}"]
    lines += [f"up = {_shown(eye.up)}", f"fov_deg = {across:.6g}"]
    for medium, values in look.edits.items():
        lines += ["", "[scattering]" if every_medium else f"[scattering.by_type.{medium}]"]
        lines += [_toml_line(name, value) for name, value in values.items()]
    if look.light_turn_deg:
        lines += [
            "",
            f"# the lights are turned by {look.light_turn_deg:g} degrees, counterclockwise from above",
        ]
    return "\n".join(lines) + "\n"


def _toml_line(name: str, value: Any) -> str:
    if "_width_" in name:
        return f"{name}_deg = {math.degrees(value):.6g}"
    return f"{name} = {_shown(value) if isinstance(value, tuple) else format(value, '.6g')}"


def _shown(vector: tuple[float, ...]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in vector) + "]"


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z
