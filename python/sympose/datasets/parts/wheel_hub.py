"""Wheels and hubs: spokes, windows, bolt holes and studs between a rim and a boss."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sympose.datasets.parts.solid import (
    Solid,
    arc,
    copies,
    cylinder,
    disc,
    loft,
    outline,
    prism,
    revolve,
    rounded,
    segments,
)

__all__ = ["WHEEL_HUBS"]


def _window(
    inner: float, outer: float, spoke_inner: float, spoke_outer: float, order: int
) -> NDArray[np.float64]:
    """Outline between two neighbouring spokes of the given widths, around angle 0."""
    half = 180.0 / order
    at_inner = half - np.degrees(np.arcsin(spoke_inner / 2.0 / inner))
    at_outer = half - np.degrees(np.arcsin(spoke_outer / 2.0 / outer))
    return np.concatenate(
        [arc((0, 0), outer, -at_outer, at_outer, 21), arc((0, 0), inner, at_inner, -at_inner, 11)]
    )


def wheel_hub_5() -> Solid:
    """Car rim: five dished spokes near the outer face, a drop-centre barrel, five bolt holes and a bore."""
    facets = segments(5)
    barrel = revolve(
        [(0.500, -0.200), (0.500, -0.182), (0.462, -0.172), (0.445, -0.100), (0.400, -0.070), (0.400, 0.030),
         (0.445, 0.070), (0.462, 0.132), (0.492, 0.142), (0.492, 0.160), (0.448, 0.154), (0.428, 0.082),
         (0.382, 0.040), (0.382, -0.080), (0.430, -0.112), (0.446, -0.186), (0.470, -0.200)],
        facets,
    )  # fmt: skip
    face = revolve(
        [(0, 0.015), (0.15, 0.015), (0.27, 0.055), (0.393, 0.035), (0.430, 0.070), (0.445, 0.108),
         (0.32, 0.118), (0.20, 0.098), (0.155, 0.070), (0.065, 0.070), (0.065, 0.055), (0, 0.055)],
        facets,
    )  # fmt: skip
    window = prism(rounded(outline(_window(0.165, 0.385, 0.085, 0.105, 5)), 0.025), -0.3, 0.3)
    bolt = cylinder(0.017, -0.3, 0.3, facets=36) + cylinder(0.028, 0.05, 0.3, facets=36)
    bolts = copies(bolt.translate((0.115, 0.0, 0.0)), 5)
    pad = cylinder(0.155, -0.02, 0.03, facets=facets)
    return barrel + (face - copies(window, 5)) + pad - bolts - cylinder(0.055, -0.3, 0.3, facets=facets)


def wheel_hub_6() -> Solid:
    """Cast trolley wheel: a web with six round windows and six ribs, a flanged tread and a long boss."""
    facets = segments(6)
    tread = revolve(
        [(0.500, -0.120), (0.500, -0.085), (0.452, -0.065), (0.440, 0.110), (0.392, 0.110), (0.392, -0.120)],
        facets,
    )
    web = cylinder(0.42, -0.045, -0.005, facets=facets)
    windows = copies(cylinder(0.072, -0.3, 0.3, facets=60).translate((0.27, 0.0, 0.0)), 6)
    corners = [(0.08, -0.04), (0.08, 0.135), (0.17, 0.125), (0.40, 0.045), (0.40, -0.04)]
    rib = loft([[(r, y, z) for r, z in corners] for y in (-0.016, 0.016)])
    boss = revolve(
        [(0, -0.105), (0.105, -0.105), (0.125, -0.02), (0.125, 0.14), (0.110, 0.21), (0, 0.21)], facets
    )
    bore = cylinder(0.060, -0.3, 0.3, facets=facets) + cylinder(0.085, 0.15, 0.3, facets=facets)
    return tread + (web - windows) + copies(rib, 6, phase_deg=30.0) + boss - bore


def wheel_hub_10() -> Solid:
    """Truck hub: a flange with ten studs, ten gussets between them, a stepped boss and a hollow back."""
    facets = segments(10)
    flange = revolve([(0, 0.0), (0.49, 0.0), (0.5, 0.012), (0.5, 0.045), (0.49, 0.057), (0, 0.057)], facets)
    boss = revolve(
        [(0, 0.04), (0.245, 0.04), (0.215, 0.18), (0.195, 0.20), (0.195, 0.30), (0.180, 0.315), (0, 0.315)],
        facets,
    )
    skirt = cylinder(0.315, -0.11, 0.02, top_radius=0.335, facets=facets)
    hollow = cylinder(0.275, -0.2, -0.03, facets=facets) + cylinder(0.115, -0.2, 0.5, facets=facets)
    hollow += cylinder(0.150, 0.25, 0.5, facets=facets)
    stud = cylinder(0.021, 0.05, 0.185, facets=24) + cylinder(0.021, 0.185, 0.2, top_radius=0.014, facets=24)
    nut = prism(disc(0.042, facets=6), 0.05, 0.085)
    studs = copies((stud + nut).translate((0.415, 0.0, 0.0)), 10)
    corners = [(0.17, 0.03), (0.17, 0.175), (0.225, 0.165), (0.365, 0.07), (0.365, 0.03)]
    gusset = loft([[(r, y, z) for r, z in corners] for y in (-0.014, 0.014)])
    return flange + boss + skirt + studs + copies(gusset, 10, phase_deg=18.0) - hollow


WHEEL_HUBS: dict[str, tuple[int, Callable[[], Solid]]] = {
    "wheel_hub_5": (5, wheel_hub_5),
    "wheel_hub_6": (6, wheel_hub_6),
    "wheel_hub_10": (10, wheel_hub_10),
}
