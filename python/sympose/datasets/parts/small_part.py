"""Small parts: a knob, a sprocket, a flange and a gear."""

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
    outline,
    prism,
    revolve,
    rounded,
    segments,
)

__all__ = ["SMALL_PARTS"]


def knob_3() -> Solid:
    """Three-lobed knob: a domed grip with filleted lobes on a boss, bored from below."""
    facets = segments(3)
    grip = disc(0.25, facets=facets)
    for turn_deg in (0.0, 120.0, 240.0):
        grip += disc(0.125, 0.37, 0.0, 60).rotate(turn_deg)
    grip = prism(rounded(grip, -0.11, 96), 0.0, 0.5)
    crown = revolve(
        np.concatenate([[(0, 0.03), (0.44, 0.03)], arc((0.455, 0.070), 0.040, -90.0, 35.0, 9),
                        [(0.43, 0.155), (0.36, 0.19), (0.26, 0.222), (0.14, 0.242), (0, 0.248)]]),
        facets,
    )  # fmt: skip
    boss = revolve([(0, -0.14), (0.120, -0.14), (0.130, -0.13), (0.165, 0.05), (0, 0.05)], facets)
    bore = cylinder(0.062, -0.2, 0.10, facets=facets) + cylinder(0.080, -0.2, -0.12, facets=facets)
    return (grip ^ crown) + boss - bore


def sprocket_6() -> Solid:
    """Chain sprocket: eighteen teeth, six rounded windows, a boss on one side."""
    teeth, facets = 18, segments(18)
    plate = revolve(
        [(0, -0.03), (0.462, -0.03), (0.5, -0.012), (0.5, 0.012), (0.462, 0.03), (0, 0.03)], facets
    )
    pitch_radius, roller = 0.452, 0.050
    gap = prism(disc(roller, pitch_radius, 0.0, 40) + outline(_flare(pitch_radius, roller)), -0.1, 0.1)
    half = 19.0
    pocket = np.concatenate(
        [arc((0, 0), 0.345, -half, half, 15), arc((0, 0), 0.215, half - 3.0, -half + 3.0, 11)]
    )
    windows = copies(prism(rounded(outline(pocket), 0.028), -0.1, 0.1), 6)
    boss = revolve([(0, 0.0), (0.165, 0.0), (0.165, 0.125), (0.155, 0.135), (0, 0.135)], facets)
    bore = cylinder(0.075, -0.2, 0.3, facets=facets)
    return plate - copies(gap, teeth) - windows + boss - bore


def _flare(radius: float, roller: float) -> NDArray[np.float64]:
    """Opening of a tooth gap outward from the roller."""
    inner, outer = radius, radius + 0.08
    return np.array([(inner, -roller), (outer, -1.45 * roller), (outer, 1.45 * roller), (inner, roller)])


def flange_8() -> Solid:
    """Welding-neck flange: eight bolt holes, a raised face below and a tapered neck above."""
    facets = segments(8)
    body = revolve(
        [(0.165, -0.020), (0.325, -0.020), (0.325, 0.0), (0.495, 0.0), (0.5, 0.005), (0.5, 0.095),
         (0.495, 0.1), (0.300, 0.1), (0.270, 0.125), (0.215, 0.275), (0.205, 0.330),
         (0.185, 0.345), (0.165, 0.345)],
        facets,
    )  # fmt: skip
    hole = cylinder(0.050, -0.1, 0.2, facets=48).translate((0.412, 0.0, 0.0))
    return body - copies(hole, 8)


def gear_12() -> Solid:
    """Helical gear: twelve involute teeth, a recess above, a boss below."""
    teeth, facets = 12, segments(12)
    module = 1.0 / (teeth + 2)
    wheel = prism(outline(_tooth(teeth, module, 20.0)), -0.10, 0.10, twist_deg=16.0, layers=16)
    body = copies(wheel, teeth) + cylinder(module * (teeth - 2.4) / 2.0, -0.10, 0.10, facets=facets)
    # Tip edges are chamfered.
    blank = revolve([(0, -0.10), (0.48, -0.10), (0.5, -0.082), (0.5, 0.082), (0.48, 0.10), (0, 0.10)], facets)
    recess = revolve([(0.14, 0.055), (0.275, 0.055), (0.29, 0.2), (0.125, 0.2)], facets)
    boss = revolve([(0, -0.22), (0.16, -0.22), (0.17, -0.21), (0.17, 0.0), (0, 0.0)], facets)
    return (body ^ blank) - recess + boss - cylinder(0.08, -0.5, 0.5, facets=facets)


def _tooth(teeth: int, module: float, pressure_deg: float, count: int = 10) -> NDArray[np.float64]:
    """Outline of one involute tooth about angle 0, rooted below the foot circle."""
    pressure = np.radians(pressure_deg)
    pitch = module * teeth / 2.0
    base, tip, foot = pitch * np.cos(pressure), pitch + module, pitch - 1.25 * module
    radius = np.linspace(max(base, foot), tip, count)
    roll = np.sqrt((radius / base) ** 2 - 1.0)
    # Half the angle of the tooth at a radius: that at the pitch circle plus the difference of the involutes.
    angle = np.pi / (2.0 * teeth) + np.tan(pressure) - pressure - (roll - np.arctan(roll))
    radius = np.concatenate([[foot - 0.3 * module], radius])
    angle = np.concatenate([[angle[0]], angle])
    flank = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return np.concatenate([flank[::-1], flank * [1.0, -1.0]])


SMALL_PARTS: dict[str, tuple[int, Callable[[], Solid]]] = {
    "knob_3": (3, knob_3),
    "sprocket_6": (6, sprocket_6),
    "flange_8": (8, flange_8),
    "gear_12": (12, gear_12),
}
