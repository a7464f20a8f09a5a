"""Light from all around, as one latitude-longitude picture in world directions.

Row 0 is +y; column 0 starts at -z and columns go toward +x, as in Mitsuba 3. Radiance is constant in a texel.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from weft.files.errors import InputError

from .config import ConstantLight, DaylightLight, EnvironmentLight, Light, SkyLight, StudioLight
from .daylight import daylight
from .image import read_rgb

ROUNDED_BELOW_ZERO = 1e-4
"""Part of a picture's light that may lie below zero and is cut off: lossy compression (DWA) rounds there."""
MAX_ROWS = 1024
PROCEDURAL_ROWS = 256
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def build_environment(lights: Sequence[Light], camera_axes: np.ndarray) -> np.ndarray:
    """Sum of all lights around the scene, float32, shape [rows, 2 rows, 3]; two black texels if none."""
    pictures = [picture for light in lights if (picture := _picture(light, camera_axes)) is not None]
    rows = max((len(picture) for picture in pictures), default=1)
    total = np.zeros((rows, 2 * rows, 3))
    for picture in pictures:
        total += _resized(picture, rows)
    return total.astype(np.float32)


def texel_directions(rows: int) -> np.ndarray:
    """Unit vectors to the texel centers, float64, shape [rows, 2 rows, 3]."""
    theta = (np.arange(rows) + 0.5)[:, None] * np.pi / rows
    phi = (np.arange(2 * rows) + 0.5)[None, :] * np.pi / rows
    x, z = np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi)
    return np.stack([x, np.broadcast_to(np.cos(theta), x.shape), z], axis=-1)


def texel_solid_angles(rows: int) -> np.ndarray:
    """Exact solid angle of a texel of each row [sr], shape [rows]; they sum to 4 pi over the picture."""
    edges = np.cos(np.arange(rows + 1) * np.pi / rows)
    return (edges[:-1] - edges[1:]) * np.pi / rows


def _picture(light: Light, camera_axes: np.ndarray) -> np.ndarray | None:
    if isinstance(light, ConstantLight):
        return np.broadcast_to(np.array(light.radiance), (1, 2, 3))
    if isinstance(light, EnvironmentLight):
        return _rotated(load_environment(light.file), light.rotation_deg) * light.intensity
    if isinstance(light, StudioLight):
        return studio(texel_directions(PROCEDURAL_ROWS) @ camera_axes.T, light.rotation_deg) * light.intensity
    if isinstance(light, SkyLight):
        return sky(texel_directions(PROCEDURAL_ROWS), light) * light.intensity
    if isinstance(light, DaylightLight):
        solid_angles = texel_solid_angles(PROCEDURAL_ROWS)[:, None]
        return daylight(texel_directions(PROCEDURAL_ROWS), light, solid_angles)
    return None


def load_environment(path: Path) -> np.ndarray:
    """A latitude-longitude picture, reduced to at most 1024 rows by averaging over solid angle."""
    picture = read_rgb(path).astype(np.float64)
    rows, columns = picture.shape[:2]
    if columns != 2 * rows:
        raise InputError(
            f"the picture is {columns} x {rows}; an environment must be twice as wide as high.", path=path
        )
    if not np.isfinite(picture).all() or -np.minimum(picture, 0).sum() > ROUNDED_BELOW_ZERO * picture.sum():
        raise InputError("the picture holds values that are negative or not finite.", path=path)
    picture = np.maximum(picture, 0)
    if rows > MAX_ROWS:
        picture = _resized(picture, MAX_ROWS)
    return picture


def _rotated(picture: np.ndarray, degrees: float) -> np.ndarray:
    """Turned about +y, counterclockwise from above, by a shift of columns with linear interpolation."""
    # azimuth from -z toward +x is clockwise from above, so counterclockwise moves the columns to the left
    shift = -degrees / 360 * picture.shape[1]
    whole = int(np.floor(shift))
    part = shift - whole
    near = np.roll(picture, whole, axis=1)
    return near if part == 0 else near * (1 - part) + np.roll(near, 1, axis=1) * part


