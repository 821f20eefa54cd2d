"""What may be passed in, in which form, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import sympose
from conftest import ORDER, Part, make_part
from sympose import Config, InsufficientDataError, InvalidInputError, PinholeCamera, Scene, View, datasets

Points = NDArray[np.float64]


def read_only(points: Points) -> Points:
    copy = points.copy()
    copy.setflags(write=False)
    return copy


def unaligned(points: Points) -> Points:
    buffer = np.zeros(points.nbytes + 1, dtype=np.uint8)
    view = buffer[1:].view(np.float64).reshape(points.shape)
    view[...] = points
    assert not view.flags.aligned
    return view


FORMS: dict[str, Callable[[Points], Any]] = {
    "fortran": np.asfortranarray,
    "strided": lambda points: np.repeat(points, 2, axis=0)[::2],
    "columns": lambda points: np.hstack([points, points])[:, :3],
    "reversed": lambda points: points[::-1].copy()[::-1],
    "read_only": read_only,
    "unaligned": unaligned,
    "big_endian": lambda points: points.astype(">f8"),
    "list": lambda points: points.tolist(),
}


def estimate(scene: Any, part: Part, **options: Any) -> sympose.Estimate:
    options = {"order": ORDER, "viewpoints": part.viewpoint} | options
    return sympose.estimate(scene, **options)


def bytes_of(estimate: sympose.Estimate) -> tuple[bytes, ...]:
    return estimate.pose.tobytes(), estimate.points.tobytes(), estimate.completed.tobytes()


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_an_array_gives_the_same_bytes(form: str) -> None:
    part = make_part(1500)
    points = FORMS[form](part.points)
    assert bytes_of(estimate(points, part)) == bytes_of(estimate(part.points, part))
    means = sympose.voxel_downsample(points, 0.05)
    assert np.array_equal(means, sympose.voxel_downsample(part.points, 0.05))
    oracle = sympose.KdTree(part.points).query(part.points, 4)[1]
    assert np.array_equal(sympose.KdTree(points).query(points, 4)[1], oracle)


def test_float32_is_taken_for_what_it_is() -> None:
    part = make_part(1500)
    single = part.points.astype(np.float32)
    assert bytes_of(estimate(single, part)) == bytes_of(estimate(single.astype(np.float64), part))
    assert bytes_of(estimate(np.asfortranarray(single), part)) == bytes_of(estimate(single, part))


def test_integers_are_taken_as_lengths() -> None:
    part = make_part(1500)
    whole = np.rint(part.points * 10_000).astype(np.int32)
    viewpoint = part.viewpoint * 10_000
    one = estimate(whole, part, viewpoints=viewpoint)
    assert bytes_of(one) == bytes_of(estimate(whole.astype(float), part, viewpoints=viewpoint))


def test_the_input_is_left_alone(part: Part) -> None:
    before = part.points.copy()
    estimate(part.points, part)
    assert np.array_equal(part.points, before)


class Mesh:
    """As trimesh has it."""

    def __init__(self, vertices: Points) -> None:
        self.vertices = vertices


def test_other_libraries_are_known_by_what_they_have(part: Part, estimate: sympose.Estimate) -> None:
    cloud = SimpleNamespace(points=part.points, normals=np.zeros((3, 3)))
    for scene in (cloud, Mesh(part.points), Scene(part.points)):
        found = sympose.estimate(scene, order=ORDER, viewpoints=part.viewpoint)
        assert bytes_of(found) == bytes_of(estimate)
    with pytest.raises(InvalidInputError, match=r"scene\.points"):
        sympose.estimate(SimpleNamespace(points=np.zeros((4, 2))))


def test_the_vertices_of_a_mesh_are_remarked_on(part: Part, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    triangles = [[0, 1, 2]]
    mesh = trimesh.Trimesh(part.points, triangles, process=False)
    path = tmp_path / "mesh.ply"
    path.write_bytes(trimesh.exchange.ply.export_ply(mesh))
    of_open3d = SimpleNamespace(vertices=part.points, triangles=triangles, vertex_normals=[])
    for scene in (mesh, of_open3d, path):
        assert "the scan is a mesh" in estimate(scene, part).warnings[0]
    without = SimpleNamespace(vertices=part.points, triangles=np.empty((0, 3)))
    for cloud in (trimesh.PointCloud(part.points), without):
        assert not estimate(cloud, part).warnings


def test_objects_of_open3d_and_trimesh(part: Part, estimate: sympose.Estimate) -> None:
    trimesh = pytest.importorskip("trimesh")
    cloud = trimesh.PointCloud(part.points)
    found = sympose.estimate(cloud, order=ORDER, viewpoints=part.viewpoint)
    assert bytes_of(found) == bytes_of(estimate)


def test_the_normals_of_an_open3d_cloud_count(part: Part) -> None:
    normals = sympose.estimate_normals(part.points, viewpoints=part.viewpoint)
    cloud = SimpleNamespace(points=part.points, normals=normals)
    found = sympose.estimate(cloud, order=ORDER, viewpoints=part.viewpoint)
    given = sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint, normals=normals)
    assert bytes_of(found) == bytes_of(given)
    without = sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint)
    assert bytes_of(found) != bytes_of(without)


def test_a_path_is_read(part: Part, estimate: sympose.Estimate, tmp_path: Path) -> None:
    path = tmp_path / "scan.npy"
    np.save(path, part.points)
    for scene in (path, str(path)):
        found = sympose.estimate(scene, order=ORDER, viewpoints=part.viewpoint)
        assert bytes_of(found) == bytes_of(estimate)
    with pytest.raises(FileNotFoundError):
        sympose.estimate(tmp_path / "nothing.ply")


def test_a_scene_brings_its_viewpoints_and_normals(part: Part, estimate: sympose.Estimate) -> None:
    found = sympose.estimate(Scene(part.points, viewpoints=part.viewpoint), order=ORDER)
    assert np.allclose(found.pose, estimate.pose, atol=1e-9)
    rows = np.tile(part.viewpoint, (len(part.points), 1))
    one_each = sympose.estimate(part.points, viewpoints=rows, order=ORDER)
    assert bytes_of(one_each) == bytes_of(found)


def test_points_that_are_not_finite_are_dropped_and_indices_kept(part: Part) -> None:
    rng = np.random.default_rng(2)
    rows = np.sort(rng.permutation(len(part.points) + 500)[: len(part.points)])
    points = np.full((len(part.points) + 500, 3), np.nan)
    points[rows] = part.points
    clean = estimate(part.points, part)
    found = estimate(points, part)
    assert bytes_of(found) == bytes_of(clean)
    assert np.array_equal(found.inliers, rows[clean.inliers])
    with pytest.raises(InvalidInputError, match="500 of"):
        estimate(points, part, config=Config(non_finite="error"))


def test_masked_points_are_dropped_or_refused(part: Part) -> None:
    points = np.ma.array(np.vstack([part.points, part.points[:50] + 9.0]))
    points[len(part.points) :] = np.ma.masked
    found = estimate(points, part)
    assert bytes_of(found) == bytes_of(estimate(part.points, part))
    assert found.diagnostics["non_finite_points"] == 50
    with pytest.raises(InvalidInputError, match="50 of"):
        sympose.voxel_downsample(points, 0.1)


def test_far_from_the_origin_nothing_is_lost(part: Part, estimate: sympose.Estimate) -> None:
    offset = np.array([4.5e6, -5.4e6, 250.0])
    found = sympose.estimate(part.points + offset, order=ORDER, viewpoints=part.viewpoint + offset)
    assert np.abs(found.axis - estimate.axis).max() < 1e-6
    assert np.abs(found.center - offset - estimate.center).max() < 1e-6


def test_what_is_no_array_of_points_is_named(part: Part) -> None:
    scene = Scene(part.points)
    with pytest.raises(InvalidInputError, match=r"\(4, 3, 3\); an organised cloud is \.reshape\(-1, 3\)"):
        sympose.estimate(np.zeros((4, 3, 3)))
    with pytest.raises(InvalidInputError, match="a list of scenes or clouds; join them"):
        sympose.estimate([scene, scene])
    with pytest.raises(InvalidInputError, match="must be an array, got Scene; pass the points that it holds"):
        sympose.write("scan.ply", scene)


BAD_SHAPES = np.zeros(3), np.zeros((5, 4)), np.zeros((2, 2, 3)), 7.0, [], [[1, 2]], ["a", "b"]


@pytest.mark.parametrize("bad", BAD_SHAPES, ids=str)
def test_a_wrong_shape_is_named(bad: Any) -> None:
    with pytest.raises(InvalidInputError):
        sympose.estimate(bad)


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        np.zeros((1, 3)),
        np.zeros((500, 3)),
        np.linspace(0, 1, 500)[:, None] * [1.0, 2.0, 3.0],
        np.eye(3),
    ],
    ids=["empty", "one", "identical", "collinear", "three"],
)
def test_degenerate_clouds_are_refused(points: Points) -> None:
    with pytest.raises(InsufficientDataError):
        sympose.estimate(points, order=3)


@pytest.mark.parametrize("order", ["continuous", 60, 360, None])
@pytest.mark.parametrize("shape", ["square", "disc", "grid"])
def test_a_hint_along_a_plane_leads_to_no_axis_far_away(shape: str, order: int | str | None) -> None:
    sheet = np.zeros((2000, 3))
    sheet[:, :2] = np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 2))
    if shape == "disc":
        sheet = sheet[np.linalg.norm(sheet, axis=1) < 0.5]
    if shape == "grid":
        sheet[:, :2] = np.round(sheet[:, :2] * 30.0) / 30.0
    try:
        found = sympose.estimate(sheet, order=order, axis_hint=[1.0, 0.0, 0.0])
    except sympose.NoSymmetryError:
        return
    assert found.score < 0.5
    assert np.linalg.norm(found.center) < 2.0


def test_a_completed_cloud_without_bounds_is_refused(part: Part) -> None:
    anything = {"min_neighbors": 0, "radius": 1e6, "scattered": None, "off_surface": None, "std_ratio": 1e6}
    fine = Config(voxel_size=1e-5, cluster="off", outliers=anything)
    with pytest.raises(InvalidInputError, match="voxel_size"):
        sympose.estimate(part.points, order="continuous", viewpoints=part.viewpoint, config=fine)


def test_all_nan_overflowing_and_vanishing_clouds_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="500 of 500"):
        sympose.estimate(np.full((500, 3), np.nan), order=3)
    with pytest.raises(InvalidInputError, match="1e18"):
        sympose.estimate(np.eye(3) * 1e200, order=3)
    with pytest.raises(InvalidInputError, match="at least 1e-18"):
        sympose.estimate(np.eye(3) * 1e-200, order=3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 1}, "order"),
        ({"order": -3}, "order"),
        ({"order": 2.5}, "order"),
        ({"order": "many"}, "order"),
        ({"order": 5.0}, r"order = 5.0: expected a whole number of at least 2, \"continuous\", or None"),
        ({"order": np.float64(5)}, "order = .*5.0.*: expected a whole number of at least 2"),
        ({"order": True}, "order = True: expected a whole number of at least 2"),
        ({"order": 2**70}, r"order = 1\.18\d+e21: expected a whole number from 2 to 360"),
        ({"order": [5]}, r"order = \[5\]: expected a whole number"),
        ({"views": 7}, "views must be a sequence"),
        ({"viewpoints": [0.0, 0.0]}, "viewpoints"),
        ({"viewpoints": np.zeros((7, 3))}, "viewpoints has 7 rows"),
        ({"viewpoints": [0.0, 0.0, np.nan]}, "viewpoints = 1 of 1 rows with a coordinate that is NaN"),
        ({"normals": np.zeros((7, 3))}, "normals has 7 rows"),
        ({"normals": np.zeros(3)}, "normals"),
        ({"roi": [[0, 0, 0]]}, "roi"),
        ({"roi": [[1, 1, 1], [0, 0, 0]]}, "roi"),
        ({"roi": [[0, 0, 0], [1, 1, np.nan]]}, "roi"),
        ({"axis_hint": [0, 0, 0]}, "axis_hint"),
        ({"axis_hint": [1, 0]}, "axis_hint"),
        ({"initial": np.eye(3)}, "initial"),
        ({"initial": 2.0 * np.eye(4)}, "initial"),
        ({"prefer": np.diag([1, 1, -1, 1])}, "prefer"),
        ({"threads": 0}, "threads"),
        ({"threads": -1}, "threads"),
        ({"threads": 100_000}, "threads = 100000: expected 1 to 1,024"),
        ({"seed": -1}, r"seed: .*-1.*, expected a whole number from 0 to 9,223"),
        ({"seed": 2**63}, "seed = 9223372036854775808: expected a whole number from 0 to 9,223"),
        ({"seed": 2**64}, "seed: .*expected a whole number from 0 to 9,223"),
        ({"viewpoints": [0.0, 0.0, 1e300]}, "1 of 1 rows with a coordinate .* beyond 1e18"),
        ({"timeout": 0.0}, "timeout"),
        ({"timeout": float("nan")}, "timeout"),
        ({"timeout": "2"}, "timeout = '2': expected a positive number of seconds"),
        ({"timeout": [1.0, 2.0]}, "timeout"),
        ({"progress": 1}, "progress = 1: expected a function"),
    ],
)
def test_a_wrong_argument_is_named(part: Part, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        sympose.estimate(part.points, **({"order": ORDER} | options))


def test_an_order_may_be_any_whole_number(part: Part, estimate: sympose.Estimate) -> None:
    for order in (np.int64(ORDER), np.uint8(ORDER), np.array(ORDER)):
        found = sympose.estimate(part.points, order=order, viewpoints=part.viewpoint)  # type: ignore[arg-type]
        assert bytes_of(found) == bytes_of(estimate)


def test_one_where_several_are_expected_is_answered_with_what_to_do(part: Part) -> None:
    camera = PinholeCamera(4, 3, 4.0, 4.0, 1.5, 1.0)
    view: Any = View(camera, np.eye(4))
    scene: Any = Scene(part.points)
    for call in (
        lambda: sympose.estimate(part.points, views=view),
        lambda: sympose.segment(part.points, view),
        lambda: Scene(part.points, views=view),
    ):
        with pytest.raises(InvalidInputError, match=r"got one View; pass \[view\]"):
            call()
    with pytest.raises(InvalidInputError, match=r"got one Scene; pass \[scene, ...\]"):
        Scene.merge(scene)
    with pytest.raises(InvalidInputError, match="sequence of scenes, got int"):
        Scene.merge(7)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=r"got NoneType; pass PinholeCamera\("):
        Scene.from_depth(np.ones((3, 4)), None)  # type: ignore[arg-type]


def test_an_argument_wins_over_the_configuration(part: Part) -> None:
    config = Config(order=3, seed=4)
    assert sympose.estimate(part.points, order=ORDER, config=config, viewpoints=part.viewpoint).order == ORDER


def test_outside_the_region_of_interest_nothing_counts(part: Part) -> None:
    lower, upper = part.points.min(axis=0) - 0.01, part.points.max(axis=0) + 0.01
    stray = np.random.default_rng(0).uniform(upper + 0.1, upper + 1.0, (3000, 3))
    found = estimate(np.vstack([stray, part.points]), part, roi=[lower, upper])
    assert (found.inliers >= len(stray)).all()
    assert abs(found.axis @ part.axis) > np.cos(np.radians(0.5))


def test_tracking_starts_from_an_estimate_or_a_matrix(part: Part, estimate: sympose.Estimate) -> None:
    for initial in (estimate, estimate.pose):
        found = sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint, initial=initial)
        assert abs(found.axis @ estimate.axis) > np.cos(np.radians(0.2))


def test_tracking_sees_the_free_space_about_a_part_on_a_table() -> None:
    scanned = datasets.scan(datasets.part("propeller_3"), "table", views=5, seed=1)
    whole = sympose.estimate(scanned.scene, order=3)
    few = sympose.Config(tracking={"points": 20_000})
    tracked = sympose.estimate(scanned.scene, order=3, initial=whole, config=few)
    assert tracked.ground is not None
    assert len(tracked.inliers) <= 20_000 < len(whole.inliers)
    assert "tracking" not in tracked.diagnostics
    assert tracked.score > whole.score - 0.03
    assert abs(tracked.axis @ scanned.axis) > np.cos(np.radians(0.1))


def test_the_preferred_pose_is_the_nearest_equivalent(part: Part, estimate: sympose.Estimate) -> None:
    for wanted in estimate.equivalent_poses():
        found = estimate_with_preference(part, wanted)
        angle = np.arccos(np.clip((np.trace(found.pose[:3, :3].T @ wanted[:3, :3]) - 1) / 2, -1, 1))
        assert angle < np.pi / ORDER
    again = sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint, prefer=found)
    assert again.pose.tobytes() == found.pose.tobytes()


def estimate_with_preference(part: Part, wanted: Points) -> sympose.Estimate:
    return sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint, prefer=wanted)


def seen_before_a_wall(part: Part) -> tuple[Scene, int]:
    """The part before a wall as one view sees both, and how many points the wall has; they come first."""
    camera = PinholeCamera(320, 240, 500.0, 500.0, 159.5, 119.5)
    forward = part.world_from_object[:3, 3] - part.viewpoint
    distance = np.linalg.norm(forward)
    forward /= distance
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = part.viewpoint
    view = View(camera, pose)
    rng = np.random.default_rng(0)
    wall = rng.uniform([0, 0, 3 * distance], [320, 240, 3.02 * distance], (4000, 3))
    wall = camera.unproject(wall[:, :2], wall[:, 2]) @ pose[:3, :3].T + part.viewpoint
    return Scene(np.vstack([wall, part.points]), viewpoints=part.viewpoint, views=[view]), len(wall)


def test_views_segment_the_scene_first(part: Part) -> None:
    scene, wall = seen_before_a_wall(part)
    found = sympose.estimate(scene, order=ORDER)
    assert (found.inliers >= wall).all()
    assert np.abs(scene.points[found.inliers] - found.points[found.point_of_inlier]).max() < 0.1
    assert abs(found.axis @ part.axis) > np.cos(np.radians(0.5))


def test_with_views_too_points_that_are_not_finite_are_counted_or_refused(part: Part) -> None:
    scene, wall = seen_before_a_wall(part)
    lost = np.array([[np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]])
    holed = Scene(np.vstack([lost, scene.points]), viewpoints=part.viewpoint, views=scene.views)
    found, clean = sympose.estimate(holed, order=ORDER), sympose.estimate(scene, order=ORDER)
    assert (found.diagnostics["non_finite_points"], clean.diagnostics["non_finite_points"]) == (2, 0)
    assert np.array_equal(found.inliers, clean.inliers + 2)
    assert bytes_of(found) == bytes_of(clean)
    with pytest.raises(InvalidInputError, match=f"2 of {2 + wall + len(part.points)} points"):
        sympose.estimate(holed, order=ORDER, config=Config(non_finite="error"))


def test_fields_of_a_structured_array_are_its_coordinates(part: Part, estimate: sympose.Estimate) -> None:
    table = np.zeros(len(part.points), dtype=[("i", "f4"), ("z", "f8"), ("y", "f8"), ("x", "f8")])
    for axis, column in zip("xyz", part.points.T, strict=True):
        table[axis] = column
    found = sympose.estimate(table, order=ORDER, viewpoints=part.viewpoint)  # type: ignore[arg-type]
    assert found.pose.tobytes() == estimate.pose.tobytes()
    with pytest.raises(InvalidInputError, match="real numbers"):
        sympose.estimate(table[["i", "z", "y"]])  # type: ignore[arg-type]


def test_tensors_are_taken_like_arrays(part: Part, estimate: sympose.Estimate) -> None:
    class Tensor:
        def __init__(self, array: object) -> None:
            self.numpy = lambda: array

    class TensorCloud:
        def __init__(self, positions: object) -> None:
            self.point = {"positions": Tensor(positions)}

    for scene in (Tensor(part.points), TensorCloud(part.points)):
        found = sympose.estimate(scene, order=ORDER, viewpoints=part.viewpoint)  # type: ignore[arg-type]
        assert found.pose.tobytes() == estimate.pose.tobytes()


@pytest.mark.parametrize(("times", "words"), [(1000.0, "far away"), (0.0, "inside the part")])
def test_a_viewpoint_in_another_unit_is_named(part: Part, times: float, words: str) -> None:
    middle = part.points.mean(axis=0)
    viewpoint = middle + times * (part.viewpoint - middle)
    found = sympose.estimate(part.points, order=ORDER, viewpoints=viewpoint)
    assert any(words in warning and "check the unit" in warning for warning in found.warnings)
    try:
        warnings = sympose.estimate(part.points, viewpoints=viewpoint).warnings
    except sympose.NoSymmetryError as error:
        warnings = (str(error),)
    assert any("check the unit" in warning for warning in warnings)
