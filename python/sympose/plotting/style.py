"""Colours and figures: one look for all drawings, told apart by the colour-blind too (Okabe and Ito 2008)."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sympose.errors import InvalidInputError, SymposeError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "AXIS",
    "COMPLETED",
    "HEADING",
    "INK",
    "INPUT",
    "MEASURED",
    "MUTED",
    "REMOVED",
    "label",
    "new_figure",
    "save",
]

MEASURED = "#0072B2"
COMPLETED = "#E69F00"
AXIS = "#C2185B"
HEADING = "#009E73"
INK = "#1F2933"
MUTED = "#737E8B"
INPUT = "#7C8B9C"
REMOVED = "#D3DAE1"

_WITHOUT_WINDOW = {"agg", "cairo", "pdf", "pgf", "ps", "svg", "template"}


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure [inches] without pyplot, so that no window, backend or global state is involved.

    Raises:
        ImportError: matplotlib is missing.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("drawing needs matplotlib: pip install 'sympose[plot]'") from error
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def save(figure: Figure, path: str | PathLike[str], *, dpi: float = 130.0) -> None:
    """Write `figure` to an image whose type follows from the suffix.

    Raises:
        InvalidInputError: matplotlib does not know the suffix.
        OSError: The file cannot be written.
    """
    try:
        figure.savefig(path, dpi=dpi)
    except ValueError as error:
        raise InvalidInputError(f"{path}: cannot be drawn: {error}") from error


def show(draw: Callable[[Figure], None], size: tuple[float, float]) -> None:
    """Let `draw` fill a figure of this size [inches], and show it in a window or in the notebook.

    Raises:
        ImportError: matplotlib is missing.
        SymposeError: There is no display to open a window on.
    """
    new_figure(*size)  # raises where matplotlib is missing
    from matplotlib import get_backend, pyplot  # here only: a window needs the event loop of pyplot

    if get_backend().lower() in _WITHOUT_WINDOW:
        raise SymposeError("there is no display to open a window on; save the figure to a file instead")
    figure = pyplot.figure(figsize=size, layout="constrained")
    draw(figure)
    pyplot.show()
    pyplot.close(figure)


def label(axes: Axes, title: str, x: str = "", y: str = "") -> None:
    """Write title and axis labels, and leave only the lines that help reading."""
    # Names of files may have anything in them: a formula, or bytes that are no letters.
    title = title.encode(errors="replace").decode()
    axes.set_title(title, fontsize=10.5, fontweight="bold", color=INK, loc="left", parse_math=False)
    axes.set_xlabel(x, fontsize=9, color=INK)
    axes.set_ylabel(y, fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    for side in ("top", "right"):
        if side in axes.spines:
            axes.spines[side].set_visible(False)


def two_colors(which: NDArray[np.bool_], one: str, other: str) -> NDArray[np.float64]:
    """(N, 3) colours from 0 to 1: `one` where (N,) `which` holds, else `other`."""
    from matplotlib.colors import to_rgb

    return np.where(which[:, None], to_rgb(one), to_rgb(other))
