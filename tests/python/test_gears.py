"""Fine teeth, of which no small order tells anything, and details that fit no order."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

import sympose
from solids import cylinder, solid_part
from sympose.datasets import Part, scan


def gear(teeth: int, *, hub: bool) -> Part:
    """A spur gear of diameter 1 with trapezoidal teeth; with a hub on one side it is not dihedral."""
    step = 2.0 * np.pi / teeth
    outline = [
        (radius * np.cos(angle), radius * np.sin(angle))
        for k in range(teeth)
        for radius, share in (
            (0.5 - 2.2 / teeth, -0.38),
            (0.5, -0.15),
            (0.5, 0.15),
            (0.5 - 2.2 / teeth, 0.38),
        )
        for angle in [(k + share) * step]
    ]
    solid = manifold3d.CrossSection([np.array(outline)]).extrude(0.14) - cylinder(1.0, 0.08, -0.5)
    if hub:
        solid += cylinder(0.12, 0.18, 0.13) - cylinder(1.0, 0.08, -0.5)
    return solid_part(solid, teeth)


def grooved_knob(grooves: int) -> Part:
    """A disk of diameter 0.9 with grooves along its rim, 0.028 wide and half as deep."""
    solid = cylinder(0.3, 0.45, 0.0)
    groove = manifold3d.CrossSection.square((0.02, 0.02), center=True).rotate(45).extrude(0.5)
    for k in range(grooves):
        solid -= groove.translate([0.45, 0.0, -0.1]).rotate([0.0, 0.0, 360.0 * k / grooves])
    return solid_part(solid, grooves)


def plate(*, recess: bool) -> Part:
    """A plate with four holes, and a shallow recess that only one of its ends has."""
    solid = manifold3d.Manifold.cube([0.8, 0.5, 0.12], center=True)
    for x in (-0.3, 0.3):
        for y in (-0.17, 0.17):
            solid -= cylinder(1.0, 0.05, -0.5).translate([x, y, 0.0])
    solid -= manifold3d.Manifold.cube([0.3, 0.2, 0.05], center=True).translate([0.0, 0.0, 0.06])
    if recess:
        solid -= manifold3d.Manifold.cube([0.1, 0.24, 0.06], center=True).translate([0.33, 0.0, 0.06])
    return solid_part(solid, 1 if recess else 2)


@pytest.mark.parametrize(
    ("teeth", "hub", "seed"), [(37, False, 1), (37, False, 2), (31, True, 3), (47, True, 4)]
)
def test_a_gear_has_an_order_of_as_many_as_it_has_teeth(teeth: int, hub: bool, seed: int) -> None:
    scanned = scan(gear(teeth, hub=hub), "sphere", views=5, seed=seed)
    found = sympose.estimate(scanned.scene)
    assert found.order == teeth
    assert abs(found.pose[:3, 2] @ scanned.axis) > np.cos(np.radians(0.05))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_view_of_a_gear_is_right_or_refused_or_doubtful(seed: int) -> None:
    try:
        found = sympose.estimate(scan(gear(43, hub=False), "sphere", views=1, seed=seed).scene)
    except sympose.NoSymmetryError:
        return
    assert found.order == 43 or found.score < 0.5


@pytest.mark.parametrize(("teeth", "seed"), [(12, 2), (15, 3), (20, 1), (24, 2)])
def test_half_turns_about_two_lines_tell_the_axis_of_a_gear_from_the_side(teeth: int, seed: int) -> None:
    # Half turns about lines toward the camera keep all in sight, and score higher than turns about the axis.
    scanned = scan(gear(teeth, hub=False), "edge", views=1, seed=seed)
    found = sympose.estimate(scanned.scene)
    assert found.order == teeth
    assert abs(found.pose[:3, 2] @ scanned.axis) > np.cos(np.radians(0.5))


@pytest.mark.parametrize(("grooves", "views"), [(43, 1), (52, 3), (58, 1)])
def test_grooves_too_narrow_to_see_through_are_counted_by_their_flanks(grooves: int, views: int) -> None:
    found = sympose.estimate(scan(grooved_knob(grooves), "sphere", views=views, seed=1).scene)
    assert found.order == grooves
    assert found.score > 0.9


def test_teeth_too_fine_for_an_order_are_remarked_on() -> None:
    found = sympose.estimate(scan(gear(67, hub=True), "sphere", views=5, seed=1).scene)
    assert found.order == "continuous"
    assert any("details contradict the order (continuous)" in warning for warning in found.warnings)


def test_a_recess_in_one_end_of_a_plate_is_remarked_on() -> None:
    try:
        found = sympose.estimate(scan(plate(recess=True), "sphere", views=5, seed=1).scene)
    except sympose.NoSymmetryError:
        return
    assert any("details contradict the order" in warning for warning in found.warnings)


def test_a_plate_without_a_recess_has_nothing_to_remark_on() -> None:
    found = sympose.estimate(scan(plate(recess=False), "sphere", views=5, seed=1).scene)
    assert found.order == 2
    assert not any("details" in warning for warning in found.warnings)


def test_a_fan_whose_blades_meet_nothing_under_other_turns_is_found() -> None:
    blade = (
        manifold3d.Manifold.cube([0.33, 0.012, 0.22], True)
        .rotate([60.0, 0.0, 0.0])
        .translate([0.315, 0.0, 0.0])
    )
    fan = cylinder(0.2, 0.17, -0.1)
    for k in range(11):
        fan += blade.rotate([0.0, 0.0, 360.0 * k / 11])
    scanned = scan(solid_part(fan, 11), "table", views=3, seed=2)
    found = sympose.estimate(scanned.scene)
    assert found.order == 11
    assert found.score > 0.5
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.1))


def knurled_knob(teeth: int) -> Part:
    """A knob of diameter 1 with a wave of low teeth on its side and a rounded edge."""
    angle = np.linspace(0.0, 2.0 * np.pi, 24 * teeth, endpoint=False)
    radius = 0.486 + 0.014 * np.sin(teeth * angle)
    outline = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    bend = np.linspace(0.0, 0.5 * np.pi, 13)
    edge = np.column_stack([0.458 + 0.042 * np.cos(bend), 0.226 + 0.042 * np.sin(bend)])
    profile = np.vstack([[0.0, 0.0], [0.5, 0.0], edge, [0.0, 0.268]])
    rounded = manifold3d.Manifold.revolve(manifold3d.CrossSection([profile]), 256)
    return solid_part(manifold3d.CrossSection([outline]).extrude(0.268) ^ rounded, teeth)


def toothed_dome(teeth: int) -> Part:
    """A dome with low teeth about its foot."""
    angle = np.linspace(0.0, 0.5 * np.pi, 24)
    rim = np.column_stack([0.45 * np.cos(angle), 0.04 + 0.2 * np.sin(angle)])
    profile = np.vstack([[0.0, 0.0], [0.45, 0.0], rim[:-1], [0.0, 0.24]])
    solid = manifold3d.CrossSection([profile]).revolve(180)
    tooth = manifold3d.Manifold.cube([0.1, 0.36 * np.pi / teeth, 0.06], center=True)
    for k in range(teeth):
        solid += tooth.translate([0.45, 0.0, 0.04]).rotate([0.0, 0.0, 360.0 * k / teeth])
    return solid_part(solid, teeth)


@pytest.mark.parametrize(("teeth", "views", "seed"), [(58, 1, 4), (58, 2, 2), (58, 2, 3)])
def test_orders_that_a_rough_axis_fits_leave_no_doubt(teeth: int, views: int, seed: int) -> None:
    found = sympose.estimate(
        scan(toothed_dome(teeth), "sphere" if views == 1 else "upper", views=views, seed=seed).scene
    )
    assert found.order == teeth
    assert found.score > 0.9


@pytest.mark.parametrize(("teeth", "seed"), [(53, 9), (50, 2)])
def test_few_of_many_teeth_do_not_tell_their_number(teeth: int, seed: int) -> None:
    # They fit another number as well if the axis gives way by a fraction of a tooth.
    found = sympose.estimate(scan(knurled_knob(teeth), "sphere", views=1, seed=seed).scene)
    assert found.score < 0.5
    assert any("to tell the order from" in warning for warning in found.warnings)
