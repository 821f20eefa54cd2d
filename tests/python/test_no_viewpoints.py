"""What is found where nothing says from where the points were seen, not even their order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sympose
from sympose.datasets import Scan, part, scan


def seen_without_viewpoints(name: str, views: int = 5) -> Scan:
    return shuffled(scan(part(name), "sphere", views=views, seed=1))


def shuffled(scanned: Scan) -> Scan:
    points = np.random.default_rng(0).permutation(scanned.scene.points)
    return replace(scanned, scene=sympose.Scene(points))


def axis_error(scanned: Scan, found: sympose.Estimate) -> float:
    sine = np.linalg.norm(np.cross(found.pose[:3, 2], scanned.world_from_object[:3, 2]))
    return float(np.degrees(np.arcsin(min(1.0, sine))))


@pytest.mark.parametrize("name", ["flange_8", "impeller_5", "wheel_hub_5", "wheel_hub_10", "gear_12"])
def test_an_order_stands_out_although_much_is_hidden(name: str) -> None:
    scanned = seen_without_viewpoints(name)
    found = sympose.estimate(scanned.scene.points)
    assert found.order == part(name).order
    assert axis_error(scanned, found) < 0.05
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


@pytest.mark.parametrize("name", ["propeller_2", "propeller_3", "propeller_5", "impeller_7", "flange_8"])
def test_one_view_tells_the_sides_of_walls_without_its_viewpoint(name: str) -> None:
    scanned = seen_without_viewpoints(name, views=1)
    found = sympose.estimate(scanned.scene.points, order=part(name).order)
    assert found.diagnostics["one_view_assumed"] is True
    assert axis_error(scanned, found) < 0.2
    assert found.score >= 0.5
    # Front and back look alike, so nothing may be told from where the sensor is supposed to have stood.
    assert found.diagnostics["oriented_normals"] is False


def test_the_sides_are_what_it_takes() -> None:
    scanned = seen_without_viewpoints("propeller_3", views=1)
    config = sympose.Config(smoothing={"assume_view": False})
    found = sympose.estimate(scanned.scene.points, order=3, config=config)
    assert "one_view_assumed" not in found.diagnostics
    assert axis_error(scanned, found) > 1.0


@pytest.mark.parametrize("name", ["propeller_3", "wheel_hub_5", "can", "knob_3"])
def test_several_views_are_not_taken_for_one(name: str) -> None:
    scanned = seen_without_viewpoints(name)
    found = sympose.estimate(scanned.scene.points, order=part(name).order)
    assert found.diagnostics["one_view_assumed"] is False


def test_a_surface_of_revolution_that_hides_much_is_weak_evidence() -> None:
    # One view hides so much of the spokes that turns by any angle hold as well as those of the order.
    found = sympose.estimate(seen_without_viewpoints("wheel_hub_10", views=1).scene.points)
    assert found.order == "continuous"
    assert found.score < 0.5
    assert any("would be hidden" in warning for warning in found.warnings)


def test_the_flanks_of_spokes_tell_their_number_where_gaps_do_not() -> None:
    found = sympose.estimate(seen_without_viewpoints("wheel_hub_5", views=1).scene.points)
    assert found.order == 5
    assert found.score > 0.5


@pytest.mark.parametrize("name", ["gear_12", "can"])
def test_an_order_found_in_one_view_from_the_side_is_weak_evidence(name: str) -> None:
    found = sympose.estimate(shuffled(scan(part(name), "edge", views=1, seed=1)).scene.points)
    assert found.diagnostics["one_view_assumed"] is True
    assert found.score < 0.5
    assert any("ambiguous" in warning for warning in found.warnings)


def test_an_axis_found_again_from_a_rough_start_is_no_other_axis() -> None:
    # The hub of the README twice: the second of its candidates ends at the axis of the first.
    points = sympose.read(Path(__file__).parents[2] / "examples/data/hub.ply").points
    found = sympose.estimate(np.concatenate([points, points]), order=5)
    once = sympose.estimate(points, order=5)
    assert np.degrees(np.arccos(min(1.0, abs(found.axis @ once.axis)))) < 0.1
    assert found.score == pytest.approx(once.score, abs=0.05)
    assert not [warning for warning in found.warnings if "another axis" in warning]


@pytest.mark.parametrize("order", [5, "continuous"])
def test_a_piece_of_a_table_is_no_part(order: int | str) -> None:
    random = np.random.default_rng(0)
    across = random.uniform(-1.0, 1.0, (40_000, 2)) * [1.0, 0.6]
    table = np.column_stack([across, random.normal(0.0, 0.001, len(across))])
    found = sympose.estimate(table, order=order)
    assert found.score < 0.5
    assert any("lies in one plane" in warning for warning in found.warnings)
    # A disc maps to itself.
    disc = sympose.estimate(table[np.hypot(table[:, 0], table[:, 1]) < 0.6], order=order)
    assert disc.score > 0.9
