"""A group that holds only nearly, and a part of it that holds to within the noise."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

import sympose
from solids import solid_part
from sympose.datasets import Scan, scan


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
