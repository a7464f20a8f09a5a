"""Placing the camera: framing the volume, and the vectors the kernel makes rays from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from weft.files.errors import InputError

from .config import OrthographicCamera, PerspectiveCamera
from .distortion import refuse_folds


@dataclass(frozen=True)
class CameraFrame:
    """Position [mm] and axes, each float64, shape [3].

    `right` and `up` reach from the middle of the picture to its edges: in mm for an orthographic camera, at
    distance 1 for a perspective one.
    """

    perspective: bool
    position: np.ndarray
    forward: np.ndarray
    right: np.ndarray
    up: np.ndarray
    aperture_radius: float = 0.0
    """[mm]; 0: a pinhole."""
    aperture_blades: int = 0
    """Corners of the aperture; 0: a circle."""
    aperture_rotation: float = 0.0
    """Of a polygon [rad]."""
    focus_distance: float = 1.0
    """Along the view [mm]."""
    distortion: tuple[float, float] = (0.0, 0.0)
    """k1 and k2 of the lens (distortion.py)."""

    @property
    def axes(self) -> np.ndarray:
        """Rows: unit vectors to the right, up, and toward the camera."""
        unit = [v / np.linalg.norm(v) for v in (self.right, self.up, -self.forward)]
        return np.array(unit)


def place_camera(
    camera: PerspectiveCamera | OrthographicCamera, bounds_mm: np.ndarray, resolution: tuple[int, int]
) -> CameraFrame:
    """The camera around a volume with corners `bounds_mm`, shape [2, 3]."""
    frame = _framed(camera, bounds_mm, resolution)
    turn = rotation("xyz".index(camera.orbit_axis), math.radians(camera.orbit_deg))
    middle = bounds_mm.mean(axis=0)
    return replace(
        frame,
        position=middle + turn @ (frame.position - middle),
        forward=turn @ frame.forward,
        right=turn @ frame.right,
        up=turn @ frame.up,
    )


def nearest_pixel_mm(frame: CameraFrame, boxes_mm: np.ndarray, resolution: tuple[int, int]) -> float:
    """Width of a pixel at the nearest point in view of boxes [n, 2, 3]; the lens's distortion aside.

    Raises `InputError` where nothing is in view, or the camera stands among the boxes.
    """
    width = 2 * float(np.linalg.norm(frame.right)) / resolution[0]
    if not frame.perspective:
        return width
    half = np.diff(boxes_mm, axis=1)[:, 0] / 2
    middle = boxes_mm.mean(axis=1) - frame.position
    depth, radius = middle @ frame.forward, np.linalg.norm(half, axis=1)
    seen = depth + radius > 0
    for side in (frame.right, frame.up):
        slope = np.linalg.norm(side)
        # a ball around the box reaches into the wedge between the two planes through the camera
        seen &= np.abs(middle @ side) / slope <= depth * slope + radius * np.hypot(1, slope)
    if not seen.any():
        raise InputError(
            "render.camera: no fiber is in view.", hint="Move it, or set voxelize.voxel_size_mm."
        )
    nearest = float((depth - half @ np.abs(frame.forward))[seen].min())
    if nearest <= 0:
        raise InputError("render.camera: stands among the fibers.", hint="Set voxelize.voxel_size_mm.")
    return nearest * width


def rotation(axis: int, angle: float) -> np.ndarray:
    """Matrix of a turn about axis 0, 1 or 2, counterclockwise seen from its tip, [rad], shape [3, 3]."""
    c, s = math.cos(angle), math.sin(angle)
    following, last = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[following, following] = turn[last, last] = c
    turn[last, following], turn[following, last] = s, -s
    return turn


def _framed(
    camera: PerspectiveCamera | OrthographicCamera, bounds_mm: np.ndarray, resolution: tuple[int, int]
) -> CameraFrame:
    """The camera before it orbits."""
    aspect = resolution[1] / resolution[0]
    center = bounds_mm.mean(axis=0) if camera.target_mm is None else np.array(camera.target_mm)
    toward = _toward_camera(camera, bounds_mm, center)
    right, up = _picture_axes(toward, np.array(camera.up))
    if camera.kind == "orthographic":
        half = _half_width(camera, bounds_mm, center, right, up, aspect)
        position = center + toward * (np.ptp(bounds_mm, axis=0).sum() + 1.0)
        if camera.position_mm is not None:
            position = np.array(camera.position_mm)
        return CameraFrame(False, position, -toward, right * half, up * half * aspect)
    slope = math.tan(math.radians(camera.fov_deg) / 2)
    if camera.position_mm is not None:
        position = np.array(camera.position_mm)
    else:
        half = _half_width(camera, bounds_mm, center, right, up, aspect)
        # the frame is that wide at the side of the volume facing the camera, or at the target of a close-up
        depth = 0.0 if camera.frame_width_mm else np.abs(toward) @ (np.ptp(bounds_mm, axis=0) / 2)
        position = center + toward * (half / slope + depth)
    frame = CameraFrame(True, position, -toward, right * slope, up * slope * aspect)
    refuse_folds(camera.distortion_k1, camera.distortion_k2, math.hypot(slope, slope * aspect))
    return replace(
        frame,
        distortion=(camera.distortion_k1, camera.distortion_k2),
        aperture_radius=camera.aperture_radius_mm,
        aperture_blades=camera.aperture_blades,
        aperture_rotation=math.radians(camera.aperture_rotation_deg),
        focus_distance=camera.focus_distance_mm or float(np.linalg.norm(position - center)),
    )


def _toward_camera(
    camera: PerspectiveCamera | OrthographicCamera, bounds_mm: np.ndarray, center: np.ndarray
) -> np.ndarray:
    if camera.position_mm is not None:
        toward = np.array(camera.position_mm) - center
    elif camera.view_direction is not None:
        toward = np.array(camera.view_direction)
    else:
        toward = np.eye(3)[np.argmin(np.ptp(bounds_mm, axis=0))]
    length = np.linalg.norm(toward)
    if not length > 0:
        raise InputError("render.camera: the camera stands at its target.", hint="Move position_mm.")
    return toward / length


def _picture_axes(toward: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit right and up vectors of the picture."""
    if np.linalg.norm(np.cross(up, toward)) < 1e-3 * np.linalg.norm(up) or not up.any():
        up = np.array([0.0, 0.0, -1.0])
        if abs(toward[2]) > 0.9:
            up = np.array([0.0, 1.0, 0.0])
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    return right, np.cross(toward, right)


def _half_width(
    camera: PerspectiveCamera | OrthographicCamera,
    bounds_mm: np.ndarray,
    center: np.ndarray,
    right: np.ndarray,
    up: np.ndarray,
    aspect: float,
) -> float:
    """Half the width [mm] of what is seen: as asked, or so that the volume fits with a small margin."""
    if camera.frame_width_mm is not None:
        return camera.frame_width_mm / 2
    corners = np.array(
        [[bounds_mm[i, 0], bounds_mm[j, 1], bounds_mm[k, 2]] for i, j, k in np.ndindex(2, 2, 2)]
    )
    offsets = corners - center
    return 1.03 * float(max(np.abs(offsets @ right).max(), np.abs(offsets @ up).max() / aspect))
