"""How far points are from the true surface: what joint optimisation is judged by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree  # type: ignore[import-untyped]

from sympose.datasets import Part, Scan
from sympose.datasets.optional import load

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["HISTOGRAM_EDGES", "PointErrors", "Surface", "point_errors"]

HISTOGRAM_EDGES = np.linspace(0.0, 0.008, 41)  # diameters; what lies beyond is counted in the last bin

_SAMPLES = 60_000
_CANDIDATES = 8
_MOST_POINTS = 20_000


class Surface:
    """A mesh that answers how far points are from it, exactly for points near it.

    The nearest point is sought on the triangles that hold the nearest few of many samples, so the distance is
    never too small, and too large only where the nearest triangle holds none of them.

    Args:
        mesh: Of diameter 1.

    Example:
        >>> import trimesh
        >>> box = Surface(trimesh.creation.box([0.5, 0.5, 0.5]))
        >>> box.distance([[0.26, 0.1, 0.0], [0.26, 0.26, 0.0]]).round(6).tolist()
        [0.01, 0.014142]
    """

    def __init__(self, mesh: Trimesh) -> None:
        triangles = np.asarray(mesh.triangles)
        samples, faces = load("trimesh").sample.sample_surface(mesh, _SAMPLES, seed=0)
        # The corners of the faces stand for those that are too small to be sampled.
        every = np.arange(len(triangles))
        inner = triangles.mean(axis=1, keepdims=True)
        corners = triangles + 1e-3 * (inner - triangles)
        self._triangles = triangles
        self._faces = np.concatenate([faces, np.repeat(every, 3)])
        self._tree = cKDTree(np.concatenate([samples, corners.reshape(-1, 3)]))

    def distance(self, points: Any) -> NDArray[np.float64]:
        """(N,) distances of (N, 3) points from the surface."""
        points = np.asarray(points, dtype=np.float64)
        _, nearest = self._tree.query(points, k=_CANDIDATES)
        candidates = self._triangles[self._faces[nearest]].reshape(-1, 3, 3)
        repeated = np.repeat(points, _CANDIDATES, axis=0)
        foot = load("trimesh").triangles.closest_point(candidates, repeated)
        return np.asarray(np.linalg.norm(foot - repeated, axis=1).reshape(-1, _CANDIDATES).min(axis=1))


@dataclass(frozen=True)
class PointErrors:
    """Mean distances to the true surface [diameters], and how many points lie in which range.

    Attributes:
        raw: Of the measured points that the answer keeps.
        voxel: Of their means in each voxel, which go into the optimisation.
        refined: Of the points that come out.
        histogram_voxel, histogram_refined: Shares of the points by `HISTOGRAM_EDGES`.
    """

    raw: float
    voxel: float
    refined: float
    histogram_voxel: tuple[float, ...]
    histogram_refined: tuple[float, ...]


def point_errors(part: Part, scan: Scan, estimate: Any) -> PointErrors | None:
    """Distances of the points of an estimate; None where it keeps no measured point of the part.

    Points of anything but the part (table, outliers) are left out, since no surface is true for them. At most
    20,000 points of each kind are measured.
    """
    inliers, rows = np.asarray(estimate.inliers), np.asarray(estimate.point_of_inlier)
    mine = scan.label_of_point[inliers] == 0
    inliers, rows = inliers[mine], rows[mine]
    if len(inliers) == 0:
        return None
    measured = scan.scene.points[inliers]
    refined = np.asarray(estimate.points)
    count = np.bincount(rows, minlength=len(refined))
    sums = [np.bincount(rows, weights=measured[:, k], minlength=len(refined)) for k in range(3)]
    filled = count > 0
    voxel = np.stack(sums, axis=1)[filled] / count[filled, None]
    surface = _surface(part)
    before, between, after = (
        surface.distance(_in_mesh(_some(cloud), scan)) for cloud in (measured, voxel, refined[filled])
    )
    return PointErrors(
        raw=float(before.mean()),
        voxel=float(between.mean()),
        refined=float(after.mean()),
        histogram_voxel=_shares(between),
        histogram_refined=_shares(after),
    )


@lru_cache(maxsize=8)
def _surface(part: Part) -> Surface:
    return Surface(part.mesh)


def _in_mesh(points: NDArray[np.float64], scan: Scan) -> NDArray[np.float64]:
    pose = scan.world_from_object
    return np.asarray((points - pose[:3, 3]) @ pose[:3, :3] / scan.scale)


def _some(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Evenly spaced rows, at most so many."""
    return points[:: -(-len(points) // _MOST_POINTS)]


def _shares(errors: NDArray[np.float64]) -> tuple[float, ...]:
    counts, _ = np.histogram(np.minimum(errors, HISTOGRAM_EDGES[-1]), HISTOGRAM_EDGES)
    return tuple((counts / max(len(errors), 1)).tolist())
