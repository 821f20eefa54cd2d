"""Parts that hang before a wall, or are held over a floor: plain clouds, without a region of interest."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import sympose
from sympose.camera import View
from sympose.datasets import DEPTH_CAMERA, part, render


def before_a_wall(
    name: str, away: float, tilt: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Points of one view of a part and of a wall so far behind it; its axis, and which points are its own."""
    camera = DEPTH_CAMERA
    rng = np.random.default_rng(1)
    world_from_object = np.eye(4)
    world_from_object[:3, :3] = Rotation.from_rotvec([2.4, 0.7, 0.0]).as_matrix()
    world_from_object[:3, 3] = [0.0, 0.0, 2.2]
    mesh = part(name).mesh.copy().apply_transform(world_from_object)
    depth = render(mesh, View(camera, np.eye(4)), rng).depth
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    normal = Rotation.from_rotvec([tilt, 0.0, 0.0]).apply([0.0, 0.0, 1.0])
    wall = ((mesh.vertices @ normal).max() + away) / (rays @ normal) + rng.normal(0.0, 0.002, u.shape)
    is_part = np.isfinite(depth)
    points = rays * np.where(is_part, depth, wall)[..., None]
    return points.reshape(-1, 3), world_from_object[:3, :3] @ part(name).axis, is_part.ravel()


def angle_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(a @ b)))))


@pytest.mark.parametrize("name", ["propeller_2", "impeller_7", "wheel_hub_5"])
@pytest.mark.parametrize(("away", "tilt"), [(0.8, 0.0), (1.5, 0.4)])
def test_a_wall_behind_a_part_is_left_out(name: str, away: float, tilt: float) -> None:
    points, axis, is_part = before_a_wall(name, away, tilt)
    found = sympose.estimate(points, viewpoints=[0.0, 0.0, 0.0], order=part(name).order)
    assert angle_deg(found.axis, axis) < 0.5
    assert found.score > 0.8
    assert is_part[found.inliers].all()
    assert len(found.inliers) > 0.95 * is_part.sum()
    # Nothing stands on it.
    assert found.ground is None
    assert found.diagnostics["backdrop_points"] > 0.9 * (~is_part).sum()


def test_without_a_viewpoint_the_order_of_the_points_tells_it() -> None:
    points, axis, is_part = before_a_wall("wheel_hub_5", 1.0)
    found = sympose.estimate(points, order=5)
    assert angle_deg(found.axis, axis) < 0.5
    assert is_part[found.inliers].all()


def test_the_wall_tells_what_is_empty() -> None:
    # The gaps between the blades are seen to be empty only by the rays that go on to the wall.
    points, axis, _ = before_a_wall("propeller_3", 1.0)
    found = sympose.estimate(points, viewpoints=[0.0, 0.0, 0.0])
    assert found.order == 3
    assert angle_deg(found.axis, axis) < 0.5
    assert found.score > 0.8


def test_ground_on_says_that_nothing_stands_on_a_wall() -> None:
    points, axis, _ = before_a_wall("wheel_hub_5", 1.0)
    config = sympose.Config(ground="on")
    found = sympose.estimate(points, viewpoints=[0.0, 0.0, 0.0], order=5, config=config)
    assert angle_deg(found.axis, axis) < 0.5
    assert any('ground = "on"' in warning for warning in found.warnings)
    # Off is off.
    off = sympose.estimate(
        points, viewpoints=[0.0, 0.0, 0.0], order=5, config=sympose.Config(ground="off", cluster="off")
    )
    assert off.score < 0.5


@pytest.mark.parametrize("name", ["impeller_9", "flange_8"])
def test_a_part_that_hangs_askew_before_a_wall_does_not_end_there(name: str) -> None:
    # Near enough for its foot to be out of sight, if it were on a table.
    points, axis, is_part = before_a_wall(name, 0.2, 0.5)
    order = part(name).order
    found = sympose.estimate(points, viewpoints=[0.0, 0.0, 0.0], order=order)
    alone = sympose.estimate(points[is_part], viewpoints=[0.0, 0.0, 0.0], order=order)
    assert is_part[found.inliers].all()
    assert angle_deg(found.axis, axis) < 0.1
    assert abs((found.center - alone.center) @ axis) < 0.02


