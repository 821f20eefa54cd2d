"""Clouds that look solid: dots in the size of their spacing, lit by their normals, far ones first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose._core import estimate_normals, voxel_downsample
from sympose.plotting.style import AXIS, HEADING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Eye", "draw_cloud"]

_CELLS = 190.0  # dots along the longest side of a drawing
_OVERLAP = 2.0  # of a dot over the spacing, so that a surface has no holes
_AMBIENT = 0.38


@dataclass(frozen=True, eq=False)
class Eye:
    """Where a cloud is looked at from: a parallel projection.

    Attributes:
        right, up, toward: (3,) unit vectors of the picture; `toward` points at who looks.
    """

    right: NDArray[np.float64]
    up: NDArray[np.float64]
    toward: NDArray[np.float64]

    @classmethod
    def at(cls, toward: ArrayLike, up: ArrayLike) -> Eye:
        """Look from the direction `toward`, with `up` upright; the two must not be parallel."""
        ahead = np.asarray(toward, dtype=np.float64)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(np.asarray(up, dtype=np.float64), ahead)
        right /= np.linalg.norm(right)
        return cls(right, np.cross(ahead, right), ahead)

    @classmethod
    def of_pose(
        cls, pose: NDArray[np.float64], *, azimuth_deg: float = 35.0, height_deg: float = 38.0
    ) -> Eye:
        """Look down on an object from `height_deg` over its xy plane, the axis upright."""
        azimuth, height = np.radians([azimuth_deg, height_deg])
        x, y, z = pose[:3, :3].T
        flat = np.cos(azimuth) * x + np.sin(azimuth) * y
        return cls.at(np.cos(height) * flat + np.sin(height) * z, z)

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (N, 2) places in the picture and (N,) nearness of (N, 3) points."""
        return points @ np.stack([self.right, self.up], axis=1), points @ self.toward


def draw_cloud(
    axes: Axes,
    eye: Eye,
    points: NDArray[np.float64],
    colors: Any,
    *,
    pose: NDArray[np.float64] | None = None,
    frame: tuple[NDArray[np.float64], float] | None = None,
) -> None:
    """Draw points as a surface that is lit from beside who looks.

    Args:
        axes: Where to.
        eye: Where from.
        points: (N, 3), finite.
        colors: One colour, or (N, 3) from 0 to 1.
        pose: (4, 4) of an object, whose axis is drawn through the points, and its +x.
        frame: (3,) centre and half the width of what is shown; everything where it is not given.
    """
    from matplotlib.colors import to_rgb

    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="datalim")
    if len(points) == 0:
        axes.text(0.5, 0.5, "no points", ha="center", va="center", transform=axes.transAxes)
        return
    rgb = np.broadcast_to(to_rgb(colors) if isinstance(colors, str) else np.asarray(colors), (len(points), 3))
    if frame is not None:
        (middle,), half = eye.project(frame[0][None])[0], frame[1]
        # Half as much again, since the picture need not be square.
        inside = (np.abs(eye.project(points)[0] - middle) <= 1.5 * half).all(axis=1)
        points, rgb = points[inside], rgb[inside]
        corners = [middle - half, middle + half]
    else:
        places, _ = eye.project(points)
        corners = [places.min(axis=0), places.max(axis=0)]
    cell = float((corners[1] - corners[0]).max()) / _CELLS
    if cell > 0.0:
        shown = _thinned(points, cell)
        points, rgb = points[shown], rgb[shown]
    places, nearness = eye.project(points)
    lit = np.clip(rgb * _light(points, eye)[:, None], 0.0, 1.0)
    order = np.argsort(nearness)
    front = np.zeros(len(points), dtype=bool) if pose is None else _before_axis(eye, pose, places, nearness)
    size = _OVERLAP * max(cell, _spacing(points))
    for chosen, layer in ((order[~front[order]], 1), (order[front[order]], 3)):
        _draw_dots(axes, places[chosen], lit[chosen], size, layer)
    if pose is not None:
        corners += list(_draw_pose(axes, eye, pose, points))
    axes.update_datalim(corners)
    axes.margins(0.04)
    axes.autoscale_view()


