"""What is found where nobody says from where the points were seen."""

from __future__ import annotations

import numpy as np
import pytest

import sympose
from sympose.datasets import Scan, part, scan


def seen_without_viewpoints(name: str) -> Scan:
    return scan(part(name), "sphere", views=5, seed=1)


@pytest.mark.parametrize("name", ["flange_8", "impeller_5", "wheel_hub_5", "wheel_hub_10", "gear_12"])
def test_an_order_stands_out_although_much_is_hidden(name: str) -> None:
    scanned = seen_without_viewpoints(name)
    found = sympose.estimate(scanned.scene.points)
    assert found.order == part(name).order
    sine = np.linalg.norm(np.cross(found.pose[:3, 2], scanned.world_from_object[:3, 2]))
    assert np.degrees(np.arcsin(sine)) < 0.05
    assert any("without viewpoints" in warning for warning in found.warnings)


@pytest.mark.parametrize("name", ["bracket", "cam_casting"])
def test_a_part_without_symmetry_is_refused(name: str) -> None:
    with pytest.raises(sympose.NoSymmetryError):
        sympose.estimate(seen_without_viewpoints(name).scene.points)


@pytest.mark.parametrize("name", ["can", "pulley"])
def test_hidden_surface_makes_no_order_of_a_surface_of_revolution(name: str) -> None:
    assert sympose.estimate(seen_without_viewpoints(name).scene.points).order == "continuous"


def test_a_half_turn_that_leaves_much_unmatched_is_weak_evidence() -> None:
    found = sympose.estimate(seen_without_viewpoints("propeller_2").scene.points)
    assert found.order == 2
    assert found.score < 0.5
    assert any("half turn" in warning for warning in found.warnings)