def _resized(picture: np.ndarray, rows: int) -> np.ndarray:
    """Averaged over the solid angles of `rows` x 2 `rows` texels, so that no light is lost at any sizes."""
    if len(picture) == rows:
        return picture
    heights = [-np.cos(np.arange(n + 1) * np.pi / n) for n in (len(picture), rows)]
    azimuths = [np.linspace(0, 1, n + 1) for n in (picture.shape[1], 2 * rows)]
    channels = [_averaged(_averaged(c, *heights).T, *azimuths).T for c in np.moveaxis(picture, -1, 0)]
    return np.maximum(np.stack(channels, axis=-1), 0)  # differences of sums may round below zero


def _averaged(values: np.ndarray, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Rows of `values`, constant between the `old` edges, as means between the `new` edges."""
    widths = np.diff(old)
    sums = np.cumsum(values * widths[:, None], axis=0)
    sums = np.concatenate([np.zeros_like(sums[:1]), sums])
    cell = np.clip(np.searchsorted(old, new, side="right") - 1, 0, len(values) - 1)
    part = ((new - old[cell]) / widths[cell])[:, None]
    return np.diff(sums[cell] * (1 - part) + sums[cell + 1] * part, axis=0) / np.diff(new)[:, None]


def studio(directions: np.ndarray, rotation_deg: float) -> np.ndarray:
    """Radiance of the softboxes. Directions: x right, y up, z toward the camera, shape [..., 3]."""
    turn = np.radians(rotation_deg)
    c, s = np.cos(turn), np.sin(turn)
    turned = directions @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    walls = 0.04 + 0.06 * np.clip(turned[..., 1], 0, 1)
    radiance = walls[..., None] * np.array([1.0, 1.0, 1.0])
    _add_softbox(radiance, turned, (-0.75, 0.75, 0.65), (0.55, 0.4), np.array([9.0, 8.6, 8.0]))
    _add_softbox(radiance, turned, (0.95, 0.1, 0.5), (0.5, 0.6), np.array([0.8, 0.95, 1.2]))
    _add_softbox(radiance, turned, (0.45, 0.7, -0.7), (0.7, 0.15), np.array([5.0, 5.2, 5.6]))
    return radiance


def _add_softbox(
    radiance: np.ndarray,
    directions: np.ndarray,
    middle: tuple[float, float, float],
    half_size: tuple[float, float],
    color: np.ndarray,
) -> None:
    """A rectangle at distance 1 toward `middle`, brightest in its middle, soft over a tenth of its size."""
    n = np.array(middle) / np.linalg.norm(middle)
    right = np.cross([0.0, 1.0, 0.0], n)
    right /= np.linalg.norm(right)
    up = np.cross(n, right)
    depth, across, upward = (np.reshape(directions @ axis, -1) for axis in (n, right, up))
    seen = np.flatnonzero(depth > 0.05)
    x = np.abs(across[seen]) / depth[seen] / half_size[0]
    y = np.abs(upward[seen]) / depth[seen] / half_size[1]
    inside = (x < 1.05) & (y < 1.05)
    seen, x, y = seen[inside], x[inside], y[inside]
    edge = np.clip((1.05 - x) / 0.1, 0, 1) * np.clip((1.05 - y) / 0.1, 0, 1)
    falloff = 1 - 0.25 * np.clip(x**2 + y**2, 0, 2)
    radiance.reshape(-1, 3)[seen] += (edge * falloff)[:, None] * color


def sky(directions: np.ndarray, light: SkyLight) -> np.ndarray:
    """Radiance of the sky gradient. Directions in the world, y up, shape [..., 3]."""
    height = directions[..., 1:2]
    blend = np.clip(height, 0, 1) ** 0.5
    above = np.array(light.horizon) * (1 - blend) + np.array(light.zenith) * blend
    return np.where(height >= 0, above, np.array(light.ground))
