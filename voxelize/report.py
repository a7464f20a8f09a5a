"""What a voxelization did: the numbers that prove it complete."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class VoxelizeReport:
    """Length conservation, size and time of one voxelization."""

    generated_length_mm: float
    """Fiber length inside the region, measured segment by segment as the fibers were generated."""
    grid_length_mm: float
    """Sum of lambda h^3 over all voxels, from the densities as stored."""
    item_count: int
    """Stretches of yarn (or blocks of segments) that took part."""
    visit_count: int
    """How often one was made: once for each tile that its box reaches."""
    tile_count: int
    brick_count: int
    voxel_count: int
    """Voxels with fiber in them, summed over the media."""
    max_volume_fraction: float
    overfull_voxel_count: int
    """Voxels whose volume fraction passes 1: fibers overlap there, or the voxel is smaller than a fiber."""
    seconds: float

    @property
    def relative_difference(self) -> float:
        """Of grid_length_mm from generated_length_mm."""
        if self.generated_length_mm == 0.0:
            return 0.0 if self.grid_length_mm == 0.0 else float("inf")
        return self.grid_length_mm / self.generated_length_mm - 1.0