@pytest.mark.parametrize("name", ["propeller_3", "wheel_hub_6"])
def test_several_views_before_a_wall(name: str) -> None:
    one = part(name)
    turn = Rotation.from_rotvec([0.4, 0.2, 0.0])
    mesh = one.mesh.copy()
    mesh.apply_transform(
        np.block([[turn.as_matrix(), np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    )
    wall = trimesh.creation.box([9.0, 9.0, 0.1]).apply_translation([0.0, 0.0, -1.7])
    scene = trimesh.util.concatenate([mesh, wall])
    points, viewpoints = [], []
    for k, (aside, up) in enumerate([(-0.7, 0.3), (0.6, 0.5), (0.1, -0.7)]):
        world_from_camera = np.eye(4)
        looks = Rotation.from_euler("yx", [aside, up]).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        world_from_camera[:3, :3] = looks
        world_from_camera[:3, 3] = -2.4 * looks[:, 2]
        image = render(scene, View(DEPTH_CAMERA, world_from_camera), np.random.default_rng(k))
        points.append(image.points())
        viewpoints.append(np.broadcast_to(world_from_camera[:3, 3], points[-1].shape))
    found = sympose.estimate(np.concatenate(points), viewpoints=np.concatenate(viewpoints))
    assert found.order == one.order
    assert angle_deg(found.axis, turn.apply(one.axis)) < 0.1
    assert found.score > 0.8
    assert found.ground is None
    assert np.ptp(found.completed, axis=0).max() < 1.1


@pytest.mark.parametrize("name", ["impeller_7", "flange_8"])
def test_a_part_held_in_the_corner_of_a_room(name: str) -> None:
    one = part(name)
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_rotvec([0.3, 0.8, 0.0]).as_matrix()
    mesh = one.mesh.copy().apply_transform(turned)
    floor = trimesh.creation.box([12.0, 12.0, 0.1]).apply_translation([0.0, 0.0, -1.4])
    wall = trimesh.creation.box([0.1, 12.0, 12.0]).apply_translation([-1.6, 0.0, 3.0])
    looks = np.array([[0.0, 0.35, -0.94], [1.0, 0.0, 0.0], [0.0, -0.94, -0.35]])
    looks, _ = np.linalg.qr(looks)
    looks[:, 2] *= np.sign(looks[0, 2]) * -1.0
    looks[:, 0] *= np.sign(np.linalg.det(looks))
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = looks
    world_from_camera[:3, 3] = -2.2 * looks[:, 2]
    scene = trimesh.util.concatenate([mesh, floor, wall])
    points = render(scene, View(DEPTH_CAMERA, world_from_camera), np.random.default_rng(1)).points()
    found = sympose.estimate(points, viewpoints=world_from_camera[:3, 3], order=one.order)
    assert angle_deg(found.axis, turned[:3, :3] @ one.axis) < 0.1
    assert found.score > 0.7
    assert np.ptp(found.completed, axis=0).max() < 1.1


def test_segmentation_does_not_cut_a_part_once_its_background_is_gone() -> None:
    # The border of the image cuts a blade, which goes on beyond it like a table before a wall.
    tilt = Rotation.from_rotvec([0.4, 0.0, 0.0])
    turned = np.eye(4)
    turned[:3, :3] = tilt.as_matrix()
    mesh = part("propeller_3").mesh.copy().apply_transform(turned)
    mesh.apply_translation([0.0, 0.0, 1.0 - mesh.bounds[0, 2]])
    floor = trimesh.creation.box([8.0, 8.0, 0.1]).apply_translation([0.0, 0.0, -0.05])
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix()
    world_from_camera[:3, 3] = -4.2 * world_from_camera[:3, 2]
    view = View(DEPTH_CAMERA, world_from_camera)
    scene = trimesh.util.concatenate([mesh, floor])
    image = render(scene, view, np.random.default_rng(1), sigma=0.0005)
    seen = sympose.Scene.from_depth(image.depth, DEPTH_CAMERA, world_from_camera)
    face = image.face.ravel()
    is_part = face[face >= 0] < len(mesh.faces)
    assert sympose.segment(seen.points, seen.views).mask[is_part].all()
    found = sympose.estimate(seen)
    assert found.order == 3
    assert angle_deg(found.axis, tilt.apply(part("propeller_3").axis)) < 0.1
