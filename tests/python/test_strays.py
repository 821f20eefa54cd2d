"""Points that belong to no surface, and returns that never came."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

import sympose
from sympose.datasets import LABELS, part, scan


@pytest.fixture(scope="module")
def scanned() -> sympose.Scene:
    return scan(part("sprocket_6"), "sphere", views=4, seed=3).scene


def test_what_other_views_see_through_is_dropped(scanned: sympose.Scene) -> None:
    points, viewpoints = scanned.points, np.asarray(scanned.viewpoints)
    # A sheet before a face, as dense and close to it: neither density nor clusters tell it from the part.
    middle = points[np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1))]
    patch = (np.linalg.norm(points - middle, axis=1) < 0.15) & (viewpoints == viewpoints[0]).all(axis=1)
    toward = viewpoints[patch] - points[patch]
    sheet = points[patch] + 0.04 * toward / np.linalg.norm(toward, axis=1, keepdims=True)
    everything = np.concatenate([points, sheet])

    def kept(viewpoints: np.ndarray | None) -> float:
        config = sympose.Config(viewpoints_from_order=False)
        found = sympose.estimate(everything, order=6, viewpoints=viewpoints, config=config)
        return float(np.mean(np.isin(np.arange(len(points), len(everything)), found.inliers)))

    assert len(sheet) > 200
    assert kept(None) > 0.8
    assert kept(np.concatenate([viewpoints, viewpoints[patch]])) < 0.5


def test_an_ambiguous_answer_has_a_low_score() -> None:
    # The faces of a cube: three axes of order 4.
    side = np.linspace(-0.5, 0.5, 40)
    u, v = (grid.ravel() for grid in np.meshgrid(side, side))
    half = np.full_like(u, 0.5)
    faces = [
        np.roll(np.stack([u, v, sign * half], axis=1), turn, axis=1) for turn in range(3) for sign in (1, -1)
    ]
    points = np.concatenate(faces)
    normals = np.concatenate(
        [
            np.roll(np.tile([0.0, 0.0, sign], (len(u), 1)), turn, axis=1)
            for turn in range(3)
            for sign in (1, -1)
        ]
    )
    found = sympose.estimate(points, order=4, normals=normals)
    assert any("ambiguous" in warning for warning in found.warnings)
    assert found.score <= 0.5


@pytest.mark.parametrize("name", ["sprocket_6", "propeller_2"])
def test_lost_returns_are_told(name: str) -> None:
    scene = scan(part(name), "sphere", views=5, seed=1, dropout=0.3).scene
    found = sympose.estimate(scene.points, viewpoints=scene.viewpoints)
    assert any("returns are missing" in warning for warning in found.warnings)


@pytest.mark.parametrize("name", ["impeller_5", "wheel_hub_10", "knob_3", "can"])
def test_what_one_view_lost_is_no_gap_where_no_other_view_misses_it(name: str) -> None:
    scanned = scan(part(name), "sphere", views=2, seed=31, dropout=0.3)
    found = sympose.estimate(scanned.scene)
    assert found.order == scanned.order
    assert found.score > 0.8
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))


@pytest.mark.parametrize("name", ["propeller_5", "wheel_hub_5"])
def test_a_few_lost_returns_alone_are_no_reason_to_doubt_a_declared_order(name: str) -> None:
    """One view cannot tell a gap in the part from one in the scan."""
    scanned = scan(part(name), "sphere", views=1, seed=31, dropout=0.1)
    found = sympose.estimate(scanned.scene, order=scanned.order)
    assert found.score > 0.8
    assert any("was declared" in warning for warning in found.warnings)
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))
    wrong = sympose.estimate(scanned.scene, order="continuous")
    assert wrong.score < 0.5


@pytest.mark.parametrize("name", ["propeller_5", "knob_3", "sprocket_6"])
def test_one_view_that_lost_returns_is_answered_with_doubt(name: str) -> None:
    """A part that merely lacks returns had been refused, with viewpoints, but not without them."""
    scanned = scan(part(name), "sphere", views=1, seed=1, dropout=0.3)
    found = sympose.estimate(scanned.scene)
    assert found.order == scanned.order
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))
    assert found.score < 0.5
    assert any("was taken for lost: the order" in warning for warning in found.warnings)
    whole = sympose.estimate(scan(part(name), "sphere", views=1, seed=1).scene)
    assert not any("taken for lost" in warning for warning in whole.warnings)


def test_one_view_that_lost_returns_tells_no_half_turn() -> None:
    """About the edges of what one view shows of anything a half turn stands out."""
    scene = scan(part("propeller_2"), "sphere", views=1, seed=1, dropout=0.3).scene
    with pytest.raises(sympose.NoSymmetryError):
        sympose.estimate(scene)


def test_the_order_is_found_among_strays() -> None:
    scanned = scan(part("sprocket_6"), "sphere", views=4, seed=1, outliers=0.3)
    scene = scanned.scene
    found = sympose.estimate(scene.points, viewpoints=scene.viewpoints)
    assert found.order == 6
    assert found.score > 0.9
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))
    # Strays within two voxels of the surface cannot be told from noise; those in space are gone.
    config = sympose.Config(outliers={"scattered": None})
    many = sympose.estimate(scene.points, viewpoints=scene.viewpoints, order=6, config=config)
    stray = scanned.label_of_point == LABELS.index("outlier")
    assert np.sum(stray[found.inliers]) < 0.85 * np.sum(stray[many.inliers]) < 0.25 * np.sum(stray)
    assert many.score < found.score - 0.1


def test_sparse_rests_of_the_table_are_not_kept() -> None:
    # What the ground has left of itself about the part is flat and sparse, as a grazing view is.
    scanned = scan(part("sprocket_6"), "table", views=5, seed=1)
    found = sympose.estimate(scanned.scene, order=6)
    foreign = scanned.label_of_point[found.inliers] != 0
    assert found.ground is not None
    assert np.mean(foreign) < 5e-4


def test_a_sector_that_nobody_measured_is_not_taken_for_empty() -> None:
    scanned = scan(part("sprocket_6"), "sphere", views=5, seed=2, wedge_deg=90.0)
    found = sympose.estimate(scanned.scene.points, viewpoints=scanned.scene.viewpoints)
    assert found.order == 6
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))
    assert any("sector" in warning for warning in found.warnings)


@pytest.mark.parametrize(("name", "order"), [("propeller_5", 5), ("pulley", "continuous")])
def test_nothing_is_known_behind_a_sector_that_nobody_measured(name: str, order: int | str) -> None:
    # A ray through the sector may have met the part there, and one past an edge there proves nothing.
    scanned = scan(part(name), "sphere", views=5, seed=1, wedge_deg=90.0)
    found = sympose.estimate(scanned.scene.points, viewpoints=scanned.scene.viewpoints)
    assert found.order == order
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))


def test_a_sector_that_a_camera_saw_through_is_empty() -> None:
    scanned = scan(part("sprocket_6"), "table", views=5, seed=3)
    points, viewpoints = scanned.scene.points.copy(), np.asarray(scanned.scene.viewpoints)
    ground = sympose.estimate(scanned.scene, order=6).ground
    assert ground is not None
    # As if a quarter of the part were missing: the rays that met it go on to the table.
    across = np.cross(scanned.axis, [1.0, 0.0, 0.0])
    from_center = points - scanned.center
    missing = (from_center @ across > 0.0) & (from_center @ np.cross(scanned.axis, across) > 0.0)
    missing &= scanned.label_of_point == 0
    rays = points[missing] - viewpoints[missing]
    lengths = -(viewpoints[missing] @ ground[:3] + ground[3]) / (rays @ ground[:3])
    points[missing] = viewpoints[missing] + lengths[:, None] * rays
    # A flat part that misses a quarter still looks the same after half a turn about the bisector.
    with contextlib.suppress(sympose.NoSymmetryError):
        assert sympose.estimate(points, viewpoints=viewpoints).order == 2


def test_a_coarse_camera_leaves_gaps_but_the_order_is_found() -> None:
    scanned = scan(part("impeller_9"), "sphere", views=5, seed=1, low_resolution=True)
    found = sympose.estimate(scanned.scene.points, viewpoints=scanned.scene.viewpoints)
    assert found.order == 9
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.05))


def test_what_a_coarse_camera_sees_at_a_grazing_angle_is_no_gap() -> None:
    scanned = scan(part("can"), "sphere", views=5, seed=1, low_resolution=True)
    found = sympose.estimate(scanned.scene.points, viewpoints=scanned.scene.viewpoints)
    assert found.order == "continuous"
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.05))


def test_a_refusal_says_how_much_the_sensor_lost() -> None:
    # Gaps in the scan look like gaps in the part, which may be symmetric all the same.
    scene = scan(part("cam_casting"), "sphere", views=5, seed=1, dropout=0.3).scene
    with pytest.raises(sympose.NoSymmetryError, match=r"\d+ % of the returns are missing"):
        sympose.estimate(scene, views=())


@pytest.mark.parametrize("name", ["propeller_3", "impeller_9", "wheel_hub_5", "gear_12"])
def test_strays_below_a_table_do_not_keep_it_from_being_found(name: str) -> None:
    one = scan(part(name), "table", views=3, seed=2, outliers=0.1)
    found = sympose.estimate(one.scene.points, viewpoints=one.scene.viewpoints, order=one.order)
    assert found.ground is not None
    assert abs(found.axis @ one.axis) > np.cos(np.radians(0.1))
    assert found.score >= 0.5
    strays = np.mean(one.label_of_point[found.inliers] == LABELS.index("outlier"))
    assert strays < 0.005
