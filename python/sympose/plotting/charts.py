"""Charts of the evidence: depths with their mixture, match curve, yaw histogram, and the numbers in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sympose.plotting.style import AXIS, HEADING, INK, MEASURED, MUTED, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from sympose._core import Estimate
    from sympose.mixture import ViewMixture

__all__ = ["describe", "draw_depths", "draw_match_curve", "draw_rows", "draw_yaw"]


def draw_depths(axes: Axes, mixture: ViewMixture, title: str) -> None:
    """Draw the histogram of the depths that a view sees, its mixture, and the cut where there is one."""
    label(axes, title, "depth in the view", "density of points")
    if len(mixture.depths) == 0:
        axes.text(0.5, 0.5, mixture.reason, ha="center", va="center", wrap=True, transform=axes.transAxes)
        return
    axes.hist(mixture.depths, bins=90, density=True, color="#D5DBE1", label="points")
    grid = np.linspace(mixture.depths.min(), mixture.depths.max(), 600)
    for k, density in enumerate(mixture.component_densities(grid).T):
        axes.plot(grid, density, color=MEASURED, lw=1.0, label=None if k else "components")
    axes.plot(grid, mixture.density(grid), color=INK, lw=1.6, label="mixture")
    if mixture.threshold is not None:
        axes.axvline(mixture.threshold, color=AXIS, ls="--", lw=1.6, label="cut")
    axes.legend(fontsize=8, frameon=False)


def draw_match_curve(axes: Axes, estimate: Estimate, title: str = "Match when turned about the axis") -> None:
    """Draw how well the part meets itself at each angle, with the angles of its symmetry marked."""
    label(axes, title, "turn about the axis [deg]", "match score")
    axes.set_xlim(0.0, 360.0)
    axes.set_ylim(0.0, 1.04)
    axes.set_xticks(np.arange(0, 361, 60))
    order, curve = estimate.order, estimate.match_curve
    if isinstance(order, int):
        axes.vlines(360.0 / order * np.arange(order + 1), 0.0, 1.04, color=AXIS, lw=0.9, ls=(0, (4, 3)))
    if len(curve) == 0:
        return
    degrees, score = np.degrees(curve[:, 0]), curve[:, 1]
    degrees, score = np.append(degrees, degrees[0] + 360.0), np.append(score, score[0])
    axes.fill_between(degrees, score, color=MEASURED, alpha=0.15, lw=0)
    axes.plot(degrees, score, color=MEASURED, lw=1.5)


def draw_yaw(axes: Axes, estimate: Estimate, title: str = "Yaw histogram") -> None:
    """Draw the completed surface by its angle about the axis; `axes` are polar, +x points to the right."""
    label(axes, title)
    axes.grid(False)
    axes.spines["polar"].set_visible(False)
    axes.set_yticks([])
    axes.set_xticks(np.radians([0, 90, 180, 270]), ["0°", "90°", "180°", "270°"])
    histogram = np.asarray(estimate.diagnostics.get("yaw_histogram", ()), dtype=np.float64)
    heading = estimate.diagnostics.get("yaw_angle", float("nan"))
    if not isinstance(estimate.order, int) or histogram.sum() <= 0.0 or not np.isfinite(heading):
        axes.set_ylim(0.0, 1.0)
        text = "yaw is free" if "yaw" in estimate.unobservable else "no histogram"
        axes.text(0.0, 0.0, text, ha="center", va="center", color=MUTED)
        return
    share = histogram / histogram.max()
    bins, hole = len(share), 0.4  # with a hole, since bars that meet in a point hide their length
    edges = np.repeat(2.0 * np.pi / bins * np.arange(bins + 1), 2)[1:-1] - heading
    axes.fill_between(edges, hole, hole + np.repeat(share, 2), color=MEASURED, alpha=0.85, lw=0)
    top = hole + 1.1
    axes.set_ylim(0.0, top)
    turns = 2.0 * np.pi / estimate.order * np.arange(1, estimate.order)
    axes.vlines(turns, 0.0, top, color=HEADING, lw=1.0, ls=(0, (4, 3)))
    arrow = {
        "arrowstyle": "-|>",
        "color": HEADING,
        "lw": 2.4,
        "shrinkA": 0,
        "shrinkB": 0,
        "mutation_scale": 16,
    }
    axes.annotate("", (0.0, top), (0.0, 0.0), arrowprops=arrow)
    axes.text(0.12, 0.86 * top, "+x", color=HEADING, fontweight="bold", ha="center", va="center")


def describe(estimate: Estimate) -> list[tuple[str, str]]:
    """Return what to know about an estimate as rows of name and value, for a person to read."""
    sigma = np.sqrt(np.diag(estimate.covariance))
    tilt, yaw = np.degrees([np.hypot(sigma[0], sigma[1]), sigma[2]])
    shift, slide = np.hypot(sigma[3], sigma[4]), sigma[5]
    order = estimate.order
    rows = [
        ("order", f"{order}, every {360.0 / order:g}°" if isinstance(order, int) else order),
        ("score", f"{estimate.score:.2f}  (0.5 and above: a pose to act on)"),
        ("explained", f"{estimate.explained:.1%} of the observed surface"),
        ("axis", _vector(estimate.axis, "+.4f")),
        ("origin", _vector(estimate.center, "+.5g")),
        ("quaternion", _vector(estimate.quaternion, "+.4f")),
        ("uncertainty", f"axis {_angle(tilt)}, yaw {_angle(yaw)}"),
        ("", f"across {_length(shift)}, along {_length(slide)}"),
        ("points", f"{len(estimate.points):,} measured, {len(estimate.completed):,} completed"),
        ("time", f"{sum(estimate.timings.values()):.2f} s"),
    ]
    if estimate.unobservable:
        rows.append(("free", ", ".join(estimate.unobservable)))
    return rows + [("warning", text) for text in estimate.warnings]


def draw_rows(axes: Axes, title: str, rows: list[tuple[str, str]]) -> None:
    """Write rows of name and value."""
    import textwrap

    label(axes, title)
    axes.set_axis_off()
    lines = [
        (name if k == 0 else "", piece)
        for name, value in rows
        for k, piece in enumerate(textwrap.wrap(value, 44) or [""])
    ]
    step = min(0.098, 1.0 / max(1, len(lines)))
    for k, (name, value) in enumerate(lines):
        height = 0.97 - k * step
        _write(axes, 0.0, height, name, MUTED)
        _write(axes, 0.26, height, value, INK)


def _write(axes: Axes, x: float, y: float, text: str, color: str) -> None:
    axes.text(x, y, text, color=color, va="top", fontsize=9.2, transform=axes.transAxes)


def _vector(values: NDArray[np.float64], form: str) -> str:
    return "   ".join(format(value, form).replace("-", "\N{MINUS SIGN}") for value in values)


def _angle(sigma_deg: float) -> str:
    return f"± {sigma_deg:.2g}°" if np.isfinite(sigma_deg) else "free"


def _length(sigma: float) -> str:
    return f"± {sigma:.2g}" if np.isfinite(sigma) else "free"
