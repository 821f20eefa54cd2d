"""Where the cameras of a scenario stand, and where the part lies in the world.

Directions are drawn in the frame of the part, whose axis is +z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CAMERA_DISTANCE", "SCENARIOS", "draw_camera_pose", "random_pose"]

SCENARIOS = ("sphere", "edge", "upper", "table", "alone")
CAMERA_DISTANCE = 2.2  # diameters

_COSINES = {
    "sphere": (0.25, 0.95),
    "edge": (0.0, 0.25),
    "upper": (0.25, 0.95),
    # Steeper views of a table see neither its edge nor the wall.
    "table": (0.25, 0.7),
    "alone": (0.25, 0.7),
}
_WALL_SECTOR = np.pi / 4.0  # cameras in front of the wall stand this far to either side
_TABLE_ROLL = np.pi / 12.0  # and are held nearly upright


def draw_camera_pose(
    rng: np.random.Generator, scenario: str, target: NDArray[np.float64], front: float
) -> NDArray[np.float64]:
    """Draw the (4, 4) pose of a camera that looks at `target`.

    Directions are uniform over the part of the sphere that belongs to the scenario. `front` is the azimuth
    opposite the wall; the scenarios without a wall ignore it.
    """
    cosine = rng.uniform(*_COSINES[scenario])
    below = rng.random() < 0.5
    if below and scenario in ("sphere", "edge"):
        cosine = -cosine
    azimuth, roll = rng.uniform(-1.0, 1.0, 2)
    if scenario in ("table", "alone"):
        azimuth, roll = front + azimuth * _WALL_SECTOR, roll * _TABLE_ROLL
    else:
        azimuth, roll = azimuth * np.pi, roll * np.pi
    sine = np.sqrt(1.0 - cosine * cosine)
    direction = np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])
    return _look_at(target + CAMERA_DISTANCE * direction, target, roll)


def random_pose(rng: np.random.Generator, reach: float) -> NDArray[np.float64]:
    """A (4, 4) pose: rotation uniform over all, translation up to `reach` along each axis."""
    x, y, z, w = _unit(rng.normal(size=4))
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = rng.uniform(-reach, reach, 3)
    return pose


def _look_at(position: NDArray[np.float64], target: NDArray[np.float64], roll: float) -> NDArray[np.float64]:
    """World from camera: z toward `target`, y down (along -z of the part), then turned by `roll` about z."""
    forward = _unit(target - position)
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    down = np.cross(forward, right)
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    pose[:3, 1] = np.cos(roll) * down - np.sin(roll) * right
    pose[:3, 2], pose[:3, 3] = forward, position
    return pose


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / np.linalg.norm(vector))
