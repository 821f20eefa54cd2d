"""Scans of a part: views drawn for a scenario, rendered and merged into a scene with its truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from sympose.camera import View
from sympose.datasets import stress
from sympose.datasets.depth_camera import DEPTH_CAMERA, LOW_RESOLUTION, render, turn
from sympose.datasets.parts.model import Order, Part, diameter
from sympose.datasets.stage import LABELS, set_stage
from sympose.datasets.view_poses import SCENARIOS, draw_camera_pose, random_pose
from sympose.errors import InvalidInputError
from sympose.scene import Scene

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["Scan", "scan"]

_OUTLIER = LABELS.index("outlier")


@dataclass(frozen=True, eq=False)
class Scan:
    """A synthetic scan with its truth.

    Attributes:
        scene: Points, the viewpoint of each, and the views.
        world_from_object: (4, 4) rigid pose of the part; a point p of the mesh that was scanned is at
            `world_from_object @ (scale * p)`.
        scale: Factor from the mesh to the world.
        diameter: Diameter of the part in the world.
        view_of_point: (N,) index into `scene.views`.
        label_of_point: (N,) index into `LABELS`: 0 part, 1 table, 2 wall, 3 clutter, 4 outlier.
        order: Order of the part, "continuous" or None.
        dihedral: Whether the sign of the axis is undefined.
        axis: (3,) unit direction of the symmetry axis in the world.
        center: (3,) centroid of the visible surface on the axis, in the world.
    """

    scene: Scene
    world_from_object: NDArray[np.float64]
    scale: float
    diameter: float
    view_of_point: NDArray[np.int64]
    label_of_point: NDArray[np.int64]
    order: Order
    dihedral: bool
    axis: NDArray[np.float64]
    center: NDArray[np.float64]


def scan(
    part: Part | Trimesh,
    scenario: str = "sphere",
    *,
    views: int = 5,
    sigma: float = 0.001,
    seed: int = 1,
    scale: float = 1.0,
    clutter: int = 0,
    low_resolution: bool = False,
    flying_pixels: float = 0.0,
    dropout: float = 0.0,
    wedge_deg: float = 0.0,
    falloff: float = 0.0,
    warp: float = 0.0,
    outliers: float = 0.0,
    view_shift: float = 0.0,
    view_turn_deg: float = 0.0,
) -> Scan:
    """Scan a part with the virtual depth camera, 2.2 diameters away, at a random pose in the world.

    The scan follows from the name of the part, the scenario, the seed and the options. Options do not disturb
    each other: with another noise or number of views, the pose and the first views stay the same.

    Args:
        part: Or a mesh of any size whose axis is +z, taken as without symmetry.
        scenario: Where the cameras stand, by the cosine of their direction to the axis. "sphere": 0.25 to
            0.95 from both sides; "edge": below 0.25; "upper": 0.25 to 0.95 from above; "table": 0.25 to 0.7
            from above, with the part on a table of 4 x 4 diameters, 2 to 3 diameters before a wall; "alone":
            the views of "table" without table and wall.
        views: How many.
        sigma: Noise along the ray, as a share of the mean depth of the view.
        seed: Any whole number from zero up.
        scale: Factor from the mesh to the world.
        clutter: Boxes on the table.
        low_resolution: 160 x 120 pixels instead of 320 x 240.
        flying_pixels: Share of the pixels at depth edges that fly off; they are labelled as outliers.
        dropout: Share of the pixels that is lost, in blobs.
        wedge_deg: Angle about the axis in which the part is missing.
        falloff: Points are kept with a probability that falls with this power of the distance to the camera.
        warp: Root mean square of a smooth deformation of the whole scene, in diameters.
        outliers: Share of uniform points, among all, in the bounding box of the scan.
        view_shift: How far a view is off where it is said to be, as the standard deviation in each of three
            directions, in diameters.
        view_turn_deg: The same for its rotation about the part.

    Raises:
        InvalidInputError: There is no such scenario, or an option is out of its range.
        ImportError: trimesh or embreex is not installed.

    Example:
        >>> from sympose.datasets import part, scan
        >>> one = scan(part("propeller_2"), "upper", views=2, seed=7)
        >>> len(one.scene.views), len(one.scene) == len(one.label_of_point)
        (2, True)
    """
    if scenario not in SCENARIOS:
        raise InvalidInputError(f"scenario must be one of {', '.join(SCENARIOS)}, got {scenario!r}")
    if clutter and scenario != "table":
        raise InvalidInputError(f"clutter stands on the table: scenario must be 'table', got {scenario!r}")
    _check_whole(views=(views, 1), seed=(seed, 0), clutter=(clutter, 0))
    if not 0.0 < scale < np.inf:
        raise InvalidInputError(f"scale must be positive and finite, got {scale!r}")
    _check_range(1.0, flying_pixels=flying_pixels, dropout=dropout, outliers=outliers)
    _check_range(360.0, wedge_deg=wedge_deg, view_turn_deg=view_turn_deg)
    _check_range(np.inf, sigma=sigma, falloff=falloff, warp=warp, view_shift=view_shift)
    size = scale
    if not isinstance(part, Part):
        size = scale * diameter(part)
        part = Part.from_mesh(part)
    name = part.name

    def stream(purpose: str) -> np.random.Generator:
        # Every purpose has numbers of its own, so that changing one option leaves the others as they were;
        # "alone" shares those of "table".
        place = "table" if scenario == "alone" else scenario
        return np.random.default_rng([seed, crc32(f"{name}/{place}/{purpose}".encode())])

    front = stream("front").uniform(0.0, 2.0 * np.pi)
    mesh, label_of_face = part.mesh, np.zeros(len(part.mesh.faces), dtype=np.int64)
    if scenario == "table":
        mesh, label_of_face = set_stage(mesh, stream("stage"), front=front, clutter=clutter)

    # Measured in the frame and the size of the part, where embree's single precision is at its best.
    camera = LOW_RESOLUTION if low_resolution else DEPTH_CAMERA
    target = _target(part)
    part_views = [
        View(camera, draw_camera_pose(stream(f"view {k}"), scenario, target, front), f"view {k}")
        for k in range(views)
    ]
    looks = [
        _look(mesh, label_of_face, k, view, stream, sigma=sigma, flying=flying_pixels, dropout=dropout)
        for k, view in enumerate(part_views)
    ]
    cloud = _Cloud.join(looks)
    if wedge_deg:
        outside = stress.cut_wedge(cloud.points - part.center, wedge_deg, stream("wedge"))
        cloud = cloud.where(outside | (cloud.label != 0))
    if falloff:
        centers = np.array([view.center for view in part_views])
        away = np.linalg.norm(cloud.points - centers[cloud.view], axis=1)
        cloud = cloud.where(stress.thin_with_distance(away, falloff, stream("falloff")))
    if warp:
        bent = stress.warp_smoothly(cloud.points, cloud.label == 0, warp, stream("warp"))
        cloud = replace(cloud, points=bent)

    if view_shift or view_turn_deg:
        errors = [
            stress.misplace(target, view_shift, view_turn_deg, stream(f"place {k}")) for k in range(views)
        ]
        points = cloud.points.copy()
        for k, error in enumerate(errors):
            points[cloud.view == k] = _move(error, points[cloud.view == k])
        cloud = replace(cloud, points=points)
        part_views = [
            replace(view, world_from_camera=error @ view.world_from_camera)
            for view, error in zip(part_views, errors, strict=True)
        ]

    pose = random_pose(stream("pose"), 3.0 * size)
    cloud = replace(cloud, points=_place(cloud.points, pose, size))
    if outliers:
        rng = stream("outliers")
        extra = stress.add_outliers(cloud.points, outliers, rng)
        count = len(extra)
        cloud = _Cloud.join([cloud, _Cloud(extra, np.full(count, _OUTLIER), rng.integers(views, size=count))])

    world_views = [_view_in_world(view, pose, size) for view in part_views]
    viewpoints = np.array([view.center for view in world_views])[cloud.view]
    return Scan(
        scene=Scene(cloud.points, viewpoints=viewpoints, views=world_views, name=f"{name} {scenario} {seed}"),
        world_from_object=pose,
        scale=scale,
        diameter=size,
        view_of_point=cloud.view,
        label_of_point=cloud.label,
        order=part.order,
        dihedral=part.dihedral,
        axis=pose[:3, :3] @ part.axis,
        center=_place(part.center, pose, size),
    )


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Points (N, 3) with the label and the view of each (N,)."""

    points: NDArray[np.float64]
    label: NDArray[np.int64]
    view: NDArray[np.int64]

    @classmethod
    def join(cls, clouds: Sequence[_Cloud]) -> _Cloud:
        return cls(
            np.concatenate([cloud.points for cloud in clouds]),
            np.concatenate([cloud.label for cloud in clouds]),
            np.concatenate([cloud.view for cloud in clouds]),
        )

    def where(self, keep: NDArray[np.bool_]) -> _Cloud:
        return _Cloud(self.points[keep], self.label[keep], self.view[keep])


