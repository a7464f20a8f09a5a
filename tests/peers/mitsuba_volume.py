"""The same grid in Mitsuba 3: a heterogeneous medium in a uniform environment, three phase functions."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from tests.peers.compared_pictures import PeerImage, perspective_sensor


@dataclass(frozen=True)
class VolumeScene:
    """A dense block of extinction in front of a perspective camera, in a uniform white environment."""

    extinction: np.ndarray
    """Extinction per voxel [1/mm], float32, shape [nx, ny, nz]; constant within a voxel."""
    voxel_size_mm: float
    albedo: float
    camera_position: tuple[float, float, float]
    camera_target: tuple[float, float, float]
    fov_deg: float
    """Vertical (= horizontal: the image is square) field of view."""
    resolution: int
    g: float | None = None
    """Mean cosine of Henyey and Greenstein's phase function; unset: isotropic."""
    flake_roughness: float | None = None
    """Of SGGX microflakes along `axes`; unset: none."""
    toward_sun: tuple[float, float, float] | None = None
    """Parallel light of irradiance 1 and a single scattering, in place of the environment."""
    axes: np.ndarray | None = None
    """Unit fiber axes, shape [nx, ny, nz, 3]."""

    @property
    def size_mm(self) -> np.ndarray:
        return np.array(self.extinction.shape) * self.voxel_size_mm


def render_with_mitsuba(scene: VolumeScene, *, samples_per_run: int, runs: int, seed: int) -> PeerImage:
    """Render `runs` independent images with Mitsuba's `volpath` (scalar_rgb) and pool them."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    loaded = mi.load_dict(scene_dict(mi, scene))
    images = []
    started = time.process_time()
    for run in range(runs):
        image = mi.render(loaded, spp=samples_per_run, seed=seed + run)
        images.append(np.asarray(image)[..., :3].mean(-1, dtype=np.float64))
    cpu_seconds = time.process_time() - started
    stack = np.stack(images)
    return PeerImage(
        mean=stack.mean(0),
        variance=stack.var(0, ddof=1) / runs,
        paths=runs * samples_per_run * scene.resolution**2,
        cpu_seconds=cpu_seconds,
    )


def scene_dict(mi, scene: VolumeScene) -> dict:
    """For `mi.load_dict`. `gridvolume` is indexed [z, y, x] in the unit cube; a `cube` spans [-1, 1]."""
    size = scene.size_mm
    to_block = mi.ScalarTransform4f().scale(list(size))
    cube_to_block = mi.ScalarTransform4f().translate(list(size / 2)).scale(list(size / 2))
    grid = np.ascontiguousarray(scene.extinction.transpose(2, 1, 0)[..., None], np.float32)
    return {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 2 if scene.toward_sun else 1000, "rr_depth": 1000},
        "light": _light_dict(scene),
        "block": {
            "type": "cube",
            "to_world": cube_to_block,
            "bsdf": {"type": "null"},
            "interior": {
                "type": "heterogeneous",
                "sigma_t": {
                    "type": "gridvolume",
                    "grid": mi.VolumeGrid(grid),
                    "filter_type": "nearest",
                    "wrap_mode": "clamp",
                    "to_world": to_block,
                },
                "albedo": scene.albedo,
                "phase": _phase_dict(mi, scene, to_block),
            },
        },
        "sensor": perspective_sensor(
            mi,
            position=scene.camera_position,
            target=scene.camera_target,
            fov_deg=scene.fov_deg,
            size=scene.resolution,
        ),
    }


def _light_dict(scene: VolumeScene) -> dict:
    if scene.toward_sun is None:
        return {"type": "constant", "radiance": 1.0}
    return {"type": "directional", "direction": [-x for x in scene.toward_sun], "irradiance": 1.0}


def _phase_dict(mi, scene: VolumeScene, to_block) -> dict:
    if scene.g is not None:
        return {"type": "hg", "g": scene.g}
    if scene.flake_roughness is None:
        return {"type": "isotropic"}
    assert scene.axes is not None
    outer = scene.axes[..., :, None] * scene.axes[..., None, :]
    matrix = np.eye(3) - (1 - scene.flake_roughness**2) * outer
    six = np.stack([matrix[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=-1)
    grid = np.ascontiguousarray(six.transpose(2, 1, 0, 3), np.float32)
    volume = {
        "type": "gridvolume",
        "grid": mi.VolumeGrid(grid),
        "raw": True,
        "filter_type": "nearest",
        "wrap_mode": "clamp",
        "to_world": to_block,
    }
    return {"type": "sggx", "S": volume}
