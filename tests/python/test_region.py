"""What lies outside: of the region of interest, of the cone about a hint, and far away from all the rest."""

from __future__ import annotations

import numpy as np
import pytest

import sympose

for library in ("trimesh", "manifold3d", "embreex"):
    pytest.importorskip(library)

from scipy.spatial.transform import Rotation  # noqa: E402

from sympose.datasets import Scan, part, scan  # noqa: E402


@pytest.fixture(scope="module")
def hub() -> Scan:
    return scan(part("wheel_hub_5"), "sphere", views=3, seed=1)


@pytest.mark.parametrize("margin", [0.02, 0.15])
@pytest.mark.parametrize(
    ("name", "views", "seed"), [("propeller_4", 1, 3), ("gear_12", 3, 4), ("flange_8", 2, 3)]
)
def test_a_tight_region_keeps_the_support_apart(name: str, views: int, seed: int, margin: float) -> None:
    scanned = scan(part(name), "table", views=views, seed=seed)
    own = scanned.scene.points[scanned.label_of_point == 0]
    box = [own.min(axis=0) - margin, own.max(axis=0) + margin]
    found = sympose.estimate(scanned.scene, views=(), roi=box)
    assert found.order == part(name).order
    assert found.ground is not None
    assert found.score > 0.7
    inside = np.all((scanned.scene.points >= box[0]) & (scanned.scene.points <= box[1]), axis=1)
    assert inside[found.inliers].all()
    assert (scanned.label_of_point[found.inliers] == 0).mean() > 0.98


@pytest.mark.parametrize("clutter", [0, 2])
def test_a_like_thing_beside_is_said(clutter: int) -> None:
    found = sympose.estimate(scan(part("propeller_2"), "table", views=3, seed=1, clutter=clutter).scene)
    warned = [warning for warning in found.warnings if "stands beside what was answered for" in warning]
    assert len(warned) == (clutter > 0)


def test_a_plane_that_is_asked_for_and_not_there_is_said(hub: Scan) -> None:
    config = sympose.Config(ground="on")
    found = sympose.estimate(hub.scene.points, viewpoints=hub.scene.viewpoints, order=5, config=config)
    assert (found.ground is None) == any("ground" in warning for warning in found.warnings)


@pytest.mark.parametrize("off_deg", [20.0, 40.0])
def test_no_axis_is_returned_beyond_reach_of_the_hint(hub: Scan, off_deg: float) -> None:
    across = np.cross(hub.axis, [0.3, 0.2, 0.9])
    turn = Rotation.from_rotvec(np.radians(off_deg) * across / np.linalg.norm(across))
    hint = turn.apply(hub.axis)
    cloud = {"scene": hub.scene.points[::3], "viewpoints": hub.scene.viewpoints[::3], "axis_hint": hint}
    if off_deg < 30.0:
        assert sympose.estimate(**cloud).order == 5
        return
    with pytest.raises(sympose.NoSymmetryError):
        sympose.estimate(**cloud)
    # Of a declared order there may be an axis within reach, but none to act on; nor does an earlier pose
    # lead out of it.
    for initial in (None, hub.world_from_object):
        found = sympose.estimate(**cloud, order=5, initial=initial)
        assert abs(found.axis @ hint) > np.cos(np.radians(30.1))
        assert found.score < 0.5


@pytest.mark.parametrize("far", [-9999.0, 1e5, 1e10, 3.4e38])
def test_a_wild_point_changes_nothing(hub: Scan, far: float) -> None:
    points, viewpoints = hub.scene.points[::3], hub.scene.viewpoints
    assert viewpoints is not None
    viewpoints = viewpoints[::3]
    exact = sympose.estimate(points, viewpoints=viewpoints)
    found = sympose.estimate(
        np.vstack([[[far, far, far]], points]), viewpoints=np.vstack([viewpoints[:1], viewpoints])
    )
    assert found.diagnostics["far_points"] == 1
    assert any("far points" in warning for warning in found.warnings)
    np.testing.assert_allclose(found.pose, exact.pose, atol=1e-6)
    np.testing.assert_array_equal(found.inliers, exact.inliers + 1)


@pytest.mark.parametrize(("place", "share"), [(0.0, 1.5), (-0.0, 0.1), (65.535, 0.1), (65.535, 4.0)])
def test_points_that_stand_for_no_return_are_left_out(hub: Scan, place: float, share: float) -> None:
    points, viewpoints = hub.scene.points[::3], hub.scene.viewpoints
    assert viewpoints is not None
    exact = sympose.estimate(points, viewpoints=viewpoints[::3])
    count = int(share * len(points))
    # In the middle of the points, as in a picture.
    with_zeros = np.insert(points, len(points) // 2, np.full((count, 3), place), axis=0)
    seen_from = np.insert(viewpoints[::3], len(points) // 2, np.zeros((count, 3)), axis=0)
    found = sympose.estimate(with_zeros, viewpoints=seen_from, timeout=60.0)
    assert found.diagnostics["coinciding_points"] == count
    assert any(str(count) in warning and "one place" in warning for warning in found.warnings)
    np.testing.assert_array_equal(found.pose, exact.pose)
    np.testing.assert_array_equal(with_zeros[found.inliers], points[exact.inliers])


@pytest.mark.parametrize(("level", "share"), [(-999.0, 0.5), (-9999.0, 3.0), (32767.0, 0.05)])
def test_a_height_that_stands_for_no_return_is_left_out(hub: Scan, level: float, share: float) -> None:
    """As of a profiler that writes a number for the height, and the place beside it."""
    points, viewpoints = hub.scene.points[::3], hub.scene.viewpoints
    assert viewpoints is not None
    exact = sympose.estimate(points, viewpoints=viewpoints[::3])
    beside = np.random.default_rng(0).uniform(-1, 1, size=(int(share * len(points)), 3))
    beside[:, 2] = level
    found = sympose.estimate(
        np.vstack([points, beside]), viewpoints=np.vstack([viewpoints[::3], np.zeros_like(beside)])
    )
    assert found.diagnostics["coinciding_points"] == len(beside)
    assert any("far value of a coordinate" in warning for warning in found.warnings)
    np.testing.assert_array_equal(found.pose, exact.pose)


def test_what_lies_at_one_height_near_the_rest_is_kept(hub: Scan) -> None:
    """A made-up plane, below a part that hovers over it, and points of one plane with a stray above it."""
    plane = np.random.default_rng(0).uniform(-1, 1, size=(20_000, 3))
    plane[:, 2] = hub.scene.points[:, 2].min() - 1.0
    found = sympose.estimate(np.vstack([hub.scene.points, plane]), order=hub.order)
    assert found.diagnostics["coinciding_points"] == 0
    disc = plane[np.linalg.norm(plane[:, :2], axis=1) < 1]
    found = sympose.estimate(np.vstack([disc, disc[:1] + [0, 0, 1e6]]), order=2)
    assert found.diagnostics["coinciding_points"] == 0
    assert found.diagnostics["far_points"] == 1


def test_zeros_do_not_hide_the_order_of_the_points(hub: Scan) -> None:
    """Of a picture whose pixels without a return are zeros."""
    first = hub.scene.points[np.asarray(hub.view_of_point) == 0]
    with_zeros = np.insert(first, np.arange(0, len(first), 50).repeat(80), np.zeros(3), axis=0)
    found, exact = sympose.estimate(with_zeros), sympose.estimate(first)
    assert found.diagnostics["viewpoints_from_order"]
    np.testing.assert_array_equal(found.pose, exact.pose)
