"""A dress form for the shirt, made from it: `python -m tests.jobs.dress_form tests/jobs/dress_form.obj`.

Ring by ring around the y axis: in every direction the form ends a few mm inside the cloth, or as a torso
would where the cloth is a sleeve or an opening. It begins above the hem; its neck stands out of the collar.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.garments.mesh_files import read_mesh

SHIRT = Path(__file__).parents[3] / "shared/data/garments/unisex_shirt.usd"
ANGLES = 96
STEP_MM = 8.0
EASE_MM = 6.0
"""Between form and cloth; the cloth is up to 2 mm thick on either side of its surface."""
HALF_WIDTH_MM, HALF_DEPTH_MM = 150.0, 140.0
"""Of the torso, where no cloth is nearer."""
SHOULDER_MM, NECK_FROM_MM, NECK_RADIUS_MM = 1420.0, 1510.0, 45.0
"""Heights between which shoulders become the neck, and its radius."""
HEIGHTS_MM = np.arange(905.0, 1570.0, STEP_MM)
SAMPLES = 400_000
"""Places on the cloth, 1.3 mm apart."""


def dress_form(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [mm], shape [n, 3], and triangles, shape [m, 3], of the form; closed, normals outward."""
    import trimesh

    cloth = trimesh.Trimesh(vertices, faces, process=False)
    points = np.asarray(trimesh.sample.sample_surface(cloth, SAMPLES, seed=1)[0])
    points = points[np.argsort(points[:, 1])]
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    radius, depth = np.empty((len(HEIGHTS_MM), ANGLES)), np.empty(len(HEIGHTS_MM))
    for ring, y in enumerate(HEIGHTS_MM):
        near = points[slice(*np.searchsorted(points[:, 1], (y - STEP_MM, y + STEP_MM)))]
        core = near[np.abs(near[:, 0]) < 40, 2]
        depth[ring] = 0.5 * (core.min() + core.max()) if y < SHOULDER_MM else depth[ring - 1]
        radius[ring] = np.minimum(_reach(near - [0, y, depth[ring]]), _torso(y, angle))
    radius = _mean(_least(radius))
    x, z = radius * np.cos(angle), radius * np.sin(angle) + depth[:, None]
    rings = np.stack([x, np.broadcast_to(HEIGHTS_MM[:, None], x.shape), z], axis=-1)
    return _closed(rings)


def _reach(offsets: np.ndarray) -> np.ndarray:
    """Distance to the nearest cloth in each direction, less the ease [mm]; infinite where there is none."""
    direction = np.rint(np.arctan2(offsets[:, 2], offsets[:, 0]) * ANGLES / (2 * np.pi)).astype(int) % ANGLES
    nearest = np.full(ANGLES, np.inf)
    np.minimum.at(nearest, direction, np.hypot(offsets[:, 0], offsets[:, 2]))
    return nearest - EASE_MM


def _torso(y: float, angle: np.ndarray) -> np.ndarray:
    """Radius [mm] of an ellipse that narrows from the shoulders to the neck."""
    share = np.clip((y - SHOULDER_MM) / (NECK_FROM_MM - SHOULDER_MM), 0, 1)
    width, depth = (half + share * (NECK_RADIUS_MM - half) for half in (HALF_WIDTH_MM, HALF_DEPTH_MM))
    return 1 / np.hypot(np.cos(angle) / width, np.sin(angle) / depth)


def _least(radius: np.ndarray) -> np.ndarray:
    """Least of the rings and directions around each, so that the mean over as many is never too large."""
    around = [np.roll(radius, k, axis=1) for k in range(-4, 5)]
    rows = np.pad(np.min(around, axis=0), ((2, 2), (0, 0)), mode="edge")
    return np.min([rows[k : k + len(radius)] for k in range(5)], axis=0)


def _mean(radius: np.ndarray) -> np.ndarray:
    around = [np.roll(radius, k, axis=1) for k in range(-4, 5)]
    rows = np.pad(np.mean(around, axis=0), ((2, 2), (0, 0)), mode="edge")
    return np.mean([rows[k : k + len(radius)] for k in range(5)], axis=0)


def _closed(rings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles between neighboring rings, with a lid below and above."""
    count, around = rings.shape[:2]
    number = np.arange(count * around).reshape(count, around)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = number[1:], np.roll(number[1:], -1, axis=1)
    sides = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)])
    middles = rings[[0, -1]].mean(axis=1)
    foot, top = number[0], number[-1]
    below = np.stack([np.full(around, number.size), foot, np.roll(foot, -1)], -1)
    above = np.stack([np.full(around, number.size + 1), np.roll(top, -1), top], -1)
    return np.concatenate([rings.reshape(-1, 3), middles]), np.concatenate([sides, below, above])


def main() -> None:
    """Write the form as an OBJ file."""
    import trimesh

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    cloth = read_mesh(SHIRT, scale_to_mm=10.0, up_axis=1)
    form = trimesh.Trimesh(*dress_form(cloth.vertices, cloth.faces), process=False)
    form.export(parser.parse_args().file)


if __name__ == "__main__":
    main()
