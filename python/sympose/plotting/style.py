"""Colours and figures: one look for all drawings, told apart by the colour-blind too (Okabe and Ito 2008)."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

from sympose.errors import InvalidInputError

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
MUTED = "#8A94A0"
INPUT = "#7C8B9C"
REMOVED = "#D3DAE1"


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


def label(axes: Axes, title: str, x: str = "", y: str = "") -> None:
    """Write title and axis labels, and leave only the lines that help reading."""
    axes.set_title(title, fontsize=10.5, fontweight="bold", color=INK, loc="left")
    axes.set_xlabel(x, fontsize=9, color=INK)
    axes.set_ylabel(y, fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    for side in ("top", "right"):
        if side in axes.spines:
            axes.spines[side].set_visible(False)
