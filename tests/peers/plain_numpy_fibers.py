"""The peer of the fiber kernels as numpy is usually written: float64, a cosine wherever the formula has one.

`numpy_fibers` is the same tuned by hand for the cache: float32, and rotations in place of cosines.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tests.peers.numpy_fibers import body_peaks, hair_points, placed
from weft.fiber_model.fibers import FiberSet
from weft.fiber_model.flyaways import FlyawayShape

NODE_PHASES = ("ply", "twist", "migration")


@dataclass(frozen=True)
class PlainFibers:
    """All points of all strands, a stretch at a time."""

    fibers: FiberSet
    shape: FlyawayShape

    @cached_property
    def angles(self) -> dict[str, np.ndarray]:
        """Of all nodes and of all seats [rad]."""
        nodes = {name: _angle(self.fibers.nodes[name]) for name in NODE_PHASES}
        seats = {f"seat {name}": _angle(self.fibers.seats[name]) for name in ("angle", "migration")}
        return nodes | seats

    def stretch_points(self, stretch: int) -> np.ndarray:
        """One stretch: body fibers and then hairs [mm], shape [point_count, 3]."""
        fibers = self.fibers
        piece = fibers.stretches[stretch]
        yarn = fibers.yarns[piece["yarn"]]
        index = piece["first"] + np.arange(piece["segments"] + 1)
        if yarn["closed"]:
            index %= yarn["intervals"]
        node, count = yarn["first_node"] + index, yarn["plies"] * yarn["fibers_per_ply"]
        fiber = np.arange(count)
        seat = yarn["first_fiber"] + fiber
        low = (yarn["migration_low"] * fibers.seats["radius"][seat])[:, None]
        peak = body_peaks(fibers, int(piece["yarn"]), yarn, fibers.seats[seat], index, self.shape)
        migration = np.cos(self.angles["migration"][node] + self.angles["seat migration"][seat, None])
        radius = low + 0.5 * (peak - low) * (migration + 1.0)
        turned = self.angles["twist"][node] + self.angles["seat angle"][seat, None]
        of_ply = 2 * np.pi * (fiber // yarn["fibers_per_ply"])[:, None] / yarn["plies"]
        ply = self.angles["ply"][node] + of_ply
        at = fibers.nodes[node]
        body = placed(
            radius * np.cos(turned), radius * np.sin(turned), (np.cos(ply), np.sin(ply)), yarn, at
        ).reshape(-1, 3)
        return np.concatenate([body, hair_points(fibers, stretch, self.shape)])


def _angle(on_circle: np.ndarray) -> np.ndarray:
    return np.arctan2(on_circle[:, 1].astype(np.float64), on_circle[:, 0].astype(np.float64))
