"""Errors of a pose: of the axis, along it and about it, and over the surface.

Lengths are given in diameters of the part, angles in degrees. An axis is a line, so its sign does not count:
it is a convention, like the place of the origin on the axis and the yaw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sympose.evaluation.reference import Order, Reference, about_z, turned_over
from sympose.metrics import adds, mssd

__all__ = [
    "SUCCESS_DEG",
    "SUCCESS_OFFSET",
    "PoseErrors",
    "along_axis",
    "axis_angle_deg",
    "axis_offset",
    "pose_errors",
    "wrap_deg",
]

SUCCESS_DEG = 2.0
SUCCESS_OFFSET = 0.02  # diameters

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class PoseErrors:
    """What separates an estimated pose from the true one.

    Attributes:
        axis_deg: Angle between the axes, at most 90.
        offset: Distance of the true centre from the estimated axis.
        along: From the true to the estimated origin along the true axis, signed.
        yaw_deg: Angle about the axis modulo 360/n; None where the order, the truth or the method has no yaw.
        adds: ADD-S with the yaw of the truth from the same rule; None where `yaw_deg` is.
        adds_aligned: ADD-S with the yaw of the truth turned to that of the estimate.
        mssd: Largest distance over the surface, least over the symmetry group; None where `yaw_deg` is.
        mssd_aligned: The same with the yaw of the truth turned to that of the estimate.
        success: Axis within 2 degrees and 0.02 diameters.
    """

    axis_deg: float
    offset: float
    along: float
    yaw_deg: float | None
    adds: float | None
    adds_aligned: float
    mssd: float | None
    mssd_aligned: float
    success: bool


def axis_angle_deg(first: Vector, second: Vector) -> float:
    """Angle between two lines with directions (3,), from 0 to 90 degrees; exact for small angles."""
    across = np.linalg.norm(np.cross(first, second))
    return float(np.degrees(np.arctan2(across, abs(first @ second))))


def axis_offset(center: Vector, point: Vector, axis: Vector) -> float:
    """Distance of `center` from the line through `point` along the unit `axis`."""
    return float(np.linalg.norm(np.cross(center - point, axis)))


def along_axis(center: Vector, point: Vector, axis: Vector) -> float:
    """How far `point` lies beyond `center` along the unit `axis`."""
    return float((point - center) @ axis)


def wrap_deg(angle_deg: float, period_deg: float) -> float:
    """The representative of an angle modulo `period_deg` that is nearest to zero."""
    return float((angle_deg + period_deg / 2.0) % period_deg - period_deg / 2.0)


def pose_errors(
    reference: Reference,
    world_from_object: NDArray[np.float64],
    estimated: NDArray[np.float64],
    *,
    diameter: float = 1.0,
    yaw: float | None = None,
) -> PoseErrors:
    """Compare an estimated pose with the truth.

    Args:
        reference: The part in its true frame.
        world_from_object: (4, 4) true pose of that frame.
        estimated: (4, 4) estimated pose: +z along the axis, origin on the axis.
        diameter: Of the part in the world.
        yaw: Angle [rad] in the true frame of the direction that the rule for the yaw chooses on the true
            surface, or None where there is none.
    """
    truth, guess = _in_diameters(world_from_object, diameter), _in_diameters(estimated, diameter)
    axis, center = truth[:3, 2], truth[:3, 3]
    angle = axis_angle_deg(axis, guess[:3, 2])
    offset = axis_offset(center, guess[:3, 3], guess[:3, 2])
    points = reference.points
    if axis @ guess[:3, 2] < 0.0:
        truth, points = truth @ turned_over(), points @ turned_over()[:3, :3]
        yaw = None if yaw is None else -yaw

    # The turn about z in true_from_estimated; what is left is the tilt.
    relative = np.linalg.inv(truth) @ guess
    turn = float(np.arctan2(relative[1, 0] - relative[0, 1], relative[0, 0] + relative[1, 1]))
    group = reference.symmetries
    aligned = guess @ about_z(-turn)
    judged = None if yaw is None or not _has_yaw(reference.order) else guess @ about_z(-yaw)
    period = None if judged is None else 360.0 / _period(reference.order)
    return PoseErrors(
        axis_deg=angle,
        offset=offset,
        along=along_axis(center, guess[:3, 3], axis),
        yaw_deg=None if period is None or yaw is None else wrap_deg(np.degrees(turn - yaw), period),
        adds=None if judged is None else adds(points, judged, truth),
        adds_aligned=adds(points, aligned, truth),
        mssd=None if judged is None else mssd(points, judged, truth, group),
        mssd_aligned=mssd(points, aligned, truth, group),
        success=angle < SUCCESS_DEG and offset < SUCCESS_OFFSET,
    )


def _has_yaw(order: Order) -> bool:
    return order != "continuous"


def _period(order: Order) -> int:
    return order if isinstance(order, int) else 1


def _in_diameters(pose: NDArray[np.float64], diameter: float) -> NDArray[np.float64]:
    scaled = pose.copy()
    scaled[:3, 3] /= diameter
    return scaled
