"""What noise does to the points, and what is done about it."""

from __future__ import annotations

import numpy as np
import pytest

import sympose
from sympose.datasets import part, scan
from sympose.evaluation.surface import point_errors


@pytest.mark.parametrize(("sigma", "share"), [(0.001, 0.4), (0.003, 0.65)])
def test_refined_points_are_nearer_to_the_surface(sigma: float, share: float) -> None:
    wheel = part("wheel_hub_5")
    scanned = scan(wheel, "sphere", views=5, seed=1, sigma=sigma)
    smooth = point_errors(wheel, scanned, sympose.estimate(scanned.scene, order=5))
    config = sympose.Config(smoothing={"max_angle": None, "ray_neighbors": 0})
    rough = point_errors(wheel, scanned, sympose.estimate(scanned.scene, order=5, config=config))
    assert smooth is not None and rough is not None
    assert smooth.refined < share * smooth.raw
    assert smooth.refined < 0.85 * rough.refined


@pytest.mark.parametrize("along_rays", [True, False])
def test_points_stay_where_they_were_measured_without_joint_optimisation(along_rays: bool) -> None:
    scanned = scan(part("sprocket_6"), "sphere", views=3, seed=1, sigma=0.005)
    smoothing = {} if along_rays else {"ray_neighbors": 0}
    config = sympose.Config(joint=False, smoothing=smoothing)
    found = sympose.estimate(scanned.scene, order=6, config=config)
    # The noise is met in one of two ways.
    assert found.diagnostics["smoothed_along_rays"] is along_rays
    assert along_rays or found.diagnostics["plane_neighbors"] > 20
    count = np.bincount(found.point_of_inlier, minlength=len(found.points))
    measured = scanned.scene.points[found.inliers]
    sums = [np.bincount(found.point_of_inlier, measured[:, k], len(found.points)) for k in range(3)]
    np.testing.assert_allclose(found.points, np.stack(sums, axis=1) / count[:, None], atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_is_found_in_five_times_the_noise(seed: int) -> None:
    scanned = scan(part("impeller_7"), "sphere", views=5, seed=seed, sigma=0.005)
    found = sympose.estimate(scanned.scene)
    assert found.order == 7
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(0.3))


@pytest.mark.parametrize(
    ("name", "limit_deg"), [("propeller_2", 0.3), ("propeller_3", 0.04), ("impeller_7", 0.02)]
)
def test_blades_as_thin_as_the_noise_do_not_tilt_the_axis(name: str, limit_deg: float) -> None:
    scanned = scan(part(name), "sphere", views=5, seed=1, sigma=0.005)
    found = sympose.estimate(scanned.scene, order=part(name).order)
    assert found.diagnostics["smoothed_along_rays"] is True
    assert abs(found.axis @ scanned.axis) > np.cos(np.radians(limit_deg))
    # Without it each of these axes is farther off.
    config = sympose.Config(smoothing={"ray_neighbors": 0})
    rough = sympose.estimate(scanned.scene, order=part(name).order, config=config)
    assert rough.diagnostics["smoothed_along_rays"] is False
    assert abs(rough.axis @ scanned.axis) < np.cos(np.radians(limit_deg))


def test_little_noise_is_left_to_the_voxels() -> None:
    scanned = scan(part("propeller_3"), "sphere", views=5, seed=1)
    found = sympose.estimate(scanned.scene, order=3)
    assert found.diagnostics["smoothed_along_rays"] is False


@pytest.mark.parametrize("settings", [{}, {"voxel_size": 0.03}])
def test_coarse_voxels_do_not_pass_for_noise(settings: dict[str, float]) -> None:
    # Tracking takes voxels twice as large; over either, a hub with bolts is rougher than noise makes it.
    scanned = scan(part("wheel_hub_6"), "sphere", views=5, seed=1)
    found = sympose.estimate(
        scanned.scene, order=6, initial=scanned.world_from_object, config=sympose.Config(**settings)
    )
    assert found.diagnostics["noise"] > 0.0035
    assert found.diagnostics["ray_noise"] < 0.003
    assert found.diagnostics["smoothed_along_rays"] is False


def test_one_layer_of_points_gives_the_same_pose() -> None:
    scanned = scan(part("wheel_hub_5"), "sphere", views=5, seed=1)
    several = sympose.Config(smoothing={"join_layers": False}, voxel_size=0.006)
    one = sympose.Config(voxel_size=0.006)
    found = {
        name: sympose.estimate(scanned.scene, order=5, config=c)
        for name, c in (("several", several), ("one", one))
    }
    assert len(found["one"].points) < 0.8 * len(found["several"].points)
    for estimate in found.values():
        assert abs(estimate.axis @ scanned.axis) > np.cos(np.radians(0.02))
