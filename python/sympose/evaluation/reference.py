"""The true surface of a part in its true frame, sampled so that the exact pose scores zero.

Independent random samples would put a floor under every surface distance, half their spacing (0.005 at 20,000
samples), and hide everything below. So one sector is sampled and rotated n-fold.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sympose.datasets.parts import Part
from sympose.datasets.parts.model import Order
from sympose.datasets.visibility import sample_visible

__all__ = ["Order", "Reference", "about_z", "group_of", "mesh_from_object", "reference_of", "turned_over"]

_SAMPLES = 20_000
_STEPS = 72  # a surface of revolution is sampled and judged at every 5 degrees


@dataclass(frozen=True, eq=False)
class Reference:
    """A part in its true frame: +z the axis, the origin at the centroid of the visible surface.

    Attributes:
        points: (M, 3) samples of the visible surface, carried into themselves by the symmetry [diameters].
        normals: (M, 3) their unit normals.
        symmetries: (S, 4, 4) the rotations of the symmetry group.
        order: Order of the part.
        mesh_from_object: (4, 4) from this frame to that of the mesh.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    symmetries: NDArray[np.float64]
    order: Order
    mesh_from_object: NDArray[np.float64]


@lru_cache(maxsize=64)
def reference_of(part: Part, *, count: int = _SAMPLES, seed: int = 0) -> Reference:
    """Sample one sector of `part` as cameras see it, and rotate it; about `count` samples in all.

    Raises:
        ImportError: trimesh or embreex is not installed.

    Example:
        >>> from sympose.datasets import part
        >>> three = reference_of(part("propeller_3"), count=3000)
        >>> three.symmetries.shape, len(three.points) % 3
        ((3, 4, 4), 0)
    """
    frame = mesh_from_object(part)
    mesh_points, mesh_normals = sample_visible(part.mesh, count, seed=seed)
    points = (mesh_points - frame[:3, 3]) @ frame[:3, :3]
    normals = mesh_normals @ frame[:3, :3]
    group = group_of(part.order)
    if len(group) > 1:
        # Which sector is arbitrary, and so is the sample that stands for an angle.
        sector = 2.0 * np.pi / len(group)
        inside = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi) < sector
        points = np.concatenate([points[inside] @ turn[:3, :3].T for turn in group])
        normals = np.concatenate([normals[inside] @ turn[:3, :3].T for turn in group])
    return Reference(points, normals, group, part.order, frame)


def group_of(order: Order) -> NDArray[np.float64]:
    """(S, 4, 4) rotations about z that leave a part of this order as it is, the identity first."""
    count = {None: 1, "continuous": _STEPS}.get(order) if not isinstance(order, int) else order
    return np.stack([about_z(2.0 * np.pi * k / (count or 1)) for k in range(count or 1)])


def mesh_from_object(part: Part) -> NDArray[np.float64]:
    """(4, 4) frame of a part: +z along its axis, the origin at its centre, +x near that of the mesh."""
    z = part.axis / np.linalg.norm(part.axis)
    x = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    frame[:3, 3] = part.center
    return frame


def about_z(angle: float) -> NDArray[np.float64]:
    """(4, 4) rotation by `angle` [rad] about z."""
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.eye(4)
    turn[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return turn


def turned_over() -> NDArray[np.float64]:
    """(4, 4) half turn about x, which reverses the axis."""
    return np.diag([1.0, -1.0, -1.0, 1.0])
