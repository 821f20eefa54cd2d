"""The method of Sympose, written with Open3D and SciPy as one would for a day's use.

Voxel grid, outlier filters, normals; axes tried from directions all over the half sphere, each aligned with
its own rotated copies by Gauss-Newton steps in the four parameters of a line; the best one refined on all
points; the cloud completed by its rotated copies. Left out, in its favour: the ground, free space, the order,
joint refinement of the points, covariance, and the yaw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["Line", "estimate"]

Array = NDArray[np.float64]

_THREADS = 2
_DIRECTIONS = 60
_HUBER = 1.345


@dataclass(frozen=True, eq=False)
class Line:
    """An axis: a point on it and its unit direction."""

    center: Array
    direction: Array

    def turned(self, points: Array, angle: float) -> Array:
        """Points turned about the line (Rodrigues)."""
        return self.center + _turn(self.direction, points - self.center, angle)


@dataclass(frozen=True, eq=False)
class Surface:
    points: Array
    normals: Array
    tree: cKDTree


def estimate(points: Array, order: int) -> tuple[Line, Array]:
    """The axis of a part of this order, and the completed cloud."""
    surface, size = _surface(points)
    angles = [2.0 * np.pi * k / order for k in range(1, order // 2 + 1)]
    center = surface.points.mean(axis=0)
    lines = [Line(center, direction) for direction in _half_sphere(_DIRECTIONS)]
    # Rounds of more points, a narrower gate and fewer axes.
    for samples, gate, steps, kept in [
        (200, 0.06, 6, 10),
        (1000, 0.03, 5, 3),
        (len(surface.points), 0.015, 8, 1),
    ]:
        chosen = np.linspace(0, len(surface.points) - 1, samples).astype(int)
        aligned = [_align(surface, chosen, line, angles, gate * size, steps) for line in lines]
        aligned.sort(key=lambda line: -_explained(surface, chosen, line, angles, 0.5 * gate * size))
        lines = aligned[:kept]
    axis = lines[0]
    copies = np.concatenate([axis.turned(surface.points, 2.0 * np.pi * k / order) for k in range(order)])
    return axis, np.asarray(_cloud(copies).voxel_down_sample(size / 200.0).points)


def _surface(points: Array) -> tuple[Surface, float]:
    """The cleaned cloud with normals, and the size of the part."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)) / np.sqrt(2.0))
    cloud = _cloud(points).voxel_down_sample(size / 200.0)
    cloud, _ = cloud.remove_radius_outlier(4, 3.0 * size / 200.0)
    cloud, _ = cloud.remove_statistical_outlier(20, 3.0)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
    points = np.asarray(cloud.points)
    return Surface(points, np.asarray(cloud.normals), cKDTree(points)), size


def _align(surface: Surface, chosen: Array, line: Line, angles: list[float], gate: float, steps: int) -> Line:
    """Gauss-Newton on symmetric point-to-plane residuals with Huber's weights."""
    for _ in range(steps):
        rows, residuals = [], []
        # Two tilts and two shifts: turning about the line and sliding along it change nothing.
        across = np.linalg.svd(line.direction[None])[2][1:]
        for angle in angles:
            turned, partner, met = _matches(surface, chosen, line, angle, gate)
            normals = _turn(line.direction, surface.normals[chosen[met]], angle)
            theirs = surface.normals[partner]
            normals = theirs + np.copysign(1.0, np.einsum("ij,ij->i", normals, theirs))[:, None] * normals
            normals /= np.linalg.norm(normals, axis=1)[:, None]
            before, after = surface.points[chosen[met]] - line.center, turned - line.center
            tilts = [np.cross(u, after) - _turn(line.direction, np.cross(u, before), angle) for u in across]
            shifts = [np.broadcast_to(u - _turn(line.direction, u, angle), after.shape) for u in across]
            rows.append(np.stack([np.einsum("ij,ij->i", normals, d) for d in tilts + shifts], axis=1))
            residuals.append(np.einsum("ij,ij->i", normals, turned - surface.points[partner]))
        jacobian, residual = np.concatenate(rows), np.concatenate(residuals)
        if len(residual) < 10:
            return line
        scale = 1.4826 * np.median(np.abs(residual)) + 1e-12
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(residual), 1e-300))
        normal = jacobian.T @ (weight[:, None] * jacobian) + 1e-9 * np.eye(4)
        step = -np.linalg.solve(normal, jacobian.T @ (weight * residual))
        direction = line.direction + np.cross(step[:2] @ across, line.direction)
        line = Line(line.center + step[2:] @ across, direction / np.linalg.norm(direction))
    return line


def _explained(surface: Surface, chosen: Array, line: Line, angles: list[float], gate: float) -> float:
    """Share of the points that meet a surface of the same slope after every turn."""
    met_by_turn = []
    for angle in angles:
        _, partner, met = _matches(surface, chosen, line, angle, gate)
        normals = _turn(line.direction, surface.normals[chosen[met]], angle)
        met[met] = np.abs(np.einsum("ij,ij->i", normals, surface.normals[partner])) > 0.8
        met_by_turn.append(met.mean())
    return float(np.mean(met_by_turn))


def _matches(
    surface: Surface, chosen: Array, line: Line, angle: float, gate: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Turned points that meet the cloud, the points they meet, and which of the chosen they are."""
    turned = line.turned(surface.points[chosen], angle)
    distance, partner = surface.tree.query(turned, distance_upper_bound=gate, workers=_THREADS)
    met = np.isfinite(distance)
    return turned[met], partner[met], met


def _turn(axis: Array, vectors: Array, angle: float) -> Array:
    along = (vectors @ axis)[..., None] * axis
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * np.cross(axis, vectors)


def _half_sphere(count: int) -> Array:
    """Directions on a Fibonacci lattice."""
    i = np.arange(count)
    z, turn = (i + 0.5) / count, np.pi * (3.0 - np.sqrt(5.0)) * i
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)


def _cloud(points: Array) -> o3d.geometry.PointCloud:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
