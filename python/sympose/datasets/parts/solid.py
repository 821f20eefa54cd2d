"""Solids from profiles, outlines and sections: the few operations all parts are made of.

Solids are `manifold3d.Manifold`, closed by construction, with +z as the axis. Angles are in degrees here, as
in manifold3d. The number of segments of a circle must be a multiple of the order of the part, or the facets
break the symmetry; `segments` takes care of it.
"""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.datasets.optional import load

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = [
    "Solid",
    "airfoil",
    "arc",
    "copies",
    "cylinder",
    "disc",
    "loft",
    "outline",
    "prism",
    "revolve",
    "rounded",
    "segments",
    "to_mesh",
]

Solid = Any  # manifold3d.Manifold, which has no type stubs
Outline = Any  # manifold3d.CrossSection


def segments(order: int, least: int = 180) -> int:
    """Smallest multiple of `order` that is at least `least` facets to the full circle."""
    return order * -(-least // order)


def outline(*loops: ArrayLike) -> Outline:
    """The region inside an odd number of `loops`, each (M, 2)."""
    m3d = load("manifold3d")
    contours = [np.asarray(loop, dtype=np.float64) for loop in loops]
    return m3d.CrossSection(contours, m3d.FillRule.EvenOdd)


def disc(radius: float, x: float = 0.0, y: float = 0.0, facets: int = 48) -> Outline:
    """A round outline."""
    return load("manifold3d").CrossSection.circle(radius, facets).translate((x, y))


def rounded(region: Outline, radius: float, facets: int = 32) -> Outline:
    """Round the convex corners of `region`; negative `radius` rounds the concave ones."""
    join = load("manifold3d").JoinType.Round
    return region.offset(-radius, join, 2.0, facets).offset(radius, join, 2.0, facets)


def prism(region: Outline, bottom: float, top: float, twist_deg: float = 0.0, layers: int = 0) -> Solid:
    """Extrude `region` from z = bottom to z = top, turning by `twist_deg` on the way."""
    return region.extrude(top - bottom, layers, twist_deg).translate((0.0, 0.0, bottom))


def cylinder(
    radius: float, bottom: float, top: float, *, top_radius: float | None = None, facets: int = 180
) -> Solid:
    """A cylinder, or a frustum where `top_radius` is given, about the z axis."""
    upper = radius if top_radius is None else top_radius
    solid = load("manifold3d").Manifold.cylinder(top - bottom, radius, upper, facets)
    return solid.translate((0.0, 0.0, bottom))


def revolve(profile: ArrayLike, facets: int) -> Solid:
    """Turn the closed loop `profile`, (M, 2) of radius and z, about the z axis."""
    return outline(profile).revolve(facets)


def arc(
    center: tuple[float, float], radius: float, start_deg: float, stop_deg: float, count: int = 13
) -> NDArray[np.float64]:
    """(count, 2) points on a circle, for profiles and outlines."""
    angle = np.radians(np.linspace(start_deg, stop_deg, count))
    return np.asarray(center) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def airfoil(chord: float, thickness: float, camber: float, count: int = 12) -> NDArray[np.float64]:
    """(2 count, 2) loop of a four-digit NACA section with a blunt trailing edge, mid-chord at the origin.

    `thickness` and `camber` are lengths (not shares of the chord); the most camber is at 40 % of the chord.
    """
    # Denser at the nose, where the section is round.
    x = (1.0 - np.cos(np.linspace(0.0, np.pi, count + 1))) / 2.0
    half = (
        5.0 * thickness * (0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.0950 * x**4)
    )
    p = 0.4
    line = camber * np.where(x < p, (2 * p * x - x**2) / p**2, (1 - 2 * p + 2 * p * x - x**2) / (1 - p) ** 2)
    upper = np.stack([(x - 0.5) * chord, line + half], axis=1)
    lower = np.stack([(x - 0.5) * chord, line - half], axis=1)
    return np.concatenate([lower, upper[:0:-1]])


def loft(sections: ArrayLike) -> Solid:
    """The solid through `sections`, (K, M, 3): K loops of M points each.

    The ends are closed by a zigzag from the first point of the loop to the opposite one, which suits thin,
    cambered sections as well as convex ones.

    Raises:
        ValueError: The sections do not bound a solid.
    """
    m3d = load("manifold3d")
    rings = np.asarray(sections, dtype=np.float64)
    count, width = rings.shape[:2]
    index = np.arange(count * width).reshape(count, width)
    a, b = index[:-1], index[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    walls = [np.stack(corner, axis=-1).reshape(-1, 3) for corner in ((a, a_next, b_next), (a, b_next, b))]
    caps = []
    for ring, turned in ((index[0], True), (index[-1], False)):
        left, right = ring[: width // 2 + 1], ring[-np.arange(width - width // 2 + 1)]
        rungs = [(a, b, c) for a, b, c in zip(left[:-1], left[1:], right[1:], strict=False)]
        rungs += [(a, b, c) for a, b, c in zip(left[:-1], right[1:], right[:-1], strict=False)]
        triangles = np.array([rung for rung in rungs if len(set(rung)) == 3])
        caps.append(triangles[:, ::-1] if turned else triangles)
    vertices = rings.reshape(-1, 3)
    faces = np.concatenate(walls + caps)
    corners = vertices[faces]
    if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0.0:
        faces = faces[:, ::-1]
    solid = m3d.Manifold(m3d.Mesh64(vertices, faces.astype(np.uint64)))
    if solid.status() != m3d.Error.NoError or solid.is_empty():
        raise ValueError(f"the sections do not bound a solid: {solid.status()}")
    return solid


def copies(solid: Solid, order: int, phase_deg: float = 0.0) -> Solid:
    """The union of `order` copies of one sector's content, turned by 360/order about z."""
    return reduce(add, (solid.rotate((0.0, 0.0, phase_deg + 360.0 * k / order)) for k in range(order)))


def to_mesh(solid: Solid) -> Trimesh:
    """The surface of `solid`."""
    raw = solid.to_mesh64()
    vertices = np.asarray(raw.vert_properties, dtype=np.float64)[:, :3]
    mesh: Trimesh = load("trimesh").Trimesh(
        vertices, np.asarray(raw.tri_verts, dtype=np.int64), process=False
    )
    return mesh
