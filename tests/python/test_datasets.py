"""Procedural parts, the virtual depth camera and scans: their truth, held against brute force."""

from __future__ import annotations

import doctest
import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("manifold3d")
pytest.importorskip("embreex")

from sympose import datasets  # noqa: E402
from sympose.camera import PinholeCamera, View  # noqa: E402
from sympose.datasets import DEPTH_CAMERA, LABELS, Part, load_mesh_folder, names, part, render, scan  # noqa: E402
from sympose.errors import InvalidInputError  # noqa: E402

CYCLIC = names("cyclic")
PRIMES = (2, 3, 5, 7, 11, 13)


def distance_to_surface(mesh: trimesh.Trimesh, points: NDArray) -> NDArray:
    """Brute force over all faces that can hold the nearest point."""
    triangles = np.asarray(mesh.triangles)
    middle = triangles.mean(axis=1)
    reach = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    bound, _ = cKDTree(mesh.vertices).query(points)
    nearest = np.full(len(points), np.inf)
    for start in range(0, len(points), 100):
        chunk = points[start : start + 100]
        least = np.linalg.norm(chunk[:, None] - middle, axis=2) - reach
        i, j = np.nonzero(least <= bound[start : start + 100, None] + 1e-9)
        foot = trimesh.triangles.closest_point(triangles[j], chunk[i])
        distance = np.linalg.norm(foot - chunk[i], axis=1)
        np.fmin.at(nearest, start + i, distance)
    return nearest


def surface_samples(mesh: trimesh.Trimesh, count: int = 120) -> NDArray:
    return np.asarray(trimesh.sample.sample_surface(mesh, count, seed=1)[0])


def turned(points: NDArray, angle: float) -> NDArray:
    return Rotation.from_rotvec([0.0, 0.0, angle]).apply(points)


def rms_when_turned(one: Part, angle: float, points: NDArray) -> float:
    return float(np.sqrt((distance_to_surface(one.mesh, turned(points, angle)) ** 2).mean()))


def in_object(one: datasets.Scan, points: NDArray) -> NDArray:
    pose = one.world_from_object
    return (points - pose[:3, 3]) @ pose[:3, :3] / one.scale


# ---- parts --------------------------------------------------------------------------------


def test_the_catalogue_has_fourteen_cyclic_parts_and_six_others() -> None:
    assert len(CYCLIC) == 14
    assert sorted(names()) == sorted((*CYCLIC, *names("continuous"), *names("asymmetric")))
    families = {family: len(names(family)) for family in ("propeller", "impeller", "wheel_hub", "small_part")}
    assert sum(families.values()) == 14 and min(families.values()) >= 3
    assert max(part(name).order for name in CYCLIC) >= 10
    with pytest.raises(InvalidInputError, match="propeller_9"):
        part("propeller_9")
    with pytest.raises(InvalidInputError, match="banana"):
        names("banana")


@pytest.mark.parametrize("name", names())
def test_part_is_one_closed_body_of_diameter_one(name: str) -> None:
    one = part(name)
    assert part(name) is one
    assert one.mesh.is_watertight and one.mesh.is_winding_consistent and one.mesh.volume > 0.0
    assert one.mesh.body_count == 1  # an inner void would be a body of its own
    hull = one.mesh.convex_hull.vertices
    farthest = max(cdist(hull[k : k + 500], hull).max() for k in range(0, len(hull), 500))
    assert farthest == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(one.axis, [0.0, 0.0, 1.0])


@pytest.mark.parametrize("name", CYCLIC)
def test_cyclic_part_has_its_order_and_no_larger_one(name: str) -> None:
    one = part(name)
    points = surface_samples(one.mesh)
    step = 2.0 * np.pi / one.order
    assert distance_to_surface(one.mesh, turned(points, step)).max() < 1e-6
    # A larger group would hold the rotation by step / p for some prime p.
    for prime in PRIMES:
        assert rms_when_turned(one, step / prime, points) > 0.003
    # Turned over, the part is another one, so that the sign of the axis is defined.
    low, high = one.mesh.bounds[:, 2]
    over = points * [1.0, -1.0, -1.0] + [0.0, 0.0, low + high]
    assert min(rms_when_turned(one, step * k / 6.0, over) for k in range(6)) > 0.015
    assert not one.dihedral


