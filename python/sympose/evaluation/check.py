"""A figure held against its target, and how such checks are made from rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sympose.evaluation.measure import Row
from sympose.evaluation.scenario import Scenario
from sympose.evaluation.summary import figure, markdown_table, share, statistics

__all__ = [
    "LOST",
    "Check",
    "check_least",
    "check_mean",
    "check_near",
    "check_share",
    "check_worst",
    "checks_table",
    "pick",
    "worst_first",
]

LOST = 90.0  # degrees; stands for a scan without an answer, so that it counts against "every" and shares


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


def checks_table(checks: Sequence[Check]) -> str:
    """The promises in Markdown, and below the scans that break them."""
    head = ["scenario", "figure", "target", "measured", ""]
    body = [[c.scenario, c.what, c.target, c.measured, "pass" if c.passed else "**fail**"] for c in checks]
    lines = [markdown_table(head, body)]
    for check in checks:
        if check.failing:
            lines.append(f"{check.scenario}, {check.what}: " + "; ".join(check.failing))
    return "\n\n".join(lines)


def pick(rows: Sequence[Row], scenario: Scenario, method: str) -> list[Row]:
    """The rows of a scenario and a method."""
    return [row for row in rows if row["scenario"] == scenario.label and row["method"] == method]


def worst_first(values: Mapping[str, float], bad: Callable[[float], bool], form: str) -> tuple[str, ...]:
    """The names and values that are bad, at most twenty of them."""
    wrong = sorted(((value, key) for key, value in values.items() if bad(value)), reverse=True)
    return tuple(f"{key} ({form.format(value)})" for value, key in wrong[:20])


def check_worst(rows: Sequence[Row], scenario: str, column: str, limit: float, unit: str = "") -> Check:
    """No scan is beyond the limit, nor without an answer."""
    errors = _errors(rows, column)
    worst = max(errors.values(), default=0.0)
    return Check(
        scenario,
        f"{column}, worst of {len(rows)}",
        f"every <= {limit:g} {unit}".strip(),
        figure(worst),
        worst <= limit if rows else None,
        worst_first(errors, lambda error: error > limit, "{:.3g}"),
    )


def check_mean(
    rows: Sequence[Row], scenario: str, column: str, limit: float, unit: str = "", *, may_refuse: bool = False
) -> Check:
    """The mean is below the limit; scans without an answer fail it, unless they are counted elsewhere."""
    s = statistics(rows, column)
    lost = sum(row["outcome"] != "ok" for row in rows)
    measured = f"{figure(s.mean)} (median {figure(s.median)}, 95 % {figure(s.p95)}, worst {figure(s.worst)})"
    return Check(
        scenario,
        f"{column}, mean of {s.count}",
        f"<= {limit:g} {unit}".strip(),
        measured + (f", {lost} lost" if lost else ""),
        s.mean <= limit and (may_refuse or not lost) if rows else None,
    )


def check_near(rows: Sequence[Row], scenario: str, least: float) -> Check:
    """The axis is within a degree in a share of the scans."""
    errors = _errors(rows, "axis_deg")
    near = share(rows, lambda row: row.get("axis_deg", LOST) <= 1.0)
    return Check(
        scenario,
        f"axis within 1 deg, of {len(rows)}",
        f">= {100 * least:g} %",
        f"{100 * near:.1f} %, median {figure(statistics(rows, 'axis_deg').median)} deg",
        near >= least if rows else None,
        worst_first(errors, lambda error: error > 1.0, "{:.3g}"),
    )


def check_share(
    rows: Sequence[Row], scenario: str, what: str, good: Callable[[Row], bool], least: float
) -> Check:
    """A share of the scans is good."""
    bad = tuple(row["key"] for row in rows if not good(row))
    return Check(
        scenario,
        f"{what}, of {len(rows)}",
        f">= {100 * least:g} %" if least < 1.0 else "every",
        f"{100 * share(rows, good):.1f} %",
        share(rows, good) >= least if rows else None,
        bad[:20],
    )


def check_least(rows: Sequence[Row], scenario: str, column: str, least: float, what: str) -> Check:
    """No scan has less of something."""
    shares = {row["key"]: row.get(column, 0.0) for row in rows}
    worst = min(shares.values(), default=0.0)
    mean = float(np.mean(list(shares.values()) or [0.0]))
    return Check(
        scenario,
        f"{what}, least of {len(rows)}",
        f"every >= {100 * least:g} %",
        f"{100 * worst:.1f} % (mean {100 * mean:.2f} %)",
        worst >= least if rows else None,
        worst_first(
            {key: 1.0 - value for key, value in shares.items()},
            lambda lack: lack > 1.0 - least,
            "lacks {:.3f}",
        ),
    )


def _errors(rows: Sequence[Row], column: str) -> dict[str, float]:
    return {row["key"]: abs(row[column]) if row.get(column) is not None else LOST for row in rows}
