"""Clouds that tell good from bad: a scan as cameras deliver it, a lattice, noise, and a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sympose.camera import View
from sympose.datasets import part, render, scan
from sympose.datasets.depth_camera import pinhole
from sympose.datasets.view_poses import draw_camera_pose

__all__ = ["Cloud", "lattice", "noise", "part_scan", "table_scan", "thinned"]

Points = NDArray[np.float64]

PART = "wheel_hub_5"
ORDER = 5
_VIEWS = 5
_FIELD_OF_VIEW_DEG = 35.0


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points in the order in which they were measured, the camera of each, and the true axis."""

    name: str
    points: Points
    viewpoints: Points
    axis: Points


@lru_cache(maxsize=4)
def part_scan(count: int) -> Cloud:
    """`count` points of a part of diameter 1, from five views, view by view and row by row.

    The order matters: points that follow each other are neighbours in space, but each part of the surface
    comes up once for every view that saw it.
    """
    one = part(PART)
    target = one.mesh.bounds.mean(axis=0)
    poses = [
        draw_camera_pose(np.random.default_rng([1, view]), "sphere", target, 0.0) for view in range(_VIEWS)
    ]

    def measured(width: int) -> list[Points]:
        camera = pinhole(width, 3 * width // 4, _FIELD_OF_VIEW_DEG)
        rng = np.random.default_rng(2)
        return [render(one.mesh, View(camera, pose, ""), rng).points() for pose in poses]

    # What a few pixels hit tells how many are needed; one percent more, the rest is thinned out.
    few = sum(map(len, measured(320)))
    views = measured(int(320 * np.sqrt(1.01 * count / few)) + 1)
    points = np.concatenate(views)
    viewpoints = np.concatenate(
        [np.broadcast_to(pose[:3, 3], rows.shape) for pose, rows in zip(poses, views, strict=True)]
    )
    chosen = thinned(len(points), count)
    return Cloud(f"scan, {count:,}", points[chosen], viewpoints[chosen], one.axis)


@lru_cache(maxsize=1)
def table_scan(count: int) -> Points:
    """`count` points of a part on a table before a wall, as the cameras measured them."""
    points = scan(part(PART), "table", views=8, seed=1).scene.points
    return points[thinned(len(points), count)]


def lattice(count: int) -> Points:
    """About `count` points of a square lattice in a plane, of edge 1: coordinates come up again and again."""
    edge = int(np.sqrt(count))
    y, x = np.mgrid[:edge, :edge] / edge
    return np.stack([x.ravel(), y.ravel(), np.full(edge * edge, 0.25)], axis=1)


def noise(count: int) -> Points:
    """`count` points, uniform in a cube of edge 1."""
    return np.random.default_rng(3).random((count, 3))


def thinned(length: int, count: int) -> NDArray[np.int64]:
    """`count` of `length` indices at even steps, in order."""
    if length < count:
        raise ValueError(f"{count} of {length} points are too many")
    return np.linspace(0, length - 1, count).astype(np.int64)
