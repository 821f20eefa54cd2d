"""The suite `exact`: its figures against cases that are worked out by hand, its checks, its cases."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("trimesh")
pytest.importorskip("embreex")

from sympose.evaluation.covariance import is_inside, stated_figures
from sympose.evaluation.exact import EDGE, STRESSED, covariance_table, exact_cases
from sympose.evaluation.exact_checks import check_exact, yaw_spread_deg
from sympose.evaluation.measure import Row
from sympose.evaluation.reference import about_z
from sympose.evaluation.scenario import Scenario, Subject, subject_of
from sympose.evaluation.suites import SUITES
from sympose.evaluation.taught import measure_taught

Floats = NDArray[np.float64]
SPHERE = Scenario("sphere", 5)


def row(part: str, scenario: Scenario, method: str = "order_unknown", seed: int = 1, **figures: Any) -> Row:
    key = f"own | {part} | {scenario.label} | {seed} | {method}"
    named = {"source": "own", "part": part, "family": "wheel_hub", "order": 5, "scenario": scenario.label}
    return {**named, "key": key, "seed": seed, "method": method, "outcome": "ok", **figures}


def one_check(rows: list[Row], what: str, scenario: str = "") -> tuple[bool | None, str]:
    (found,) = [c for c in check_exact(rows) if c.what.startswith(what) and c.scenario.startswith(scenario)]
    return found.passed, found.measured


# ---- covariance ----------------------------------------------------------------------------


def random_pose(seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    pose[:3, 3] = rng.normal(size=3) * 50.0
    return pose


def stated(pose: Floats, covariance: Floats, world_from_true: Floats) -> Any:
    estimate = SimpleNamespace(pose=pose, center=pose[:3, 3], covariance=covariance)
    return stated_figures(estimate, world_from_true[:3, 2], world_from_true[:3, 3], 2.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_region_holds_as_many_axes_as_it_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = np.diag([1e-3, 2e-3, 0.0, 0.1, 0.2, 0.0]) @ rng.normal(size=(6, 6))
    covariance = root @ root.T
    covariance[2, 2] = covariance[5, 5] = np.inf  # yaw and slide are free
    pose, inside, angles = random_pose(seed), 0, []
    for _ in range(2000):
        tilt_x, tilt_y, _, shift_x, shift_y, _ = root @ rng.normal(size=6)
        error = np.eye(4)
        error[:3, :3] = [[1.0, 0.0, tilt_y], [0.0, 1.0, -tilt_x], [-tilt_y, tilt_x, 1.0]]
        error[:3, 3] = [shift_x, shift_y, 0.0]
        # The true frame is turned about the axis, slid along it, and upside down: that is no error.
        other = error @ about_z(rng.uniform(0.0, 6.0)) @ np.diag([1.0, -1.0, -1.0, 1.0])
        other[:3, 3] += 7.0 * error[:3, 2]
        figures = stated(pose, covariance, pose @ other)
        inside += is_inside(figures)
        angles.append(np.degrees(np.hypot(tilt_x, tilt_y)))
    assert inside / 2000 == pytest.approx(0.95, abs=0.02)
    assert figures["stated_deg"] == pytest.approx(np.sqrt(np.mean(np.square(angles))), rel=0.05)
    assert figures["shift"] == pytest.approx(np.hypot(shift_x, shift_y) / 2.0, rel=0.02)


def test_a_free_axis_has_no_region() -> None:
    covariance = np.diag([np.inf, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert stated(np.eye(4), covariance, np.eye(4)) == {}


def test_the_covariance_is_told_by_class_and_without_wrong_answers() -> None:
    figures = {"axis_deg": 0.2, "stated_deg": 0.1, "shift": 3e-4, "stated_shift": 2e-4}
    rows = [
        row("a", SPHERE, axis_chi_sq=9.0, **figures),
        row("b", SPHERE, axis_chi_sq=10.0, **figures),
        row("c", SPHERE, axis_chi_sq=1e6, **(figures | {"axis_deg": 40.0})),
        row("a", EDGE, axis_chi_sq=1.0, **figures),
    ]
    last = covariance_table(rows).splitlines()[-1]
    axis, shift = "2.00 | 0.100 | 0.200", "1.50 | 0.000200 | 0.000300"
    assert last == f"| {SPHERE.label}, own, wheel_hub | 2 | 50 % | {axis} | {shift} |"


# ---- checks --------------------------------------------------------------------------------


def test_the_yaw_spreads_modulo_its_period() -> None:
    def spread(*yaws: float) -> float:
        return yaw_spread_deg([row("a", SPHERE, yaw_deg=yaw) for yaw in yaws])

    assert spread(1.0, 3.0) == pytest.approx(1.0)
    # 36 and -36 degrees are the same direction of a part of order five.
    assert spread(35.0, -35.0) == pytest.approx(1.0)
    assert spread(1.0) == np.inf


def test_an_axis_seen_edge_on_may_be_refused_or_marked_but_not_wrong() -> None:
    def edge(**figures: Any) -> bool | None:
        return one_check([row("a", EDGE, **figures)], "right, refused")[0]

    assert edge(axis_deg=0.5, order_right=True, score=0.9)
    assert edge(axis_deg=40.0, order_right=True, score=0.4)
    assert edge(outcome="refused")
    assert not edge(axis_deg=40.0, order_right=True, score=0.6)
    assert not edge(axis_deg=0.5, order_right=False, score=0.6)
    assert not edge(outcome="error")


def test_a_ratio_is_of_the_scans_that_both_answer() -> None:
    rows = [
        row("a", SPHERE, axis_deg=0.02),
        row("b", SPHERE, axis_deg=80.0),
        row("a", SPHERE, "cad_icp", axis_deg=0.04),
        row("b", SPHERE, "cad_icp", outcome="error"),
    ]
    assert one_check(rows, "axis over that of ICP") == (True, "0.500 (medians 0.500)")


def test_a_scan_without_an_answer_breaks_every_target() -> None:
    lost = [row("a", one, outcome="refused") for one in STRESSED.values()]
    checks = [check for check in check_exact(lost) if "refined" not in check.what]
    assert len(checks) >= 11
    assert not any(check.passed for check in checks)


# ---- what is run ---------------------------------------------------------------------------


def test_the_suites_are_named_by_what_they_are() -> None:
    assert set(SUITES) == {"short", "pose", "exact"}


def test_every_promise_has_its_scans() -> None:
    def only(*names: str) -> Any:
        return lambda subject: subject.part.name in names

    hub = exact_cases("own", [1], [1, 2], only("wheel_hub_5"))
    labels = {case.scenario.label for case in hub}
    assert {one.label for one in STRESSED.values()} | {EDGE.label, "sphere views=8 sigma=1"} <= labels
    assert {case.seed for case in hub if case.scenario == SPHERE} == {1, 2}
    knob = exact_cases("own", [1], [1], only("knob_3"))
    assert STRESSED["warp"] not in {case.scenario for case in knob}


@pytest.fixture(scope="module")
def taught() -> tuple[Subject, Row]:
    subject = subject_of("own", "wheel_hub_5")
    return subject, measure_taught(subject, Scenario("sphere", 3), 1)


def test_a_taught_part_is_found_again(taught: tuple[Subject, Row]) -> None:
    _, figures = taught
    assert figures["outcome"] == "ok", figures
    assert 0.0 < figures["taught_mssd"] < 0.005
