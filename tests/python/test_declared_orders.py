"""Declared orders that the part does not have."""

from __future__ import annotations

import numpy as np
import pytest

import sympose
from sympose.datasets import part, scan


def declared(name: str, order: int) -> sympose.Estimate:
    return sympose.estimate(scan(part(name), "sphere", views=3, seed=1).scene, order=order)


@pytest.mark.parametrize(
    ("name", "order"),
    [("flange_8", 6), ("flange_8", 12), ("wheel_hub_6", 7), ("wheel_hub_5", 8), ("impeller_7", 2)],
)
def test_an_order_that_the_scan_contradicts_is_no_pose_to_act_on(name: str, order: int) -> None:
    found = declared(name, order)
    right = part(name).order
    assert found.order == order
    assert found.score < 0.5
    assert f"order {order} was declared, but left open order {right} would have been found" in found.warnings


@pytest.mark.parametrize("times", [2, 3, 4, 6])
def test_multiples_of_an_order_are_held_against_turns_of_their_own(times: int) -> None:
    # Of the 20 turns of twice the order every second one is of the part itself.
    found = declared("wheel_hub_10", times * 10)
    assert found.score < 0.5
    assert found.explained < 0.97


@pytest.mark.parametrize(("name", "order"), [("wheel_hub_6", 3), ("gear_12", 4), ("flange_8", 2), ("can", 7)])
def test_a_part_of_an_order_may_be_declared(name: str, order: int) -> None:
    found = declared(name, order)
    assert found.score > 0.8
    assert found.explained > 0.98
    truth = scan(part(name), "sphere", views=3, seed=1)
    assert abs(found.axis @ truth.axis) > np.cos(np.radians(0.1))