def _draw_dots(
    axes: Axes, places: NDArray[np.float64], colors: NDArray[np.float64], size: float, layer: int
) -> None:
    from matplotlib.collections import EllipseCollection

    # Ellipses, unlike the markers of a scatter plot, have a size in the unit of the cloud.
    dots = EllipseCollection(
        [size], [size], [0.0],
        units="xy", offsets=places, offset_transform=axes.transData, facecolors=colors, edgecolors="none",
        zorder=layer, rasterized=True,
    )  # fmt: skip
    axes.add_collection(dots, autolim=False)


def _draw_pose(
    axes: Axes, eye: Eye, pose: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Draw the axis between the dots behind and before it, faintly over all, and +x; return the ends."""
    x, _, z = pose[:3, :3].T
    offsets = points - pose[:3, 3]
    height = offsets @ z
    radius = float(np.linalg.norm(offsets - height[:, None] * z, axis=1).max())
    reach = 0.35 * (2.0 * radius)
    along = np.array([height.min() - 0.6 * reach, height.max() + reach])
    line, _ = eye.project(pose[:3, 3] + along[:, None] * z)
    for layer, style in ((2, {"lw": 2.6}), (4, {"lw": 1.1, "ls": (0, (2, 2))})):
        axes.plot(*line.T, color=AXIS, zorder=layer, solid_capstyle="round", **style)
    arrow = {"arrowstyle": "-|>", "lw": 2.2, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 15}
    tip = line[1] + 0.14 * (line[1] - line[0])
    axes.annotate("", tip, line[1], arrowprops={**arrow, "color": AXIS}, zorder=5)
    heading, _ = eye.project(pose[:3, 3] + np.array([[0.0], [1.25 * radius]]) * x)
    axes.annotate("", heading[1], heading[0], arrowprops={**arrow, "color": HEADING}, zorder=5)
    for name, place, color in (("z", tip, AXIS), ("x", heading[1], HEADING)):
        axes.annotate(
            name, place, xytext=(6, 4), textcoords="offset points", color=color, fontweight="bold", zorder=6
        )
    return np.stack([line[0], tip, heading[1]])


def _before_axis(
    eye: Eye, pose: NDArray[np.float64], places: NDArray[np.float64], nearness: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which dots lie nearer than the axis where they meet it in the picture."""
    (base, tip), near = eye.project(np.stack([pose[:3, 3], pose[:3, 3] + pose[:3, 2]]))
    step = tip - base
    length_sq = float(step @ step)
    if length_sq < 1e-6:  # looked at along the axis
        return np.zeros(len(places), dtype=bool)
    along = (places - base) @ step / length_sq
    return np.asarray(nearness > near[0] + along * (near[1] - near[0]))


def _thinned(points: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """Rows of `points`, one for each occupied voxel of edge `cell`."""
    _, inverse = voxel_downsample(points, cell, return_inverse=True)
    return np.asarray(np.unique(inverse, return_index=True)[1])


def _spacing(points: NDArray[np.float64]) -> float:
    """Edge of a square that holds one of the points on a surface, about."""
    from sympose._core import KdTree

    if len(points) < 8:
        return 0.0
    some = points[:: max(1, len(points) // 2000)]
    return float(np.median(KdTree(points).query(some, 5)[0][:, 4]) / 1.3)


def _light(points: NDArray[np.float64], eye: Eye) -> NDArray[np.float64]:
    """(N,) brightness of each point under a lamp beside who looks."""
    if len(points) < 8:
        return np.ones(len(points))
    normals = estimate_normals(points, min(16, len(points)))
    normals = normals * np.where(normals @ eye.toward < 0.0, -1.0, 1.0)[:, None]
    lamp = eye.toward + 0.45 * eye.up - 0.35 * eye.right
    lamp = lamp / np.linalg.norm(lamp)
    diffuse = np.clip(normals @ lamp, 0.0, 1.0)
    gloss = 0.16 * diffuse**24
    return np.asarray(_AMBIENT + (1.02 - _AMBIENT) * diffuse + gloss)