@pytest.mark.parametrize("name", names("continuous"))
def test_surface_of_revolution_comes_to_itself_at_any_angle(name: str) -> None:
    one = part(name)
    assert one.order == "continuous"
    for angle in (0.1, 1.0, 2.5):
        assert distance_to_surface(one.mesh, turned(surface_samples(one.mesh, 60), angle)).max() < 1e-5


@pytest.mark.parametrize("name", names("asymmetric"))
def test_asymmetric_part_has_no_order(name: str) -> None:
    one = part(name)
    assert one.order is None
    for prime in PRIMES:
        assert rms_when_turned(one, 2.0 * np.pi / prime, surface_samples(one.mesh)) > 0.02


@pytest.mark.parametrize("name", names())
def test_center_is_the_centroid_of_a_surface_that_cameras_see(name: str) -> None:
    one = part(name)
    seen, normals = datasets.sample_visible(one.mesh, 20_000, seed=5)
    assert len(seen) > 0.98 * 20_000
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert one.center[:2].tolist() == [0.0, 0.0]
    assert one.center[2] == pytest.approx(seen[:, 2].mean(), abs=2e-3)


def test_center_leaves_out_what_is_hidden() -> None:
    outer = trimesh.creation.box([0.5, 0.5, 0.5])
    inner = trimesh.creation.box([0.4, 0.4, 0.1]).apply_translation([0.0, 0.0, 0.15])
    inner.invert()
    hollow = trimesh.util.concatenate([outer, inner])
    assert hollow.triangles_center[:, 2] @ hollow.area_faces / hollow.area > 0.03
    assert Part.from_mesh(hollow).center[2] == pytest.approx(0.0, abs=1e-3)


# ---- camera --------------------------------------------------------------------------------


def shell(radius: float) -> trimesh.Trimesh:
    """A hollow ball, 2.2 in front of the camera."""
    ball, inside = trimesh.creation.icosphere(5, radius), trimesh.creation.icosphere(4, 0.8 * radius)
    inside.invert()
    return trimesh.util.concatenate([ball, inside]).apply_translation([0.0, 0.0, 2.2])


def test_render_meets_a_ball_where_its_rays_do() -> None:
    image = render(shell(0.5), View(DEPTH_CAMERA, np.eye(4)), sigma=0.0)
    points = image.points()
    away = np.linalg.norm(points - [0.0, 0.0, 2.2], axis=1)
    assert away.max() <= 0.5 + 1e-9 and away.min() > 0.5 * (1.0 - 1e-3)  # facets; nothing of the inner shell
    assert (
        len(points)
        == (image.face >= 0).sum()
        == np.isfinite(image.distance).sum()
        == np.isfinite(image.depth).sum()
    )
    # The silhouette is the cone of half angle asin(r / d): give or take a pixel.
    radius = np.tan(np.arcsin(0.5 / 2.2)) * DEPTH_CAMERA.fx
    assert np.pi * (radius - 1) ** 2 < len(points) < np.pi * (radius + 1) ** 2
    row, column = np.nonzero(image.face >= 0)
    pixels, depth = DEPTH_CAMERA.project(points)
    np.testing.assert_allclose(pixels, np.stack([column, row], axis=1), atol=1e-9)
    np.testing.assert_allclose(depth, image.depth[row, column])


def test_noise_lies_along_the_ray_and_grows_with_the_depth() -> None:
    view = View(DEPTH_CAMERA, np.eye(4))
    for mesh in (shell(0.5), shell(0.5).apply_translation([0.0, 0.0, 2.2])):
        clean = render(mesh, view, sigma=0.0)
        noisy = render(mesh, view, np.random.default_rng(3), sigma=0.01)
        np.testing.assert_array_equal(noisy.face, clean.face)
        along = (noisy.distance - clean.distance)[clean.face >= 0]
        expected = 0.01 * np.nanmean(clean.depth)
        assert along.std() == pytest.approx(expected, rel=0.03)
        assert abs(along.mean()) < 4.0 * expected / np.sqrt(len(along))
        across = np.cross(noisy.points(), clean.points())
        assert np.abs(across).max() < 1e-9


def test_lens_distortion_bends_the_rays() -> None:
    camera = PinholeCamera(80, 60, 70.0, 70.0, 39.5, 29.5, (0.2, -0.05))
    image = render(shell(0.8), View(camera, np.eye(4)), sigma=0.0)
    row, column = np.nonzero(image.face >= 0)
    np.testing.assert_allclose(camera.project(image.points())[0], np.stack([column, row], axis=1), atol=1e-6)


