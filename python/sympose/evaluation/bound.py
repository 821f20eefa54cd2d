"""The least error that noise leaves: the Cramer-Rao bound of the axis with a known surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sympose.datasets import Scan
from sympose.datasets.depth_camera import cast
from sympose.datasets.parts import Part
from sympose.evaluation.reference import Reference
from sympose.metrics import adds

__all__ = ["NoiseBound", "adds_of_bound", "axis_bound", "noise_bound"]


@dataclass(frozen=True)
class NoiseBound:
    """Root mean square errors that no unbiased estimate can beat.

    Attributes:
        axis_deg: Angle of the axis [deg].
        offset: Distance of the centre from the axis [diameters].
    """

    axis_deg: float
    offset: float


def noise_bound(part: Part, scan: Scan, sigma: float) -> NoiseBound:
    """Bound for a scan of `part` with depth noise `sigma`, a share of the mean depth of each view.

    The noise lies along the ray, so that casting the ray again finds the true point and its normal. All of it
    is taken to act along the normal, as in point-to-plane. Where a surface is seen obliquely less of it does,
    so that an error can be a little below this bound.

    Raises:
        ValueError: The points of the scan fix no axis, or there is no noise.
    """
    pose = scan.world_from_object
    on_part = scan.label_of_point == 0
    points, normals, deviations = [], [], []
    for k, view in enumerate(scan.scene.views):
        mine = scan.view_of_point == k
        # As in the scan, the mean is taken over all that the view measured.
        mean_depth = view.project(scan.scene.points[mine])[1].mean() / scan.scale
        eye = (view.center - pose[:3, 3]) @ pose[:3, :3] / scan.scale
        rays = (scan.scene.points[mine & on_part] - pose[:3, 3]) @ pose[:3, :3] / scan.scale - eye
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        distance, face = cast(part.mesh, eye, rays)
        hit = face >= 0  # embree may lose a ray through an edge
        points.append(eye + distance[hit, None] * rays[hit])
        normals.append(np.asarray(part.mesh.face_normals)[face[hit]])
        deviations.append(np.full(int(hit.sum()), sigma * mean_depth))
    return axis_bound(
        np.concatenate(points), np.concatenate(normals), np.concatenate(deviations), part.axis, part.center
    )


def adds_of_bound(reference: Reference, bound: NoiseBound) -> float:
    """ADD-S of a pose whose axis is off by just the bound, in angle and in place."""
    angle = np.radians(bound.axis_deg)
    pose = np.eye(4)
    pose[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[0, 3] = bound.offset
    return float(adds(reference.points, pose, np.eye(4)))


def axis_bound(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    deviations: NDArray[np.float64],
    axis: NDArray[np.float64],
    center: NDArray[np.float64],
) -> NoiseBound:
    """Bound from true points (N, 3), unit normals (N, 3) and standard deviations (N,) of their distances.

    A tilt w and a shift t of the surface move a point by w x (p - c) + t, and its distance by n times that;
    w and t lie across the axis, since slide and yaw are held fixed.

    Raises:
        ValueError: The four numbers of the axis are not fixed by these points.
    """
    z = axis / np.linalg.norm(axis)
    x = np.linalg.svd(z[None])[2][1]
    across = np.stack([x, np.cross(z, x)], axis=1)
    if not (deviations > 0.0).all():
        raise ValueError("without noise there is no bound")
    jacobian = np.concatenate([np.cross(points - center, normals) @ across, normals @ across], axis=1)
    jacobian /= deviations[:, None]
    information = jacobian.T @ jacobian
    try:
        covariance = np.linalg.inv(information)
    except np.linalg.LinAlgError as error:
        raise ValueError("these points fix no axis") from error
    tilt, shift = np.trace(covariance[:2, :2]), np.trace(covariance[2:, 2:])
    if not (tilt > 0.0 and shift > 0.0 and np.linalg.cond(information) < 1e14):
        raise ValueError("these points fix no axis")
    return NoiseBound(float(np.degrees(np.sqrt(tilt))), float(np.sqrt(shift)))
