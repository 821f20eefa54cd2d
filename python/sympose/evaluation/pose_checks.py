"""The promises for a known order: accuracy, segmentation, steadiness, time and memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sympose.evaluation.check import (
    LOST,
    Check,
    check_least,
    check_mean,
    check_near,
    check_worst,
    pick,
    worst_first,
)
from sympose.evaluation.invariance import CHANGES
from sympose.evaluation.measure import Row
from sympose.evaluation.scenario import Scenario
from sympose.evaluation.summary import figure, grouped, statistics

__all__ = ["ALONE", "ONE_VIEW", "SPHERE", "TABLE", "check_pose"]

SPHERE = Scenario("sphere", 5)
ONE_VIEW = Scenario("sphere", 1)
TABLE = Scenario("table", 5)
ALONE = Scenario("alone", 5)


def check_pose(rows: Sequence[Row]) -> list[Check]:
    """Every promise for which there are rows; the parts of each source are judged apart."""
    found: list[Check] = []
    for (source,), mine in grouped((row for row in rows if "source" in row), "source").items():
        found += [
            *_accuracy(pick(mine, SPHERE, "default"), f"5 views, {source}"),
            check_near(pick(mine, ONE_VIEW, "default"), f"1 view, {source}", 0.97),
            *_paper(mine, source),
            *_no_viewpoints(pick(mine, SPHERE, "no_viewpoints"), f"no viewpoints, 5 views, {source}"),
            *_no_viewpoints(
                pick(mine, SPHERE, "no_viewpoints_shuffled"),
                f"no viewpoints, points shuffled, 5 views, {source}",
            ),
            _joint(pick(mine, SPHERE, "default"), source),
            *_segmentation(mine, source),
            *_invariance([row for row in mine if row["method"] == "invariance"], source),
        ]
    found += _performance([row for row in rows if row["method"] == "performance"])
    return [check for check in found if check.passed is not None]


def _no_viewpoints(rows: Sequence[Row], scenario: str) -> list[Check]:
    return [
        check_worst(rows, scenario, "axis_deg", 1.0, "deg"),
        check_mean(rows, scenario, "axis_deg", 0.03, "deg"),
    ]


def _accuracy(rows: Sequence[Row], scenario: str) -> list[Check]:
    return [
        check_worst(rows, scenario, "axis_deg", 1.0, "deg"),
        check_mean(rows, scenario, "axis_deg", 0.02, "deg"),
        check_mean(rows, scenario, "offset", 0.0002),
        check_mean(rows, scenario, "adds", 0.006),
        check_mean(rows, scenario, "adds_aligned", 0.006),
    ]


def _paper(rows: Sequence[Row], source: str) -> list[Check]:
    """The preset of the paper: joint optimisation must help, and the axis be right where the start is."""
    scenario = f"`Config.paper()`, 5 views, {source}"
    joint = {row["key"]: row for row in pick(rows, SPHERE, "paper") if row["outcome"] == "ok"}
    alone = {row["key"]: row for row in pick(rows, SPHERE, "paper_no_joint") if row["outcome"] == "ok"}
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
    near = [row for row in joint.values() if row.get("start_deg", LOST) < 10.0]
    checks.append(check_worst(near, f"{scenario}, start within 10 deg", "axis_deg", 0.2, "deg"))
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
        worst_first(ratios, lambda ratio: ratio > 0.6, "{:.2f}"),
    )


def _segmentation(rows: Sequence[Row], source: str) -> list[Check]:
    table, alone = pick(rows, TABLE, "default"), pick(rows, ALONE, "default")
    on_table, by_itself = f"table and wall, 5 views from above, {source}", f"`alone`, {source}"
    grounds = {row["key"]: 1.0 for row in alone if row.get("has_ground", True)}
    return [
        check_worst(table, on_table, "axis_deg", 1.0, "deg"),
        check_least(table, on_table, "kept_precision", 0.98, "points kept that belong to the part"),
        check_least(table, on_table, "kept_recall", 0.95, "points of the part kept above the table"),
        check_least(alone, by_itself, "kept", 0.995, "points kept"),
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
                worst_first(changes, lambda change, limit=limit: change >= limit, "{:.1e}"),  # type: ignore[misc]
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
