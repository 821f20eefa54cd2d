"""Viewpoints that are not where the sensors stood, as users give them by mistake: a warning says so."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import sympose
from sympose.datasets import Scan, part, scan

Places = Callable[[Scan], NDArray[np.float64]]

REMARK = "the viewpoints do not fit the points"


def translations_of_inverse_poses(one: Scan) -> NDArray[np.float64]:
    """The t of each world-to-camera pose of COLMAP, which is -R C, where C was asked for."""
    places = np.full_like(one.scene.points, np.nan)
    centers = one.scene.viewpoints
    for view in one.scene.views:
        camera_from_world = np.linalg.inv(view.world_from_camera)
        places[np.all(np.isclose(centers, view.world_from_camera[:3, 3]), axis=1)] = camera_from_world[:3, 3]
    return places


def of_the_next_view(one: Scan) -> NDArray[np.float64]:
    places, view = np.unique(one.scene.viewpoints, axis=0, return_inverse=True)
    return np.asarray(places[(view.ravel() + 1) % len(places)])


def of_the_first_view(one: Scan) -> NDArray[np.float64]:
    return np.asarray(one.scene.viewpoints[0])


def with_y_up(one: Scan) -> NDArray[np.float64]:
    x, y, z = one.scene.viewpoints.T
    return np.stack([x, -z, y], axis=1)


WRONG = [translations_of_inverse_poses, of_the_next_view, of_the_first_view, with_y_up]


def remarks(one: Scan, viewpoints: NDArray[np.float64], **arguments: object) -> str:
    try:
        found = sympose.estimate(one.scene.points, viewpoints=viewpoints, **arguments)  # type: ignore[arg-type]
    except sympose.NoSymmetryError as refusal:
        return str(refusal)
    return "; ".join(found.warnings)


@pytest.mark.parametrize("order", [5, None])
@pytest.mark.parametrize("places", WRONG)
def test_wrong_viewpoints_are_remarked_on(places: Places, order: int | None) -> None:
    one = scan(part("wheel_hub_5"), views=3)
    said = remarks(one, places(one), order=order)
    assert REMARK in said
    # They are the reason, not a sensor that loses returns.
    assert "returns are missing" not in said


@pytest.mark.parametrize("name", ["wheel_hub_5", "propeller_3", "impeller_9", "knob_3"])
@pytest.mark.parametrize(
    ("scenario", "spoilt"),
    [
        ("sphere", {"sigma": 0.005}),
        ("sphere", {"outliers": 0.3}),
        ("sphere", {"dropout": 0.3}),
        ("table", {"sigma": 0.005}),
        ("table", {"clutter": 4}),
    ],
)
def test_right_viewpoints_are_not_doubted(name: str, scenario: str, spoilt: dict[str, float]) -> None:
    one = scan(part(name), scenario, views=3, **spoilt)  # type: ignore[arg-type]
    assert REMARK not in remarks(one, one.scene.viewpoints, order=one.order)
