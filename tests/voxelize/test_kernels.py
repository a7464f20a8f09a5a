"""What one voxel receives: lengths, directions, and nothing lost at faces and corners."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

from weft.voxelize.axis_kernels import hemisphere, largest_eigenvector
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid import FiberGrid
from weft.voxelize.voxelize import voxelize_segments

RADIUS = 0.01


def voxelize(segments: np.ndarray, voxel_size_mm: float, **config) -> FiberGrid:
    made = VoxelizeConfig(voxel_size_mm=voxel_size_mm, **config)
    volume = voxelize_segments(made, np.asarray(segments, np.float32), fiber_radius_mm=RADIUS)
    return volume.grids["fiber"]


def dense(grid: FiberGrid, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Length [mm] and direction of the voxels low <= (i, j, k) < high, as dense arrays."""
    length = np.zeros((*(high - low), 1))
    direction = np.zeros((*(high - low), 3))
    to_length = grid.voxel_size_mm**3 / (math.pi * RADIUS**2)
    local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1)
    for origin, density, axis in zip(grid.origins, grid.density, grid.direction, strict=True):
        place = origin + local - low
        inside = ((place >= 0) & (place < high - low)).all(axis=1)
        length[tuple(place[inside].T)] = density[inside, None] * to_length
        direction[tuple(place[inside].T)] = axis[inside]
        assert not density[~inside].any()
    return length[..., 0], direction


