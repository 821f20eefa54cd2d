"""Whether an estimate is as uncertain as it says: its covariance beside its error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["is_inside", "stated_figures"]

_AXIS = [0, 1, 3, 4]  # two tilts and two shifts: an axis is a line, which has four parameters
_REGION = 9.4877  # 95 % of a chi-squared variable with four degrees of freedom lie below


def stated_figures(
    estimate: Any, axis: NDArray[np.float64], center: NDArray[np.float64], diameter: float
) -> dict[str, float]:
    """The error of the axis beside what the covariance says about it.

    Args:
        estimate: Of a scan.
        axis, center: (3,) true direction of the axis, and a true point of it.
        diameter: Of the part, in the unit of the scan.

    Returns:
        `shift`, the distance of the true axis from the origin of the estimate [diameters]; `stated_deg` and
        `stated_shift`, the stated standard deviations of the angle and of the shift; `axis_chi_sq`, the
        squared Mahalanobis distance of the true axis. Nothing where a direction of the axis is free.
    """
    stated = np.asarray(estimate.covariance)[np.ix_(_AXIS, _AXIS)]
    if not np.isfinite(stated).all():
        return {}
    rotation = np.asarray(estimate.pose)[:3, :3]
    true = rotation.T @ axis
    true = true / true[2]  # a line, so that its sign does not matter
    across = rotation.T @ (center - np.asarray(estimate.center))
    across = across - across[2] * true
    # A small turn w moves z by w x z = (w_y, -w_x, 0).
    error = np.array([-true[1], true[0], across[0], across[1]])
    return {
        "shift": float(np.hypot(across[0], across[1])) / diameter,
        "stated_deg": float(np.degrees(np.sqrt(stated[0, 0] + stated[1, 1]))),
        "stated_shift": float(np.sqrt(stated[2, 2] + stated[3, 3])) / diameter,
        "axis_chi_sq": float(error @ np.linalg.solve(stated, error)),
    }


def is_inside(row: Mapping[str, Any]) -> bool:
    """Whether the true axis lies in the stated 95 % region."""
    return bool(row["axis_chi_sq"] <= _REGION)
