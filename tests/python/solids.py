"""Solids of the tests' own, as parts that can be scanned."""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh

from sympose.datasets import Part

__all__ = ["cylinder", "solid_part"]


def cylinder(height: float, radius: float, bottom: float) -> manifold3d.Manifold:
    """A cylinder about z that stands on the height `bottom`."""
    return manifold3d.Manifold.cylinder(height, radius, radius, 96).translate([0.0, 0.0, bottom])


def solid_part(solid: manifold3d.Manifold, order: int | str | None) -> Part:
    """A part that is symmetric about z, or would be but for a detail (order None)."""
    mesh = solid.to_mesh()
    shape = trimesh.Trimesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts))
    return Part("solid", "small_part", order, shape, np.array([0.0, 0.0, 1.0]), np.zeros(3), False)
