"""Pictures of captured scenes: from two sides, with the axis that was found and the one that is known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sympose.evaluation.captures import Capture
from sympose.evaluation.plots import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_capture"]

_MOST = 20_000
_PANELS = {"front": (0, 1), "from the side": (2, 1), "from above": (0, 2)}


def draw_capture(capture: Capture, estimate: Any, path: Path, remark: str = "") -> None:
    """Draw what was given (grey), kept (blue) and completed (orange), and the axes.

    Raises:
        ImportError: matplotlib is not installed.
    """
    figure = new_figure(4.0 * len(_PANELS), 4.4)
    given = capture.scene.points
    if capture.roi is not None:
        given = given[((given >= capture.roi[0]) & (given <= capture.roi[1])).all(axis=1)]
    elif estimate is not None:
        given = _near(given, np.asarray(estimate.points))
    for axes, (title, (u, v)) in zip(figure.subplots(1, len(_PANELS)), _PANELS.items(), strict=True):
        _dots(axes, given, u, v, "0.7", "given")
        if estimate is not None:
            _dots(axes, np.asarray(estimate.completed), u, v, "tab:orange", "completed")
            _dots(axes, np.asarray(estimate.points), u, v, "tab:blue", "kept")
            size = float(np.ptp(np.asarray(estimate.points), axis=0).max())
            _line(
                axes, np.asarray(estimate.center), np.asarray(estimate.axis), size, u, v, "tab:red", "found"
            )
        if capture.known is not None:
            known = capture.known
            _line(axes, known.point, known.direction, 3.0 * known.radius, u, v, "k", "known", "--")
        axes.set(title=title, aspect="equal")
        if v == 1:
            axes.invert_yaxis()  # y of a camera points down
    figure.axes[-1].legend(fontsize=7, markerscale=8, loc="best")
    score = "" if estimate is None else f", score {estimate.score:.2f}, explained {estimate.explained:.2f}"
    figure.suptitle(f"{capture.name} ({capture.how}){score}\n{remark[:140]}", fontsize=9)
    figure.savefig(path, dpi=100)


def _near(points: NDArray[np.float64], kept: NDArray[np.float64]) -> NDArray[np.float64]:
    """What lies within a size of the object around it, so that the object fills the picture."""
    low, high = kept.min(axis=0), kept.max(axis=0)
    margin = 0.5 * (high - low).max()
    near = ((points >= low - margin) & (points <= high + margin)).all(axis=1)
    return np.asarray(points[near])


def _dots(axes: Axes, points: NDArray[np.float64], u: int, v: int, color: str, label: str) -> None:
    some = points[:: -(-len(points) // _MOST) or 1]
    axes.plot(some[:, u], some[:, v], ",", color=color, label=label, rasterized=True)


def _line(
    axes: Axes,
    point: NDArray[np.float64],
    direction: NDArray[np.float64],
    length: float,
    u: int,
    v: int,
    color: str,
    label: str,
    style: str = "-",
) -> None:
    ends = np.stack([point - length * direction, point + length * direction])
    axes.plot(ends[:, u], ends[:, v], style, color=color, linewidth=1.2, label=label)
