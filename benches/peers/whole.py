"""Whole estimates: raw points of a multi-view scan in, pose out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import sympose
from peers import clouds
from peers.report import Row, alternate, library, skipped

__all__ = ["estimate"]

_WORST_DEG = 0.1
_GOALS_MS = {"known": 150.0, "unknown": 400.0, "tracking": 50.0}


def estimate(repeats: int) -> Iterator[Row]:
    """Order known, unknown, from the pose before; then the same method with Open3D and SciPy."""
    scan = clouds.part_scan(500_000)
    data = {"viewpoints": scan.viewpoints, "threads": 2}
    before = sympose.estimate(scan.points, order=clouds.ORDER, **data)
    calls = {
        "known": lambda: sympose.estimate(scan.points, order=clouds.ORDER, **data),
        "unknown": lambda: sympose.estimate(scan.points, **data),
        "tracking": lambda: sympose.estimate(scan.points, order=clouds.ORDER, initial=before, **data),
    }
    times, busy, found = alternate(calls, repeats)
    for case, goal in _GOALS_MS.items():
        off = _angle_deg(found[case].axis, scan.axis)
        agrees = off < _WORST_DEG and found[case].order == clouds.ORDER
        yield Row(
            f"estimate, {'order ' if case != 'tracking' else ''}{case}",
            scan.name,
            "-",
            times[case],
            measured=times[case],
            goal=goal,
            at_most=True,
            unit="ms",
            agrees=agrees,
            results=f"axis {off:.3f} deg off, order {found[case].order}, {busy[case]:.0f} ms of CPU",
        )

    what, peer = "estimate, order known", "Open3D + SciPy"
    if library("open3d") is None:
        yield skipped(what, scan.name, peer)
        return
    from peers import method

    times, busy, results = alternate(
        {"sympose": calls["known"], peer: lambda: method.estimate(scan.points, clouds.ORDER)}, repeats
    )
    line, _ = results[peer]
    off, their_off = (_angle_deg(axis, scan.axis) for axis in (results["sympose"].axis, line.direction))
    yield Row(
        what,
        scan.name,
        peer,
        times["sympose"],
        times[peer],
        times[peer] / times["sympose"],
        15.0,
        cpu=busy[peer] / busy["sympose"],
        agrees=max(off, their_off) < _WORST_DEG,
        results=f"axis {off:.3f} and {their_off:.3f} deg off",
    )


def _angle_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Between two directions, sign ignored."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))))
