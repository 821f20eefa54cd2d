"""Scans of a part: views drawn for a scenario, rendered and merged into a scene with its truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from sympose.camera import View
from sympose.datasets.depth_camera import DEPTH_CAMERA, LOW_RESOLUTION, render
from sympose.datasets.parts import Part
from sympose.scene import Scene

__all__ = ["LABELS", "SCENARIOS", "Scan", "scan"]

LABELS = ("part", "table", "wall", "clutter", "outlier")
SCENARIOS = ("sphere", "edge", "upper", "table", "alone")

_CAMERA_DISTANCE = 2.2  # diameters


@dataclass(frozen=True, eq=False)
class Scan:
    """A synthetic scan with its truth.

    Attributes:
        scene: Points, the viewpoint of each, and the views.
        world_from_object: (4, 4) rigid pose of the part; a point p of its mesh is at
            `world_from_object @ (scale * p)`.
        scale: Diameter of the part in the world.
        view_of_point: (N,) index into `scene.views`.
        label_of_point: (N,) index into `LABELS`: 0 part, 1 table, 2 wall, 3 clutter, 4 outlier.
        order: Order of the part, "continuous" or None.
        axis: (3,) unit direction of the symmetry axis in the world.
        center: (3,) centroid of the visible surface on the axis, in the world.
    """

    scene: Scene
    world_from_object: NDArray[np.float64]
    scale: float
    view_of_point: NDArray[np.int64]
    label_of_point: NDArray[np.int64]
    order: int | Literal["continuous"] | None
    axis: NDArray[np.float64]
    center: NDArray[np.float64]


def scan(
    part: Part,
    scenario: str = "sphere",
    *,
    views: int = 5,
    sigma: float = 0.001,
    seed: int = 1,
    scale: float = 1.0,
    low_resolution: bool = False,
) -> Scan:
    """Scan `part` with the virtual depth camera."""
    if scenario not in SCENARIOS:
        raise ValueError(f"scenario must be one of {SCENARIOS}, got {scenario!r}")

    def stream(purpose: str) -> np.random.Generator:
        # Every purpose has numbers of its own, so that changing one option leaves all others as they were.
        return np.random.default_rng([seed, crc32(f"{part.name}/{scenario}/{purpose}".encode())])

    camera = LOW_RESOLUTION if low_resolution else DEPTH_CAMERA
    target = _target(part)
    world_from_object = _random_pose(stream("pose"), scale)
    rotation, translation = world_from_object[:3, :3], world_from_object[:3, 3]
    points, world_views, of_view = [], [], []
    for k in range(views):
        view = _draw_view(stream(f"view {k}"), scenario, camera, target)
        image = render(part.mesh, view, stream(f"noise {k}"), sigma=sigma)
        points.append(image.points())
        of_view.append(np.full(len(points[-1]), k))
        pose = world_from_object @ view.world_from_camera
        pose[:3, 3] = scale * (rotation @ view.center) + translation
        world_views.append(View(camera, pose, name=f"view {k}"))
    xyz = scale * (np.concatenate(points) @ rotation.T) + translation
    view_of_point = np.concatenate(of_view)
    centers = np.array([view.center for view in world_views])
    scene = Scene(
        xyz, viewpoints=centers[view_of_point], views=world_views, name=f"{part.name} {scenario} {seed}"
    )
    return Scan(
        scene,
        world_from_object,
        scale,
        view_of_point,
        np.zeros(len(xyz), dtype=np.int64),
        part.order,
        rotation @ part.axis,
        scale * (rotation @ part.center) + translation,
    )


def _target(part: Part) -> NDArray[np.float64]:
    """What the cameras look at: the middle of the part, on the axis where there is one."""
    middle = part.mesh.bounds.mean(axis=0)
    if part.order is None:
        return np.asarray(middle)
    return np.asarray(part.center + ((middle - part.center) @ part.axis) * part.axis)


def _random_pose(rng: np.random.Generator, scale: float) -> NDArray[np.float64]:
    """A rotation uniform over all, and a translation of up to three diameters along each axis."""
    x, y, z, w = _unit(rng.normal(size=4))
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = scale * rng.uniform(-3.0, 3.0, 3)
    return pose


def _draw_view(rng, scenario, camera, target):
    low, high = (0.0, 0.25) if scenario == "edge" else (0.25, 0.95)
    cosine = rng.uniform(low, high) * (1.0 if scenario == "upper" else rng.choice([-1.0, 1.0]))
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    sine = np.sqrt(1.0 - cosine * cosine)
    direction = np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])
    return View(
        camera, _look_at(target + _CAMERA_DISTANCE * direction, target, rng.uniform(0.0, 2.0 * np.pi))
    )


def _look_at(position: NDArray[np.float64], target: NDArray[np.float64], roll: float) -> NDArray[np.float64]:
    """World from camera: z toward `target`, y down (along -z of the part), then turned by `roll` about z."""
    forward = _unit(target - position)
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    down = np.cross(forward, right)
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    pose[:3, 1] = np.cos(roll) * down - np.sin(roll) * right
    pose[:3, 2], pose[:3, 3] = forward, position
    return pose


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / np.linalg.norm(vector))
