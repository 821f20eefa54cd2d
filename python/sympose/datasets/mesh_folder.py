"""A folder of meshes with a manifest, read as parts, so that CAD models are scanned like procedural ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from sympose.datasets.optional import load
from sympose.datasets.parts.model import Order, Part, diameter
from sympose.datasets.visibility import visible_centroid
from sympose.errors import InvalidInputError

__all__ = ["load_mesh_folder"]

_DIAMETER_TOLERANCE = 0.01


def load_mesh_folder(folder: str | Path) -> tuple[Part, ...]:
    """Read `manifest.json` in `folder` and the meshes that it lists.

    The manifest is a list of objects with these keys; others are ignored.
        name, class: Name and family of the part.
        file: Path of the mesh, relative to `folder`. Its diameter is 1 and its axis about +z.
        order: n, or 0 for a surface of revolution, or 1 for a part without symmetry.
        dihedral: Optional, whether the sign of the axis is undefined.
        axis_fit, axis_point_fit: Optional, (3,) direction of the axis and a point on it; without them, +z
            through the origin.
        visible_centroid_z: Optional, z of the centroid of the visible surface; measured where it is missing.

    Returns:
        The parts in the order of the manifest. Meshes keep their size and place.

    Raises:
        FileNotFoundError: There is no manifest, or a mesh is missing.
        InvalidInputError: The manifest or a mesh cannot be read, or an entry lacks a key.
        ImportError: trimesh is not installed.
    """
    manifest = Path(folder) / "manifest.json"
    try:
        entries = json.loads(manifest.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"{manifest} is not JSON: {error}") from error
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InvalidInputError(f"{manifest} must hold a list of objects")
    parts = tuple(_read_part(manifest.parent, entry) for entry in entries)
    names = [part.name for part in parts]
    if twice := {name for name in names if names.count(name) > 1}:
        raise InvalidInputError(f"{manifest} has more than one part of the name {', '.join(sorted(twice))}")
    return parts


def _read_part(folder: Path, entry: dict[str, Any]) -> Part:
    missing = [key for key in ("name", "class", "file", "order") if key not in entry]
    if missing:
        raise InvalidInputError(f"an entry of {folder / 'manifest.json'} lacks {', '.join(missing)}: {entry}")
    for key in ("name", "class", "file"):
        if not isinstance(entry[key], str):
            raise InvalidInputError(f"{key} of an entry of the manifest must be a text, got {entry[key]!r}")
    path = folder / entry["file"]
    if not path.is_file():
        raise FileNotFoundError(f"{path}, listed in the manifest as {entry['name']!r}, does not exist")
    try:
        mesh = load("trimesh").load_mesh(path)
        mesh.merge_vertices()
    except Exception as error:  # trimesh lets whatever its readers raise through
        raise InvalidInputError(f"{path} is not a mesh that can be read: {error}") from error

    size = diameter(mesh)
    if not abs(size - 1.0) < _DIAMETER_TOLERANCE:
        raise InvalidInputError(f"{path} has diameter {size:g}; scale it to 1, the unit of the scenarios")
    number = entry["order"]
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise InvalidInputError(
            f"order of {entry['name']!r} must be n >= 2, 0 (continuous) or 1 (none), got {number!r}"
        )
    order: Order = {0: "continuous", 1: None}.get(number, number)
    axis = _vector(entry, "axis_fit", (0.0, 0.0, 1.0))
    if not axis[2] > 0.0:
        raise InvalidInputError(f"axis_fit of {entry['name']!r} must point about along +z, got {axis}")
    axis /= np.linalg.norm(axis)
    point = _vector(entry, "axis_point_fit", (0.0, 0.0, 0.0))
    height = entry.get("visible_centroid_z")
    if height is None:
        height = visible_centroid(mesh)[2]
    elif not isinstance(height, (int, float)) or not np.isfinite(height):
        raise InvalidInputError(f"visible_centroid_z of {entry['name']!r} must be a number, got {height!r}")
    center = point + (height - point[2]) / axis[2] * axis
    return Part(entry["name"], entry["class"], order, mesh, axis, center, bool(entry.get("dihedral", False)))


def _vector(entry: dict[str, Any], key: str, default: tuple[float, float, float]) -> np.ndarray[Any, Any]:
    value = entry.get(key)
    vector = np.array(default if value is None else value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InvalidInputError(f"{key} of {entry['name']!r} must be three finite numbers, got {value!r}")
    return vector