def _look(
    mesh: Trimesh,
    label_of_face: NDArray[np.int64],
    k: int,
    view: View,
    stream: Callable[[str], np.random.Generator],
    *,
    sigma: float,
    flying: float,
    dropout: float,
) -> _Cloud:
    """What the depth camera of view `k` measures, in the frame of the mesh."""
    image = render(mesh, view, stream(f"noise {k}"), sigma=sigma)
    distance, flew = stress.fly_edges(image.distance, flying, stream(f"flying {k}"))
    lost = stress.drop_blobs(distance, dropout, stream(f"dropout {k}"))
    image = replace(image, distance=distance, face=np.where(lost, -1, image.face))
    hit = image.face >= 0
    label = np.where(flew, _OUTLIER, label_of_face[image.face])[hit]
    return _Cloud(image.points(), label, np.full(len(label), k))


def _target(part: Part) -> NDArray[np.float64]:
    """What the cameras look at: the middle of the part, on the axis where there is one."""
    middle = part.mesh.bounds.mean(axis=0)
    if part.order is None:
        return np.asarray(middle)
    return np.asarray(part.center + ((middle - part.center) @ part.axis) * part.axis)


def _move(motion: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (N, 3) after a rigid motion (4, 4)."""
    return turn(motion[:3, :3], points) + motion[:3, 3]


def _place(points: NDArray[np.float64], pose: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Points of the part, of diameter 1, in the world."""
    return size * turn(pose[:3, :3], np.atleast_2d(points)).reshape(points.shape) + pose[:3, 3]


def _view_in_world(view: View, pose: NDArray[np.float64], size: float) -> View:
    """A view of the part, of diameter 1, in the world."""
    world_from_camera = pose @ view.world_from_camera
    world_from_camera[:3, 3] = _place(view.center, pose, size)
    return replace(view, world_from_camera=world_from_camera)


def _check_whole(**options: tuple[int, int]) -> None:
    for name, (value, least) in options.items():
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
            raise InvalidInputError(f"{name} must be a whole number, {least} or more, got {value!r}")


def _check_range(below: float, **options: float) -> None:
    for name, value in options.items():
        if not 0.0 <= value < below:
            limit = "finite" if below == np.inf else f"below {below:g}"
            raise InvalidInputError(f"{name} must be zero or more and {limit}, got {value!r}")
