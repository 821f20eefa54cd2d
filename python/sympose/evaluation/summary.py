"""Rows made into tables: mean, median, 95th percentile and worst, and a row for each part."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sympose.evaluation.measure import Row

__all__ = [
    "Statistics",
    "figure",
    "grouped",
    "markdown_table",
    "report",
    "share",
    "statistics",
    "write_csv",
    "write_json",
]

_COLUMNS = ("axis_deg", "offset", "adds_aligned")
_TITLES = {
    "axis_deg": "axis [deg]",
    "offset": "offset",
    "along": "along the axis",
    "yaw_deg": "yaw [deg]",
    "adds": "ADD-S",
    "adds_aligned": "ADD-S, yaw aligned",
    "mssd": "MSSD",
    "mssd_aligned": "MSSD, yaw aligned",
    "axis_over_bound": "axis / bound",
    "offset_over_bound": "offset / bound",
    "raw_error": "raw to surface",
    "voxel_error": "voxel means to surface",
    "refined_error": "refined to surface",
    "seconds": "time [s]",
    "cpu_seconds": "processor time [s]",
}


@dataclass(frozen=True)
class Statistics:
    """Of the absolute values of a figure."""

    count: int
    mean: float
    median: float
    p95: float
    worst: float


def statistics(rows: Iterable[Row], column: str) -> Statistics:
    """Over the rows that have the figure; NaN where none has it."""
    values = np.abs([row[column] for row in rows if row.get(column) is not None])
    if len(values) == 0:
        return Statistics(0, *[float("nan")] * 4)
    middle, high = np.quantile(values, [0.5, 0.95])
    return Statistics(len(values), float(values.mean()), float(middle), float(high), float(values.max()))


def share(rows: Sequence[Row], good: Callable[[Row], bool]) -> float:
    """Share of all rows that are good; a row that failed or was refused is one of them."""
    return sum(map(good, rows)) / len(rows) if rows else float("nan")


def grouped(rows: Iterable[Row], *columns: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by the values in some columns, in order of first appearance."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.get(column) for column in columns), []).append(row)
    return groups


def figure(value: float | None, digits: int = 3) -> str:
    """A number with some significant digits, a dash where there is none."""
    if value is None or np.isnan(value):
        return "-"
    if value == 0.0:
        return "0"
    if not np.isfinite(value):
        return "inf"
    places = digits - 1 - int(np.floor(np.log10(abs(value))))
    return f"{value:.{min(max(places, 0), 7)}f}"


def markdown_table(head: Sequence[str], body: Iterable[Sequence[object]]) -> str:
    """A Markdown table; the first column is left-aligned, the others right-aligned."""
    lines = [f"| {' | '.join(head)} |", f"|{'|'.join([':--', *['--:'] * (len(head) - 1)])}|"]
    lines += [f"| {' | '.join(str(cell).replace('|', '/') for cell in row)} |" for row in body]
    return "\n".join(lines)


def report(rows: Sequence[Row]) -> str:
    """In Markdown: for each scenario the methods side by side and the parts, then what went wrong."""
    parts = [
        "Lengths in diameters of the part. Each figure: mean / median / 95th percentile / worst.",
    ]
    for (scenario,), mine in grouped(rows, "scenario").items():
        parts += [f"## {scenario}", _by_method(mine), "### By part (mean / worst)", _by_part(mine)]
    wrong = [row for row in rows if row["outcome"] != "ok" or row.get("axis_deg", 0.0) > 1.0]
    if wrong:
        parts += ["## Refused, failed, or off by more than 1 deg", _failures(wrong)]
    return "\n\n".join(parts) + "\n"


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """One line a row; lists are left out of the table, they are in the JSON."""
    columns = dict.fromkeys(key for row in rows for key, value in row.items() if not isinstance(value, list))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def write_json(rows: Sequence[Row], path: Path) -> None:
    """All rows, as a list."""
    path.write_text(json.dumps(list(rows), indent=1) + "\n", encoding="utf-8")


def _by_method(rows: Sequence[Row]) -> str:
    """Methods across, figures down."""
    methods = {name: mine for (name,), mine in grouped(rows, "method").items()}
    lines: dict[str, list[str]] = {
        "scans": [str(len(mine)) for mine in methods.values()],
        "refused": [str(sum(row["outcome"] == "refused" for row in mine)) for mine in methods.values()],
        "failed": [str(sum(row["outcome"] == "error" for row in mine)) for mine in methods.values()],
        "within 1 deg": [
            _percent(mine, lambda row: row.get("axis_deg", 90.0) < 1.0) for mine in methods.values()
        ],
        "within 2 deg and 0.02": [_percent(mine, _success) for mine in methods.values()],
        "order right": [
            _percent([r for r in m if "order_right" in r], _order_right) for m in methods.values()
        ],
    }
    for column, title in _TITLES.items():
        if any(row.get(column) is not None for row in rows):
            lines[title] = [_four(statistics(mine, column)) for mine in methods.values()]
    return markdown_table(["", *methods], ([title, *cells] for title, cells in lines.items()))


def _by_part(rows: Sequence[Row]) -> str:
    methods = list(dict.fromkeys(row["method"] for row in rows))
    head = ["part", "order", *(f"{_TITLES[c]}, {m}" for m in methods for c in _COLUMNS)]
    body = []
    for (part, order), mine in grouped(rows, "part", "order").items():
        cells = []
        for method in methods:
            own = [row for row in mine if row["method"] == method]
            cells += [_two(statistics(own, column)) for column in _COLUMNS]
        body.append([part, order if order is not None else "none", *cells])
    return markdown_table(head, body)


def _failures(rows: Sequence[Row]) -> str:
    head = ["part", "scenario", "seed", "method", "outcome", "axis [deg]", "score", "order found", "message"]
    return markdown_table(
        head,
        (
            [
                *(row[key] for key in ("part", "scenario", "seed", "method", "outcome")),
                figure(row.get("axis_deg")),
                figure(row.get("score")),
                row.get("order_found", "-"),
                str(row.get("message", "; ".join(row.get("warnings", [])))).replace("\n", " ")[:200],
            ]
            for row in rows
        ),
    )


def _success(row: Row) -> bool:
    return bool(row.get("success", False))


def _order_right(row: Row) -> bool:
    return bool(row["order_right"])


def _percent(rows: Sequence[Row], good: Callable[[Row], bool]) -> str:
    return f"{100 * share(rows, good):.1f} %" if rows else "-"


def _four(s: Statistics) -> str:
    return " / ".join(figure(value) for value in (s.mean, s.median, s.p95, s.worst)) if s.count else "-"


def _two(s: Statistics) -> str:
    return f"{figure(s.mean)} / {figure(s.worst)}" if s.count else "-"
