"""The camera sees what its settings say."""

from __future__ import annotations

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.camera import place_camera
from weft.renderer.config import OrthographicCamera, PerspectiveCamera

BOX = np.array([[-3.0, -2.0, -0.5], [3.0, 4.0, 0.5]])


def project(frame, points):
    """Picture coordinates in [-1, 1] of points [mm]."""
    offset = points - frame.position
    depth = offset @ frame.forward
    right, up = frame.right, frame.up
    x, y = offset @ right / (right @ right), offset @ up / (up @ up)
    return np.stack([x, y], axis=-1) / (depth[..., None] if frame.perspective else 1.0)


def corners(box=BOX):
    return np.array([[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])


@pytest.mark.parametrize("kind", [PerspectiveCamera, OrthographicCamera])
@pytest.mark.parametrize("view", [None, (1.0, 0.5, 2.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])
@pytest.mark.parametrize("resolution", [(400, 300), (200, 500)])
def test_the_whole_volume_is_in_the_picture(kind, view, resolution):
    frame = place_camera(kind(view_direction=view), BOX, resolution)
    place = project(frame, corners())
    assert np.abs(place).max() <= 1
    assert np.abs(place).max() > 0.6  # and fills it


def test_default_view_is_across_the_thinnest_side():
    frame = place_camera(PerspectiveCamera(), BOX, (100, 100))
    np.testing.assert_allclose(frame.forward, [0, 0, -1])
    np.testing.assert_allclose(frame.axes, np.eye(3), atol=1e-15)


def test_a_cloth_on_the_ground_has_its_far_side_up():
    frame = place_camera(PerspectiveCamera(view_direction=(0, 1, 0)), BOX, (100, 100))
    np.testing.assert_allclose(frame.axes, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)


@pytest.mark.parametrize("kind", [PerspectiveCamera, OrthographicCamera])
def test_close_up_shows_the_width_asked_for(kind):
    frame = place_camera(kind(target_mm=(1.0, 0.5, 0.0), frame_width_mm=2.0), BOX, (300, 150))
    edge = project(frame, np.array([[2.0, 0.5, 0.0], [1.0, 1.0, 0.0], [1.0, 0.5, 0.0]]))
    np.testing.assert_allclose(edge, [[1, 0], [0, 1], [0, 0]], atol=1e-12)


def test_field_of_view_is_horizontal():
    frame = place_camera(
        PerspectiveCamera(position_mm=(0, 1, 10), target_mm=(0, 1, 0), fov_deg=90), BOX, (2, 1)
    )
    assert np.linalg.norm(frame.right) == pytest.approx(1)
    assert np.linalg.norm(frame.up) == pytest.approx(0.5)


def test_a_camera_at_its_target_is_refused():
    with pytest.raises(InputError, match="the camera stands at its target"):
        place_camera(PerspectiveCamera(position_mm=(1, 1, 1), target_mm=(1, 1, 1)), BOX, (2, 2))
