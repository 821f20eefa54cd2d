"""Figures held against targets: what the project promises about its accuracy, and whether it keeps it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sympose.evaluation.invariance import CHANGES
from sympose.evaluation.measure import Row
from sympose.evaluation.scenario import Scenario
from sympose.evaluation.summary import figure, grouped, markdown_table, share, statistics

__all__ = ["ALONE", "ONE_VIEW", "SPHERE", "TABLE", "Check", "check_all", "checks_table"]

SPHERE = Scenario("sphere", 5)
ONE_VIEW = Scenario("sphere", 1)
TABLE = Scenario("table", 5)
ALONE = Scenario("alone", 5)

_LOST = 90.0  # degrees; stands for a scan without an answer, so that it counts against "every" and shares


@dataclass(frozen=True)
class Check:
    """One promise.

    Attributes:
        scenario, what: What is measured.
        target, measured: In words.
        passed: None where nothing was measured.
        failing: The scans that break it, worst first.
    """

    scenario: str
    what: str
    target: str
    measured: str
    passed: bool | None
    failing: tuple[str, ...] = ()


def check_all(rows: Sequence[Row]) -> list[Check]:
    """Every promise for which there are rows; the parts of each source are judged apart."""
    found: list[Check] = []
    for (source,), mine in grouped((row for row in rows if "source" in row), "source").items():
        found += [
            *_accuracy(_pick(mine, SPHERE, "default"), f"5 views, {source}"),
            _within(_pick(mine, ONE_VIEW, "default"), f"1 view, {source}", 0.97),
            *_paper(mine, source),
            _worst(
                _pick(mine, SPHERE, "no_viewpoints"),
                f"no viewpoints, 5 views, {source}",
                "axis_deg",
                1.0,
                "deg",
            ),
            _mean(
                _pick(mine, SPHERE, "no_viewpoints"),
                f"no viewpoints, 5 views, {source}",
                "axis_deg",
                0.03,
                "deg",
            ),
            _joint(_pick(mine, SPHERE, "default"), source),
            *_segmentation(mine, source),
            *_invariance([row for row in mine if row["method"] == "invariance"], source),
        ]
    found += _performance([row for row in rows if row["method"] == "performance"])
    return [check for check in found if check.passed is not None]


def checks_table(checks: Sequence[Check]) -> str:
    """The promises in Markdown, and below the scans that break them."""
    head = ["scenario", "figure", "target", "measured", ""]
    body = [[c.scenario, c.what, c.target, c.measured, "pass" if c.passed else "**fail**"] for c in checks]
    lines = [markdown_table(head, body)]
    for check in checks:
        if check.failing:
            lines.append(f"{check.scenario}, {check.what}: " + "; ".join(check.failing))
    return "\n\n".join(lines)


def _accuracy(rows: Sequence[Row], scenario: str) -> list[Check]:
    return [
        _worst(rows, scenario, "axis_deg", 1.0, "deg"),
        _mean(rows, scenario, "axis_deg", 0.02, "deg"),
        _mean(rows, scenario, "offset", 0.0002),
        _mean(rows, scenario, "adds", 0.006),
        _mean(rows, scenario, "adds_aligned", 0.006),
    ]


def _paper(rows: Sequence[Row], source: str) -> list[Check]:
    """The preset of the paper: joint optimisation must help, and the axis be right where the start is."""
    scenario = f"`Config.paper()`, 5 views, {source}"
    joint = {row["key"]: row for row in _pick(rows, SPHERE, "paper") if row["outcome"] == "ok"}
    alone = {row["key"]: row for row in _pick(rows, SPHERE, "paper_no_joint") if row["outcome"] == "ok"}
    pairs = [(row, alone[key + "_no_joint"]) for key, row in joint.items() if key + "_no_joint" in alone]
    checks = []
    for column in ("axis_deg", "adds_aligned"):
        with_joint = statistics([one for one, _ in pairs], column).mean
        without = statistics([other for _, other in pairs], column).mean
        checks.append(
            Check(
                scenario,
                f"{column} with / without joint optimisation, mean",
                "better with",
                f"{figure(with_joint)} / {figure(without)}",
                with_joint < without if pairs else None,
            )
        )
    near = [row for row in joint.values() if row.get("start_deg", _LOST) < 10.0]
    checks.append(_worst(near, f"{scenario}, start within 10 deg", "axis_deg", 0.2, "deg"))
    return checks


def _joint(rows: Sequence[Row], source: str) -> Check:
    moved = [row for row in rows if "refined_error" in row]
    ratios = {row["key"]: row["refined_error"] / row["raw_error"] for row in moved}
    mean = float(np.mean(list(ratios.values()))) if ratios else float("nan")
    over_voxel = (
        statistics(moved, "refined_error").mean / statistics(moved, "voxel_error").mean if moved else 0.0
    )
    return Check(
        f"joint optimisation, 5 views, {source}",
        "distance of the points to the true surface over that of the raw",
        "mean <= 0.6",
        f"mean {mean:.3f}, worst {max(ratios.values(), default=0.0):.3f} ({over_voxel:.3f} of voxel means)",
        mean <= 0.6 if ratios else None,
        _named(ratios, lambda ratio: ratio > 0.6, "{:.2f}"),
    )


def _segmentation(rows: Sequence[Row], source: str) -> list[Check]:
    table, alone = _pick(rows, TABLE, "default"), _pick(rows, ALONE, "default")
    on_table, by_itself = f"table and wall, 5 views from above, {source}", f"`alone`, {source}"
    grounds = {row["key"]: 1.0 for row in alone if row.get("has_ground", True)}
    return [
        _worst(table, on_table, "axis_deg", 1.0, "deg"),
        _least(table, on_table, "kept_precision", 0.98, "points kept that belong to the part"),
        _least(table, on_table, "kept_recall", 0.95, "points of the part kept, two voxels above the table"),
        _least(alone, by_itself, "kept", 0.995, "points kept"),
        Check(
            by_itself,
            "no ground found",
            "every part",
            f"{len(alone) - len(grounds)} of {len(alone)}",
            not grounds if alone else None,
            tuple(grounds),
        ),
    ]


def _invariance(rows: Sequence[Row], source: str) -> list[Check]:
    found = []
    for name in CHANGES:
        limit = 1e-4 if name == "float32" else 1e-5
        column = f"change_{name}"
        changes = {row["key"]: row.get(column, np.inf) for row in rows}
        worst = max(changes.values(), default=0.0)
        measured = f"worst {worst:.1e}, median {np.median(list(changes.values()) or [0.0]):.1e}"
        found.append(
            Check(
                f"cloud {name}, {source}",
                "change of the pose [diameters]",
                f"every < {limit:.0e}",
                measured,
                worst < limit if rows else None,
                _named(changes, lambda change, limit=limit: change >= limit, "{:.1e}"),  # type: ignore[misc]
            )
        )
    return found


def _performance(rows: Sequence[Row]) -> list[Check]:
    found = []
    for row in rows:
        scenario = row["scenario"]
        memory = row["memory_mb"]
        found += [
            Check(
                scenario,
                "time, two threads",
                "<= 1 s",
                f"{row['seconds']:.2f} s ({row['cpu_seconds']:.2f} s of the processors)",
                row["seconds"] <= 1.0,
            ),
            Check(
                scenario,
                "peak memory above the interpreter",
                "<= 500 MB",
                "-" if memory is None else f"{memory:.0f} MB",
                None if memory is None else memory <= 500.0,
            ),
            Check(
                "compiled module",
                "abi3, compressed as in the wheel",
                "<= 5 MB",
                f"{row['module']}, {row['module_compressed_mb']:.1f} MB",
                "abi3" in row["module"] and row["module_compressed_mb"] <= 5.0,
            ),
        ]
    return found


def _pick(rows: Sequence[Row], scenario: Scenario, method: str) -> list[Row]:
    return [row for row in rows if row["scenario"] == scenario.label and row["method"] == method]


def _values(rows: Sequence[Row], column: str, lost: float) -> dict[str, float]:
    return {row["key"]: abs(row[column]) if row.get(column) is not None else lost for row in rows}


def _named(values: dict[str, float], bad: Callable[[float], bool], form: str) -> tuple[str, ...]:
    wrong = sorted(((value, key) for key, value in values.items() if bad(value)), reverse=True)
    return tuple(f"{key} ({form.format(value)})" for value, key in wrong[:20])


def _worst(rows: Sequence[Row], scenario: str, column: str, limit: float, unit: str = "") -> Check:
    values = _values(rows, column, _LOST)
    worst = max(values.values(), default=0.0)
    return Check(
        scenario,
        f"{column}, worst of {len(rows)}",
        f"every <= {limit:g} {unit}".strip(),
        figure(worst),
        worst <= limit if rows else None,
        _named(values, lambda value: value > limit, "{:.3g}"),
    )


def _mean(rows: Sequence[Row], scenario: str, column: str, limit: float, unit: str = "") -> Check:
    s = statistics(rows, column)
    lost = sum(row["outcome"] != "ok" for row in rows)
    measured = f"{figure(s.mean)} (median {figure(s.median)}, 95 % {figure(s.p95)}, worst {figure(s.worst)})"
    return Check(
        scenario,
        f"{column}, mean of {s.count}",
        f"<= {limit:g} {unit}".strip(),
        measured + (f", {lost} lost" if lost else ""),
        s.mean <= limit and not lost if s.count else None,
    )


def _within(rows: Sequence[Row], scenario: str, least: float) -> Check:
    values = _values(rows, "axis_deg", _LOST)
    near = share(rows, lambda row: row.get("axis_deg", _LOST) <= 1.0)
    return Check(
        scenario,
        f"axis within 1 deg, of {len(rows)}",
        f">= {100 * least:g} %",
        f"{100 * near:.1f} %, median {figure(statistics(rows, 'axis_deg').median)} deg",
        near >= least if rows else None,
        _named(values, lambda value: value > 1.0, "{:.3g}"),
    )


def _least(rows: Sequence[Row], scenario: str, column: str, least: float, what: str) -> Check:
    values = {row["key"]: row.get(column, 0.0) for row in rows}
    worst = min(values.values(), default=0.0)
    mean = float(np.mean(list(values.values()) or [0.0]))
    return Check(
        scenario,
        f"{what}, least of {len(rows)}",
        f"every >= {100 * least:g} %",
        f"{100 * worst:.1f} % (mean {100 * mean:.2f} %)",
        worst >= least if rows else None,
        _named(
            {key: 1.0 - value for key, value in values.items()},
            lambda lack: lack > 1.0 - least,
            "lacks {:.3f}",
        ),
    )
