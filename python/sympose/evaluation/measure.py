"""One scan, one method: one row of figures."""

from __future__ import annotations

import time
from dataclasses import asdict
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

import sympose
from sympose.datasets import Part, Scan
from sympose.errors import NoSymmetryError, SymposeError
from sympose.evaluation import methods
from sympose.evaluation.bound import adds_of_bound, noise_bound
from sympose.evaluation.covariance import stated_figures
from sympose.evaluation.metrics import axis_angle_deg, pose_errors
from sympose.evaluation.reference import reference_of
from sympose.evaluation.scenario import SIGMA, Scenario, Subject
from sympose.evaluation.surface import point_errors

__all__ = ["Row", "failed", "identity", "key_of", "measure"]

Row: TypeAlias = dict[str, Any]
"""Names of figures and their values, all fit for JSON; a figure that does not apply is missing.

source, part, family, order, scenario, seed, method: what was measured.
outcome: "ok", "refused" (a `SymposeError`) or "error" (anything else), then with `message`.
seconds, cpu_seconds: of the method alone, by the clock and of the processors. points: of the scan.
The fields of `PoseErrors`; bound_deg, bound_offset, adds_bound; axis_over_bound, offset_over_bound.
order_found, order_right, score, explained, warnings, start_deg (axis before the refinement): of methods of
this package; with those of `stated_figures`.
raw_error, voxel_error, refined_error and the histograms: distances to the true surface.
kept_precision, kept_recall, has_ground: of scenarios that are segmented; kept: share of the points kept.
"""


def key_of(source: str, part: str, scenario: str, seed: int, method: str) -> str:
    """What names a row."""
    return f"{source} | {part} | {scenario} | {seed} | {method}"


def measure(subject: Subject, scenario: Scenario, scan: Scan, seed: int, name: str) -> Row:
    """Run a method on a scan of `subject` and judge its answer.

    Nothing that the method raises is let through: it becomes the outcome.
    """
    part = subject.part
    row: Row = identity(subject, scenario, seed, name)
    row["points"] = len(scan.scene)
    solve = methods.method(name)
    start, busy = time.perf_counter(), time.process_time()
    try:
        answer = solve(subject, scenario, scan, seed)
    except SymposeError as error:
        right = isinstance(error, NoSymmetryError) and None in subject.orders
        return {
            **row,
            **_outcome("refused", error),
            "order_right": right,
            "seconds": time.perf_counter() - start,
        }
    except Exception as error:  # a failure is a result, too
        return {**row, **_outcome("error", error), "seconds": time.perf_counter() - start}
    row |= {"seconds": time.perf_counter() - start, "cpu_seconds": time.process_time() - busy}
    row["outcome"] = "ok"
    try:
        row |= _judge(subject, scenario, scan, name, answer)
    except Exception as error:  # an answer that cannot be judged is wrong
        return {**row, **_outcome("error", error)}
    if scenario.sigma > 0.0 and isinstance(part.order, int):
        row |= _bound(part, scenario, scan, row)
    return row


def failed(subject: Subject, scenario: Scenario, seed: int, name: str, error: BaseException) -> Row:
    """The row of a case that could not even be tried."""
    return {**identity(subject, scenario, seed, name), **_outcome("error", error)}


def identity(subject: Subject, scenario: Scenario, seed: int, name: str) -> Row:
    """What every row begins with: which scan of which part, and the method."""
    part = subject.part
    return {
        "key": key_of(subject.source, part.name, scenario.label, seed, name),
        "source": subject.source,
        "part": part.name,
        "family": part.family,
        "order": part.order,
        "scenario": scenario.label,
        "seed": seed,
        "method": name,
    }


def _outcome(kind: str, error: BaseException) -> Row:
    return {"outcome": kind, "message": f"{type(error).__name__}: {error}"}


