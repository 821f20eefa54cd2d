"""Impellers: vanes standing on a back plate or a curved hub, open toward the inlet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.datasets.parts.solid import (
    Solid,
    arc,
    copies,
    cylinder,
    loft,
    outline,
    prism,
    revolve,
    segments,
)

__all__ = ["IMPELLERS"]


def _spiral_vane(
    inner: float, outer: float, wrap_deg: float, thickness: tuple[float, float], count: int = 24
) -> NDArray[np.float64]:
    """Outline of a vane that leans back by `wrap_deg` between two radii; thickness at both ends."""
    share = np.linspace(0.0, 1.0, count)
    radius = inner + (outer - inner) * share
    angle = -np.radians(wrap_deg) * np.log(radius / inner) / np.log(outer / inner)
    middle = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return _thicken(middle, thickness[0] + (thickness[1] - thickness[0]) * share)


def _thicken(line: NDArray[np.float64], thickness: ArrayLike) -> NDArray[np.float64]:
    """Closed loop around a line in the plane, half the thickness to each side."""
    along = np.gradient(line, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    half = np.broadcast_to(np.asarray(thickness, dtype=np.float64) / 2.0, len(line))[:, None]
    return np.concatenate([line + half * normal, (line - half * normal)[::-1]])


def _meridional_blade(
    hub: NDArray[np.float64],
    shroud: NDArray[np.float64],
    wrap_deg: ArrayLike,
    thickness: tuple[float, float],
    span: int = 6,
) -> Solid:
    """A blade between two meridional curves, both (K, 2) of radius and z, from inlet to outlet.

    `wrap_deg`, (K,) or (K, span), is the angle about the axis; the thickness falls from hub to shroud.
    """
    share = np.linspace(0.0, 1.0, span)
    curves = hub[:, None, :] + (shroud - hub)[:, None, :] * share[None, :, None]
    wrap = np.radians(np.asarray(wrap_deg, dtype=np.float64))
    angle = np.broadcast_to(wrap if wrap.ndim == 2 else wrap[:, None], curves.shape[:2])
    half = (thickness[0] + (thickness[1] - thickness[0]) * share) / 2.0 / curves[..., 0]

    def side(sign: float) -> NDArray[np.float64]:
        turned = angle + sign * half
        x, y = curves[..., 0] * np.cos(turned), curves[..., 0] * np.sin(turned)
        return np.stack([x, y, curves[..., 1]], axis=-1)

    return loft(np.concatenate([side(1.0), side(-1.0)[:, ::-1]], axis=1))


def impeller_5() -> Solid:
    """Open pump impeller: five backward-curved vanes, lower toward the rim, on a plate with a nose."""
    facets = segments(5)
    vane = prism(outline(_spiral_vane(0.13, 0.52, 105.0, (0.034, 0.026))), -0.01, 0.4)
    below_shroud = revolve(
        [(0, -0.02), (0.5, -0.02), (0.5, 0.075), (0.40, 0.10), (0.28, 0.15), (0.20, 0.21), (0.17, 0.25),
         (0, 0.25)],
        facets,
    )  # fmt: skip
    plate = revolve(
        [(0, -0.035), (0.5, -0.035), (0.5, -0.008), (0.30, 0.008), (0.19, 0.035), (0.135, 0.09),
         (0.105, 0.16), (0.085, 0.195), (0.070, 0.205), (0, 0.205)],
        facets,
    )  # fmt: skip
    boss = cylinder(0.12, -0.10, 0.0, facets=facets)
    bore = cylinder(0.035, -0.2, 0.3, facets=facets) + cylinder(0.06, -0.2, -0.06, facets=facets)
    return (copies(vane, 5) ^ below_shroud) + plate + boss - bore


def impeller_7() -> Solid:
    """Compressor wheel: seven blades and seven splitters on a flared hub."""
    facets = segments(7)
    share = np.linspace(0.0, 1.0, 22)
    turn = share * np.pi / 2.0
    # Quarter ellipses: axial at the inlet, radial at the outlet.
    hub = np.stack([0.5 - 0.41 * np.cos(turn), 0.42 * (1.0 - np.sin(turn)) + 0.01], axis=1)
    shroud = np.stack([0.5 - 0.18 * np.cos(turn), 0.30 * (1.0 - np.sin(turn)) + 0.085], axis=1)
    # The inlet edge leans forward like a fan blade, the outlet is swept back.
    lean = np.linspace(0.0, 1.0, 6)
    wrap = -(62.0 * share[:, None] ** 1.5) + 26.0 * (1.0 - share[:, None]) ** 2 * lean[None, :]
    root = hub - [0.02, 0.02]  # rooted inside the hub
    blade = _meridional_blade(root, shroud, wrap, (0.016, 0.009))
    splitter = _meridional_blade(root[8:], shroud[8:], wrap[8:], (0.016, 0.009))
    body = revolve(
        np.concatenate([[(0, -0.05), (0.09, -0.05), (0.12, -0.03), (0.48, -0.012), (0.5, -0.012)], hub[::-1],
                        [(0.085, 0.47), (0.06, 0.49), (0, 0.49)]]),
        facets,
    )  # fmt: skip
    wheel = copies(blade, 7) + copies(splitter, 7, phase_deg=180.0 / 7.0)
    # The wheel is turned to its outer diameter.
    envelope = cylinder(0.5, -0.2, 0.6, facets=facets)
    bore = cylinder(0.032, -0.2, 0.6, facets=facets)
    return (wheel ^ envelope) + body - bore


def impeller_9() -> Solid:
    """Blower wheel: nine forward-curved vanes between a coned back plate and a ring around the inlet."""
    facets = segments(9)
    vane = prism(outline(_spiral_vane(0.27, 0.485, -42.0, (0.020, 0.016), count=16)), 0.0, 0.29)
    plate = revolve(
        [
            (0, -0.02),
            (0.10, -0.02),
            (0.13, 0.0),
            (0.5, 0.0),
            (0.5, 0.02),
            (0.24, 0.02),
            (0.09, 0.11),
            (0, 0.11),
        ],
        facets,
    )
    ring = revolve(
        np.concatenate([[(0.5, 0.27), (0.5, 0.29)], arc((0.40, 0.33), 0.04, 270.0, 180.0, 7),
                        [(0.34, 0.33)], arc((0.40, 0.33), 0.06, 180.0, 270.0, 9)]),
        facets,
    )  # fmt: skip
    bore = cylinder(0.04, -0.2, 0.3, facets=facets)
    return copies(vane, 9) + plate + ring - bore


IMPELLERS: dict[str, tuple[int, Callable[[], Solid]]] = {
    "impeller_5": (5, impeller_5),
    "impeller_7": (7, impeller_7),
    "impeller_9": (9, impeller_9),
}
