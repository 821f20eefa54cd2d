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


def profile(one: Part) -> tuple[Floats, Floats, Floats]:
    """Points of a laser line that passes over a part, where the sensor stood, and the axis."""
    mesh = one.mesh.copy()
    turn = Rotation.from_euler("xyz", [25.0, 12.0, 40.0], degrees=True).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = turn
    mesh.apply_transform(pose)
    places = np.linspace(-0.7, 0.7, 300)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, 1.0]
    angles = np.linspace(-0.6, 0.6, 400)
    fan = np.stack([0.0 * angles, np.sin(angles), -np.cos(angles)], axis=1)
    sources, rays = np.repeat(places, len(fan), axis=0), np.tile(fan, (len(places), 1))
    points, index, _ = mesh.ray.intersects_location(sources, rays, multiple_hits=False)
    index, points = index[np.argsort(index)], points[np.argsort(index)]
    noise = np.random.default_rng(1).normal(0.0, 0.0005, (len(points), 1))
    return points + noise * rays[index], sources[index], turn @ one.axis


@pytest.mark.parametrize("name", ["propeller_3", "sprocket_6", "gear_12", "wheel_hub_10"])
def test_a_line_profiler_is_as_good_as_a_camera(name: str) -> None:
    points, viewpoints, axis = profile(part(name))
    found = sympose.estimate(points, viewpoints=viewpoints)
    assert found.order == part(name).order
    assert found.score > 0.9
    assert off_deg(found.axis, axis) < 0.02
    assert found.diagnostics["dropout"] == 0.0
