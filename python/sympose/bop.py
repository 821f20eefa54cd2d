"""Files of the BOP benchmark (https://bop.felk.cvut.cz): `models_info.json`, and the CSV file of results.

BOP counts in millimetres. Each object has one model frame: teach it once (`Estimate.as_reference`), write its
`models_info.json` from that estimate, and pose the other scans with `estimate(scan, reference=...)`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose._core import Estimate
from sympose.camera import as_rigid
from sympose.errors import InsufficientDataError, InvalidInputError

__all__ = ["BopResult", "model_info", "write_models_info", "write_results"]

_HEADER = "scene_id,im_id,obj_id,score,R,t,time"
_DIRECTIONS = 2000


@dataclass(frozen=True, eq=False)
class BopResult:
    """An estimate and where it belongs.

    Attributes:
        scene_id, im_id, obj_id: Of the scene, the image and the object, as in the data set.
        estimate: The pose, in the frame of the scan.
        world_from_camera: (4, 4) the camera of the image, in the frame and unit of the scan; None where the
            scan is in the frame of the camera (x to the right, y down, z forward).
        seconds: Time of the whole image, for all its objects; None where it was not taken.
    """

    scene_id: int
    im_id: int
    obj_id: int
    estimate: Estimate
    world_from_camera: ArrayLike | None = None
    seconds: float | None = None


def model_info(estimate: Estimate, *, mm_per_unit: float = 1.0) -> dict[str, Any]:
    """Describe the object of an estimate as an entry of `models_info.json`.

    Args:
        estimate: With its points.
        mm_per_unit: Millimetres in a unit of the cloud: 1000 where it is in metres.

    Returns:
        `diameter`, the largest distance of two points of the completed cloud; `min_x` to `size_z`, its box in
        the object frame; `symmetries_discrete` or `symmetries_continuous`. Lengths in mm.

    Raises:
        InvalidInputError: `mm_per_unit` is not positive.
        InsufficientDataError: The estimate was stored without its points.
    """
    _check(mm_per_unit)
    if len(estimate.completed) == 0:
        raise InsufficientDataError("the estimate has no completed cloud; it was stored without its points")
    points = mm_per_unit * (estimate.completed - estimate.center) @ estimate.pose[:3, :3]
    lower, size = points.min(axis=0), np.ptp(points, axis=0)
    info: dict[str, Any] = {"diameter": _diameter(points)}
    info |= {f"min_{axis}": float(value) for axis, value in zip("xyz", lower, strict=True)}
    info |= {f"size_{axis}": float(value) for axis, value in zip("xyz", size, strict=True)}
    # The axis runs through the origin: a turn about it moves nothing, in millimetres or not.
    return info | {key: value for key, value in estimate.bop_symmetries().items() if value}


def write_models_info(
    path: str | os.PathLike[str], estimates: Mapping[int, Estimate], *, mm_per_unit: float = 1.0
) -> None:
    """Write `models_info.json`.

    Args:
        path: An existing file is replaced.
        estimates: For each obj_id the estimate whose frame is that of the model.
        mm_per_unit: As for `model_info`.

    Raises:
        InvalidInputError, InsufficientDataError: As for `model_info`.

    Example:
        >>> taught = sympose.estimate("first.ply", order=5)  # doctest: +SKIP
        >>> write_models_info("models/models_info.json", {1: taught}, mm_per_unit=1000.0)  # doctest: +SKIP
    """
    models = {
        str(obj_id): model_info(estimates[obj_id], mm_per_unit=mm_per_unit) for obj_id in sorted(estimates)
    }
    Path(path).write_text(json.dumps(models, indent=2) + "\n", encoding="utf-8")


def write_results(
    path: str | os.PathLike[str], results: Iterable[BopResult], *, mm_per_unit: float = 1.0
) -> None:
    """Write poses in the camera as the CSV file that BOP evaluates: METHOD_DATASET-SPLIT.csv.

    Args:
        path: An existing file is replaced.
        results: A row each; `score` is that of the estimate.
        mm_per_unit: Millimetres in a unit of the clouds: 1000 where they are in metres.

    Raises:
        InvalidInputError: `mm_per_unit` is not positive, a `world_from_camera` is no rigid transform, or one
            image has two times.

    Example:
        >>> found = sympose.estimate("scan.ply", reference=taught)  # doctest: +SKIP
        >>> one = BopResult(1, 0, 1, found, world_from_camera, seconds=0.4)  # doctest: +SKIP
        >>> write_results("sympose_parts-test.csv", [one], mm_per_unit=1000.0)  # doctest: +SKIP
    """
    _check(mm_per_unit)
    rows = sorted(results, key=lambda one: (one.scene_id, one.im_id, one.obj_id))
    for one, other in pairwise(rows):
        if (one.scene_id, one.im_id) == (other.scene_id, other.im_id) and one.seconds != other.seconds:
            raise InvalidInputError(
                f"scene {one.scene_id}, image {one.im_id}: {one.seconds} and {other.seconds} seconds; "
                "the time is that of the whole image"
            )
    lines = [_HEADER, *(_line(one, mm_per_unit) for one in rows)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _line(result: BopResult, mm_per_unit: float) -> str:
    pose = result.estimate.pose
    if result.world_from_camera is not None:
        pose = np.linalg.inv(as_rigid(result.world_from_camera, "world_from_camera")) @ pose
    seconds = -1 if result.seconds is None else result.seconds
    ids = (result.scene_id, result.im_id, result.obj_id)
    numbers = _words(pose[:3, :3].ravel()), _words(mm_per_unit * pose[:3, 3])
    return ",".join(map(str, (*ids, result.estimate.score, *numbers, seconds)))


def _words(values: NDArray[np.float64]) -> str:
    return " ".join(map(repr, values.tolist()))


def _check(mm_per_unit: float) -> None:
    if not (0.0 < mm_per_unit < np.inf):
        raise InvalidInputError(f"mm_per_unit = {mm_per_unit}: expected a positive number")


def _diameter(points: NDArray[np.float64]) -> float:
    """Largest distance of two points, among those that lie farthest in one of many directions.

    The two that are sought lie farthest along the line through them, and mostly for some way around it. Where
    that way is narrower than the directions leave free (2.5 degrees), less than 0.1 % is missing.
    """
    k = np.arange(_DIRECTIONS) + 0.5
    height, angle = 1.0 - 2.0 * k / _DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    farthest = points[sorted({int((points @ direction).argmax()) for direction in directions})]
    return float(max(np.linalg.norm(farthest - one, axis=1).max() for one in farthest))
