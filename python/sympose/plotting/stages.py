"""The figure of the whole way from a raw scan to a pose, stage by stage."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sympose.plotting.charts import describe, draw_depths, draw_match_curve, draw_rows, draw_yaw
from sympose.plotting.cloud import Eye, draw_cloud
from sympose.plotting.pose import draw_completed
from sympose.plotting.style import INK, INPUT, MEASURED, REMOVED, label, new_figure, save, two_colors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sympose._core import Estimate
    from sympose.scene import Scene
    from sympose.segmentation import Segmentation

__all__ = ["plot_stages"]

_SIZE = (16.0, 7.6)  # inches
_BESIDE_DEG = 50.0


def plot_stages(
    scene: Scene,
    segmentation: Segmentation,
    estimate: Estimate,
    path: str | PathLike[str] | None = None,
    *,
    title: str = "From a raw scan to a pose",
    remarks: Sequence[tuple[str, str]] = (),
) -> Figure:
    """Draw a scene as measured and after each stage, with the depths, the match curve and the yaw histogram.

    Args:
        scene: What was measured.
        segmentation: Its foreground, as `sympose.segment` told it.
        estimate: What `sympose.estimate` made of the scene.
        path: Where to save the figure; not saved where it is not given.
        title: Headline.
        remarks: Rows of name and value that are written below those of the estimate.

    Returns:
        A matplotlib Figure, made without pyplot.

    Raises:
        ImportError: matplotlib is missing.
        InvalidInputError: The suffix of `path` names no kind of image.
    """
    figure = new_figure(*_SIZE)
    figure.suptitle(title, fontsize=15, fontweight="bold", color=INK, x=0.008, ha="left")
    rows = figure.add_gridspec(2, 1, height_ratios=[1.0, 1.0])
    stages = rows[0].subgridspec(1, 5)
    charts = rows[1].subgridspec(1, 4, width_ratios=[1.0, 1.05, 0.82, 1.2])
    eye = _eye(scene, estimate)

    # Input rows that come out of each stage; the next panel shows what its stage leaves of them.
    finite = np.flatnonzero(np.isfinite(scene.points).all(axis=1))
    foreground = finite[segmentation.mask[finite]]
    above = foreground[_above_ground(scene.points[foreground], estimate)]
    ground = "no ground found" if estimate.ground is None else "ground removed"
    size = float(np.linalg.norm(estimate.completed - estimate.center, axis=1).max())
    kept = [finite, foreground, above, estimate.inliers]
    for k, name in enumerate(("raw scan", "foreground", ground)):
        axes = figure.add_subplot(stages[k])
        label(axes, f"{k + 1}  {name}, {len(kept[k]):,} points")
        stays = np.isin(kept[k], kept[k + 1])
        frame = (estimate.center, (2.7, 2.7, 1.25)[k] * size)
        draw_cloud(axes, eye, scene.points[kept[k]], two_colors(stays, INPUT, REMOVED), frame=frame)
    axes = figure.add_subplot(stages[3])
    label(axes, f"4  object and axis, {len(estimate.points):,} points")
    draw_cloud(axes, eye, estimate.points, MEASURED, pose=estimate.pose)
    draw_completed(figure.add_subplot(stages[4]), eye, estimate, "5  completed")

    mixtures = segmentation.mixtures
    cuts = [k for k, mixture in enumerate(mixtures) if mixture.threshold is not None]
    shown = cuts[0] if cuts else 0
    name = scene.views[shown].name or f"view {shown}"
    heading = f"2  depths in {name} ({len(cuts)} of {len(mixtures)} views cut)"
    draw_depths(figure.add_subplot(charts[0]), mixtures[shown], heading)
    draw_match_curve(figure.add_subplot(charts[1]), estimate, "4  match when turned about the axis")
    draw_yaw(figure.add_subplot(charts[2], projection="polar"), estimate, "5  yaw histogram")
    draw_rows(figure.add_subplot(charts[3]), "Estimate", [*describe(estimate), *remarks])
    if path is not None:
        save(figure, path)
    return figure


def _eye(scene: Scene, estimate: Estimate) -> Eye:
    """Beside the cameras: from where they stood, all is measured, and what was completed is out of sight."""
    cameras = np.mean([view.center for view in scene.views], axis=0) - estimate.center
    x, y, _ = cameras @ estimate.pose[:3, :3]
    return Eye.of_pose(estimate.pose, azimuth_deg=float(np.degrees(np.arctan2(y, x))) + _BESIDE_DEG)


def _above_ground(points: NDArray[np.float64], estimate: Estimate) -> NDArray[np.bool_]:
    """Which of the (N, 3) points that the search for the ground saw it left: all but the lowest ones."""
    removed = int(estimate.diagnostics.get("ground_points", 0))
    if estimate.ground is None or not 0 < removed < len(points):
        return np.ones(len(points), dtype=bool)
    height = points @ estimate.ground[:3] + estimate.ground[3]
    return np.asarray(height > np.partition(height, removed - 1)[removed - 1])