def test_render_says_what_is_wrong() -> None:
    view = View(DEPTH_CAMERA, np.eye(4))
    with pytest.raises(InvalidInputError, match=r"-0\.1"):
        render(shell(0.5), view, sigma=-0.1)
    with pytest.raises(InvalidInputError, match="rng"):
        render(shell(0.5), view)


def test_a_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex", None)
    with pytest.raises(ImportError, match=r"embreex.*sympose\[datasets\]"):
        scan(part("propeller_2"))


# ---- scans --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "scenario"), [("propeller_3", "sphere"), ("impeller_7", "edge"), ("mug", "upper")]
)
def test_noise_free_points_lie_on_the_part_at_its_true_pose(name: str, scenario: str) -> None:
    one = scan(part(name), scenario, sigma=0.0, scale=25.0, seed=4)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(one.scene), 300, replace=False)
    points = in_object(one, one.scene.points[chosen])
    assert distance_to_surface(part(name).mesh, points).max() < 1e-5
    assert one.diameter == 25.0
    assert np.linalg.norm(one.world_from_object[:3, 3]) > 1.0
    if isinstance(one.order, int):
        turn = Rotation.from_rotvec(2.0 * np.pi / one.order * one.axis)
        again = turn.apply(one.scene.points[chosen] - one.center) + one.center
        assert distance_to_surface(part(name).mesh, in_object(one, again)).max() < 1e-5


def test_viewpoints_are_the_cameras_that_saw_the_points() -> None:
    one = scan(part("wheel_hub_5"), "sphere", scale=3.0)
    assert len(one.scene.views) == 5
    for k, view in enumerate(one.scene.views):
        mine = one.view_of_point == k
        assert mine.sum() > 5000
        np.testing.assert_array_equal(
            one.scene.viewpoints[mine], np.broadcast_to(view.center, (mine.sum(), 3))
        )
        pixels, depth, visible = view.project(one.scene.points[mine])
        assert visible.all() and depth.min() > 0.0
        np.testing.assert_allclose(pixels, np.rint(pixels), atol=1e-6)
        middle = one.world_from_object[:3, :3] @ part("wheel_hub_5").mesh.bounds.mean(axis=0) * 3.0
        away = np.linalg.norm(view.center - middle - one.world_from_object[:3, 3])
        assert away == pytest.approx(2.2 * 3.0, rel=1e-3)


@pytest.mark.parametrize(
    ("scenario", "low", "high"),
    [("sphere", 0.25, 0.95), ("edge", 0.0, 0.25), ("upper", 0.25, 0.95), ("table", 0.25, 0.7)],
)
def test_cameras_stand_where_the_scenario_says(scenario: str, low: float, high: float) -> None:
    cosines = []
    for seed in range(1, 6):
        one = scan(part("propeller_2"), scenario, seed=seed, sigma=0.0, low_resolution=True)
        middle = np.array([0.0, 0.0, part("propeller_2").mesh.bounds[:, 2].mean()])
        centers = in_object(one, np.array([view.center for view in one.scene.views])) - middle
        cosines.extend(centers[:, 2] / np.linalg.norm(centers, axis=1))
    assert np.abs(cosines).min() >= low - 1e-9 and np.abs(cosines).max() <= high + 1e-9
    assert (np.min(cosines) < 0.0) == (scenario in ("sphere", "edge"))
    assert len(set(np.round(cosines, 6))) == 25


def test_same_seed_same_bytes_and_options_do_not_disturb_each_other() -> None:
    one = part("gear_12")
    first, again, other = scan(one, seed=2), scan(one, seed=2), scan(one, seed=3)
    assert first.scene.points.tobytes() == again.scene.points.tobytes()
    assert first.world_from_object.tobytes() == again.world_from_object.tobytes()
    assert not np.allclose(first.world_from_object, other.world_from_object)
    noisy, fewer = scan(one, seed=2, sigma=0.005), scan(one, seed=2, views=2)
    np.testing.assert_array_equal(first.world_from_object, noisy.world_from_object)
    np.testing.assert_array_equal(first.view_of_point, noisy.view_of_point)
    np.testing.assert_array_equal(first.scene.points[first.view_of_point < 2], fewer.scene.points)


