"""Several like parts in one scan."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import sympose
from sympose import datasets
from sympose.camera import View
from sympose.datasets import Part, scan


def two_of(name: str, gap: float) -> Part:
    """Two parts beside each other, `gap` apart."""
    part = datasets.part(name)
    aside = np.cross(part.axis, [1.0, 0.0, 0.3])
    aside /= np.linalg.norm(aside)
    other = part.mesh.copy()
    other.apply_translation(aside * (np.ptp(part.mesh.vertices @ aside) + gap))
    both = trimesh.util.concatenate([part.mesh, other])
    return Part("two", part.family, part.order, both, part.axis, part.center)


@pytest.mark.parametrize("views", [2, 5])
@pytest.mark.parametrize("gap", [0.1, 0.4])
def test_an_axis_between_two_like_parts_is_ambiguous(views: int, gap: float) -> None:
    beside = scan(two_of("propeller_2", gap), "sphere", views=views, seed=1)
    found = sympose.estimate(np.asarray(beside.scene.points), viewpoints=beside.scene.viewpoints)
    assert found.order == 2
    assert found.score < 0.5
    assert any("set roi" in warning for warning in found.warnings)
    # One of them alone is no such case.
    alone = scan(datasets.part("propeller_2"), "sphere", views=views, seed=1)
    assert not any("set roi" in warning for warning in sympose.estimate(alone.scene).warnings)


def test_two_parts_far_from_each_other_are_said_to_be() -> None:
    # As a mesh of that size, so that both are in the pictures.
    both = scan(two_of("wheel_hub_5", 0.8).mesh, "alone", views=3, seed=1)
    points, viewpoints = np.asarray(both.scene.points), both.scene.viewpoints
    found = sympose.estimate(points, viewpoints=viewpoints, order=5)
    assert found.score < 0.5
    assert any("set roi to one of them" in warning for warning in found.warnings)
    # The half turn that exchanges them does not hold for their spokes.
    with pytest.raises(sympose.NoSymmetryError, match="set roi to one of them"):
        sympose.estimate(points, viewpoints=viewpoints)


@pytest.mark.parametrize("apart", [1.3, 1.45])
def test_of_two_hubs_on_a_table_one_is_answered_for(apart: float) -> None:
    # The underside of each is out of sight, so that both seem to hover.
    hub = datasets.part("wheel_hub_5")
    meshes = []
    for aside in (-0.5 * apart, 0.5 * apart):
        mesh = hub.mesh.copy()
        mesh.apply_translation([aside, 0.3 * aside, -mesh.bounds[0, 2]])
        meshes.append(mesh)
    table = trimesh.creation.box([12.0, 12.0, 0.1]).apply_translation([0.0, 0.0, -0.05])
    scene = trimesh.util.concatenate([*meshes, table])
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix()
    world_from_camera[:3, 3] = -4.4 * world_from_camera[:3, 2]
    image = datasets.render(scene, View(datasets.DEPTH_CAMERA, world_from_camera), np.random.default_rng(1))
    found = sympose.estimate(image.points(), viewpoints=world_from_camera[:3, 3], order=5)
    assert found.score > 0.8
    assert abs(abs(found.center[0]) - 0.5 * apart) < 0.01
    assert any("another thing" in warning for warning in found.warnings)
