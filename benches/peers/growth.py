"""What more points and more threads cost; each measured in processes of their own."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from peers import clouds
from peers.report import Row

__all__ = ["growth", "second_thread"]


class _Child:
    """A process that estimates the pose of one cloud whenever it is asked to."""

    def __init__(self, folder: Path, threads: int) -> None:
        command = [sys.executable, str(Path(__file__).with_name("child.py")), str(folder)]
        self.process = subprocess.Popen(
            [*command, str(threads), str(clouds.ORDER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def answer(self) -> dict[str, float]:
        """Seconds of the estimate, and the peak of the whole process [bytes]."""
        assert self.process.stdout is not None
        row: dict[str, float] = json.loads(self.process.stdout.readline())
        return row

    def close(self) -> None:
        self.process.communicate()


def second_thread(repeats: int) -> Iterator[Row]:
    """Two threads on one estimate, beside two processes of one thread each: what sharing the work costs."""
    with tempfile.TemporaryDirectory() as folder:
        scan = _store(500_000, Path(folder))
        both, *single = [_Child(Path(folder), threads) for threads in (2, 1, 1)]
        together, apart = [], []
        for done in range(repeats + 1):
            both.ask()
            together.append(both.answer()["seconds"])
            for child in single:
                child.ask()
            apart.append(max(child.answer()["seconds"] for child in single))
            if done == 0:  # the first warms the caches
                together.clear(), apart.clear()
        for child in (both, *single):
            child.close()
    ours, theirs = (1e3 * statistics.median(seconds) for seconds in (together, apart))
    # While the two processes do two estimates, two threads could do two, one after the other.
    share = theirs / (2.0 * ours)
    yield Row("second thread", scan, "two processes", ours, theirs, share, 0.85, unit="of it")


def growth(repeats: int) -> Iterator[Row]:
    """Ten times the points of the same part: time and memory."""
    medians, rows = [], []
    for count in (1_000_000, 10_000_000):
        with tempfile.TemporaryDirectory() as folder:
            scan = _store(count, Path(folder))
            size = sum(file.stat().st_size for file in Path(folder).iterdir())
            child = _Child(Path(folder), 2)
            answers = []
            for _ in range(min(repeats, 3)):
                child.ask()
                answers.append(child.answer())
            child.close()
        medians.append(1e3 * statistics.median(answer["seconds"] for answer in answers))
        # The peak of the first call, the input and the interpreter included.
        peak, allowed = answers[0]["peak"] / 1e6, 3.0 * size / 1e6 + 200.0
        rows.append(
            Row("peak memory", scan, "-", medians[-1], measured=peak, goal=allowed, at_most=True, unit="MB")
        )
    yield from rows
    factor = medians[1] / medians[0]
    yield Row(
        "ten times the points",
        "scan",
        "-",
        medians[1],
        measured=factor,
        goal=11.5,
        at_most=True,
        unit="times",
    )


def _store(count: int, folder: Path) -> str:
    scan = clouds.part_scan(count)
    np.save(folder / "points.npy", scan.points)
    np.save(folder / "viewpoints.npy", scan.viewpoints)
    clouds.part_scan.cache_clear()
    return scan.name
