"""The surroundings of a part: a table that it stands on, a wall behind, boxes as clutter.

All in the frame of the part, in diameters, with +z up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sympose.datasets.optional import load
from sympose.errors import InvalidInputError

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["LABELS", "set_stage"]

LABELS = ("part", "table", "wall", "clutter", "outlier")

_TABLE_SIZE = 4.0
_TABLE_BEHIND = (1.0, 1.5)  # from the axis to the rear edge
_WALL_BEHIND = (2.0, 3.0)  # from the axis
_WALL_HALF_WIDTH = 7.0
_WALL_HEIGHTS = (-4.0, 5.0)
_THICKNESS = 0.08
_CLUTTER_REACH = 1.6  # from the axis
_CLUTTER_SIZES = (0.12, 0.32)
_GAP = 0.05
_ATTEMPTS = 200


def set_stage(
    mesh: Trimesh, rng: np.random.Generator, *, front: float, clutter: int
) -> tuple[Trimesh, NDArray[np.int64]]:
    """Put `mesh` on a table before a wall.

    Args:
        front: Azimuth of the free side, opposite the wall.
        clutter: Number of boxes on the table, none of which touches the part or another box.

    Returns:
        The whole as one mesh, and for each of its faces the index into `LABELS`.

    Raises:
        InvalidInputError: There is no room for so many boxes.
    """
    trimesh = load("trimesh")
    ground = float(mesh.bounds[0, 2])
    table_behind, wall_behind = rng.uniform(*_TABLE_BEHIND), rng.uniform(*_WALL_BEHIND)
    back = np.pi + front
    # In a frame whose x axis points at the wall.
    table = _box([_TABLE_SIZE, _TABLE_SIZE, _THICKNESS], [table_behind - _TABLE_SIZE / 2.0, 0.0, -_THICKNESS])
    wall = _box(
        [_THICKNESS, 2.0 * _WALL_HALF_WIDTH, _WALL_HEIGHTS[1] - _WALL_HEIGHTS[0]],
        [wall_behind + _THICKNESS / 2.0, 0.0, _WALL_HEIGHTS[0]],
    )
    radius = float(np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]).max())
    boxes = _clutter(rng, clutter, radius, table_behind)
    upright = trimesh.transformations.rotation_matrix(back, [0.0, 0.0, 1.0])
    upright[2, 3] = ground
    props = [prop.apply_transform(upright) for prop in (table, wall, *boxes)]
    whole = trimesh.util.concatenate([mesh, *props])
    labels = [0, 1, 2, *([3] * len(boxes))]
    return whole, np.repeat(labels, [len(piece.faces) for piece in (mesh, *props)])


def _clutter(rng: np.random.Generator, count: int, radius: float, table_behind: float) -> list[Any]:
    """Boxes around a part of the given radius, each within a circle that touches no other."""
    placed: list[tuple[float, float, float]] = [(0.0, 0.0, radius)]
    boxes: list[Any] = []
    for _ in range(count):
        for _ in range(_ATTEMPTS):
            size = rng.uniform(*_CLUTTER_SIZES, 3)
            reach = float(np.hypot(size[0], size[1])) / 2.0
            distance, azimuth = rng.uniform(radius, _CLUTTER_REACH), rng.uniform(0.0, 2.0 * np.pi)
            x, y = float(distance * np.cos(azimuth)), float(distance * np.sin(azimuth))
            free = all(np.hypot(x - u, y - v) > reach + r + _GAP for u, v, r in placed)
            if free and x + reach < table_behind:
                break
        else:
            raise InvalidInputError(f"the table has no room for clutter={count} boxes, only for {len(boxes)}")
        placed.append((x, y, reach))
        boxes.append(_box(size, [x, y, 0.0], turn=rng.uniform(0.0, np.pi)))
    return boxes


def _box(size: Any, foot: Any, turn: float = 0.0) -> Any:
    """A box standing with the middle of its lower face at `foot`."""
    trimesh = load("trimesh")
    pose = trimesh.transformations.rotation_matrix(turn, [0.0, 0.0, 1.0])
    pose[:3, 3] = np.asarray(foot) + [0.0, 0.0, size[2] / 2.0]
    return trimesh.creation.box(size, pose)
