"""Parts for the edges of the method: surfaces of revolution, and parts without symmetry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sympose.datasets.parts.solid import (
    Solid,
    arc,
    cylinder,
    disc,
    loft,
    outline,
    prism,
    revolve,
    rounded,
)

__all__ = ["ASYMMETRIC", "CONTINUOUS"]

_FACETS = 720  # off the true circle by 5e-6 of the diameter


def can() -> Solid:
    """Drink can: a domed bottom, a necked top with a rim."""
    return revolve(
        np.concatenate([
            arc((0.0, -0.62), 0.24, 90.0, 50.0, 9) * [1.0, 1.0],
            [(0.168, -0.452), (0.185, -0.452), (0.232, -0.405), (0.240, -0.39), (0.240, 0.36), (0.232, 0.385),
             (0.195, 0.435), (0.198, 0.450), (0.190, 0.452), (0.183, 0.440), (0.178, 0.415), (0.0, 0.420)],
        ]),
        _FACETS,
    )  # fmt: skip


def bowl() -> Solid:
    """Bowl with a foot ring and a thick lip."""
    middle = [0.0, 0.258]
    outside = arc((0.0, 0.0), 1.0, -66.0, -4.0, 13) * [0.50, 0.43] + middle
    inside = arc((0.0, 0.0), 1.0, -3.0, -90.0, 16) * [0.474, 0.375] + middle
    foot = [(0.0, -0.14), (0.160, -0.14), (0.160, -0.165), (0.195, -0.165), (0.199, -0.14)]
    return revolve(np.concatenate([foot, outside, [(0.498, 0.245), (0.486, 0.245)], inside]), _FACETS)


def pulley() -> Solid:
    """Stepped pulley: three V-grooves of falling diameter, a bore."""
    edge = [(0.055, 0.0)]
    bottom = 0.0
    for radius in (0.49, 0.38, 0.27):
        edge += [(radius, bottom), (radius, bottom + 0.02), (radius - 0.075, bottom + 0.055)]
        edge += [(radius - 0.075, bottom + 0.075), (radius, bottom + 0.11), (radius, bottom + 0.13)]
        bottom += 0.13
    edge += [(0.14, bottom), (0.14, bottom + 0.06), (0.055, bottom + 0.06)]
    recess = revolve([(0.15, -0.1), (0.40, -0.1), (0.38, 0.04), (0.17, 0.04)], _FACETS)
    return revolve(edge, _FACETS) - recess


def mug() -> Solid:
    """Mug with one handle."""
    facets = 180
    wall = revolve(
        [(0, -0.35), (0.26, -0.35), (0.28, -0.33), (0.30, 0.35), (0.275, 0.35), (0.255, -0.29), (0, -0.30)],
        facets,
    )
    turn = np.linspace(-100.0, 100.0, 33)
    section = arc((0.0, 0.0), 1.0, 0.0, 342.0, 20) * [0.032, 0.045]
    loops = []
    for angle in np.radians(turn):
        out = np.array([np.cos(angle), 0.0, np.sin(angle)])
        middle = np.array([0.31, 0.0, 0.01]) + out * [0.17, 0.0, 0.22]
        loops.append(middle + section[:, :1] * out + section[:, 1:] * [0.0, 1.0, 0.0])
    inside = cylinder(0.255, -0.29, 0.5, top_radius=0.277, facets=facets)
    return wall + (loft(loops) - inside)


def bracket() -> Solid:
    """Angle bracket: a slotted base, an upright with a bore, a gusset on one side."""
    base = prism(
        rounded(outline([(-0.40, -0.22), (0.34, -0.22), (0.34, 0.22), (-0.40, 0.22)]), 0.05), -0.24, -0.18
    )
    slot = disc(0.032, -0.24, 0.11) + disc(0.032, -0.10, 0.11)
    slot += outline([(-0.24, 0.078), (-0.10, 0.078), (-0.10, 0.142), (-0.24, 0.142)])
    hole = disc(0.045, -0.22, -0.11)
    # Drawn in x and z, then stood up along y.
    upright = prism(
        rounded(outline([(-0.22, -0.24), (0.22, -0.24), (0.22, 0.12), (0.07, 0.30), (-0.22, 0.30)]), 0.04),
        0.0,
        0.07,
    )
    upright = upright.rotate((90.0, 0.0, 90.0)).translate((0.23, 0.0, 0.0))
    bore = cylinder(0.08, -1.0, 1.0, facets=72).rotate((0.0, 90.0, 0.0)).translate((0.0, -0.05, 0.13))
    gusset = prism(outline([(-0.20, -0.19), (0.24, -0.19), (0.24, 0.18)]), 0.0, 0.045)
    gusset = gusset.rotate((90.0, 0.0, 0.0)).translate((0.0, -0.14, 0.0))
    return base + upright + gusset - prism(slot + hole, -0.5, 0.0) - bore


def cam_casting() -> Solid:
    """Casting with a cam off the centre: an uneven plate, two bosses of different height, a lug and a rib."""
    plate = prism(
        rounded(outline([(-0.42, -0.20), (0.10, -0.34), (0.44, -0.16), (0.30, 0.26), (-0.20, 0.34)]), 0.08),
        -0.16, -0.08,
    )  # fmt: skip
    lobe = disc(0.17, -0.10, 0.02, 90) + disc(0.07, 0.13, 0.12, 60)
    cam = prism(lobe.hull(), -0.10, 0.10)
    shaft = cylinder(0.085, 0.0, 0.26, facets=72).translate((-0.10, 0.02, 0.0))
    boss = cylinder(0.075, -0.16, 0.04, facets=72).translate((0.28, -0.10, 0.0))
    lug = prism(disc(0.06, -0.30, -0.18, 48), -0.16, 0.0)
    rib = loft([[(x, y, z) for x, z in [(-0.05, -0.1), (0.30, -0.1), (0.28, 0.0), (-0.05, 0.09)]]
                for y in (-0.08, -0.05)])  # fmt: skip
    holes = cylinder(0.045, -1.0, 1.0, facets=48).translate((-0.10, 0.02, 0.0))
    holes += cylinder(0.035, -1.0, 1.0, facets=48).translate((0.28, -0.10, 0.0))
    holes += cylinder(0.025, -1.0, 1.0, facets=48).translate((-0.30, -0.18, 0.0))
    return plate + cam + shaft + boss + lug + rib - holes


CONTINUOUS: dict[str, Callable[[], Solid]] = {"can": can, "bowl": bowl, "pulley": pulley}
ASYMMETRIC: dict[str, Callable[[], Solid]] = {"mug": mug, "bracket": bracket, "cam_casting": cam_casting}
