"""Points that belong to no surface, and returns that never came."""

from __future__ import annotations

import numpy as np
import pytest

import sympose
from sympose.datasets import part, scan


@pytest.fixture(scope="module")
def scanned() -> sympose.Scene:
    return scan(part("sprocket_6"), "sphere", views=4, seed=3).scene


def test_what_other_views_see_through_is_dropped(scanned: sympose.Scene) -> None:
    viewpoints = np.asarray(scanned.viewpoints)
    center = scanned.points.mean(axis=0)
    # As dense as the surface and next to it, so that neither density nor clusters tell it from the part.
    ball = np.random.default_rng(1).normal(0.0, 0.012, (800, 3))
    strays = np.concatenate(
        [
            center + 0.42 * toward / np.linalg.norm(toward) + ball
            for toward in np.unique(viewpoints, axis=0) - center
        ]
    )
    owners = np.repeat(np.unique(viewpoints, axis=0), len(ball), axis=0)
    found = sympose.estimate(
        np.concatenate([scanned.points, strays]),
        order=6,
        viewpoints=np.concatenate([viewpoints, owners]),
    )
    clean = sympose.estimate(scanned.points, order=6, viewpoints=viewpoints)
    share = np.mean(np.isin(np.arange(len(strays)) + len(scanned.points), found.inliers))
    assert share < 0.3
    assert np.degrees(np.arccos(min(1.0, abs(found.axis @ clean.axis)))) < 0.1


def test_an_ambiguous_answer_has_a_low_score() -> None:
    # The faces of a cube: three axes of order 4.
    side = np.linspace(-0.5, 0.5, 40)
    u, v = (grid.ravel() for grid in np.meshgrid(side, side))
    half = np.full_like(u, 0.5)
    faces = [
        np.roll(np.stack([u, v, sign * half], axis=1), turn, axis=1) for turn in range(3) for sign in (1, -1)
    ]
    points = np.concatenate(faces)
    normals = np.concatenate(
        [
            np.roll(np.tile([0.0, 0.0, sign], (len(u), 1)), turn, axis=1)
            for turn in range(3)
            for sign in (1, -1)
        ]
    )
    found = sympose.estimate(points, order=4, normals=normals)
    assert any("ambiguous" in warning for warning in found.warnings)
    assert found.score <= 0.5


def test_lost_returns_are_told() -> None:
    scene = scan(part("sprocket_6"), "sphere", views=5, seed=1, dropout=0.3).scene
    found = sympose.estimate(scene.points, viewpoints=scene.viewpoints)
    assert any("returns are missing" in warning for warning in found.warnings)
