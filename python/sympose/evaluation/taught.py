"""Whether a part that was taught from one scan is found again in another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sympose
from sympose.datasets import Scan
from sympose.evaluation.measure import Row, identity, key_of
from sympose.evaluation.reference import Reference, about_z, reference_of, turned_over
from sympose.evaluation.scenario import Scenario, Subject
from sympose.metrics import mssd

__all__ = ["measure_taught", "taught_key"]

_METHOD = "taught"


def taught_key(subject: Subject, scenario: Scenario, seed: int) -> str:
    """What names the row of `measure_taught`."""
    return key_of(subject.source, subject.part.name, scenario.label, seed, _METHOD)


def measure_taught(subject: Subject, scenario: Scenario, seed: int) -> Row:
    """One row: teach the part from the scan of `seed`, find it in that of the next seed.

    `taught_mssd` [diameters] is between the pose that was found and the one that the truth gives to the
    taught frame; it is missing where one of the scans was refused.
    """
    part = subject.part
    row: Row = {**identity(subject, scenario, seed, _METHOD), "outcome": "ok"}
    first, second = scenario.scan(part, seed), scenario.scan(part, seed + 1)
    try:
        taught = sympose.estimate(_seen(first), threads=1)
        found = sympose.estimate(_seen(second), reference=taught.as_reference(), threads=1)
    except Exception as error:  # a failure is a result, too
        return {**row, "outcome": "error", "message": f"{type(error).__name__}: {error}"}
    reference = reference_of(part)
    # From the true frame of the first scan to the taught one, and back from where it was found in the second.
    taught_from_true = np.linalg.inv(taught.pose) @ _in_diameters(first) @ reference.mesh_from_object
    estimated, truth = found.pose @ taught_from_true, _in_diameters(second) @ reference.mesh_from_object
    symmetries = reference.symmetries
    if part.dihedral:
        symmetries = np.concatenate([symmetries, symmetries @ _flip(reference)])
    row["taught_mssd"] = mssd(reference.points, estimated, truth, symmetries)
    row["score"] = float(found.score)
    return row


def _flip(reference: Reference) -> NDArray[np.float64]:
    """(4, 4) half turn about an axis across that of a dihedral part; the surface tells which."""
    tree = sympose.KdTree(reference.points)
    some = reference.points[:: max(1, len(reference.points) // 2000)]
    flips = some @ turned_over()[:3, :3].T

    def misfit(angle: float) -> float:
        distances, _ = tree.query(flips @ about_z(angle)[:3, :3].T)
        return float(np.mean(distances))

    best, width = 0.0, 2.0 * np.pi / len(reference.symmetries)
    for _ in range(4):
        angles = best + width * np.linspace(-0.5, 0.5, 33)
        best, width = angles[np.argmin([misfit(angle) for angle in angles])], width / 16
    return about_z(best) @ turned_over()


def _seen(scan: Scan) -> sympose.Scene:
    return sympose.Scene(scan.scene.points / scan.diameter, viewpoints=_eyes(scan))


def _eyes(scan: Scan) -> NDArray[np.float64] | None:
    return None if scan.scene.viewpoints is None else scan.scene.viewpoints / scan.diameter


def _in_diameters(scan: Scan) -> NDArray[np.float64]:
    pose = scan.world_from_object.copy()
    pose[:3, 3] /= scan.diameter
    return pose
