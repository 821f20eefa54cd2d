"""Scans that were thinned before: a view of a few hundred points still shows the gaps of a part."""

from __future__ import annotations

import numpy as np
import pytest

import sympose

for library in ("trimesh", "manifold3d", "embreex"):
    pytest.importorskip(library)

from sympose.datasets import part, scan  # noqa: E402


def thinned(name: str, *, views: int = 5, count: int = 1500) -> tuple[sympose.Estimate, float]:
    """What is found in some points of a scan, and how far the axis is off, in degrees."""
    scanned = scan(part(name), "sphere", views=views, seed=1)
    chosen = np.random.default_rng(1).permutation(len(scanned.scene))[:count]
    viewpoints = scanned.scene.viewpoints
    assert viewpoints is not None
    found = sympose.estimate(scanned.scene.points[chosen], viewpoints=viewpoints[chosen])
    return found, float(np.degrees(np.arccos(min(1.0, abs(found.axis @ scanned.axis)))))


@pytest.mark.parametrize("name", ["wheel_hub_5", "propeller_4", "can"])
def test_1500_points_of_five_views_show_the_order(name: str) -> None:
    found, off_deg = thinned(name)
    assert found.order == part(name).order
    assert off_deg < 0.5


@pytest.mark.parametrize("name", ["flange_8", "wheel_hub_6", "bowl"])
def test_means_of_voxels_of_one_view_show_the_order(name: str) -> None:
    scanned = scan(part(name), "sphere", views=1, seed=1)
    points = sympose.voxel_downsample(scanned.scene.points, 0.02)
    assert len(points) < 5000
    found = sympose.estimate(points, viewpoints=scanned.scene.views[0].center)
    assert found.order == part(name).order
    assert np.degrees(np.arccos(min(1.0, abs(found.axis @ scanned.axis)))) < 0.5


def test_few_points_called_round_are_said_to_hide_details() -> None:
    found, _ = thinned("can")
    assert found.order == "continuous"
    assert any("so few points hardly show" in warning for warning in found.warnings)


def test_an_ordinary_scan_called_round_shows_details() -> None:
    found, _ = thinned("can", views=3, count=50_000)
    assert found.order == "continuous"
    assert not found.warnings


def test_what_lies_between_clumps_of_points_is_not_lost() -> None:
    # Points that were matched between pictures are dense on texture and sparse beside it.
    scanned = scan(part("pulley"), "sphere", views=8, seed=1)
    rng = np.random.default_rng(1)
    chosen = []
    for view in range(8):
        rows = np.flatnonzero(scanned.view_of_point == view)
        phases = scanned.scene.points[rows] @ rng.normal(0.0, 40.0, (3, 12))
        waves = np.cos(phases + rng.uniform(0.0, 2.0 * np.pi, 12))
        texture = np.exp(2.0 * waves.sum(axis=1) / np.sqrt(6.0))
        chosen.append(rng.choice(rows, 400, replace=False, p=texture / texture.sum()))
    viewpoints = scanned.scene.viewpoints
    assert viewpoints is not None
    index = np.concatenate(chosen)
    found = sympose.estimate(scanned.scene.points[index], viewpoints=viewpoints[index], order="continuous")
    assert np.degrees(np.arccos(min(1.0, abs(found.axis @ scanned.axis)))) < 0.5
    assert found.diagnostics["dropout"] == 0.0
