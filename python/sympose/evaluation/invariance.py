"""Whether the pose follows the cloud: shifted far, scaled, rotated, and in single precision."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import sympose
from sympose.evaluation.measure import Row
from sympose.evaluation.reference import reference_of
from sympose.evaluation.scenario import Scenario, Subject
from sympose.metrics import mssd

__all__ = ["CHANGES", "measure_invariance"]

_SHIFT = np.array([4e6, -4e6, 4e6])
_SCALE = 1000.0
_AXIS_ANGLE = np.array([0.3, -1.1, 0.7])

CHANGES = ("shifted", "scaled", "rotated", "float32")


def measure_invariance(subject: Subject, scenario: Scenario, seed: int) -> Row:
    """One row: by how much each change of the cloud changes the pose, as MSSD in diameters."""
    scan = scenario.scan(subject.part, seed)
    points, eyes = scan.scene.points, scan.scene.viewpoints
    row: Row = {
        "key": f"{subject.source} | {subject.part.name} | {scenario.label} | {seed} | invariance",
        "source": subject.source,
        "part": subject.part.name,
        "family": subject.part.family,
        "order": subject.part.order,
        "scenario": scenario.label,
        "seed": seed,
        "method": "invariance",
        "outcome": "ok",
    }

    def pose(cloud: NDArray[np.floating], viewpoints: NDArray[np.float64] | None) -> NDArray[np.float64]:
        found = sympose.estimate(cloud, order=subject.part.order, viewpoints=viewpoints, threads=1)
        return np.array(found.pose)

    def moved(change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
        return pose(change(points), None if eyes is None else change(eyes))

    rotation = _rotation(_AXIS_ANGLE)
    turn = np.eye(4)
    turn[:3, :3] = rotation
    reference = reference_of(subject.part)
    try:
        base = pose(points, eyes)
        shifted = moved(lambda p: p + _SHIFT)
        shifted[:3, 3] -= _SHIFT
        scaled = moved(lambda p: p * _SCALE)
        scaled[:3, 3] /= _SCALE
        rotated = np.linalg.inv(turn) @ moved(lambda p: p @ rotation.T)
        single = pose(((points + _SHIFT) - _SHIFT).astype(np.float32), eyes)
    except Exception as error:  # a failure is a result, too
        return {**row, "outcome": "error", "message": f"{type(error).__name__}: {error}"}
    for name, other in zip(CHANGES, (shifted, scaled, rotated, single), strict=True):
        row[f"change_{name}"] = mssd(reference.points, other, base, reference.symmetries)
    return row


def _rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation from axis times angle (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)
