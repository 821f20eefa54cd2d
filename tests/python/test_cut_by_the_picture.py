"""A part that is larger than the picture of a camera: beyond the picture nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

import sympose
from sympose.camera import PinholeCamera, View
from sympose.datasets import Scan, part, scan
from sympose.scene import Scene


def cut(scanned: Scan, width: int, height: int) -> Scene:
    """The middle of the pictures of a scan, by a camera that shows no more."""
    points, viewpoints, views = [], [], []
    for index, view in enumerate(scanned.scene.views):
        wide = view.camera
        left, top = (wide.width - width) // 2, (wide.height - height) // 2
        narrow = PinholeCamera(width, height, wide.fx, wide.fy, wide.cx - left, wide.cy - top)
        views.append(View(narrow, view.world_from_camera))
        own = scanned.scene.points[scanned.view_of_point == index]
        shown = own[views[-1].project(own)[2]]
        assert len(shown) < 0.9 * len(own)
        points.append(shown)
        viewpoints.append(np.tile(view.center, (len(shown), 1)))
    return Scene(np.vstack(points), viewpoints=np.vstack(viewpoints), views=tuple(views))


@pytest.mark.parametrize("name", ["flange_8", "wheel_hub_5", "gear_12"])
@pytest.mark.parametrize("views", [1, 3])
def test_a_picture_that_cuts_the_part_does_not_cut_its_order(name: str, views: int) -> None:
    scanned = scan(part(name), views=views, seed=4)
    found = sympose.estimate(cut(scanned, 200, 150))
    assert found.order == scanned.order
    assert np.degrees(np.arccos(abs(found.axis @ scanned.axis))) < 0.2
    assert not any("returns are missing" in warning for warning in found.warnings)


def test_an_empty_table_is_no_part_to_act_on() -> None:
    camera = PinholeCamera(320, 240, 400.0, 400.0, 159.5, 119.5)
    points, places, views = [], [], []
    for turn in (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0):
        place = np.array([np.cos(turn), np.sin(turn), 1.5])
        forward = -place / np.linalg.norm(place)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        pose[:3, 3] = place
        row, column = np.mgrid[:240, :320]
        rays = np.stack([(column - 159.5) / 400.0, (row - 119.5) / 400.0, np.ones((240, 320))], axis=-1)
        rays = rays.reshape(-1, 3) @ pose[:3, :3].T
        depth = -place[2] / rays[:, 2] + np.random.default_rng(int(turn)).normal(0.0, 1e-3, len(rays))
        points.append(place + rays * depth[:, None])
        places.append(np.tile(place, (len(rays), 1)))
        views.append(View(camera, pose))
    scene = Scene(np.vstack(points), viewpoints=np.vstack(places), views=tuple(views))
    try:
        found = sympose.estimate(scene)
    except sympose.NoSymmetryError:
        return
    assert found.score < 0.5
    assert any("lies in one plane" in warning for warning in found.warnings)


@pytest.mark.parametrize("height", [0.8, 0.5, 0.2])
def test_a_flat_rectangle_is_no_disc(height: float) -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.5, 0.5, (30_000, 3)) * [1.0, height, 0.0]
    points[:, 2] = rng.normal(0.0, 1e-3, len(points))
    found = sympose.estimate(points, viewpoints=[0.0, 0.0, 3.0])
    assert found.order == 2 or (found.score < 0.5 and any("one plane" in w for w in found.warnings))


def test_a_flat_disc_is_one() -> None:
    rng = np.random.default_rng(3)
    radius, angle = np.sqrt(rng.uniform(0.05, 0.25, 30_000)), rng.uniform(0.0, 2.0 * np.pi, 30_000)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.normal(0.0, 1e-3, 30_000)], axis=1)
    found = sympose.estimate(points, viewpoints=[0.0, 0.0, 3.0])
    assert (found.order, found.score > 0.9) == ("continuous", True)
