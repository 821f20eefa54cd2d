"""A row of the comparison, its goal, and the tables."""

from __future__ import annotations

import json
import math
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

__all__ = ["HEAD", "Row", "alternate", "header", "library", "line", "skipped", "write"]

_BUDGET = 40.0
"""Seconds after which a row is content with three rounds."""

_SHORT = 100.0
"""Milliseconds below which a call is short."""

_missing: dict[str, str] = {}
"""Modules that could not be imported, and why."""

_PEERS = ("open3d", "scipy", "scikit-learn", "small_gicp")

HEAD = (
    "| what | cloud | peer | ours [ms] | peer [ms] | measured | CPU | goal | met | results |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes:
        what: The job.
        cloud: What it was done on.
        peer: What it was measured against.
        ours: Our time [ms].
        peer_ms: Its time [ms], or None.
        measured: What the goal speaks of: a ratio of times unless `unit` says otherwise; None when skipped.
        goal: Its bound, or None where there is none.
        at_most: The bound is an upper one.
        unit: Of `measured` and `goal`.
        cpu: Ratio of the times of all processors, which other work on the machine disturbs less.
        agrees: The results are the same, up to what `results` says.
        results: How the results compare.
    """

    what: str
    cloud: str
    peer: str
    ours: float | None = None
    peer_ms: float | None = None
    measured: float | None = None
    goal: float | None = None
    at_most: bool = False
    unit: str = "x"
    cpu: float | None = None
    agrees: bool = True
    results: str = ""

    @property
    def met(self) -> bool | None:
        if self.goal is None or self.measured is None:
            return None
        return self.measured <= self.goal if self.at_most else self.measured >= self.goal


def alternate(
    calls: Mapping[str, Callable[[], Any]], repeats: int
) -> tuple[dict[str, float], dict[str, float], dict[str, Any]]:
    """Call all in turn: median time by the clock and of the processors [ms], and the last results.

    Where one of them is short, each is called twice in a row and timed the second time, as in a loop: threads
    that wake after a pause may share a core until the scheduler notices, a few milliseconds later.
    """
    results: dict[str, Any] = {}
    shortest = math.inf
    for name, call in calls.items():  # warms caches and pools
        start = time.perf_counter()
        results[name] = call()
        shortest = min(shortest, 1e3 * (time.perf_counter() - start))
    times: dict[str, list[float]] = {name: [] for name in calls}
    busy: dict[str, list[float]] = {name: [] for name in calls}
    begun = time.perf_counter()
    for done in range(repeats):
        if done >= 3 and time.perf_counter() - begun > _BUDGET:
            break
        for name, call in calls.items():
            if shortest < _SHORT:
                call()
            start, used = time.perf_counter(), time.process_time()
            results[name] = call()
            times[name].append(1e3 * (time.perf_counter() - start))
            busy[name].append(1e3 * (time.process_time() - used))
    return _medians(times), _medians(busy), results


def _medians(values: Mapping[str, list[float]]) -> dict[str, float]:
    return {name: statistics.median(rows) for name, rows in values.items()}


def library(name: str) -> Any | None:
    """The module of a peer, or None where it cannot be imported."""
    try:
        return import_module(name)
    except ImportError as error:
        _missing[name.partition(".")[0]] = str(error)
        return None


def skipped(what: str, cloud: str, peer: str) -> Row:
    """In place of a row, when the module of a peer is missing, or lacks a library of its own."""
    module = {"scikit-learn": "sklearn"}.get(peer, peer.split()[0].lower())
    return Row(what, cloud, peer, results=f"skipped: {_missing.get(module, 'it would take too long')}")


def header() -> str:
    """What was measured, and on what."""
    versions = []
    for name in ("sympose", *_PEERS):
        try:
            versions.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            versions.append(f"{name} not installed")
    return (
        f"Two threads, {platform.machine()}, Python {platform.python_version()}; {', '.join(versions)}.\n"
        "Measured: time of the peer over ours, unless there is a unit; CPU: the same, of all processors.\n"
    )


def line(row: Row) -> str:
    """The row of a Markdown table."""
    bound = "" if row.goal is None else f"{'<=' if row.at_most else '>='} {row.goal:g} {row.unit}"
    met = {None: "", True: "yes", False: "**no**"}[row.met]
    cells = [row.what, row.cloud, row.peer, _number(row.ours), _number(row.peer_ms)]
    measured = "" if row.measured is None else f"{_number(row.measured)} {row.unit}"
    results = row.results if row.agrees else f"**disagree**: {row.results}"
    cpu = "" if row.cpu is None else f"{_number(row.cpu)} x"
    return f"| {' | '.join([*cells, measured, cpu, bound, met, results])} |"


def write(rows: list[Row], folder: Path) -> None:
    """Write the rows as JSON and as a Markdown table."""
    table = [asdict(row) | {"met": row.met} for row in rows]
    (folder / "compare_peers.json").write_text(json.dumps(table, indent=1) + "\n")
    lines = [header(), HEAD, *map(line, rows)]
    (folder / "compare_peers.md").write_text("\n".join(lines) + "\n")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 1000 else f"{value:,.0f}"
