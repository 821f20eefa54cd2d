"""The figure of a scene: nothing but its points."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sympose.plotting.cloud import Eye, draw_cloud
from sympose.plotting.style import INPUT, label, new_figure, save, show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sympose.scene import Scene

__all__ = ["plot_scene", "show_scene"]

_SIZE = (8.0, 7.0)  # inches


def plot_scene(scene: Scene, path: str | PathLike[str] | None = None) -> Figure:
    """Draw the points of a scene, in their colours where they are known, as the sensors saw them.

    Args:
        scene: What `sympose.read` returned, for example.
        path: Where to save the figure; not saved where it is not given.

    Returns:
        A matplotlib Figure, made without pyplot.

    Raises:
        ImportError: matplotlib is missing.
        InvalidInputError: The suffix of `path` names no kind of image.
    """
    figure = new_figure(*_SIZE)
    _draw(figure, scene)
    if path is not None:
        save(figure, path)
    return figure


def show_scene(scene: Scene) -> None:
    """Show the figure of `plot_scene` in a window, or in the notebook.

    Raises:
        ImportError: matplotlib is missing.
        SymposeError: There is no display to open a window on.
    """
    show(lambda figure: _draw(figure, scene), _SIZE)


def _draw(figure: Figure, scene: Scene) -> None:
    axes = figure.add_subplot()
    known = np.isfinite(scene.points).all(axis=1)
    points = scene.points[known]
    label(axes, f"{scene.name or 'scene'}, {len(points):,} points")
    colors = INPUT if scene.colors is None else scene.colors[known] / 255.0
    draw_cloud(axes, _eye(scene, points), points, colors)


def _eye(scene: Scene, points: NDArray[np.float64]) -> Eye:
    """From the sensors where they are known, else from a corner; z upright, unless it is straight ahead."""
    toward = np.array([1.0, -1.4, 1.0])
    if scene.viewpoints is not None and len(points):
        mean = np.nanmean(scene.viewpoints, axis=0) - points.mean(axis=0)
        toward = mean if np.linalg.norm(mean) > 0.0 else toward
    upright = np.zeros(3)
    upright[2 if abs(toward[2]) < 0.9 * np.linalg.norm(toward) else 1] = 1.0
    return Eye.at(toward, upright)
