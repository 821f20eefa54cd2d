"""Bolt holes that cover little of their disc decide the order all the same."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

import sympose
from solids import cylinder, solid_part
from sympose import datasets
from sympose.datasets import Part, Scan, scan

#: Radius of a bolt hole [diameters of the disc].
RADIUS = 0.024


def drilled(solid: manifold3d.Manifold, holes: int, distance: float) -> Part:
    """A solid of revolution with small holes around its axis."""
    for k in range(holes):
        hole = cylinder(1.0, RADIUS, -0.3).translate([distance, 0.0, 0.0])
        solid -= hole.rotate([0.0, 0.0, 360.0 * k / holes])
    return solid_part(solid, holes or "continuous")


def disc(holes: int) -> Part:
    """A hat-shaped disc of diameter 1."""
    solid = cylinder(0.06, 0.5, 0.0) + cylinder(0.12, 0.25, 0.05) - cylinder(1.0, 0.1, -0.3)
    return drilled(solid - cylinder(0.1, 0.2, -0.04), holes, 0.16)


def flange(holes: int) -> Part:
    """A thick flange on a tube, of diameter 1, so that few cameras look through its holes."""
    return drilled(
        cylinder(0.08, 0.5, 0.0) + cylinder(0.15, 0.2, 0.08) - cylinder(1.0, 0.1, -0.1), holes, 0.4
    )


@pytest.mark.parametrize("holes", [4, 5, 6])
def test_bolt_holes_give_a_disc_its_order(holes: int) -> None:
    found = sympose.estimate(scan(disc(holes), "sphere", views=5, seed=1).scene)
    assert found.order == holes
    assert any("without them it would be continuous" in warning for warning in found.warnings)


@pytest.mark.parametrize("declared", [4, 6, 8, 12])
def test_a_declared_order_that_small_holes_contradict_is_warned_of(declared: int) -> None:
    found = sympose.estimate(scan(disc(4), "sphere", views=5, seed=1).scene, order=declared)
    assert any("was declared" in warning for warning in found.warnings) == (declared != 4)


@pytest.mark.parametrize("seed", [1, 2])
def test_bolt_holes_give_a_flange_its_order(seed: int) -> None:
    assert sympose.estimate(scan(flange(6), "sphere", views=5, seed=seed).scene).order == 6


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_table_beyond_the_picture_of_a_camera_is_no_lost_return(seed: int) -> None:
    found = sympose.estimate(scan(flange(6), "table", views=5, seed=seed).scene)
    assert found.diagnostics["dropout"] == 0.0
    assert found.order == 6


@pytest.mark.parametrize(("part", "order"), [(disc(5), 5), (flange(6), 6)])
def test_bolt_holes_decide_in_one_view_of_the_face(part: Part, order: int) -> None:
    assert sympose.estimate(scan(part, "upper", views=1, seed=4).scene).order == order


@pytest.mark.parametrize("part", [disc(0), flange(0)])
@pytest.mark.parametrize("views", [1, 5])
def test_without_holes_it_is_a_surface_of_revolution(part: Part, views: int) -> None:
    assert sympose.estimate(scan(part, "sphere", views=views, seed=1).scene).order == "continuous"


def keyed(solid: manifold3d.Manifold, radius: float, height: float, width: float) -> Part:
    """A solid with a keyway at some radius, from some height up, which no turn maps to itself."""
    keyway = manifold3d.Manifold.cube([0.14, width, 0.3]).translate([radius - 0.04, -0.5 * width, height])
    return solid_part(solid - keyway, None)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("views", [2, 5])
def test_a_keyway_is_said_to_have_no_part_in_the_order_of_the_rest(views: int, seed: int) -> None:
    solid = cylinder(0.08, 0.5, 0.0) + cylinder(0.2, 0.24, 0.08) - cylinder(1.0, 0.14, -0.1)
    for k in range(6):
        solid -= cylinder(1.0, 0.05, -0.1).translate([0.38, 0.0, 0.0]).rotate([0.0, 0.0, 60.0 * k])
    found = sympose.estimate(scan(keyed(solid, 0.14, -0.01, 0.07), "upper", views=views, seed=seed).scene)
    assert found.order == 6
    assert any("details contradict the order (6)" in warning for warning in found.warnings)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_order_that_a_shaft_has_by_chance_about_its_keyway_is_not_trusted(seed: int) -> None:
    shaft = cylinder(0.55, 0.2, 0.0) + cylinder(0.4, 0.1, 0.55)
    found = sympose.estimate(scan(keyed(shaft, 0.2, 0.1, 0.1), "table", seed=seed).scene, views=())
    assert found.score < 0.5
    assert any("hardly anything in sight" in warning for warning in found.warnings)


def slotted(slots: int) -> Part:
    """A stepped disc with narrow slots in its rim: nothing but them tells one angle from another."""
    solid = cylinder(0.06, 0.5, 0.0) + cylinder(0.14, 0.34, 0.0)
    slot = manifold3d.Manifold.cube([0.16, 0.04, 1.0], True).translate([0.5, 0.0, 0.0])
    for k in range(slots):
        solid -= slot.rotate([0.0, 0.0, 360.0 * k / slots])
    return solid_part(solid, slots)


@pytest.mark.parametrize(("slots", "seed"), [(14, 3), (14, 5), (16, 4), (18, 2), (18, 5)])
def test_narrow_slots_that_two_views_show_leave_no_doubt(slots: int, seed: int) -> None:
    # Half-way the rim mostly meets the rim, and about small orders hardly anything comes into a slot.
    found = sympose.estimate(scan(slotted(slots), "upper", views=2, seed=seed).scene)
    assert found.order == slots
    assert found.score > 0.9
    assert not any("ambiguous" in warning for warning in found.warnings)


def toothed_and_slotted(teeth: int, slots: int, width: float) -> Part:
    """A wheel with teeth on its rim and narrow slots in its web."""
    solid = cylinder(0.08, 0.42, 0.0) + cylinder(0.2, 0.15, 0.0) - cylinder(1.0, 0.06, -0.3)
    tooth = manifold3d.Manifold.cube([0.16, 0.05, 0.06], True).translate([0.45, 0.0, 0.03])
    slot = manifold3d.Manifold.cube([0.2, width, 1.0], True).translate([0.28, 0.0, 0.0])
    for k in range(teeth):
        solid += tooth.rotate([0.0, 0.0, 360.0 * k / teeth])
    for k in range(slots):
        solid -= slot.rotate([0.0, 0.0, 360.0 * k / slots])
    return solid_part(solid, int(np.gcd(teeth, slots)))


@pytest.mark.parametrize(
    ("teeth", "slots", "scenario", "views", "seed", "dropout"),
    [(22, 11, "upper", 2, 1, 0.0), (12, 4, "upper", 2, 2, 0.0), (10, 5, "sphere", 3, 1, 0.0)]
    + [(22, 11, "sphere", 3, 4, 0.0), (22, 11, "sphere", 5, 1, 0.3)],
)
def test_slots_too_narrow_to_see_through_decide_beside_more_teeth(
    teeth: int, slots: int, scenario: str, views: int, seed: int, dropout: float
) -> None:
    part = toothed_and_slotted(teeth, slots, width=0.02)
    found = sympose.estimate(scan(part, scenario, views=views, seed=seed, dropout=dropout).scene)
    assert found.order == slots
    assert any(f"without them it would be {teeth}" in warning for warning in found.warnings)


@pytest.mark.parametrize("order", [10, 12])
@pytest.mark.parametrize(("scenario", "views"), [("upper", 2), ("sphere", 3)])
def test_slots_between_as_many_teeth_have_their_order(order: int, scenario: str, views: int) -> None:
    part = toothed_and_slotted(order, order, width=0.02)
    found = sympose.estimate(scan(part, scenario, views=views, seed=1).scene)
    assert found.order == order
    assert not any("details" in warning for warning in found.warnings)


def test_an_order_that_pockets_have_by_chance_is_not_trusted() -> None:
    # Over the wall of a deep cup so little of the pockets shows that nothing contradicts a quarter turn.
    cup = cylinder(0.5, 0.4, 0.0) - cylinder(0.5, 0.35, 0.08)
    for k in range(3):
        cup -= cylinder(0.2, 0.07, 0.04).translate([0.22, 0.0, 0.0]).rotate([0.0, 0.0, 120.0 * k])
    found = sympose.estimate(scan(solid_part(cup, 3), "sphere", views=5, seed=6).scene)
    assert found.order == 3 or found.score < 0.5


@pytest.mark.parametrize("name", ["knob_3", "impeller_7", "wheel_hub_6", "sprocket_6", "gear_12"])
@pytest.mark.parametrize("views", [2, 5])
def test_noise_and_edges_are_not_taken_for_details(name: str, views: int) -> None:
    part = datasets.part(name)
    found = sympose.estimate(scan(part, "sphere", views=views, seed=2).scene)
    assert found.order == part.order
    assert not any("details" in warning for warning in found.warnings)


def oval_bottle(width: float, depth: float, height: float) -> Part:
    """Without its neck it would turn about any of three axes."""
    body = cylinder(height, 0.5, 0.0).scale([width, depth, 1.0])
    return solid_part((body + cylinder(0.15, 0.08, height - 0.001)).scale([1.06] * 3), 2)


def degrees_off(found: sympose.Estimate, scanned: Scan) -> float:
    return float(np.degrees(np.arcsin(np.linalg.norm(np.cross(found.axis, scanned.axis)))))


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("size", [(0.5, 0.3, 0.75), (0.6, 0.35, 0.7)])
def test_nothing_of_a_part_lies_below_what_it_stands_on(size: tuple[float, float, float], seed: int) -> None:
    scanned = scan(oval_bottle(*size), "table", views=5, seed=seed)
    assert degrees_off(sympose.estimate(scanned.scene, order=2, views=()), scanned) < 0.1


def test_where_the_whole_picture_is_known_an_axis_that_leads_out_of_the_part_is_refused() -> None:
    # A gear from the side: half turns about other axes bring its rim to where no return came from.
    scanned = scan(datasets.part("gear_12"), "edge", views=1, seed=1)
    assert degrees_off(sympose.estimate(scanned.scene, views=()), scanned) < 0.1


def test_a_refusal_says_how_well_the_best_axis_matches() -> None:
    # A hat with one hole beside its axis: round but for that.
    scanned = scan(
        drilled(cylinder(0.4, 0.5, 0.0) - cylinder(1.0, 0.2, 0.1).translate([0.25, 0.0, 0.0]), 0, 0.0),
        "sphere",
        seed=1,
    )
    with pytest.raises(sympose.NoSymmetryError) as refusal:
        sympose.estimate(scanned.scene)
    evidence = refusal.value.evidence
    assert 0.1 < evidence["score"] < 1.0
    assert 0.1 < evidence["explained"] < 1.0


def plate_with_a_pin(width: float) -> Part:
    """A plate that half turns would map to itself but for a pin on one of its sides."""
    plate = manifold3d.Manifold.cube([0.85, 0.5, 0.08], True)
    return solid_part(plate + cylinder(0.2, width, 0.03).translate([0.25, 0.12, 0.0]), None)


@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.parametrize(("width", "views"), [(0.04, 3), (0.05, 5)])
def test_a_half_turn_that_maps_all_but_a_pin_is_no_symmetry(width: float, views: int, seed: int) -> None:
    scanned = scan(plate_with_a_pin(width), "sphere", views=views, seed=seed)
    with pytest.raises(sympose.NoSymmetryError, match="declare order 2 if the part has it but for these"):
        sympose.estimate(scanned.scene)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_half_turn_that_maps_all_but_a_pin_is_answered_where_it_is_declared(seed: int) -> None:
    found = sympose.estimate(scan(plate_with_a_pin(0.03), "sphere", views=5, seed=seed).scene, order=2)
    assert found.order == 2
    assert found.explained > 0.9