def angle_between_axes(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between two axes; a sine, since the cosine resolves nothing below 0.02 degrees in float32."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    return np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.abs((a * b).sum(axis=-1))))


@wp.kernel
def eigenvectors(matrices: wp.array(dtype=wp.mat33d), out: wp.array(dtype=wp.vec3d)):
    i = wp.tid()
    m = matrices[i]
    out[i] = largest_eigenvector(wp.vec3d(m[0, 0], m[1, 1], m[2, 2]), wp.vec3d(m[0, 1], m[0, 2], m[1, 2]))


@wp.kernel
def hemispheres(axes: wp.array(dtype=wp.vec3), out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    out[i] = hemisphere(axes[i])


def launch(kernel, values: np.ndarray, kind: type, result: type) -> np.ndarray:
    out = wp.empty(len(values), dtype=result, device="cpu")
    wp.launch(kernel, dim=len(values), inputs=[wp.array(values, dtype=kind, device="cpu"), out], device="cpu")
    return out.numpy()


def test_eigenvector_equals_lapack():
    rng = np.random.default_rng(0)
    rotation, _ = np.linalg.qr(rng.normal(size=(5000, 3, 3)))
    values = rng.dirichlet([0.5, 0.5, 0.5], size=5000)
    matrices = np.einsum("nij,nj,nkj->nik", rotation, values, rotation)
    _, vectors = np.linalg.eigh(matrices)
    ordered = np.sort(values, axis=1)
    apart = ordered[:, 2] - ordered[:, 1] > 1e-6
    found = launch(eigenvectors, matrices, wp.mat33d, wp.vec3d)
    assert angle_between_axes(found, vectors[:, :, 2])[apart].max() < 0.001


def test_eigenvector_of_equal_eigenvalues_lies_in_their_plane():
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(200, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    matrices = 0.5 * (np.eye(3) - normal[:, :, None] * normal[:, None, :])
    matrices = np.concatenate([matrices, [np.diag([0.5, 0.5, 0.0]), np.diag([0.0, 0.5, 0.5]), np.eye(3) / 3]])
    normal = np.concatenate([normal, [[0, 0, 1], [1, 0, 0]]])
    found = launch(eigenvectors, matrices, wp.mat33d, wp.vec3d)
    assert np.allclose(np.linalg.norm(found, axis=1), 1)
    assert np.abs((found[:-1] * normal).sum(axis=1)).max() < 1e-6


def test_axis_and_its_opposite_are_one():
    rng = np.random.default_rng(2)
    axes = np.concatenate([rng.normal(size=(50, 3)), np.eye(3), [[1, -1, 0], [-1, 1, 0]]]).astype(np.float32)
    assert np.array_equal(
        launch(hemispheres, axes, wp.vec3, wp.vec3), launch(hemispheres, -axes, wp.vec3, wp.vec3)
    )
    assert (launch(hemispheres, axes, wp.vec3, wp.vec3)[:, 2] >= 0).all()


def test_random_segments_equal_fine_sampling():
    rng = np.random.default_rng(3)
    size, samples = 0.31, 4000
    start = rng.uniform(-2, 2, (150, 3))
    segments = np.stack([start, start + rng.normal(size=(150, 3))], axis=1).astype(np.float32)
    grid = voxelize(segments, size)
    low, high = np.full(3, -30), np.full(3, 30)
    length, direction = dense(grid, low, high)

    t = (np.arange(samples) + 0.5) / samples
    a, b = segments[:, None, 0].astype(np.float64), segments[:, None, 1].astype(np.float64)
    place = np.floor((a + (b - a) * t[None, :, None]) / size).astype(int) - low
    step = np.linalg.norm(b - a, axis=2) / samples
    axis = (b - a)[:, 0] / np.linalg.norm(b - a, axis=2)
    sampled, moment = np.zeros(high - low), np.zeros((*(high - low), 3, 3))
    index = tuple(place.reshape(-1, 3).T)
    np.add.at(sampled, index, np.repeat(step[:, 0], samples))
    np.add.at(
        moment, index, np.repeat(step[:, 0, None, None] * axis[:, :, None] * axis[:, None], samples, axis=0)
    )

    # each of the few segments in a voxel may be off by one sample at either end
    assert np.abs(length - sampled).max() < 4 * step.max()
    long = sampled > 0.1
    values, vectors = np.linalg.eigh(moment[long] / sampled[long, None, None])
    clear = values[:, 2] - values[:, 1] > 0.3
    assert clear.sum() > 500
    assert angle_between_axes(direction[long], vectors[:, :, 2])[clear].max() < 1.0


@pytest.mark.parametrize("tilt", [(0, 0, 1), (1, 2, 3), (-1, 0.001, 0), (0.3, -1, 0.2)])
def test_straight_bundle_keeps_its_direction(tilt):
    rng = np.random.default_rng(4)
    axis = np.array(tilt) / np.linalg.norm(tilt)
    middle = rng.uniform(-1, 1, (400, 1, 3))
    pieces = np.linspace(-2, 2, 31)[None, :, None] * axis + middle
    grid = voxelize(np.stack([pieces[:, :-1], pieces[:, 1:]], axis=2).reshape(-1, 2, 3), 0.1)
    occupied = grid.density > 0
    assert angle_between_axes(grid.direction[occupied], axis[None]).max() < 0.1
    assert np.abs(np.linalg.norm(grid.direction[occupied], axis=1) - 1).max() < 1e-6


def test_straight_bundle_has_the_density_of_its_spacing():
    """Fibers on a square lattice of spacing s: phi = pi a^2 / s^2 in every voxel they cross."""
    spacing, size = 0.05, 0.2
    x = (np.arange(40) + 0.5) * spacing
    x, y = np.meshgrid(x, x)
    ends = [np.stack([x, y, np.full_like(x, z)], axis=-1).reshape(-1, 3) for z in (-1.6, 1.6)]
    grid = voxelize(np.stack(ends, axis=1), size)
    expected = math.pi * RADIUS**2 / spacing**2
    assert grid.voxel_count == 10 * 10 * 16
    assert np.abs(grid.density[grid.density > 0] / expected - 1).max() < 1e-5


def test_crossed_bundles_point_along_one_of_their_plane():
    t = np.linspace(0.05, 0.95, 10)
    a = [[[0, y, 0.5], [1, y, 0.5]] for y in t]
    b = [[[x, 0, 0.5], [x, 1, 0.5]] for x in t]
    grid = voxelize(a + b, 1.0)
    assert grid.voxel_count == 1
    axis = grid.direction[grid.density > 0][0]
    assert np.linalg.norm(axis) == pytest.approx(1, abs=1e-6)
    assert abs(axis[2]) < 1e-6


def test_opposite_walks_are_the_same_fiber():
    rng = np.random.default_rng(5)
    segments = rng.uniform(-1, 1, (500, 2, 3)).astype(np.float32)
    there, back = voxelize(segments, 0.2), voxelize(segments[:, ::-1], 0.2)
    assert np.array_equal(there.origins, back.origins)
    assert np.abs(there.density - back.density).max() < 1e-5 * there.density.max()


@pytest.mark.parametrize(
    "segment",
    [
        [[0, 0, 0], [2, 2, 2]],
        [[0, 0, 0], [-2, 2, -2]],
        [[0.5, 0.5, 0], [0.5, 0.5, 3]],
        [[0, 0, 0], [0, 0, 3]],
        [[1, 1, 1], [1, 1, 1.25]],
        [[1, 0.5, 0.5], [0.9999999, 0.5, 0.5]],
        [[0.2, 0.2, 0.2], [0.3, 0.2, 0.2]],
        [[0, 0, 0], [1e-38, 0, 1]],
        [[1e-40, 0, 0], [-1e-40, 0, 1]],
        [[0, 0, 0], [-1e-40, 0, 1]],
        [[0, -1e-40, 0.7], [-1e-42, 0, -0.6]],
        [[-1e-7, -1e-7, -1e-7], [1, 1e-7, 1e-7]],
    ],
)
def test_no_length_is_lost_along_faces_edges_and_corners(segment):
    expected = np.linalg.norm(np.subtract(*np.array(segment, np.float32).astype(np.float64)))
    grid = voxelize(np.array([segment]), 0.25)
    assert grid.fiber_length_mm == pytest.approx(expected, rel=1e-6)


def test_length_is_exact_far_from_the_origin():
    """A million voxels out, where a position in voxels is good to 1/16."""
    rng = np.random.default_rng(6)
    start = np.array([5e4, -2e4, 3e4]) + rng.uniform(-1, 1, (5, 3))
    segments = np.stack([start, start + rng.uniform(-0.3, 0.3, (5, 3))], axis=1).astype(np.float32)
    expected = np.linalg.norm(segments[:, 1].astype(np.float64) - segments[:, 0], axis=1).sum()
    assert voxelize(segments, 0.05).fiber_length_mm == pytest.approx(expected, rel=1e-6)


def test_a_point_is_no_fiber():
    grid = voxelize(np.array([[[0.1, 0.2, 0.3]] * 2, [[0, 0, 0], [0, 0, 1]]]), 0.25)
    assert grid.fiber_length_mm == pytest.approx(1, rel=1e-6)
