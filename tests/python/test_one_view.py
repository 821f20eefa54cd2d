"""What a single view can tell, and what it cannot."""

from __future__ import annotations

import pytest

import sympose
from sympose.datasets import part, scan


@pytest.mark.parametrize("name", ["flange_8", "wheel_hub_5", "gear_12"])
def test_a_view_from_the_side_alone_tells_no_order(name: str) -> None:
    scanned = scan(part(name), "edge", views=1, seed=1)
    found = sympose.estimate(scanned.scene)
    assert found.score < 0.5
    assert any("ambiguous" in warning for warning in found.warnings)
    declared = sympose.estimate(scanned.scene, order=part(name).order)
    assert declared.score > 0.7
    assert not any("ambiguous" in warning for warning in declared.warnings)


def test_a_view_of_the_face_tells_the_order() -> None:
    found = sympose.estimate(scan(part("flange_8"), "upper", views=1, seed=1).scene)
    assert found.order == 8
    assert found.score > 0.7


def test_half_a_turn_in_one_view_is_weak_evidence() -> None:
    scanned = scan(part("propeller_2"), "sphere", views=1, seed=2)
    found = sympose.estimate(scanned.scene)
    assert found.order == 2
    assert found.score < 0.5
    assert any("ambiguous" in warning for warning in found.warnings)
    declared = sympose.estimate(scanned.scene, order=2)
    assert declared.score > 0.5
    assert not any("ambiguous" in warning for warning in declared.warnings)
