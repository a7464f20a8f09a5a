"""Lights that stand somewhere: point, spot, quad and disk, as rows for shaders/light/local.glsl."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weft.files.errors import InputError

from .config import Light
from .light_config import DiskLight, PointLight, QuadLight, SpotLight
from .mesh import DISK, PARALLELOGRAM, Triangles

LOCAL_ROWS = 4
KINDS = {"point": 0, "spot": 1, "quad": 2, "disk": 3}
SMALLEST_COSINE = 0.1
"""Lights that face away from the middle of the scene are still chosen this often, in proportion."""


@dataclass(frozen=True)
class LocalLight:
    """One light; lengths in mm, arrays float64, shape [3]."""

    kind: str
    center: np.ndarray
    value: np.ndarray
    """Radiance, or of a point or spot irradiance at 1 mm."""
    normal: np.ndarray
    """Unit vector to where it shines."""
    half_x: np.ndarray
    """From the middle to the edges; zero for points and spots."""
    half_y: np.ndarray
    angles: tuple[float, float] = (0.0, 0.0)
    """Beam and cutoff of a spot [rad]."""

    @property
    def area(self) -> float:
        """[mm²]; 0 for points and spots."""
        square = 4 * float(np.linalg.norm(self.half_x) * np.linalg.norm(self.half_y))
        return square * math.pi / 4 if self.kind == "disk" else square


def local_lights(lights: Sequence[Light], middle_mm: np.ndarray) -> list[LocalLight]:
    """Those of `lights` that stand somewhere; they face `middle_mm` unless they have a target."""
    return [
        _placed(light, middle_mm)
        for light in lights
        if isinstance(light, PointLight | SpotLight | QuadLight | DiskLight)
    ]


def _placed(light: PointLight | SpotLight | QuadLight | DiskLight, middle_mm: np.ndarray) -> LocalLight:
    center = np.array(light.position_mm, np.float64)
    nothing = np.zeros(3)
    if isinstance(light, PointLight):
        return LocalLight("point", center, np.array(light.intensity), nothing, nothing, nothing)
    target = middle_mm if light.target_mm is None else np.array(light.target_mm)
    length = np.linalg.norm(target - center)
    if not length > 0:
        raise InputError(
            f"render.lights: a {light.kind} light stands at its target.", hint="Move position_mm."
        )
    normal = (target - center) / length
    if isinstance(light, SpotLight):
        angles = math.radians(light.beam_deg), math.radians(light.cutoff_deg)
        return LocalLight("spot", center, np.array(light.intensity), normal, nothing, nothing, angles)
    up = np.array(light.up if isinstance(light, QuadLight) else (0.0, 1.0, 0.0))
    if np.linalg.norm(np.cross(up, normal)) < 1e-3 * np.linalg.norm(up) or not up.any():
        up = np.eye(3)[np.argmin(np.abs(normal))]
    x = np.cross(up, normal)
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    if isinstance(light, QuadLight):
        x, y = x * light.width_mm / 2, y * light.height_mm / 2
    else:
        x, y = x * light.radius_mm, y * light.radius_mm
    return LocalLight(light.kind, center, np.array(light.radiance), normal, x, y)


def fluence_at(light: LocalLight, middle_mm: np.ndarray, radius_mm: float) -> np.ndarray:
    """About how much of it reaches the scene, RGB; only how often it is chosen depends on it."""
    toward = middle_mm - light.center
    distance = float(np.linalg.norm(toward))
    near = max(distance, radius_mm, 1e-6) ** 2
    if light.kind in ("point", "spot"):
        return light.value / near
    cosine = max(float(toward @ light.normal) / max(distance, 1e-9), SMALLEST_COSINE)
    return light.value * min(light.area * cosine / near, 2 * math.pi)


def light_rows(lights: Sequence[LocalLight], corner_mm: np.ndarray, voxel_size_mm: float) -> np.ndarray:
    """(middle, kind), (half x, beam), (half y, cutoff), (normal, 0) of each, in voxels; float32, [n, 4]."""
    rows = np.zeros((len(lights), LOCAL_ROWS, 4), np.float32)
    for row, light in zip(rows, lights, strict=True):
        row[0, :3] = (light.center - corner_mm) / voxel_size_mm
        row[1, :3], row[2, :3] = light.half_x / voxel_size_mm, light.half_y / voxel_size_mm
        row[3, :3] = light.normal
        row[:3, 3] = KINDS[light.kind], *light.angles
    return rows.reshape(-1, 4)


def light_values(lights: Sequence[LocalLight], voxel_size_mm: float) -> np.ndarray:
    """Radiance, or irradiance at a distance of one voxel; float64, shape [n, 3]."""
    points = [light.kind in ("point", "spot") for light in lights]
    values = np.array([light.value for light in lights]).reshape(-1, 3)
    return np.where(np.array(points, bool).reshape(-1, 1), values / voxel_size_mm**2, values)


def light_shapes(lights: Sequence[LocalLight], first_material: int) -> Triangles:
    """What of them a ray can meet: the shape of each quad and disk, with a material of its own."""
    areas = [(index, light) for index, light in enumerate(lights) if light.area > 0]
    corners = np.array(
        [
            [light.center + x * light.half_x + y * light.half_y for x, y in ((-1, -1), (1, -1), (-1, 1))]
            for _, light in areas
        ]
    ).reshape(-1, 3, 3)
    normals = np.array([[light.normal] * 3 for _, light in areas]).reshape(-1, 3, 3)
    material = np.array([first_material + index for index, _ in areas], int)
    shape = np.array([DISK if light.kind == "disk" else PARALLELOGRAM for _, light in areas], int)
    return Triangles(corners, normals, np.zeros((len(areas), 3, 2)), material, shape)
