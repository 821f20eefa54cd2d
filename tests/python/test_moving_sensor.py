"""Sensors that move while they scan: a place for every line or point."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import sympose

for library in ("trimesh", "manifold3d", "embreex"):
    pytest.importorskip(library)

from scipy.spatial.transform import Rotation  # noqa: E402

from sympose.datasets import Part, part, scan  # noqa: E402

Floats = NDArray[np.float64]


def off_deg(axis: Floats, truth: Floats) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(axis @ truth)))))


def moved(viewpoints: Floats, way: str) -> Floats:
    """Where the sensor was said to be, 2.2 diameters from the part."""
    rng = np.random.default_rng(1)
    count = len(viewpoints)
    if way == "rounding":
        return viewpoints + rng.normal(0.0, 1e-9, viewpoints.shape)
    if way == "noise":
        return viewpoints + rng.normal(0.0, 0.01, viewpoints.shape)
    direction = np.array([0.48, 0.6, 0.64])
    steps = np.arange(count) * 100 // count / 100 * 0.05 if way == "path" else np.arange(count) % 3 * 0.01
    return viewpoints + steps[:, None] * direction


@pytest.mark.parametrize("way", ["rounding", "noise", "path", "alternating"])
@pytest.mark.parametrize(("name", "views"), [("wheel_hub_5", 1), ("wheel_hub_5", 3), ("flange_8", 3)])
def test_a_place_for_every_point_changes_nothing(name: str, views: int, way: str) -> None:
    scanned = scan(part(name), "sphere", views=views, seed=1)
    points, viewpoints = scanned.scene.points[::2], scanned.scene.viewpoints
    assert viewpoints is not None
    viewpoints = viewpoints[::2]
    exact = sympose.estimate(points, viewpoints=viewpoints)
    found = sympose.estimate(points, viewpoints=moved(viewpoints, way))
    assert found.order == exact.order == part(name).order
    assert found.score == pytest.approx(exact.score, abs=0.05)
    assert off_deg(found.axis, scanned.axis) < 0.1
    assert not any("missing" in warning for warning in found.warnings)


TILTED = Rotation.from_euler("xyz", [25.0, 12.0, 40.0], degrees=True)


def profile(one: Part, lines: int = 300, sides: Rotation | None = None) -> tuple[Floats, Floats, Floats]:
    """Points of a laser line that passes over a part, where the sensor stood, and the axis.

    It passes once for each of the `sides`, which turn the part from how it lies for the first pass.
    """
    places = np.linspace(-0.7, 0.7, lines)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, 1.0]
    angles = np.linspace(-0.6, 0.6, 400)
    fan = np.stack([0.0 * angles, np.sin(angles), -np.cos(angles)], axis=1)
    sources, rays = np.repeat(places, len(fan), axis=0), np.tile(fan, (len(places), 1))
    rng = np.random.default_rng(1)
    all_points, all_places = [], []
    for side in Rotation.identity(1) if sides is None else sides:
        pose = np.eye(4)
        pose[:3, :3] = (side * TILTED).as_matrix()
        mesh = one.mesh.copy()
        mesh.apply_transform(pose)
        points, index, _ = mesh.ray.intersects_location(sources, rays, multiple_hits=False)
        index, points = index[np.argsort(index)], points[np.argsort(index)]
        points += rng.normal(0.0, 0.0005, (len(points), 1)) * rays[index]
        all_points.append(side.inv().apply(points))
        all_places.append(side.inv().apply(sources[index]))
    return np.concatenate(all_points), np.concatenate(all_places), TILTED.apply(one.axis)


THREE_SIDES = Rotation.from_euler("xz", [[0.0, 0.0], [120.0, 70.0], [240.0, 140.0]], degrees=True)


@pytest.mark.parametrize("name", ["propeller_3", "sprocket_6", "gear_12", "wheel_hub_10"])
def test_a_line_profiler_is_as_good_as_a_camera(name: str) -> None:
    points, viewpoints, axis = profile(part(name))
    found = sympose.estimate(points, viewpoints=viewpoints)
    assert found.order == part(name).order
    assert found.score > 0.9
    assert off_deg(found.axis, axis) < 0.02
    assert found.diagnostics["dropout"] == 0.0


@pytest.mark.parametrize("viewpoints", [True, False])
@pytest.mark.parametrize("name", ["wheel_hub_5", "gear_12", "propeller_3", "can"])
def test_lines_may_lie_far_apart(name: str, viewpoints: bool) -> None:
    points, places, axis = profile(part(name), lines=47, sides=THREE_SIDES)
    seen_from = places if viewpoints else None
    found = sympose.estimate(points, viewpoints=seen_from, order=part(name).order)
    assert found.score > 0.7
    assert off_deg(found.axis, axis) < 0.1
    # Lines are 0.03 apart and the points of one 0.003.
    assert 0.006 < found.diagnostics["spacing"] < 0.016
    if name in ("gear_12", "can"):
        assert sympose.estimate(points, viewpoints=seen_from).order == part(name).order


def test_all_that_the_lines_saw_to_be_empty_counts() -> None:
    points, places, axis = profile(part("wheel_hub_10"), sides=THREE_SIDES)
    found = sympose.estimate(points, viewpoints=places)
    assert found.order == 10
    assert off_deg(found.axis, axis) < 0.02
    points, places, _ = profile(part("mug"), sides=THREE_SIDES)
    with pytest.raises(sympose.NoSymmetryError):
        sympose.estimate(points, viewpoints=places)


def test_lines_close_together_lose_no_returns() -> None:
    # A strip of lines is joined to one place, from which its sides seem to cut off what is nearer or farther.
    points, places, axis = profile(part("wheel_hub_5"), lines=1200, sides=THREE_SIDES)
    found = sympose.estimate(points, viewpoints=places)
    assert found.order == 5
    assert off_deg(found.axis, axis) < 0.02
    assert found.diagnostics["dropout"] == 0.0
