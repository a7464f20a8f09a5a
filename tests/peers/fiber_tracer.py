"""Fibers traced one by one: the same three lobes at the surface of every cylinder, no voxels.

A ray meets the outside of a fiber, takes a direction from the fiber's phase function (far field: the same
for all places across the fiber) and goes on from that point; the fiber it left does not stop it again at
once. This is what Mitsuba's `bsplinecurve`, whose back faces are culled, does with the three lobes as its
BSDF; tests/renderer/test_mitsuba_fibers.py compares the two. Lobes are those of the numpy twin; nearest
fibers are found by Warp's hierarchy of boxes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import fiber_phase_sample

MOST_BOUNCES = 2000
OWN_SEGMENTS = 2
"""Segments of the own fiber on either side that a leaving ray does not meet."""


@wp.kernel
def _nearest_fiber(
    tree: wp.uint64,
    start: wp.array(dtype=wp.vec3),
    stop: wp.array(dtype=wp.vec3),
    fiber: wp.array(dtype=wp.int32),
    radius: float,
    own_segments: int,
    origin: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    left: wp.array(dtype=wp.int32),
    hit: wp.array(dtype=wp.int32),
    distance: wp.array(dtype=float),
):
    """The first outside of a cylinder along each ray: segment or -1, and how far [mm]."""
    ray = wp.tid()
    o = origin[ray]
    d = direction[ray]
    own = left[ray]
    nearest = float(1.0e30)  # noqa: UP018
    best = int(-1)  # noqa: UP018, RUF046
    query = wp.bvh_query_ray(tree, o, d)
    item = int(0)  # noqa: UP018, RUF046
    while wp.bvh_query_next(query, item, nearest):
        # an index of -1 reads nothing of the fibers: the first one stands in
        if own >= 0 and fiber[item] == fiber[wp.max(own, 0)] and wp.abs(item - own) <= own_segments:
            continue
        base = start[item]
        along = stop[item] - base
        length = wp.length(along)
        axis = along / length
        across = wp.cross(d, axis)
        sine = wp.length(across)
        if sine > 1.0e-6:
            gap = wp.dot(base - o, across) / sine
            if wp.abs(gap) < radius:
                # closest approach of the two lines, then back to the surface
                closest = wp.dot(wp.cross(base - o, axis), across) / (sine * sine)
                s = closest - wp.sqrt(radius * radius - gap * gap) / sine
                u = wp.dot(o + s * d - base, axis)
                if s > 0.0 and s < nearest and u >= 0.0 and u < length:
                    nearest = s
                    best = item
    hit[ray] = best
    distance[ray] = nearest


@dataclass(frozen=True)
class FiberScene:
    """Straight pieces of fibers with one radius [mm]."""

    segments: np.ndarray
    """float32, shape [segment_count, 2, 3]; pieces of a fiber follow each other."""
    fiber: np.ndarray
    """Fiber of each piece, int32, shape [segment_count]."""
    radius_mm: float

    @property
    def axes(self) -> np.ndarray:
        """Unit, float64, shape [segment_count, 3]."""
        along = np.diff(self.segments.astype(np.float64), axis=1)[:, 0]
        return along / np.linalg.norm(along, axis=1, keepdims=True)


class FiberTracer:
    """Nearest hits of many rays among the fibers of a scene."""

    def __init__(self, scene: FiberScene) -> None:
        self.scene, self.axes = scene, scene.axes
        ends = scene.segments.astype(np.float32)
        margin = np.float32(scene.radius_mm)
        low, high = ends.min(axis=1) - margin, ends.max(axis=1) + margin
        self._low, self._high = (wp.array(part, dtype=wp.vec3, device="cpu") for part in (low, high))
        self._tree = wp.Bvh(self._low, self._high)
        self._ends = [wp.array(ends[:, k], dtype=wp.vec3, device="cpu") for k in range(2)]
        self._fiber = wp.array(scene.fiber, dtype=wp.int32, device="cpu")

    def nearest(self, origin: np.ndarray, direction: np.ndarray, left: np.ndarray) -> tuple:
        """Segment met, int32 [n], -1 for none, and distance [mm]; `left`: segment that each ray leaves."""
        hit = np.empty(len(origin), np.int32)
        distance = np.empty(len(origin), np.float32)
        inputs = [np.ascontiguousarray(part, np.float32) for part in (origin, direction)]
        wp.launch(
            _nearest_fiber,
            dim=len(origin),
            inputs=[
                self._tree.id,
                *self._ends,
                self._fiber,
                self.scene.radius_mm,
                OWN_SEGMENTS,
                *(wp.array(part, dtype=wp.vec3, device="cpu", copy=False) for part in inputs),
                wp.array(np.ascontiguousarray(left, np.int32), dtype=wp.int32, device="cpu"),
            ],
            outputs=[
                wp.array(hit, dtype=wp.int32, device="cpu", copy=False),
                wp.array(distance, dtype=float, device="cpu", copy=False),
            ],
            device="cpu",
        )
        return hit, distance.astype(np.float64)

    def radiance(
        self,
        origin: np.ndarray,
        direction: np.ndarray,
        parameters: FiberScatteringParameters,
        light: Callable[[np.ndarray], np.ndarray],
        rng: np.random.Generator,
        *,
        roulette_start: int = 16,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What rays bring back [n, k], which met a fiber [n], and their bounces [n].

        `light` maps directions [m, 3] to radiances [m, k]; rays that meet nothing at all bring back zero.
        Throughput is that of the first color.
        """
        n = len(origin)
        brought = np.zeros((n, light(direction[:1]).shape[1]))
        bounces = np.zeros(n, int)
        alive, left = np.arange(n), np.full(n, -1, np.int32)
        o, d, throughput = origin.astype(np.float64), direction.astype(np.float64), np.ones(n)
        for bounce in range(MOST_BOUNCES):
            hit, distance = self.nearest(o, d, left)
            away = hit < 0
            if bounce:
                brought[alive[away]] = throughput[away, None] * light(d[away])
            alive, hit, distance, o, d, throughput = (
                part[~away] for part in (alive, hit, distance, o, d, throughput)
            )
            if not len(alive):
                return brought, bounces > 0, bounces
            bounces[alive] += 1
            o = o + d * distance[:, None]
            d, weight = self._scatter(parameters, hit, -d, rng)
            throughput = throughput * weight
            left = hit
            if bounce >= roulette_start:
                stays = rng.random(len(alive)) < np.clip(throughput, 0.05, 1)
                throughput = throughput / np.clip(throughput, 0.05, 1)
                alive, left, o, d, throughput = (part[stays] for part in (alive, left, o, d, throughput))
        raise RuntimeError(f"paths longer than {MOST_BOUNCES} bounces")

    def _scatter(
        self, parameters: FiberScatteringParameters, hit: np.ndarray, wo: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        axis = self.axes[hit]
        helper = np.where(np.abs(axis[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
        side = np.cross(axis, helper)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        frame = np.stack([axis, side, np.cross(axis, side)], axis=1)
        local = np.einsum("nij,nj->ni", frame, wo)
        wi, weight, _ = fiber_phase_sample(parameters, local, rng.random((len(hit), 4)))
        return np.einsum("nij,ni->nj", frame, wi), weight[:, 0]
