"""The order in which a depth image is read out tells where the sensor stood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sympose
from sympose.datasets import DEPTH_CAMERA, part, scan


@pytest.mark.parametrize("views", [1, 5])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_viewpoints_of_a_scan_follow_from_its_order(views: int, dtype: type[np.floating]) -> None:
    scene = scan(part("wheel_hub_5"), views=views, seed=2).scene
    assert scene.viewpoints is not None
    found = sympose.viewpoints_from_order(scene.points.astype(dtype))
    assert found is not None
    off = np.linalg.norm(found - scene.viewpoints, axis=1)
    # A few points between two views may be taken for those of the view before.
    assert np.quantile(off, 0.999) < (1e-9 if dtype is np.float64 else 1e-3)


@pytest.mark.parametrize("sigma", [0.0, 0.001, 0.005])
def test_a_pose_is_the_same_as_with_the_viewpoints(sigma: float) -> None:
    scanned = scan(part("propeller_3"), views=5, seed=1, sigma=sigma)
    found = sympose.estimate(scanned.scene.points)
    given = sympose.estimate(scanned.scene.points, viewpoints=scanned.scene.viewpoints)
    assert found.diagnostics["viewpoints_from_order"] is True
    assert given.diagnostics["viewpoints_from_order"] is False
    assert found.diagnostics["oriented_normals"] is True
    assert found.order == given.order == 3
    assert not any("without viewpoints" in warning for warning in found.warnings)
    np.testing.assert_allclose(found.pose, given.pose, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("views", [1, 5])
def test_a_lens_that_bends_the_rows_costs_little(views: int, monkeypatch: pytest.MonkeyPatch) -> None:
    bent = replace(DEPTH_CAMERA, distortion=(-0.2, 0.05))
    monkeypatch.setattr("sympose.datasets.scenarios.DEPTH_CAMERA", bent)
    scene = scan(part("propeller_5"), views=views, seed=1).scene
    found = sympose.viewpoints_from_order(scene.points)
    assert found is not None
    assert len(np.unique(found, axis=0)) == views
    assert np.quantile(np.linalg.norm(found - scene.viewpoints, axis=1), 0.999) < 0.06 * 2.2


def test_missing_returns_of_an_organised_cloud_do_not_matter() -> None:
    scene = scan(part("flange_8"), views=1, seed=1).scene
    rows = np.insert(scene.points, np.arange(0, len(scene.points), 7), np.nan, axis=0)
    found = sympose.estimate(rows, order=8)
    assert found.diagnostics["viewpoints_from_order"] is True


def test_it_can_be_turned_off_and_takes_the_order() -> None:
    points = scan(part("flange_8"), views=5, seed=1).scene.points
    off = sympose.estimate(points, config=sympose.Config(viewpoints_from_order=False))
    lost = sympose.estimate(np.random.default_rng(0).permutation(points))
    for found in (off, lost):
        assert found.diagnostics["viewpoints_from_order"] is False
        assert found.diagnostics["oriented_normals"] is False
        assert found.order == 8
