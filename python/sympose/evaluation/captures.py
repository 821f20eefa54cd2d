"""Captured scenes as a manifest describes them: what `estimate` is given, and what is known of the axis."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sympose.camera import PinholeCamera
from sympose.errors import InvalidInputError
from sympose.io import read, read_colmap
from sympose.scene import Scene

__all__ = ["Capture", "KnownAxis", "read_captures"]

_MARGIN = 0.03  # metres around an object, so that its surroundings are in the region, too
_FEWEST = 1000  # points of a labelled object
_MUG_DEPTH = 1.05  # metres; behind is the wall

# Objects in depth images: left, top, right, bottom [pixel], and how far they reach back from their front [m].
_BOXES: dict[str, dict[str, tuple[int, int, int, int, float]]] = {
    "000002-depth.png": {
        "coffee can": (305, 155, 410, 320, 0.12),
        "soup can, lying": (385, 255, 497, 355, 0.12),
        "mug, behind": (497, 20, 588, 128, 0.12),
    },
    "000004-depth.png": {
        "pitcher": (255, 85, 455, 335, 0.16),
        "tuna can": (228, 328, 322, 418, 0.10),
        "mustard bottle": (340, 245, 440, 445, 0.10),
    },
}

# Round objects on the table of the fused scene: where they stand, and a radius that holds them [metres].
_ROUND = {
    "bowl with toys": (0.1305, 0.1216, 0.9122, 0.15),
    "can": (0.1961, 0.0198, 1.0481, 0.045),
    "noodle cup": (0.3057, -0.0767, 1.1777, 0.085),
}


@dataclass(frozen=True, eq=False)
class KnownAxis:
    """An axis fitted to a captured object; about 1 degree and 1 to 3 mm, no surveyed truth.

    Attributes:
        direction: (3,) unit.
        point: (3,) on the axis, about the middle of the object.
        radius: Of the object, in the unit of the scene.
    """

    direction: NDArray[np.float64]
    point: NDArray[np.float64]
    radius: float


@dataclass(frozen=True, eq=False)
class Capture:
    """One object of a captured scene, and how it is handed over.

    Attributes:
        name: Scene and object.
        how: "object" points alone, "region" of the scene, or the "whole" scene.
        scene: Points, viewpoints, perhaps views.
        order: "continuous", or None for a part without symmetry.
        roi: (2, 3) or None.
        known: The axis, where it was fitted.
        what: The scene in words.
    """

    name: str
    how: str
    scene: Scene
    order: str | None
    roi: NDArray[np.float64] | None = None
    known: KnownAxis | None = None
    what: str = ""


def read_captures(folder: str | Path) -> Iterator[Capture]:
    """Go through `manifest.json` in a folder of captured scenes.

    Raises:
        FileNotFoundError: There is no manifest, or a file is missing.
        InvalidInputError: The manifest is not as expected, or a file cannot be read.
    """
    place = Path(folder)
    try:
        manifest = json.loads((place / "manifest.json").read_text(encoding="utf-8"))
        items, axes = manifest["items"], manifest["estimated_axes"]
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise InvalidInputError(f"{place / 'manifest.json'} describes no captured scenes: {error}") from error
    for item in items:
        path = place / item["path"]
        order = "continuous" if item["object_order"] == 0 else None
        for capture in _captures(path, item["path"], axes, order):
            yield replace(capture, what=item["what"])


def _captures(path: Path, name: str, axes: dict[str, Any], order: str | None) -> Iterator[Capture]:
    family = name.split("/")[0]
    known = _known(axes.get(name.removesuffix(".npz")))
    if family.startswith("colmap"):
        yield Capture(name, "whole", read_colmap(path), order, known=known)
    elif family == "graspnet6dof":
        yield from _single_view(path, name, order, known)
    elif family == "mosd":
        yield from _labelled(path, name, axes)
    elif family == "posecnn":
        yield from _boxes(path, name)
    elif family == "symseg":
        yield from _fused(path)
    elif family == "pcl":
        points = _finite(read(path).points)
        near = points[points[:, 2] < _MUG_DEPTH]
        roi = np.stack([near.min(axis=0), near.max(axis=0)])
        scene = Scene(points, viewpoints=[0.0, 0.0, 0.0])
        yield Capture(name, "region", scene, order, roi, known)
    else:
        yield Capture(name, "object", Scene(_finite(read(path).points)), order, known=known)


def _single_view(path: Path, name: str, order: str | None, known: KnownAxis | None) -> Iterator[Capture]:
    with np.load(path) as data:
        depth, k, points = data["depth_m"], data["K"], data["object_points"]
    height, width = depth.shape
    camera = PinholeCamera(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    yield Capture(name, "object", Scene(points, viewpoints=[0.0, 0.0, 0.0]), order, known=known)
    yield Capture(name, "whole", Scene.from_depth(depth, camera), order, known=known)


def _labelled(path: Path, name: str, axes: dict[str, Any]) -> Iterator[Capture]:
    """Each labelled object alone, and the region around it; label 1 is the table."""
    from pypcd4.pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    points = cloud.numpy(("x", "y", "z")).astype(np.float64)
    label = cloud.numpy(("label",)).ravel().astype(int)
    valid = np.isfinite(points).all(axis=1)
    points, label = points[valid], label[valid]
    whole = Scene(points, viewpoints=[0.0, 0.0, 0.0])
    for number in np.unique(label[label > 1]):
        own = points[label == number]
        if len(own) < _FEWEST:
            continue
        key = f"{name}#label={number}"
        known, roi = _known(axes.get(key)), _around(own)
        yield Capture(key, "object", Scene(own, viewpoints=[0.0, 0.0, 0.0]), "continuous", known=known)
        yield Capture(key, "region", whole, "continuous", roi, known)


def _boxes(path: Path, name: str) -> Iterator[Capture]:
    """Regions around objects in a depth image; the intrinsics are those of the README of the data set."""
    camera = PinholeCamera(640, 480, 1066.778, 1067.487, 312.9869, 241.3109)
    scene = Scene.from_depth(path, camera, depth_scale=1e-4)
    scene = Scene(scene.points, viewpoints=[0.0, 0.0, 0.0])  # without views: the region says what is meant
    pixels, depth = camera.project(scene.points)
    for what, (left, top, right, bottom, reach) in _BOXES.get(path.name, {}).items():
        low, high = np.array([left, top]), np.array([right, bottom])
        inside = ((pixels >= low) & (pixels <= high)).all(axis=1)
        if not inside.any():
            continue
        front = np.quantile(depth[inside], 0.05)
        own = scene.points[inside & (depth < front + reach)]
        order = None if what.startswith("mustard") else "continuous"
        yield Capture(f"{name}: {what}", "object", Scene(own, viewpoints=[0.0, 0.0, 0.0]), order)
        yield Capture(f"{name}: {what}", "region", scene, order, _around(own, 0.005))


def _fused(folder: Path) -> Iterator[Capture]:
    """Round objects of a fused tabletop scene, which all touch, cut out by a cylinder; and a bottle alone."""
    points = _finite(read(folder / "scene_cloud.ply").points)
    plane = np.loadtxt(folder / "table_plane.txt").ravel()
    for what, (*foot, radius) in _ROUND.items():
        offset = points - np.array(foot)
        inside = np.linalg.norm(np.cross(offset, plane[:3]), axis=1) < radius
        own = Scene(points[inside])
        middle = np.array(foot) + np.median(offset[inside] @ plane[:3]) * plane[:3]
        known = KnownAxis(plane[:3], middle, radius)
        yield Capture(f"symseg/scene_cloud.ply: {what}", "object", own, "continuous", known=known)
    bottle = _finite(read(folder / "sample_object_cloud.ply").points)
    yield Capture("symseg/sample_object_cloud.ply", "object", Scene(bottle), None)


def _around(points: NDArray[np.float64], margin: float = _MARGIN) -> NDArray[np.float64]:
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])


def _known(entry: dict[str, Any] | None) -> KnownAxis | None:
    if entry is None:
        return None
    direction = np.array(entry["axis_direction"] if "axis_direction" in entry else entry["plane_normal"])
    direction = direction / np.linalg.norm(direction)
    if "axis_point" in entry:
        point = np.array(entry["axis_point"])
    else:
        point = np.array(entry["axis_point_on_plane"]) + 0.5 * entry["height"] * direction
    return KnownAxis(direction, point, float(entry["radius"]))


def _finite(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points[np.isfinite(points).all(axis=1)]
