"""The film: sums over samples, and the layers of the picture they become."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FILM_LAYERS = 5
SURFACE_FILM_LAYERS = 6
PIXELS_PER_CHUNK = 1 << 18


@dataclass
class Film:
    """Sums per pixel in float64, in the order of shaders/film/film.glsl, shape [layers, pixel_count, 4].

    `samples` in them: of all pixels, or of each, shape [pixel_count], where a run was interrupted.
    """

    width: int
    height: int
    sums: np.ndarray
    filtered: bool = False
    """Whether samples are weighed by a filter: radiance and opacity by it, first scatterings equally."""
    samples: int | np.ndarray = 0

    @classmethod
    def empty(cls, width: int, height: int, *, layers: int = FILM_LAYERS, filtered: bool = False) -> Film:
        return cls(width, height, np.zeros((layers, width * height, 4)), filtered)

    @property
    def fewest_samples(self) -> int:
        """Samples that every pixel has."""
        return int(np.min(self.samples))

    def relative_error(self) -> float:
        """Standard error of a pixel's green, in root mean square over the picture, relative to its mean."""
        n = np.maximum(self.samples, 1)
        mean = self.sums[0, :, 1] / n
        variance = np.maximum(self.sums[1, :, 1] / n - mean**2, 0) / np.maximum(n - 1, 1)
        return float(np.sqrt(variance.mean()) / max(mean.mean(), 1e-30))

    def layers(self, voxel_size_mm: float) -> dict[str, np.ndarray]:
        """Named channels, float32, shape [height, width].

        R, G, B, A: mean radiance and opacity. variance.R, .G, .B: of the mean (an upper bound, since samples
        are stratified). albedo, T, Z: mean color, fiber axis (see `_principal_axes`) and mean distance [mm]
        where camera rays first scatter. N: mean normal of the surfaces that camera rays meet
        first, toward the camera. samples, cut: how many paths, and how many of them `max_bounces` cut.
        """
        samples = np.broadcast_to(self.samples, self.sums.shape[1])
        n = np.maximum(samples, 1)
        radiance = self.sums[0, :, :3] / n[:, None]
        opacity = (self.sums[4, :, 0] if self.filtered else self.sums[0, :, 3]) / n
        squares = self.sums[1, :, :3] / n[:, None]
        variance = np.maximum(squares - radiance**2, 0) / np.maximum(n - 1, 1)[:, None]
        hits = self.sums[0, :, 3]
        safe = np.maximum(hits, 1)
        depth = np.where(hits > 0, self.sums[1, :, 3] / safe * voxel_size_mm, np.inf)
        columns = {
            **_named("RGB", radiance),
            "A": opacity,
            **_named(("variance.R", "variance.G", "variance.B"), variance),
            **_named(("albedo.R", "albedo.G", "albedo.B"), self.sums[3, :, :3] / safe[:, None]),
            **_named(("T.X", "T.Y", "T.Z"), self._axes()),
            "Z": depth,
            "samples": samples,
            "cut": self.sums[4, :, 1],
        }
        if len(self.sums) == SURFACE_FILM_LAYERS:
            met = np.maximum(self.sums[4, :, 2], 1)[:, None]
            columns |= _named(("N.X", "N.Y", "N.Z"), self.sums[5, :, :3] / met)
        return {
            name: data.reshape(self.height, self.width).astype(np.float32) for name, data in columns.items()
        }

    def _axes(self) -> np.ndarray:
        """Fiber axis of every pixel, a chunk of pixels at a time, shape [pixel_count, 3]."""
        axes = np.empty((self.sums.shape[1], 3))
        for start in range(0, len(axes), PIXELS_PER_CHUNK):
            chunk = slice(start, start + PIXELS_PER_CHUNK)
            axes[chunk] = _principal_axes(self.sums[:, chunk])
        return axes


def _principal_axes(sums: np.ndarray) -> np.ndarray:
    """The axis that most of a pixel's axes lie along, x >= 0, zero where there are none; shape [pixels, 3].

    Axial data: t and -t are the same, so the outer product is averaged; its largest eigenvector is the mean.
    """
    xx, yy, xy, xz = sums[2].T
    yz, hits = sums[3, :, 3], sums[0, :, 3] - sums[4, :, 2]
    moment = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, hits - xx - yy], axis=-1).reshape(-1, 3, 3)
    axis = np.linalg.eigh(moment)[1][..., -1]
    return np.where(hits > 0, 1.0, 0.0)[:, None] * np.where(axis[:, :1] < 0, -axis, axis)


def _named(names: str | tuple[str, ...], columns: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(names, columns.T, strict=True))
