"""Lights that stand somewhere: points, spots, quads, disks, meshes, as rows for shaders/light/local.glsl."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from weft.files.errors import InputError

from .config import Light
from .light_config import DiskLight, MeshLight, PointLight, QuadLight, SoftboxLight, SpotLight
from .mesh import DISK, PARALLELOGRAM, TRIANGLE, Triangles, load_mesh, placed

LOCAL_ROWS = 4
KINDS = {"point": 0, "spot": 1, "quad": 2, "disk": 3, "triangle": 4}
SHAPES = {"quad": PARALLELOGRAM, "disk": DISK, "triangle": TRIANGLE}
MAX_TRIANGLES = 65_536
"""Of a mesh light: each is a light of its own in the alias table."""
SMALLEST_COSINE = 0.1
"""Lights that face away from the middle of the scene are still chosen this often, in proportion."""


@dataclass(frozen=True)
class LocalLight:
    """One light; lengths in mm, arrays float64, shape [3]."""

    kind: str
    center: np.ndarray
    """Its middle; of a triangle the first corner."""
    value: np.ndarray
    """Radiance, or of a point or spot irradiance at 1 mm."""
    normal: np.ndarray
    """Unit vector to where it shines."""
    half_x: np.ndarray
    """From the middle to the edges, or the edges of a triangle; zero for points and spots."""
    half_y: np.ndarray
    angles: tuple[float, float] = (0.0, 0.0)
    """Beam and cutoff of a spot [rad]."""

    @property
    def area(self) -> float:
        """[mm²]; 0 for points and spots."""
        square = float(np.linalg.norm(np.cross(self.half_x, self.half_y)))
        return square * {"quad": 4.0, "disk": math.pi, "triangle": 0.5}.get(self.kind, 0.0)

    @property
    def shape(self) -> np.ndarray:
        """Corner and its two neighbors, shape [3, 3]."""
        x, y = self.half_x, self.half_y
        if self.kind == "triangle":
            return np.stack([self.center, self.center + x, self.center + y])
        return np.stack([self.center - x - y, self.center + x - y, self.center - x + y])


@dataclass(frozen=True)
class Stage:
    """What lights are placed by: the volume and the view."""

    middle_mm: np.ndarray
    diagonal_mm: float = 1.0
    camera_axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    """Rows right, up, toward the camera."""


def local_lights(lights: Sequence[Light], stage: Stage) -> list[LocalLight]:
    """Those of `lights` that stand somewhere; they face the volume's middle unless they have a target."""
    found: list[LocalLight] = []
    for light in lights:
        if isinstance(light, MeshLight):
            found += mesh_light(light)
        elif isinstance(light, SoftboxLight):
            found.append(_placed(softbox_quad(light, stage), stage.middle_mm))
        elif isinstance(light, PointLight | SpotLight | QuadLight | DiskLight):
            found.append(_placed(light, stage.middle_mm))
    return found


def mesh_light(light: MeshLight) -> list[LocalLight]:
    """A light for each triangle. Raises `InputError` for a mesh that cannot shine."""
    mesh = placed(load_mesh(light.file), light.placement, light.unit_mm)
    if len(mesh) > MAX_TRIANGLES:
        what = f"{len(mesh):,} triangles; a mesh light may have {MAX_TRIANGLES:,}."
        raise InputError(what, path=light.file, hint="Simplify the mesh: a light needs no detail.")
    value = np.array(light.radiance)
    edges = mesh.corners[:, 1:] - mesh.corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return [
        LocalLight("triangle", corner, value, normal, x, y)
        for corner, normal, (x, y) in zip(mesh.corners[:, 0], normals, edges, strict=True)
    ]


def softbox_quad(light: SoftboxLight, stage: Stage) -> QuadLight:
    """The quad that a softbox is. Its radiance gives the irradiance in the middle (Howell, catalog C-3)."""
    distance = light.distance_mm or 2 * stage.diagonal_mm
    width, height = light.width_mm or distance / 2, light.height_mm or distance / 2
    azimuth, elevation = math.radians(light.azimuth_deg), math.radians(light.elevation_deg)
    flat = math.cos(elevation)
    toward = np.array([flat * math.sin(azimuth), math.sin(elevation), flat * math.cos(azimuth)])
    x, y = width / 2 / distance, height / 2 / distance
    a, b = math.hypot(1, x), math.hypot(1, y)
    per_radiance = 2 * (x / a * math.atan(y / a) + y / b * math.atan(x / b))
    position = stage.middle_mm + distance * toward @ stage.camera_axes
    red, green, blue = (value / per_radiance for value in light.irradiance)
    return QuadLight(
        position_mm=tuple(position.tolist()),
        target_mm=tuple(stage.middle_mm.tolist()),
        up=tuple(stage.camera_axes[1].tolist()),
        width_mm=width,
        height_mm=height,
        radiance=(red, green, blue),
    )


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
    """What of them a ray can meet: the shape of each area light, with a material of its own."""
    areas = [(index, light) for index, light in enumerate(lights) if light.area > 0]
    corners = np.array([light.shape for _, light in areas]).reshape(-1, 3, 3)
    normals = np.array([[light.normal] * 3 for _, light in areas]).reshape(-1, 3, 3)
    material = np.array([first_material + index for index, _ in areas], int)
    shape = np.array([SHAPES[light.kind] for _, light in areas], int)
    return Triangles(corners, normals, np.zeros((len(areas), 3, 2)), material, shape)