def test_table_scene_is_labelled() -> None:
    name = "wheel_hub_6"
    one = scan(part(name), "table", sigma=0.0, clutter=4, seed=1)
    points, label = in_object(one, one.scene.points), one.label_of_point
    assert set(label) == {0, 1, 2, 3}
    rng = np.random.default_rng(0)
    on_part = rng.choice(np.nonzero(label == 0)[0], 200, replace=False)
    assert distance_to_surface(part(name).mesh, points[on_part]).max() < 1e-5
    ground = part(name).mesh.bounds[0, 2]
    table, wall, clutter = (points[label == LABELS.index(what)] for what in ("table", "wall", "clutter"))
    on_top = np.abs(table[:, 2] - ground) < 1e-9
    assert on_top.mean() > 0.9 and table[:, 2].max() < ground + 1e-9  # the rest is the edge of the table
    assert np.ptp(table[:, :2], axis=0).max() <= 4.0 * np.sqrt(2.0) + 1e-9
    assert clutter[:, 2].min() > ground - 1e-9 and clutter[:, 2].max() < ground + 0.4
    assert np.hypot(clutter[:, 0], clutter[:, 1]).min() > 0.5
    _, spread, direction = np.linalg.svd(wall - wall.mean(axis=0), full_matrices=False)
    assert spread[2] < 1e-9 * spread[0]
    assert 2.0 <= abs(wall.mean(axis=0) @ direction[2]) <= 3.0
    with pytest.raises(InvalidInputError, match="room"):
        scan(part(name), "table", clutter=500)


def test_alone_is_the_table_scene_without_its_background() -> None:
    with_table = scan(part("impeller_5"), "table", sigma=0.0, seed=3)
    alone = scan(part("impeller_5"), "alone", sigma=0.0, seed=3)
    np.testing.assert_array_equal(alone.world_from_object, with_table.world_from_object)
    assert not alone.label_of_point.any()
    expected = with_table.scene.points[with_table.label_of_point == 0]
    # A pixel on the very edge may fall to the one or the other.
    assert abs(len(alone.scene) - len(expected)) < 1e-3 * len(expected)
    assert np.quantile(cKDTree(alone.scene.points).query(expected)[0], 0.999) < 1e-9


def test_a_bare_mesh_of_any_size_can_be_scanned() -> None:
    box = trimesh.creation.box([300.0, 200.0, 100.0])
    one = scan(box, sigma=0.0, views=2, scale=0.001)
    assert one.order is None
    assert one.diameter == pytest.approx(0.001 * np.linalg.norm([300.0, 200.0, 100.0]))
    inside = np.abs(in_object(one, one.scene.points)) / [150.0, 100.0, 50.0]
    np.testing.assert_allclose(inside.max(axis=1), 1.0, atol=1e-6)


def test_an_unknown_scenario_and_bad_options_are_refused() -> None:
    one = part("propeller_2")
    with pytest.raises(InvalidInputError, match="sideways"):
        scan(one, "sideways")
    with pytest.raises(InvalidInputError, match="clutter"):
        scan(one, "sphere", clutter=2)
    bad = {
        "views": 0, "seed": -1, "scale": 0.0, "sigma": -1.0, "outliers": 1.0, "dropout": 1.5,
        "wedge_deg": 360.0,
        "falloff": np.nan, "warp": np.inf, "flying_pixels": -0.1, "view_shift": -1.0, "view_turn_deg": 360.0,
    }  # fmt: skip
    for option, value in bad.items():
        with pytest.raises(InvalidInputError, match=option):
            scan(one, **{option: value})


# ---- stress --------------------------------------------------------------------------------


def test_outliers_are_a_share_of_the_points_in_their_box() -> None:
    plain, one = scan(part("flange_8"), views=2), scan(part("flange_8"), views=2, outliers=0.3)
    outlier = one.label_of_point == LABELS.index("outlier")
    assert outlier.mean() == pytest.approx(0.3, abs=1e-4)
    np.testing.assert_array_equal(one.scene.points[~outlier], plain.scene.points)
    box = np.stack([plain.scene.points.min(axis=0), plain.scene.points.max(axis=0)])
    strewn = one.scene.points[outlier]
    assert (strewn >= box[0]).all() and (strewn <= box[1]).all()
    np.testing.assert_allclose(strewn.mean(axis=0), box.mean(axis=0), atol=0.02)
    assert set(one.view_of_point[outlier]) == {0, 1}


