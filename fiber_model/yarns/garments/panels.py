"""Front and back panels: a garment cut where it turns from facing +z to facing -z, each half laid flat.

Flattening is as rigid as possible (Liu, Zhang, Xu, Gotsman and Gortler 2008, "A local/global approach to mesh
parameterization"), begun from Tutte's embedding in a disk. Fewer and longer seams than an automatic atlas.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from weft.files.errors import InputError

from .surface_mesh import SurfaceMesh

SMOOTHING_STEPS = 40
"""Averagings of each face's orientation with its neighbors, so that wrinkles do not become panels."""
EAR_ROUNDS = 8
ROUNDS = 100
"""Local and global steps; the energy of a shirt's front has then long stopped falling."""
LEAST_WEIGHT = 0.02
"""Cotangent weights are held above this, which keeps the systems definite on obtuse triangles."""


def cut_panels(mesh: SurfaceMesh) -> SurfaceMesh:
    """The mesh with each of its panels laid flat, in mm."""
    panel = panel_of_faces(mesh)
    uv = np.zeros((mesh.face_count, 3, 2))
    right = 0.0
    for number in range(int(panel.max()) + 1):
        faces = np.flatnonzero(panel == number)
        vertex, index = np.unique(mesh.faces[faces], return_inverse=True)
        flat = flatten(mesh.vertices[vertex], index.reshape(-1, 3))
        flat = flat - flat.min(axis=0) + [right, 0.0]
        right = float(flat[:, 0].max()) * 1.05 + 1.0
        uv[faces] = flat[index.reshape(-1, 3)]
    return replace(mesh, uv=uv, uv_unit_mm=1.0)


