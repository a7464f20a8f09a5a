"""All that the kernel needs to know: volume, camera, lights, phase functions, and how they become GLSL."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from weft.files.errors import InputError
from weft.voxelize.grid import FiberVolume

from .brick_file import BrickFile
from .brick_pool import BrickPool
from .camera import CameraFrame, place_camera
from .config import RANDOM_KINDS, Light, RenderConfig
from .detail import pixel_footprint
from .film import FILM_LAYERS, SURFACE_FILM_LAYERS
from .gpu.shader_source import Constant
from .lights import LightTable, LocalValues, build_light_table
from .local_lights import LOCAL_ROWS, LocalLight, Stage, fluence_at, light_rows, light_values, local_lights
from .media import OtherMedia, pool_around, with_other_media
from .phase_table import PhaseTable, Scattering, build_phase_table
from .pixel_filter import CELLS, KINDS, filter_uniforms
from .simple_phases import IsotropicPhase
from .stencil import cut_out
from .surfaces import SurfaceTable, build_surface_table
from .trackers import track_piece
from .turned_lights import turned_lights
from .volume_levels import VolumeLevels, finest_pool

__all__ = [
    "IsotropicPhase",
    "PhaseTable",
    "Scattering",
    "Scene",
    "build_phase_table",
    "build_scene",
    "lit_scene",
]

SHADOW_ROULETTE = 0.4
"""Transmittance below which a shadow ray survives by roulette (shaders/path/segments.glsl)."""

SURFACE_PIECE = '#include "geometry/seek.glsl"\n#include "path/surface.glsl"\n'
DISTORTION_PIECE = 'uniform vec4 distortion;\n#include "camera/distortion.glsl"\n'
LENS_PIECE = 'uniform vec4 lens;\n#include "camera/lens.glsl"\n'
FILTER_PIECE = (
    f'uniform float filter_edges[{CELLS + 1}];\nuniform vec4 filter_shape;\n#include "film/filter.glsl"\n'
)


AnyVolume = FiberVolume | BrickFile | VolumeLevels
"""In memory, on the disk, or at several levels of detail."""


@dataclass(frozen=True)
class Scene:
    """One picture to be made, on the host."""

    config: RenderConfig
    pool: BrickPool
    camera: CameraFrame
    light_table: LightTable
    phase: PhaseTable
    surfaces: SurfaceTable | None = None
    local_lights: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), np.float32))
    """Places of the lights that stand somewhere, four rows each; float32, shape [n, 4]."""
    local_kinds: frozenset[str] = frozenset()
    """Which of them there are."""
    media: OtherMedia | None = None
    """Those that are no fibers of the volume; None where there are none."""

    @property
    def film_layers(self) -> int:
        """Sums per pixel, in rows of four (shaders/film/film.glsl)."""
        return FILM_LAYERS if self.surfaces is None else SURFACE_FILM_LAYERS

    @property
    def tables(self) -> np.ndarray:
        """Lights, then surfaces: one buffer, because OpenGL 4.3 guarantees no more; float32, [rows, 4]."""
        lights = np.concatenate([self.light_table.entries.reshape(-1, 4), self.local_lights])
        return lights if self.surfaces is None else np.concatenate([lights, self.surfaces.rows])

    @property
    def extinction_scale(self) -> np.ndarray:
        """Extinction of volume fraction 1 across the fiber, per medium [1/voxel]."""
        scale = self._fiber_extinction_scale()
        return scale if self.media is None else self.media.extinction_scale(scale, self.pool.voxel_size_mm)

    def _fiber_extinction_scale(self) -> np.ndarray:
        radius, size = self.pool.fiber_radius_mm, self.pool.voxel_size_mm
        if self.config.extinction == "projected":
            return 2 * size / (math.pi * radius)
        if self.config.isotropic_extinction_per_mm is not None:
            return np.full(len(radius), self.config.isotropic_extinction_per_mm * size)
        return size / (2 * radius)

    @property
    def colored(self) -> bool:
        """Whether extinction depends on color."""
        return self.media is not None and self.media.colored

    def constants(self) -> dict[str, Constant]:
        """Compile-time options of the kernel."""
        return {
            "LAYER_COUNT": self.pool.layer_count,
            "DETAIL": self.pool.coarsest_level > 0,
            "EXTINCTION_PROJECTED": self.config.extinction == "projected",
            "EXTINCTION_FLAKES": self.phase.flake_roughness > 0,
            "VOXEL_COLORS": self.pool.has_colors,
            "FIBER_CORRELATION": self.config.correlation == "fibers",
            "EXTINCTION_RGB": self.colored,
            "OTHER_MEDIA": self.media is not None,
            **(self.media.constants() if self.media else {}),
            "SHADOW_COLLISIONS": self.config.shadows_by != "exact",
            "SHADOW_MARCH": self.config.shadows_by == "march",
            "SHADOW_ROULETTE": SHADOW_ROULETTE,
            "SAMPLE_LIGHTS": self.config.sampling != "phase",
            "SAMPLE_PHASE": self.config.sampling != "lights",
            "RANDOM_KIND": RANDOM_KINDS.index(self.config.rng),
            "SURFACES": self.surfaces is not None,
            "LOCAL_LIGHTS": len(self.local_lights) > 0,
            **self._local_constants(),
            **self._surface_constants(),
            "CAMERA_DISTORTION": any(self.camera.distortion),
            "CAMERA_LENS": self.camera.aperture_radius > 0,
            **self._filter_constants(),
            **self.phase.constants,
        }

    def _local_constants(self) -> dict[str, Constant]:
        shapes = {"LOCAL_QUADS": "quad", "LOCAL_DISKS": "disk", "LOCAL_TRIANGLES": "triangle"}
        return {name: kind in self.local_kinds for name, kind in shapes.items()} if self.local_kinds else {}

    def _bsdf(self) -> str:
        return self.surfaces.kinds.bsdf if self.surfaces else "diffuse"

    def _merl(self) -> str:
        return '#include "surface/merl.glsl"\n' if self.surfaces and self.surfaces.kinds.measured else ""

    def _surface_constants(self) -> dict[str, Constant]:
        if self.surfaces is None:
            return {}
        return {**self.surfaces.kinds.constants, "SURFACE_INSTANCES": self.surfaces.instance_count > 0}

    def _march_uniforms(self) -> dict[str, float]:
        step, size = self.config.march_step_mm, self.pool.voxel_size_mm
        return (
            {"march_step": 1.0 if step is None else step / size} if self.config.shadows_by == "march" else {}
        )

    def _surface_uniforms(self) -> dict[str, int]:
        if self.surfaces is None:
            return {}
        entries, local = len(self.light_table.entries), len(self.local_lights)
        first = 2 * entries + local
        rows = {f"surface_{name}": first + row for name, row in self.surfaces.offsets.items()}
        return rows | {"local_lights": 2 * entries, "local_first": entries - local // LOCAL_ROWS}

    def _filter_constants(self) -> dict[str, Constant]:
        kind = KINDS[self.config.filter.kind]
        return {"PIXEL_FILTER": kind, **({"FILTER_CELLS": CELLS} if kind else {})}

    def pieces(self) -> dict[str, str]:
        """GLSL chosen or made for this scene."""
        return {
            "generated/track.glsl": track_piece(self.config.tracking, self.config.shadows_by, self.media),
            "generated/collide.glsl": '#include "medium/collide.glsl"\n' if self.media else "",
            "generated/phase.glsl": f'#include "{self.phase.piece}"\n',
            "generated/phase_block.glsl": self.phase.block,
            "generated/surfaces.glsl": "" if self.surfaces is None else SURFACE_PIECE,
            "generated/local_lights.glsl": '#include "light/local.glsl"\n' if len(self.local_lights) else "",
            "generated/bsdf.glsl": f'#include "surface/bsdf_{self._bsdf()}.glsl"\n',
            "generated/instancing.glsl": "" if self.surfaces is None else "#constant SURFACE_INSTANCES\n",
            "generated/merl.glsl": self._merl(),
            "generated/texture.glsl": '#include "surface/texture.glsl"\n',
            "generated/distortion.glsl": DISTORTION_PIECE if any(self.camera.distortion) else "",
            "generated/lens.glsl": LENS_PIECE if self.camera.aperture_radius > 0 else "",
            "generated/filter.glsl": "" if self.config.filter.kind == "box" else FILTER_PIECE,
        }

    def _thickest_fiber_mm(self) -> float:
        radius = self.pool.fiber_radius_mm
        return float((radius if self.media is None else radius[: self.media.fiber_count]).max())

    def uniforms(self) -> dict[str, object]:
        """Uniforms that hold for the whole picture; lengths in voxels."""
        config, pool, camera = self.config, self.pool, self.camera
        rows = len(self.light_table.environment)
        scale = 1.0 if camera.perspective else 1 / pool.voxel_size_mm
        thickest = self._thickest_fiber_mm() / pool.voxel_size_mm
        from_environment = config.background == "environment"
        return {
            "grid_cells": pool.cells.shape,
            "seed": config.seed,
            "image_size": config.resolution,
            "film_layers": self.film_layers,
            "max_bounces": config.max_bounces,
            "roulette_start": config.roulette_start,
            "start_offset": config.self_shadow_offset_fibers * thickest,
            "flake_roughness": self.phase.flake_roughness,
            "fiber_radius": thickest,
            "background": (0.0, 0.0, 0.0, 1.0) if from_environment else (*config.background, 0.0),
            "camera_perspective": int(camera.perspective),
            "camera_position": tuple((camera.position - pool.corner_mm) / pool.voxel_size_mm),
            "camera_forward": tuple(camera.forward),
            "camera_right": tuple(camera.right * scale),
            "camera_up": tuple(camera.up * scale),
            "distortion": (
                *self.camera.distortion,
                float(np.linalg.norm(self.camera.right)),
                float(np.linalg.norm(self.camera.up)),
            ),
            "lens": (
                camera.aperture_radius / pool.voxel_size_mm,
                camera.focus_distance / pool.voxel_size_mm,
                float(camera.aperture_blades),
                camera.aperture_rotation,
            ),
            **filter_uniforms(config.filter),
            **(self.media.uniforms(pool) if self.media else {}),
            **self._march_uniforms(),
            **self._surface_uniforms(),
            "environment_size": (2 * rows, rows),
            "light_count": len(self.light_table.entries),
            "directional_lights": [tuple(row) for row in self.light_table.directions.tolist()],
        }


def build_scene(config: RenderConfig, volume: AnyVolume, scattering: Mapping[str, Scattering]) -> Scene:
    """Put volume, camera and lights together. Raises `InputError` for what cannot be rendered."""
    shown = _shown_volume(config, volume)
    names, bounds = shown.media, np.asarray(shown.bounds_mm)
    camera = place_camera(config.camera, bounds, config.resolution)
    media: OtherMedia | None = None
    if isinstance(shown, VolumeLevels):
        footprint, on_disk = pixel_footprint(camera, config.resolution), config.brick_pool_mb is not None
        pool = shown.pool(footprint, config.detail_pixels or 0.0, on_disk=on_disk)
    else:
        shown, media = with_other_media(config, shown)
        pool = finest_pool(shown)
        pool = pool if media is None else pool_around(pool, media)
    phase = build_phase_table(names, scattering, media.phases if media else ())
    lighting = _lighting(config, pool, camera.axes, bounds)
    return Scene(config, pool, camera, phase=phase, media=media, **lighting)


def _shown_volume(config: RenderConfig, volume: AnyVolume) -> AnyVolume:
    """What lies inside of the stencil, at the levels that the config lets choose among."""
    if isinstance(volume, VolumeLevels) and config.detail_pixels is None:
        volume = volume.levels[0]
    if config.detail_pixels is not None and not isinstance(volume, VolumeLevels):
        raise InputError(
            "render.detail_pixels: the volume has no coarser levels.", hint="Set voxelize.levels = 3."
        )
    if config.stencil is None:
        return volume
    levels = volume.levels if isinstance(volume, VolumeLevels) else (volume,)
    cut = tuple(cut_out(_in_memory(level), config.stencil) for level in levels)
    return replace(volume, levels=cut) if isinstance(volume, VolumeLevels) else cut[0]


def _in_memory(volume: FiberVolume | BrickFile) -> FiberVolume:
    if isinstance(volume, BrickFile):
        raise InputError(
            "render.stencil: what is cut out must be in memory.", hint="Leave out brick_pool_mb."
        )
    return volume


def lit_scene(scene: Scene, lights: Sequence[Light], axes: np.ndarray, bounds: np.ndarray) -> Scene:
    """The scene under other lights; those that belong to a camera turn with `axes`. `bounds` [mm], [2, 3]."""
    config = scene.config.model_copy(update={"lights": tuple(lights), "lights_turn_deg": 0.0})
    return replace(scene, config=config, **_lighting(config, scene.pool, axes, bounds))


def _lighting(config: RenderConfig, pool: BrickPool, axes: np.ndarray, bounds: np.ndarray) -> dict[str, Any]:
    """Fields of a scene that its lights decide. Surfaces belong to them: a quad light is one."""
    middle, diagonal = bounds.mean(axis=0), float(np.linalg.norm(np.ptp(bounds, axis=0)))
    lights, size = turned_lights(config.lights, config.lights_turn_deg, middle), pool.voxel_size_mm
    local = local_lights(lights, Stage(middle, diagonal, axes))
    target = config.camera.target_mm
    values = _local_values(local, middle if target is None else np.array(target), bounds, size)
    return {
        "light_table": build_light_table(lights, axes, values, compensated=config.sampling == "both"),
        "surfaces": build_surface_table(config.surfaces, local, bounds, pool.corner_mm, size),
        "local_lights": light_rows(local, pool.corner_mm, size),
        "local_kinds": frozenset(light.kind for light in local),
    }


def _local_values(
    local: list[LocalLight], middle: np.ndarray, bounds: np.ndarray, voxel_size_mm: float
) -> LocalValues:
    """How often each is chosen depends on how much of it reaches `middle` [mm]."""
    radius = float(np.linalg.norm(np.ptp(bounds, axis=0))) / 2
    fluence = np.array([fluence_at(light, middle, radius) for light in local]).reshape(-1, 3)
    return LocalValues(light_values(local, voxel_size_mm), fluence)