def test_wedge_is_missing() -> None:
    one = scan(part("flange_8"), sigma=0.0, wedge_deg=90.0)
    x, y, _ = in_object(one, one.scene.points).T
    azimuth = np.sort(np.degrees(np.arctan2(y, x)))
    gaps = np.diff(np.append(azimuth, azimuth[0] + 360.0))
    assert 90.0 <= gaps.max() < 91.0


def test_density_falls_with_distance() -> None:
    plain, one = (
        scan(part("wheel_hub_10"), views=1, sigma=0.0),
        scan(part("wheel_hub_10"), views=1, sigma=0.0, falloff=6),
    )
    bins = np.quantile(
        np.linalg.norm(plain.scene.points - plain.scene.viewpoints, axis=1), [0.0, 0.2, 0.8, 1.0]
    )

    def kept(k: int) -> float:
        count = [
            np.histogram(np.linalg.norm(s.scene.points - s.scene.viewpoints, axis=1), bins)[0][k]
            for s in (one, plain)
        ]
        return count[0] / count[1]

    assert kept(0) > 1.5 * kept(2)


def test_low_resolution_has_a_quarter_of_the_pixels() -> None:
    counts = [len(scan(part("knob_3"), views=2, low_resolution=low).scene) for low in (False, True)]
    assert counts[1] == pytest.approx(counts[0] / 4, rel=0.02)


def test_flying_pixels_leave_the_surface_along_their_rays() -> None:
    clean = scan(part("propeller_5"), sigma=0.0, views=2)
    one = scan(part("propeller_5"), sigma=0.0, views=2, flying_pixels=0.5)
    flying = one.label_of_point == LABELS.index("outlier")
    np.testing.assert_array_equal(one.scene.points[~flying], clean.scene.points[~flying])
    ray, clean_ray = (s.scene.points[flying] - s.scene.viewpoints[flying] for s in (one, clean))
    beyond = np.linalg.norm(ray, axis=1) - np.linalg.norm(clean_ray, axis=1)
    assert 0.01 < flying.mean() < 0.2
    assert beyond.min() > 0.0 and beyond.max() <= 0.3 + 1e-9
    assert np.abs(np.cross(ray, clean_ray)).max() < 1e-9


def test_dropout_makes_holes() -> None:
    plain, one = scan(part("flange_8"), views=1), scan(part("flange_8"), views=1, dropout=0.3)
    assert len(one.scene) == pytest.approx(0.7 * len(plain.scene), rel=1e-3)
    kept = {tuple(point) for point in one.scene.points}
    lost = np.array([tuple(point) not in kept for point in plain.scene.points])
    _, neighbors = cKDTree(plain.scene.points).query(plain.scene.points[lost], k=9)
    assert lost[neighbors].mean() > 0.8  # blobs; a random choice would give 0.38


def test_warp_bends_without_moving_the_part() -> None:
    plain, one = (scan(part("flange_8"), sigma=0.0, warp=warp, scale=10.0) for warp in (0.0, 0.005))
    offset = one.scene.points - plain.scene.points
    assert np.sqrt((offset**2).sum(axis=1).mean()) == pytest.approx(0.05, rel=1e-9)
    centers = [s.scene.points - s.scene.points.mean(axis=0) for s in (one, plain)]
    rotation, _ = Rotation.align_vectors(centers[0], centers[1])
    assert np.linalg.norm(offset.mean(axis=0)) < 1e-9
    assert rotation.magnitude() < 1e-4
    near = np.linalg.norm(offset[1:] - offset[:-1], axis=1)[
        np.linalg.norm(np.diff(plain.scene.points, axis=0), axis=1) < 0.2
    ]
    assert np.median(near) < 0.05 * 0.1