def panel_of_faces(mesh: SurfaceMesh) -> np.ndarray:
    """Number of the panel of each face, shape [face_count]: connected parts that face front or back."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    twin = mesh.twins().reshape(-1, 3)
    neighbor = np.where(twin >= 0, twin // 3, np.arange(mesh.face_count)[:, None])
    facing = mesh.vertex_normals()[mesh.faces].mean(axis=1)[:, 2]
    for _ in range(SMOOTHING_STEPS):
        facing = 0.5 * facing + 0.5 * facing[neighbor].mean(axis=1)
    front = without_ears(facing >= 0, neighbor)
    face = np.repeat(np.arange(mesh.face_count), 3)
    same = front[face] == front[neighbor.reshape(-1)]
    links = (face[same], neighbor.reshape(-1)[same])
    graph = coo_array((np.ones(len(links[0]), np.int8), links), shape=(mesh.face_count,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1])


def without_ears(front: np.ndarray, neighbor: np.ndarray) -> np.ndarray:
    """Side of each face after faces with two neighbors on the other side went over to it, front first.

    `neighbor` has shape [face_count, 3]. Such ears flatten badly and make a ragged seam.
    """
    front = front.copy()
    for _ in range(EAR_ROUNDS):
        for side in (True, False):
            ears = (front == side) & ((front[neighbor] != side).sum(axis=1) >= 2)
            front[ears] = not side
    return front


def flatten(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """A disk of triangles laid flat as rigidly as possible, shape [vertex_count, 2] [mm]."""
    from scipy.sparse import coo_array, csc_array
    from scipy.sparse.linalg import splu

    boundary = boundary_loop(faces, len(vertices))
    rest, weight = _rest_triangles(vertices, faces)
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    rows, columns = np.concatenate([start, end]), np.concatenate([end, start])
    twice = np.concatenate([weight.reshape(-1)] * 2)
    count = len(vertices)
    adjacency = coo_array((twice, (rows, columns)), shape=(count, count)).tocsr()
    diagonal = np.asarray(adjacency.sum(axis=0)).reshape(-1)
    laplacian = csc_array(coo_array((diagonal, (np.arange(count),) * 2), shape=(count, count)) - adjacency)
    flat = _disk_embedding(vertices, boundary, laplacian)
    inner = slice(1, None)  # vertex 0 stays where it is: the energy does not feel translations
    solver = splu(csc_array(laplacian[inner, inner]))
    edges = np.roll(rest, -1, axis=1) - rest
    for _ in range(ROUNDS):
        rotation = _best_rotations(flat[faces], edges, weight)
        force = (rotation @ edges[..., None])[..., 0] * weight[..., None]
        total = np.zeros((count, 2))
        np.add.at(total, start, -force.reshape(-1, 2))
        np.add.at(total, end, force.reshape(-1, 2))
        flat = np.concatenate([np.zeros((1, 2)), solver.solve(total[inner])])
    return flat


def boundary_loop(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Vertices around a disk of triangles in order; raises `InputError` where it is no disk."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key, back = start * vertex_count + end, end * vertex_count + start
    outer = ~np.isin(key, back)
    edge_count = (len(key) + outer.sum()) // 2
    following = np.full(vertex_count, -1, np.int64)
    following[start[outer]] = end[outer]
    loop = [int(start[outer][0])] if outer.any() else []
    while loop and following[loop[-1]] != loop[0] and len(loop) <= outer.sum():
        loop.append(int(following[loop[-1]]))
    if vertex_count - edge_count + len(faces) != 1 or len(loop) != outer.sum():
        raise InputError(
            "front and back of this mesh cannot be laid flat in one piece each.",
            hint="Set yarns.surface.uv = 'unwrap', or give the mesh UVs.",
        )
    return np.array(loop)


def _rest_triangles(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle in a plane of its own, shape [n, 3, 2], and half the cotangent opposite each edge.

    Edge k leads from corner k to corner k + 1.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    along = np.linalg.norm(b - a, axis=1)
    x = ((c - a) * (b - a)).sum(axis=1) / along
    y = np.linalg.norm(np.cross(b - a, c - a), axis=1) / along
    zero = np.zeros_like(x)
    rest = np.stack([np.stack([zero, zero], 1), np.stack([along, zero], 1), np.stack([x, y], 1)], axis=1)
    to_start, to_end = rest - np.roll(rest, -2, axis=1), np.roll(rest, -1, axis=1) - np.roll(rest, -2, axis=1)
    cotangent = (to_start * to_end).sum(axis=2) / (along * y)[:, None]
    return rest, np.maximum(0.5 * cotangent, LEAST_WEIGHT)


def _disk_embedding(vertices: np.ndarray, boundary: np.ndarray, laplacian: object) -> np.ndarray:
    """Tutte's embedding: the boundary on a circle by its length, others at the mean of their neighbors."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    matrix = csc_array(laplacian)
    length = np.linalg.norm(vertices[np.roll(boundary, -1)] - vertices[boundary], axis=1)
    angle = 2 * np.pi * (np.cumsum(length) - length) / length.sum()
    flat = np.zeros((len(vertices), 2))
    flat[boundary] = length.sum() / (2 * np.pi) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    free = np.setdiff1d(np.arange(len(vertices)), boundary)
    if len(free):
        pull = -(matrix[free][:, boundary] @ flat[boundary])
        flat[free] = splu(csc_array(matrix[free][:, free])).solve(pull)
    return flat


def _best_rotations(flat: np.ndarray, edges: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The rotation of each rest triangle nearest to its place in the plane, shape [n, 1, 2, 2].

    In the plane the best angle is that of the weighted sum of conj(rest edge) * flat edge.
    """
    moved = np.roll(flat, -1, axis=1) - flat
    cosine = (weight * (edges * moved).sum(axis=2)).sum(axis=1)
    sine = (weight * (edges[..., 0] * moved[..., 1] - edges[..., 1] * moved[..., 0])).sum(axis=1)
    size = np.maximum(np.hypot(cosine, sine), 1e-300)
    c, s = cosine / size, sine / size
    return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)[:, None]
