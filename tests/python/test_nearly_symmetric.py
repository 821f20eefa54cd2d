"""A group that holds only nearly, and a part of it that holds to within the noise."""

from __future__ import annotations

import dataclasses

import manifold3d
import numpy as np
import pytest

import sympose
from solids import cylinder, solid_part
from sympose.datasets import Part, Scan, scan


def plate(sides: tuple[float, float], *, views: int, sigma: float) -> Scan:
    """A scan of a plate of the given sides and a thickness of 10, from around."""
    size = np.array([*sides, 10.0]) / np.linalg.norm([*sides, 10.0])
    solid = manifold3d.Manifold.cube(size.tolist(), True)
    return scan(solid_part(solid, 4), "sphere", views=views, seed=3, sigma=sigma)


def closer_orders(found: sympose.Estimate) -> list[str]:
    return [warning for warning in found.warnings if "less closely" in warning]


@pytest.mark.parametrize(("longer", "sigma"), [(60.5, 0.0002), (61.0, 0.001), (61.5, 0.002)])
def test_a_plate_that_is_almost_square_is_said_to_be(longer: float, sigma: float) -> None:
    found = sympose.estimate(plate((60.0, longer), views=5, sigma=sigma).scene)
    (warning,) = closer_orders(found)
    assert found.order == 4
    assert warning.startswith("order 4 holds less closely than order 2: 19 of 20 points")


@pytest.mark.parametrize("views", [1, 2, 5])
@pytest.mark.parametrize("sigma", [0.0, 0.001, 0.005])
def test_a_square_plate_is_not(views: int, sigma: float) -> None:
    found = sympose.estimate(plate((60.0, 60.0), views=views, sigma=sigma).scene, order=4)
    assert not closer_orders(found)


def wheel_without_a_spoke() -> Part:
    """Five of six spokes, a hub and a round rim."""
    wheel = manifold3d.Manifold.revolve(manifold3d.CrossSection.circle(0.047, 48).translate((0.453, 0.0)), 96)
    wheel += cylinder(0.21, 0.116, -0.074) - cylinder(0.42, 0.047, -0.21)
    spoke = manifold3d.Manifold.cube([0.353, 0.053, 0.042], True).translate([0.255, 0.0, 0.0])
    for k in range(5):
        wheel += spoke.rotate([0.0, 0.0, 60.0 * k])
    # The views follow from the name: from these a third of a turn shows the gap in one sense alone.
    return dataclasses.replace(solid_part(wheel, None), name="spoke_missing")


@pytest.mark.parametrize("seed", [1, 12])
def test_a_gap_that_turns_in_one_sense_show_is_one(seed: int) -> None:
    one_view = scan(wheel_without_a_spoke(), "sphere", views=1, seed=seed)
    try:
        found = sympose.estimate(one_view.scene)
    except sympose.NoSymmetryError:
        return
    assert found.score < 0.5
