"""Figures of an evaluation: recall curves and the histogram of point errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sympose.evaluation.measure import Row
from sympose.evaluation.summary import grouped
from sympose.evaluation.surface import HISTOGRAM_EDGES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["histogram_figure", "new_figure", "recall_figure", "save_figures"]

_LIMITS = {
    "axis_deg": ("axis angle [deg]", 1e-3, 10.0),
    "offset": ("axis offset [diameters]", 1e-5, 0.1),
    "adds_aligned": ("ADD-S, yaw aligned [diameters]", 1e-5, 0.1),
}


def save_figures(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write `recall.png`, and `points.png` where rows hold point errors; returns what was written.

    Raises:
        ImportError: matplotlib is not installed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"recall.png": recall_figure(rows)}
    if any("histogram_refined" in row for row in rows):
        figures["points.png"] = histogram_figure(rows)
    for name, one in figures.items():
        one.savefig(folder / name, dpi=120)
    return [folder / name for name in figures]


def recall_figure(rows: Sequence[Row]) -> Figure:
    """For each method the share of the scans whose error is below a limit, over the limit.

    A scan that was refused or failed is never below.
    """
    figure = new_figure(4.2 * len(_LIMITS))
    panels = figure.subplots(1, len(_LIMITS), sharey=True)
    for axes, (column, (title, low, high)) in zip(panels, _LIMITS.items(), strict=True):
        for (scenario, method), mine in grouped(rows, "scenario", "method").items():
            errors = np.sort([row[column] for row in mine if row.get(column) is not None])
            recall = np.arange(len(errors) + 2).clip(max=len(errors)) / len(mine)
            several = len({row["scenario"] for row in rows}) > 1
            label = f"{method}, {scenario}" if several else method
            axes.step([low, *np.maximum(errors, low), high], recall, where="post", label=label)
        axes.set(xscale="log", xlim=(low, high), ylim=(0.0, 1.02), xlabel=title)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of the scans")
    panels[-1].legend(fontsize=7)
    return figure


def histogram_figure(rows: Sequence[Row]) -> Figure:
    """Number of points by their distance to the true surface, with joint optimisation and without.

    Drawn for each scenario from the rows of the method "default", or of the first that moves points.
    """
    known = [row for row in rows if "histogram_refined" in row]
    scenarios = {name: mine for (name,), mine in grouped(known, "scenario").items()}
    figure = new_figure(4.2 * len(scenarios))
    panels = np.atleast_1d(figure.subplots(1, len(scenarios), squeeze=False)[0])
    for axes, (scenario, mine) in zip(panels, scenarios.items(), strict=True):
        methods = grouped(mine, "method")
        chosen = methods.get(("default",), next(iter(methods.values())))
        _bars(axes, chosen, "histogram_voxel", "without joint optimisation")
        _bars(axes, chosen, "histogram_refined", "with")
        axes.set(
            xlabel="distance to the true surface [diameters]", ylabel="share of the points", title=scenario
        )
        axes.legend(fontsize=8)
    return figure


def _bars(axes: Axes, rows: Sequence[Row], column: str, label: str) -> None:
    shares = np.mean([row[column] for row in rows], axis=0)
    axes.stairs(shares, HISTOGRAM_EDGES, fill=True, alpha=0.5, label=label)


def new_figure(width: float, height: float = 3.6) -> Figure:
    """A figure that needs no display: pyplot would choose a backend for the whole process."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("figures need matplotlib: pip install 'sympose[plot]'") from error
    return Figure(figsize=(width, height), layout="constrained")
