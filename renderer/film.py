"""The film: sums over samples, and the layers of the picture they become."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SUM_COUNT = 16


@dataclass
class Film:
    """Sums per pixel in float64, in the order of shaders/film/film.glsl, shape [4, pixel_count, 4]."""

    width: int
    height: int
    sums: np.ndarray
    samples: int = 0

    @classmethod
    def empty(cls, width: int, height: int) -> Film:
        return cls(width, height, np.zeros((4, width * height, 4)))

    def add(self, first_pixel: int, sums: np.ndarray) -> None:
        """Add the sums of one pass over some pixels."""
        self.sums[:, first_pixel : first_pixel + sums.shape[1]] += sums

    def layers(self, voxel_size_mm: float) -> dict[str, np.ndarray]:
        """Named channels, float32, shape [height, width].

        R, G, B, A: mean radiance and opacity. variance.R, .G, .B: of the mean (an upper bound, since samples
        are stratified). albedo, T, Z: color, fiber axis (x >= 0) and distance [mm] where camera rays first
        scatter.
        """
        n = self.samples
        radiance, opacity = self.sums[0, :, :3] / n, self.sums[0, :, 3] / n
        squares = self.sums[1, :, :3] / n
        variance = np.maximum(squares - radiance**2, 0) / max(n - 1, 1)
        hits = self.sums[2, :, 3]
        safe = np.maximum(hits, 1)
        axis = self.sums[2, :, :3]
        axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-30)
        depth = np.where(hits > 0, self.sums[1, :, 3] / safe * voxel_size_mm, np.inf)
        columns = {
            **_named("RGB", radiance),
            "A": opacity,
            **_named(("variance.R", "variance.G", "variance.B"), variance),
            **_named(("albedo.R", "albedo.G", "albedo.B"), self.sums[3, :, :3] / safe[:, None]),
            **_named(("T.X", "T.Y", "T.Z"), axis),
            "Z": depth,
        }
        return {
            name: data.reshape(self.height, self.width).astype(np.float32) for name, data in columns.items()
        }


def _named(names: str | tuple[str, ...], columns: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(names, columns.T, strict=True))
