"""The figure of an estimate: what was measured, what was found, and how far to trust it."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sympose._core import KdTree
from sympose.plotting.charts import describe, draw_match_curve, draw_rows, draw_yaw
from sympose.plotting.cloud import Eye, draw_cloud
from sympose.plotting.style import COMPLETED, INK, MEASURED, label, new_figure, save, show, two_colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sympose._core import Estimate

__all__ = ["draw_completed", "plot_estimate", "sector_colors", "show_estimate"]

_SIZE = (13.0, 7.8)  # inches
_AROUND = 25  # points that say whether a region was measured


def plot_estimate(estimate: Estimate, path: str | PathLike[str] | None = None) -> Figure:
    """Draw the object with its axis, the completed cloud, the match curve, the yaw histogram and the numbers.

    Args:
        estimate: What `sympose.estimate` returned, or `Estimate.load` read.
        path: Where to save the figure, as PNG, SVG or PDF; not saved where it is not given.

    Returns:
        A matplotlib Figure, made without pyplot: no window opens and no backend is chosen.

    Raises:
        ImportError: matplotlib is missing.
        InvalidInputError: The suffix of `path` names no kind of image.
    """
    figure = new_figure(*_SIZE)
    _draw(figure, estimate)
    if path is not None:
        save(figure, path)
    return figure


def show_estimate(estimate: Estimate) -> None:
    """Show the figure of `plot_estimate` in a window, or in the notebook.

    Raises:
        ImportError: matplotlib is missing.
        SymposeError: There is no display to open a window on.
    """
    show(lambda figure: _draw(figure, estimate), _SIZE)


def _draw(figure: Figure, estimate: Estimate) -> None:
    order = estimate.order
    kind = f"order {order}" if isinstance(order, int) else "a surface of revolution"
    figure.suptitle(
        f"Pose of a part of {kind}, score {estimate.score:.2f}" if order != "continuous"
        else f"Pose of {kind}, score {estimate.score:.2f}",
        fontsize=14, fontweight="bold", color=INK, x=0.012, ha="left",
    )  # fmt: skip
    eye = Eye.of_pose(estimate.pose)
    grid = figure.add_gridspec(2, 3, height_ratios=[1.4, 1.0], width_ratios=[1.0, 1.0, 0.95])
    axes = figure.add_subplot(grid[0, 0])
    label(axes, "Object points and axis")
    draw_cloud(axes, eye, estimate.points, MEASURED, pose=estimate.pose)
    draw_completed(figure.add_subplot(grid[0, 1]), eye, estimate)
    draw_rows(figure.add_subplot(grid[0, 2]), "Estimate", describe(estimate))
    draw_match_curve(figure.add_subplot(grid[1, :2]), estimate)
    draw_yaw(figure.add_subplot(grid[1, 2], projection="polar"), estimate)


def draw_completed(axes: Axes, eye: Eye, estimate: Estimate, title: str = "Completed cloud") -> None:
    """Draw the completed cloud: one colour where it was measured, another where the symmetry filled it in."""
    from matplotlib.lines import Line2D

    label(axes, title)
    draw_cloud(axes, eye, estimate.completed, _region_colors(estimate))
    marks = [
        Line2D([], [], ls="", marker="o", color=color, label=name)
        for name, color in (("measured", MEASURED), ("from the symmetry", COMPLETED))
    ]
    axes.legend(
        handles=marks, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, fontsize=8.5, frameon=False,
        handletextpad=0.0, columnspacing=1.0, borderaxespad=0.0, borderpad=0.1,
    )  # fmt: skip


def sector_colors(sector: NDArray[np.int64]) -> NDArray[np.float64]:
    """(K, 3) colours from 0 to 1 of a completed cloud, by the sector that each point came from."""
    return two_colors(sector == 0, MEASURED, COMPLETED)


def _region_colors(estimate: Estimate) -> NDArray[np.float64]:
    """Colours by what most points about a point are: cells between measured points are filled in, too."""
    points, measured = estimate.completed, estimate.completed_sector == 0
    if len(points) > _AROUND:
        _, around = KdTree(points).query(points, _AROUND)
        measured = measured[around].mean(axis=1) >= 0.5
    return two_colors(measured, MEASURED, COMPLETED)
