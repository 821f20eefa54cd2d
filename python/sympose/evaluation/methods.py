"""The columns of a table: ways to find the pose, each under a name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import sympose
from sympose.datasets import Scan
from sympose.errors import InvalidInputError
from sympose.evaluation import baselines
from sympose.evaluation.scenario import Scenario, Subject

__all__ = ["METHODS", "Answer", "Method", "applies", "method", "settings_of"]


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method says about a scan.

    Attributes:
        pose: (4, 4) world_from_object: +z along the axis, origin on the axis.
        yaw: How +x was chosen: by the "rule" of the settings, from the true "model", or None: not at all.
        estimate: The whole estimate, of a method of this package.
    """

    pose: NDArray[np.float64]
    yaw: str | None
    estimate: Any = None


class Method(Protocol):
    """Finds the pose of a scanned subject."""

    def __call__(self, subject: Subject, scenario: Scenario, scan: Scan, seed: int) -> Answer: ...


def applies(name: str, subject: Subject) -> bool:
    """Whether a method can work on a part: one without symmetry has neither axis nor an order to tell."""
    return subject.part.order is not None or not _SETTINGS.get(name, {}).get("known_order", True)


def settings_of(name: str) -> dict[str, Any]:
    """The settings in which a method of this package differs from the default; "paper" names a preset.

    Raises:
        KeyError: The method is not of this package.
    """
    return dict(_SETTINGS[name])


def method(name: str) -> Method:
    """Look a method up.

    Raises:
        InvalidInputError: There is none of that name.
    """
    if name not in METHODS:
        raise InvalidInputError(f"there is no method {name!r}; there are {', '.join(METHODS)}")
    return METHODS[name]


def _ours(name: str, subject: Subject, scenario: Scenario, scan: Scan, seed: int) -> Answer:
    del seed  # the default seed of the package, as a user has it
    settings = settings_of(name)
    known, seen = settings.pop("known_order", True), settings.pop("viewpoints", True)
    in_order = settings.pop("in_order", True)
    scene: Any = scan.scene
    if not seen:
        # Read out row by row, they tell where the sensor stood.
        points = scan.scene.points
        scene = points if in_order else np.random.default_rng(0).permutation(points)
    elif not scenario.segmented:
        scene = sympose.Scene(scan.scene.points, viewpoints=scan.scene.viewpoints)
    order = subject.part.order if known else None
    estimate = sympose.estimate(scene, order=order, config=config_of(settings), threads=1)
    return Answer(np.asarray(estimate.pose), "rule", estimate)


def config_of(settings: dict[str, Any]) -> Any:
    """The configuration with these settings changed; None for the default."""
    of_scene = ("preset", "known_order", "viewpoints", "in_order")
    changes = {key: value for key, value in settings.items() if key not in of_scene}
    if settings.get("preset") == "paper":
        return sympose.Config.paper().replace(**changes)
    return sympose.Config(**changes) if changes else None


def _baseline(
    solve: Callable[[Subject, Scan, int], NDArray[np.float64]],
    yaw: str | None,
    subject: Subject,
    scenario: Scenario,
    scan: Scan,
    seed: int,
) -> Answer:
    del scenario
    return Answer(solve(subject, scan, seed), yaw)


_SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "no_joint": {"joint": False},
    "paper": {"preset": "paper"},
    "paper_no_joint": {"preset": "paper", "joint": False},
    "point_to_point": {"residual": "point_to_point"},
    "distribution": {"residual": "distribution"},
    "no_viewpoints": {"viewpoints": False},
    "no_viewpoints_shuffled": {"viewpoints": False, "in_order": False},
    "order_unknown": {"known_order": False},
    "order_unknown_no_viewpoints": {"known_order": False, "viewpoints": False},
    "order_unknown_no_viewpoints_shuffled": {"known_order": False, "viewpoints": False, "in_order": False},
}

METHODS: dict[str, Method] = {
    **{name: partial(_ours, name) for name in _SETTINGS},
    "cad_icp": partial(_baseline, baselines.cad_icp, "model"),
    "cad_icp_point": partial(_baseline, partial(baselines.cad_icp, plane=False), "model"),
    "cad_icp_far": partial(_baseline, partial(baselines.cad_icp, near=False), "model"),
    "cad_icp_point_far": partial(_baseline, partial(baselines.cad_icp, near=False, plane=False), "model"),
    "pca": partial(_baseline, baselines.principal_axes, None),
}