def test_misplaced_views_move_as_a_whole_with_all_that_they_saw() -> None:
    plain, one = (scan(part("flange_8"), sigma=0.0, views=12, scale=10.0, **far) for far in (
        {}, {"view_shift": 0.01, "view_turn_deg": 0.5}
    ))  # fmt: skip
    shifts, turns = [], []
    for k, (was, now) in enumerate(zip(plain.scene.views, one.scene.views, strict=True)):
        motion = now.world_from_camera @ np.linalg.inv(was.world_from_camera)
        mine = plain.view_of_point == k
        moved = plain.scene.points[mine] @ motion[:3, :3].T + motion[:3, 3]
        np.testing.assert_allclose(one.scene.points[mine], moved, atol=1e-9)
        np.testing.assert_allclose(
            one.scene.viewpoints[mine], now.center[None].repeat(mine.sum(), 0), atol=1e-9
        )
        turns.append(Rotation.from_matrix(motion[:3, :3]).as_rotvec(degrees=True))
        shifts.append(motion[:3, :3] @ plain.center + motion[:3, 3] - plain.center)
    assert np.sqrt(np.square(turns).mean()) == pytest.approx(0.5, rel=0.4)
    assert np.sqrt(np.square(shifts).mean()) == pytest.approx(0.1, rel=0.4)
    np.testing.assert_array_equal(one.world_from_object, plain.world_from_object)


# ---- folders of meshes --------------------------------------------------------------------------------


def write_folder(folder: Path, **changes: object) -> None:
    trimesh.creation.cylinder(0.3, 0.8, sections=6).export(folder / "nut.ply")
    entry = {"name": "nut", "class": "small_part", "file": "nut.ply", "order": 6, "dihedral": True, **changes}
    kept = {key: value for key, value in entry.items() if value is not None}
    (folder / "manifest.json").write_text(json.dumps([kept]))


def test_mesh_folder_gives_parts_with_the_truth_of_the_manifest(tmp_path: Path) -> None:
    write_folder(tmp_path, axis_fit=[0.0, 0.03, 0.9], axis_point_fit=[0.1, 0.0, 0.2], visible_centroid_z=0.05)
    (nut,) = load_mesh_folder(tmp_path)
    assert (nut.name, nut.family, nut.order, nut.dihedral) == ("nut", "small_part", 6, True)
    assert np.linalg.norm(nut.axis) == pytest.approx(1.0)
    assert nut.center[2] == pytest.approx(0.05)
    np.testing.assert_allclose(np.cross(nut.center - [0.1, 0.0, 0.2], nut.axis), 0.0, atol=1e-12)
    one = scan(nut, seed=2, sigma=0.0)
    assert distance_to_surface(nut.mesh, in_object(one, one.scene.points[::500])).max() < 1e-6
    np.testing.assert_allclose(one.axis, one.world_from_object[:3, :3] @ nut.axis)


@pytest.mark.parametrize(("order", "expected"), [(0, "continuous"), (1, None), (12, 12)])
def test_mesh_folder_orders(tmp_path: Path, order: int, expected: object) -> None:
    write_folder(tmp_path, order=order)
    (nut,) = load_mesh_folder(tmp_path)
    assert nut.order == expected
    np.testing.assert_allclose(nut.center, 0.0, atol=1e-6)


def test_mesh_folder_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"manifest\.json"):
        load_mesh_folder(tmp_path)
    (tmp_path / "manifest.json").write_text("[{")
    with pytest.raises(InvalidInputError, match="not JSON"):
        load_mesh_folder(tmp_path)
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InvalidInputError, match="list"):
        load_mesh_folder(tmp_path)
    write_folder(tmp_path, order=None)
    with pytest.raises(InvalidInputError, match="lacks order"):
        load_mesh_folder(tmp_path)
    write_folder(tmp_path, order="six")
    with pytest.raises(InvalidInputError, match="six"):
        load_mesh_folder(tmp_path)
    trimesh.creation.box([3.0, 4.0, 12.0]).export(tmp_path / "brick.ply")
    write_folder(tmp_path, file="brick.ply")
    with pytest.raises(InvalidInputError, match="diameter 13"):
        load_mesh_folder(tmp_path)
    write_folder(tmp_path, axis_fit=[0.0, 1.0])
    with pytest.raises(InvalidInputError, match="axis_fit"):
        load_mesh_folder(tmp_path)
    write_folder(tmp_path, file="gone.ply")
    with pytest.raises(FileNotFoundError, match=r"gone\.ply"):
        load_mesh_folder(tmp_path)
    write_folder(tmp_path)
    (tmp_path / "nut.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n")
    with pytest.raises(InvalidInputError, match=r"nut\.ply"):
        load_mesh_folder(tmp_path)


@pytest.mark.parametrize("module", ["depth_camera", "visibility", "scenarios", "parts", "parts.model"])
def test_examples_in_docstrings(module: str) -> None:
    result = doctest.testmod(importlib.import_module(f"sympose.datasets.{module}"))
    assert result.attempted > 0 and result.failed == 0
