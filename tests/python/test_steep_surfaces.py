"""A sensor that gets no return from steep surfaces, as structured light from metal."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import sympose

for library in ("trimesh", "manifold3d", "embreex"):
    pytest.importorskip(library)

from sympose import View  # noqa: E402
from sympose.datasets import part  # noqa: E402
from sympose.datasets.depth_camera import DEPTH_CAMERA, render  # noqa: E402

Floats = NDArray[np.float64]


def without_steep_surfaces(name: str, cosine: float) -> tuple[Floats, Floats]:
    """One view of a part, 45 deg from its axis, of what faces the camera by a cosine; and its place."""
    one = part(name)
    toward = np.array([0.3, 0.64, np.sqrt(0.5)])
    toward /= np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, -np.cross(toward, right), -toward], axis=1)
    pose[:3, 3] = 2.2 * toward
    image = render(one.mesh, View(DEPTH_CAMERA, pose), np.random.default_rng(1), sigma=0.0005)
    points, faces = image.points(), image.face[image.face >= 0]
    rays = points - pose[:3, 3]
    facing = -np.einsum("ij,ij->i", one.mesh.face_normals[faces], rays) / np.linalg.norm(rays, axis=1)
    return points[facing > cosine], pose[:3, 3]


@pytest.mark.parametrize("name", ["propeller_3", "wheel_hub_10", "knob_3", "flange_8", "gear_12"])
def test_what_it_lost_does_not_speak_against_the_order(name: str) -> None:
    points, place = without_steep_surfaces(name, 0.5)
    found = sympose.estimate(points, viewpoints=place, order=part(name).order)
    assert abs(found.axis[2]) > np.cos(np.radians(0.2))
    assert found.score > 0.6
