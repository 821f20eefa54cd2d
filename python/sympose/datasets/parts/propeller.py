"""Propellers: thin airfoil blades with twist, on hubs that differ above and below."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.datasets.parts.solid import (
    Solid,
    airfoil,
    arc,
    copies,
    cylinder,
    loft,
    revolve,
    segments,
)

__all__ = ["PROPELLERS"]


def _blade(
    radius: ArrayLike,
    chord: ArrayLike,
    thickness: ArrayLike,
    pitch_deg: ArrayLike,
    *,
    camber: float = 0.04,
    skew_deg: ArrayLike = 0.0,
    rake: ArrayLike = 0.0,
    z: float = 0.0,
    sections: int = 24,
) -> Solid:
    """A blade whose airfoil sections are wrapped on cylinders about the axis.

    Args:
        radius: (K,) stations; the other tables, (K,) or one number, belong to these.
        chord, thickness: Lengths.
        pitch_deg: Angle between the chord and the plane of rotation.
        camber: Share of the chord.
        skew_deg, rake: How far the middle of a section is swept back about and along the axis.
        z: Height of the root.
    """
    stations = np.asarray(radius, dtype=np.float64)

    def at(table: ArrayLike, r: NDArray[np.float64]) -> NDArray[np.float64]:
        # Cubic through the stations, so that the outline of the blade is smooth.
        values = np.broadcast_to(np.asarray(table, dtype=np.float64), stations.shape)
        scale = stations[-1] - stations[0]
        fit = np.polynomial.Polynomial.fit((stations - stations[0]) / scale, values, len(stations) - 1)
        return np.asarray(fit((r - stations[0]) / scale))

    # Denser toward the tip, where the blade is rounded.
    r = stations[0] + (stations[-1] - stations[0]) * np.sin(np.linspace(0.0, np.pi / 2.0, sections))
    chords, thick, pitch = at(chord, r), at(thickness, r), np.radians(at(pitch_deg, r))
    skew, raked = np.radians(at(skew_deg, r)), at(rake, r)
    loops = []
    for k in range(sections):
        x, y = airfoil(chords[k], thick[k], camber * chords[k]).T
        along = x * np.cos(pitch[k]) - y * np.sin(pitch[k])
        angle = along / r[k] - skew[k]
        height = x * np.sin(pitch[k]) + y * np.cos(pitch[k]) + raked[k] + z
        loops.append(np.stack([r[k] * np.cos(angle), r[k] * np.sin(angle), height], axis=1))
    return loft(loops)


def _dome(radius: float, bottom: float, shoulder: float, tip: float) -> NDArray[np.float64]:
    """Profile of a cylinder from `bottom` to `shoulder` under half an ellipse that ends at `tip`."""
    nose = arc((0.0, 0.0), 1.0, 0.0, 90.0, 17) * [radius, tip - shoulder] + [0.0, shoulder]
    return np.concatenate([[[0.0, bottom], [radius, bottom]], nose])


def propeller_2() -> Solid:
    """Two thin blades of a multirotor, on a bored hub with a wider recess below."""
    facets = segments(2)
    blade = _blade(
        [0.035, 0.12, 0.22, 0.36, 0.5],
        [0.062, 0.098, 0.096, 0.072, 0.034],
        [0.016, 0.012, 0.010, 0.007, 0.004],
        [34.0, 27.0, 19.0, 13.0, 9.0],
        camber=0.06,
        skew_deg=[0, 0, 0, 1, 3],
        rake=[0, 0.002, 0.007, 0.017, 0.030],
    )
    hub = revolve([(0, -0.035), (0.056, -0.035), (0.056, 0.018), (0.046, 0.034), (0, 0.034)], facets)
    holes = cylinder(0.018, -0.1, 0.1, facets=facets) + cylinder(0.036, -0.1, -0.012, facets=facets)
    return copies(blade, 2) + hub - holes


def propeller_3() -> Solid:
    """Outboard propeller: three wide blades on a boss with a nose, bored for the shaft from below."""
    facets = segments(3)
    blade = _blade(
        [0.07, 0.16, 0.28, 0.40, 0.5],
        [0.19, 0.28, 0.36, 0.36, 0.10],
        [0.040, 0.030, 0.021, 0.013, 0.006],
        [52.0, 42.0, 30.0, 23.0, 19.0],
        skew_deg=[-4, 0, 4, 8, 14],
        rake=[0, -0.01, -0.03, -0.055, -0.085],
        sections=30,
    )
    boss = revolve(_dome(0.10, -0.15, 0.10, 0.20), facets)
    shaft = cylinder(0.055, -0.2, -0.02, top_radius=0.045, facets=facets)
    return copies(blade, 3) + boss - shaft


def propeller_4() -> Solid:
    """Ship propeller: four strongly skewed blades, a tapered boss with a cap."""
    facets = segments(4)
    blade = _blade(
        [0.08, 0.16, 0.27, 0.39, 0.5],
        [0.15, 0.21, 0.26, 0.25, 0.06],
        [0.036, 0.028, 0.019, 0.012, 0.005],
        [55.0, 44.0, 32.0, 25.0, 20.0],
        skew_deg=[2, -4, -2, 12, 34],
        rake=[0, 0, -0.01, -0.02, -0.04],
        camber=0.03,
        sections=30,
    )
    profile = [(0, -0.15), (0.085, -0.15), (0.115, 0.10), (0.085, 0.10)]
    boss = revolve(np.concatenate([profile, _dome(0.085, 0.0, 0.13, 0.21)[2:]]), facets)
    shaft = cylinder(0.06, -0.2, 0.0, top_radius=0.04, facets=facets)
    return copies(blade, 4) + boss - shaft


def propeller_5() -> Solid:
    """Axial fan: five broad sheet blades around a cup that is open below, with a stub inside."""
    facets = segments(5)
    blade = _blade(
        [0.16, 0.25, 0.34, 0.42, 0.5],
        [0.17, 0.215, 0.255, 0.275, 0.25],
        [0.014, 0.012, 0.011, 0.010, 0.009],
        [44.0, 36.0, 30.0, 26.0, 23.0],
        camber=0.08,
        skew_deg=[0, -1, -3, -7, -12],
        z=-0.005,
        sections=20,
    )
    cup = revolve(
        [
            (0, 0.08),
            (0, 0.066),
            (0.155, 0.066),
            (0.163, 0.058),
            (0.163, -0.085),
            (0.178, -0.085),
            (0.178, 0.062),
            (0.160, 0.08),
        ],
        facets,
    )
    stub = cylinder(0.04, -0.05, 0.07, facets=facets) - cylinder(0.016, -0.1, 0.03, facets=facets)
    inside = cylinder(0.17, -0.3, 0.07, facets=facets)
    return (copies(blade, 5) - inside) + cup + stub


PROPELLERS: dict[str, tuple[int, Callable[[], Solid]]] = {
    "propeller_2": (2, propeller_2),
    "propeller_3": (3, propeller_3),
    "propeller_4": (4, propeller_4),
    "propeller_5": (5, propeller_5),
}
