"""Random rays: fibers hit, counted exactly, against the optical depth of the grid made of the same fibers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.voxelize.rays import fibers_hit, optical_depth, random_rays
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.voxelize import voxelize_segments

RADIUS = 0.01


@pytest.fixture(scope="module")
def segments(fibers) -> np.ndarray:
    """All fibers of the two crossing yarns, [segment_count, 2, 3]."""
    from weft.fiber_model.fiber_curves import FiberSelection, export_curves

    curves = export_curves(fibers, FiberSelection())
    pairs = np.stack([curves.points[:-1], curves.points[1:]], axis=1)
    inside = np.ones(len(pairs), dtype=bool)
    inside[curves.offsets[1:-1] - 1] = False
    return pairs[inside]


def measure(
    segments: np.ndarray, sizes: list[float], count: int
) -> tuple[np.ndarray, dict[float, np.ndarray]]:
    """Hits of each ray; and per voxel size the depths by direction and by second moment, [2, ray]."""
    low, high = np.array([-1.5, -1.5, -0.6]), np.array([1.5, 1.5, 0.8])
    points, w = random_rays(low, high, count, seed=0)
    depths = {}
    for size in sizes:
        config = VoxelizeConfig(voxel_size_mm=size, second_moment=True)
        grid = voxelize_segments(config, segments, fiber_radius_mm=RADIUS).grids["fiber"]
        depths[size] = np.stack(
            [optical_depth(grid, points, w, 12.0, by_moment=moment) for moment in (False, True)]
        )
    return fibers_hit(segments, RADIUS, points, w), depths


def standard_error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / math.sqrt(len(values)))


def test_rays_hit_as_many_fibers_as_the_grid_says(segments):
    """The mean optical depth is the mean number of fibers hit, up to four standard errors of their difference
    (6e-5 of all seeds) and 2 %, what several directions in a voxel may add by Jensen's inequality."""
    hits, depths = measure(segments, [0.03], 400)
    difference = depths[0.03][1] - hits
    assert abs(difference.mean()) < 4 * standard_error(difference) + 0.02 * hits.mean()
    # so sure is the statement: a wrong factor of 1.3 would be seen
    assert standard_error(difference) < 0.07 * hits.mean()


@pytest.mark.proof
def test_table_of_errors_against_voxel_size(segments, capsys):
    """Prints the table of the README; the error falls with the voxel."""
    sizes = [0.4, 0.2, 0.1, 0.05, 0.025, 0.0125]
    hits, depths = measure(segments, sizes, 4000)
    clear = float((hits == 0).mean())
    with capsys.disabled():
        print(f"\nhits {hits.mean():.3f} +- {standard_error(hits):.3f}, clear rays {clear:.4f}")
        for size in sizes:
            cells = [f"{size / RADIUS:5.2f} a"]
            for tau in depths[size]:
                difference = tau - hits
                error, doubt = difference.mean() / hits.mean(), standard_error(difference) / hits.mean()
                cells.append(f"{error:+.2%} +- {doubt:.2%}, T {np.exp(-tau).mean():.4f}")
            print(" | ".join(cells))
    errors = [abs(float((depths[size][1] - hits).mean())) / hits.mean() for size in sizes]
    assert errors[-1] < 0.02
