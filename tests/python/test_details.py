"""Bolt holes that cover little of their disc decide the order all the same."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import trimesh

import sympose
from sympose.datasets import Part, scan

#: Radius of a bolt hole [diameters of the disc].
RADIUS = 0.024


def disc(holes: int) -> Part:
    """A hat-shaped disc of diameter 1 with small bolt holes."""

    def cylinder(height: float, radius: float, z: float) -> manifold3d.Manifold:
        return manifold3d.Manifold.cylinder(height, radius, radius, 96).translate([0.0, 0.0, z])

    solid = cylinder(0.06, 0.5, 0.0) + cylinder(0.12, 0.25, 0.05) - cylinder(1.0, 0.1, -0.3)
    solid -= cylinder(0.1, 0.2, -0.04)
    for k in range(holes):
        hole = cylinder(1.0, RADIUS, -0.3).translate([0.16, 0.0, 0.0])
        solid -= hole.rotate([0.0, 0.0, 360.0 * k / holes])
    mesh = solid.to_mesh()
    shape = trimesh.Trimesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts))
    return Part(
        "disc", "wheel_hub", holes or "continuous", shape, np.array([0.0, 0.0, 1.0]), np.zeros(3), False
    )


@pytest.mark.parametrize("holes", [4, 5, 6])
def test_bolt_holes_give_a_disc_its_order(holes: int) -> None:
    found = sympose.estimate(scan(disc(holes), "sphere", views=5, seed=1).scene)
    assert found.order == holes
    assert any("without them it would be continuous" in warning for warning in found.warnings)


def test_a_disc_without_holes_is_a_surface_of_revolution() -> None:
    assert sympose.estimate(scan(disc(0), "sphere", views=5, seed=1).scene).order == "continuous"
