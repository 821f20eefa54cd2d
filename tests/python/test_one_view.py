"""What a single view can tell, and what it cannot."""

from __future__ import annotations

from collections.abc import Callable

import manifold3d
import numpy as np
import pytest

import sympose
from solids import cylinder, solid_part
from sympose.datasets import Scan, part, scan


def box(*size: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(list(size), True)


def axis_error_deg(scanned: Scan, found: sympose.Estimate) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(found.pose[:3, 2] @ scanned.axis)))))


@pytest.mark.parametrize("order", [None, "continuous"])
@pytest.mark.parametrize("place", ["sphere", "edge"])
def test_the_stem_of_a_ball_tells_its_axis(place: str, order: str | None) -> None:
    knob = manifold3d.Manifold.sphere(0.36, 96).translate([0.0, 0.0, 0.14])
    knob += cylinder(0.5, 0.14, -0.5)
    scanned = scan(solid_part(knob, "continuous"), place, views=1, seed=1)
    found = sympose.estimate(scanned.scene, order=order)
    assert found.order == "continuous"
    assert axis_error_deg(scanned, found) < 0.1


def tube() -> manifold3d.Manifold:
    return box(0.5, 0.5, 0.6) - box(0.42, 0.42, 1.0)


def nut() -> manifold3d.Manifold:
    return manifold3d.Manifold.cylinder(0.5, 0.45, 0.45, 6, True) - cylinder(1.0, 0.2, -0.5)


@pytest.mark.parametrize(("solid", "order", "seed"), [(nut, 6, 2), (nut, 6, 7)])
def test_an_order_that_one_view_does_not_allow_is_doubted(
    solid: Callable[[], manifold3d.Manifold], order: int, seed: int
) -> None:
    # Walls that are seen from the side are two-fold about a line toward the camera.
    scanned = scan(solid_part(solid(), order), "edge", views=1, seed=seed)
    found = sympose.estimate(scanned.scene, order=order)
    doubted = any(f"order {order} was declared, but" in warning for warning in found.warnings)
    assert axis_error_deg(scanned, found) < 1.0 or (doubted and found.score < 0.5)


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_a_square_tube_from_the_side_is_right_or_not_trusted(seed: int) -> None:
    scanned = scan(solid_part(tube(), 4), "edge", views=1, seed=seed)
    found = sympose.estimate(scanned.scene, order=4)
    assert axis_error_deg(scanned, found) < 1.0 or (found.warnings and found.score < 0.5)


def test_two_blades_seen_edge_on_are_ambiguous() -> None:
    blades = box(1.0, 0.12, 0.03) + cylinder(0.1, 0.1, -0.05)
    scanned = scan(solid_part(blades, 2), "edge", views=1, seed=1)
    found = sympose.estimate(scanned.scene, order=2)
    assert found.score < 0.5
    assert any("ambiguous" in warning for warning in found.warnings)


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


def test_an_order_that_a_few_points_tell_is_doubted() -> None:
    # From behind its disc hides the blades.
    scanned = scan(part("impeller_7"), "sphere", views=1, seed=2)
    found = sympose.estimate(scanned.scene.points, viewpoints=scanned.scene.viewpoints)
    assert axis_error_deg(scanned, found) < 0.1
    assert found.order == 7 or found.score < 0.5
    assert any("hardly anything in sight tells" in warning for warning in found.warnings)


@pytest.mark.parametrize("order", [None, 2])
def test_a_half_turn_across_a_part_that_stands_on_its_odd_end_is_doubted(order: int | None) -> None:
    lobes = box(0.5, 0.24, 0.8)
    for side in (-0.25, 0.25):
        lobes += cylinder(0.8, 0.2, -0.4).translate([side, 0.0, 0.0])
    rotor = lobes - cylinder(2.0, 0.07, -1.0) + cylinder(0.1, 0.12, -0.5)
    scanned = scan(solid_part(rotor, 2), "upper", views=2, seed=3)
    found = sympose.estimate(scanned.scene, order=order)
    assert axis_error_deg(scanned, found) < 1.0 or found.score < 0.5
    assert any("another axis" in warning for warning in found.warnings)


def test_a_mug_whose_handle_hardly_shows_is_nearly_round() -> None:
    # A half turn across the mug maps this view to itself, too.
    scanned = scan(part("mug"), "table", views=1, seed=1)
    found = sympose.estimate(scanned.scene)
    assert found.order == "continuous"
    assert axis_error_deg(scanned, found) < 0.1
    assert found.score < 0.5
    assert any("fits a surface of revolution but for" in warning for warning in found.warnings)
    # Nobody declared it.
    assert not any("declared, but" in warning for warning in found.warnings)


def test_a_round_part_is_round_though_returns_are_lost() -> None:
    # Some order of the points that are left holds by chance.
    scanned = scan(part("bowl"), "sphere", views=1, seed=3, dropout=0.1)
    found = sympose.estimate(scanned.scene)
    assert found.order == "continuous"
    assert axis_error_deg(scanned, found) < 0.1
    assert found.score < 0.5
