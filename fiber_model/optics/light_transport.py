"""Monte-Carlo light transport through one fiber: configuration in, far-field histogram out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from weft.fiber_model.counter_random import seed_key

from .config import FiberOpticsConfig
from .cross_sections import build_outline
from .histogram import ORDERS, Array, DirectionBins, ScatteringHistogram, direction_bins
from .outline import Outline

PATHS_PER_LAUNCH = 2**17
"""Paths traced at a time. Fixed, so that sums are added up in the same order whatever the machine."""

ROOM = 1e-9
"""Added to the circle around an arc, as a part of the bounding radius: no ray that meets it is missed."""

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class PathEnds:
    """Where N paths ended."""

    sin_theta: Array
    phi: Array
    """Azimuth relative to the light's [rad], shape [N]."""
    weight: Array
    """Shape [N, 3]."""
    order: np.ndarray
    """Index into `ORDERS`; -1: lost, no way out was found; -2: ended by Russian roulette."""


def run(
    config: FiberOpticsConfig, *, progress: Progress | None = None, device: str = "cpu"
) -> ScatteringHistogram:
    """Trace `config.paths` paths for each inclination of the light.

    Raises `InputError` for a cross-section that is no shape.
    """
    outline = build_outline(config.cross_section)
    bins = direction_bins(np.radians(config.theta_bin_deg), np.radians(config.phi_bin_deg))
    theta_i = np.radians(np.array(config.theta_i_deg, dtype=np.float64))
    shape = (len(theta_i), len(ORDERS), *bins.shape, 3)
    sums, squares = np.zeros(shape), np.zeros(shape)
    lost = np.zeros(len(theta_i), dtype=np.int64)
    tracer = FiberTracer(config, outline, device)
    for stream, theta in enumerate(theta_i):
        for first in range(0, config.paths, PATHS_PER_LAUNCH):
            if progress:
                done = (stream + first / config.paths) / len(theta_i)
                progress(done, f"light at {np.degrees(theta):g} degrees")
            ends = tracer.trace(theta, stream, first, min(PATHS_PER_LAUNCH, config.paths - first))
            _count(ends, bins, sums[stream], squares[stream])
            lost[stream] += int((ends.order == -1).sum())
    counts = np.full(len(theta_i), config.paths, dtype=np.int64)
    return ScatteringHistogram(theta_i, bins, sums, squares, counts, lost, outline.mean_width)


class FiberTracer:
    """A fiber on a device, ready to be hit by light."""

    def __init__(self, config: FiberOpticsConfig, outline: Outline, device: str = "cpu") -> None:
        import warp as wp

        from .transport_kernels import Arc, Fiber

        self._device = device
        self._seed = wp.uint32(seed_key(config.seed))
        self._fiber: Any = Fiber()
        self._fiber.arcs = wp.array(_arc_records(outline, Arc), dtype=Arc, device=device)
        self._fiber.arc_count = len(outline)
        self._fiber.convex = int(outline.convex)
        self._fiber.bounding_radius = outline.bounding_radius
        self._fiber.index = config.refractive_index
        self._fiber.alpha = config.roughness
        self._fiber.absorption = wp.vec3d(*config.absorption_per_mm)
        self._fiber.reflection_floor = config.reflection_floor

    def trace(self, theta_i: float, stream: int, first: int, count: int) -> PathEnds:
        """Paths `first` to `first + count` of the stream of random numbers with this number."""
        import warp as wp

        from .transport_kernels import trace_paths

        sin_theta = wp.empty(count, dtype=wp.float64, device=self._device)
        phi = wp.empty(count, dtype=wp.float64, device=self._device)
        weight = wp.empty(count, dtype=wp.vec3d, device=self._device)
        order = wp.empty(count, dtype=wp.int32, device=self._device)
        inputs = [self._fiber, theta_i, self._seed, wp.uint32(stream), wp.uint32(first)]
        wp.launch(
            trace_paths, count, inputs=inputs, outputs=[sin_theta, phi, weight, order], device=self._device
        )
        return PathEnds(sin_theta.numpy(), phi.numpy(), weight.numpy(), order.numpy())


def _arc_records(outline: Outline, arc_type: Any) -> np.ndarray:
    records = np.zeros(len(outline), dtype=arc_type.numpy_dtype())
    records["start"], records["tangent"] = outline.starts, outline.start_tangents
    records["end"], records["end_tangent"] = outline.ends, outline.end_tangents
    records["curvature"] = outline.curvatures
    records["middle"] = 0.5 * (outline.starts + outline.ends)
    records["reach"] = (
        0.5 * np.linalg.norm(outline.ends - outline.starts, axis=1) + ROOM * outline.bounding_radius
    )
    return records


def _count(ends: PathEnds, bins: DirectionBins, sums: Array, squares: Array) -> None:
    """Add the paths' weights to `sums` and their squares to `squares`, [orders, T, P, channels] each."""
    out = ends.order >= 0
    cells = bins.shape[0] * bins.shape[1]
    index = ends.order[out] * cells + bins.index(ends.sin_theta[out], ends.phi[out])
    for channel in range(sums.shape[-1]):
        weight = ends.weight[out, channel]
        for target, value in ((sums, weight), (squares, weight**2)):
            target[..., channel] += np.bincount(index, value, len(ORDERS) * cells).reshape(sums.shape[:-1])
