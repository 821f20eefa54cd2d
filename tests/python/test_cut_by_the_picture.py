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