def _judge(subject: Subject, scenario: Scenario, scan: Scan, name: str, answer: methods.Answer) -> Row:
    part = subject.part
    row: Row = {}
    if part.order is not None:
        reference = reference_of(part)
        truth = scan.world_from_object @ reference.mesh_from_object
        truth[:3, 3] = scan.center
        yaw = (
            {"model": 0.0, None: None}.get(answer.yaw)
            if answer.yaw != "rule"
            else _true_yaw(part, _frozen(name))
        )
        errors = pose_errors(reference, truth, answer.pose, diameter=scan.diameter, yaw=yaw)
        row |= {key: value for key, value in asdict(errors).items() if value is not None}
    estimate = answer.estimate
    if estimate is None:
        return row
    row["order_found"] = estimate.order
    row["order_right"] = estimate.order in subject.orders
    if estimate.candidates and part.order is not None:
        # The best of the search, from which the refinement starts.
        row["start_deg"] = axis_angle_deg(np.asarray(estimate.candidates[0].axis), scan.axis)
    if part.order is not None:
        row |= stated_figures(estimate, scan.axis, scan.center, scan.diameter)
    row["score"], row["explained"] = float(estimate.score), float(estimate.explained)
    if estimate.warnings:
        row["warnings"] = list(estimate.warnings)
    row["kept"] = len(estimate.inliers) / max(len(scan.scene), 1)
    row["has_ground"] = estimate.ground is not None
    if scenario.place == "table":
        row |= _kept(part, scan, estimate)
    if scenario.warp == 0.0 or part.family == "wheel_hub":
        found = point_errors(part, scan, estimate)
        if found is not None:
            row |= {
                "raw_error": found.raw,
                "voxel_error": found.voxel,
                "refined_error": found.refined,
                "histogram_voxel": list(found.histogram_voxel),
                "histogram_refined": list(found.histogram_refined),
            }
    return row


def _kept(part: Part, scan: Scan, estimate: Any) -> Row:
    """Which share of the points kept belongs to the part, and which share of the part is kept.

    Of the part only what rises more than two voxels above the table counts: the rest is one with the table.
    """
    inliers = np.asarray(estimate.inliers)
    label = scan.label_of_point
    pose = scan.world_from_object
    voxel = dict(estimate.diagnostics).get("voxel_size", 0.01 * scan.diameter) / scan.diameter
    height = (scan.scene.points - pose[:3, 3]) @ pose[:3, 2] / scan.scale - part.mesh.bounds[0, 2]
    wanted = (label == 0) & (height > 2.0 * voxel)
    kept = np.zeros(len(label), dtype=bool)
    kept[inliers] = True
    return {
        "kept_precision": float((label[inliers] == 0).mean()) if len(inliers) else 0.0,
        "kept_recall": float(kept[wanted].mean()) if wanted.any() else 1.0,
    }


def _bound(part: Part, scenario: Scenario, scan: Scan, row: Row) -> Row:
    try:
        bound = noise_bound(part, scan, scenario.sigma * SIGMA)
    except ValueError:
        return {}
    figures = {
        "bound_deg": bound.axis_deg,
        "bound_offset": bound.offset,
        "adds_bound": adds_of_bound(reference_of(part), bound),
    }
    if "axis_deg" in row:
        figures["axis_over_bound"] = row["axis_deg"] / bound.axis_deg
        figures["offset_over_bound"] = row["offset"] / bound.offset
    return figures


def _frozen(name: str) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(methods.settings_of(name).items()))


@lru_cache(maxsize=256)
def _true_yaw(part: Part, settings: tuple[tuple[str, Any], ...]) -> float | None:
    """Angle [rad] of the direction that the rule of these settings chooses on the noise-free surface."""
    if not isinstance(part.order, int):
        return None
    reference = reference_of(part)
    try:
        estimate = sympose.estimate(
            reference.points,
            order=part.order,
            normals=reference.normals,
            axis_hint=[0.0, 0.0, 1.0],
            config=methods.config_of(dict(settings)),
            threads=1,
        )
    except SymposeError:
        return None
    x = np.asarray(estimate.pose)[:3, 0]
    return float(np.arctan2(x[1], x[0]))
