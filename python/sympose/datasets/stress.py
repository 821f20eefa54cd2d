"""What real sensors and pipelines do to a scan, each as one function.

Images and points are in diameters of the part, in its frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "add_outliers",
    "cut_wedge",
    "drop_blobs",
    "fly_edges",
    "misplace",
    "thin_with_distance",
    "warp_smoothly",
]

_EDGE = 0.03  # diameters; a larger jump of the distance is an edge
_FLIGHT = 0.3  # diameters; the farthest that a pixel flies off an edge
_BLOB = 16  # pixels of a 320 x 240 image
_WAVELENGTHS = (1.0, 2.0)  # diameters
_WAVES = 6


def fly_edges(
    distance: NDArray[np.float64], share: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Move a share of the pixels at depth edges between the near and the far surface (flying pixels).

    Returns:
        The new (H, W) distance, and which pixels fly.
    """
    if share == 0.0:
        return distance, np.zeros(distance.shape, dtype=bool)
    padded = np.pad(np.where(np.isnan(distance), np.inf, distance), 1, mode="edge")
    neighbors = [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
    gap = np.maximum.reduce(neighbors) - distance
    flying = (gap > _EDGE) & (rng.random(distance.shape) < share)
    flight = rng.random(distance.shape) * np.minimum(gap, _FLIGHT)
    return np.where(flying, distance + flight, distance), flying


def drop_blobs(distance: NDArray[np.float64], share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Choose blobs that hold `share` of the pixels with a return, as lost on specular patches.

    Returns:
        (H, W), which pixels are lost.
    """
    hit = np.isfinite(distance)
    if share == 0.0 or not hit.any():
        return np.zeros(distance.shape, dtype=bool)
    height, width = distance.shape
    cell = _BLOB * width / 320.0
    coarse = rng.normal(size=(int(height / cell) + 2, int(width / cell) + 2))
    row, column = np.arange(height)[:, None] / cell, np.arange(width)[None, :] / cell
    i, j = row.astype(int), column.astype(int)
    # Smooth steps between the nodes, so that the blobs have no corners.
    s, t = (3.0 - 2.0 * (row - i)) * (row - i) ** 2, (3.0 - 2.0 * (column - j)) * (column - j) ** 2
    field = (1 - s) * ((1 - t) * coarse[i, j] + t * coarse[i, j + 1])
    field = field + s * ((1 - t) * coarse[i + 1, j] + t * coarse[i + 1, j + 1])
    return np.asarray(hit & (field < np.quantile(field[hit], share)))


def cut_wedge(points: NDArray[np.float64], wedge_deg: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Choose the (N,) points outside a wedge about the z axis, which begins at a random angle."""
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    return np.asarray((azimuth - rng.uniform(0.0, 360.0)) % 360.0 >= wedge_deg)


def thin_with_distance(
    distance: NDArray[np.float64], falloff: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Choose points (N,), the nearest surely, others with probability (nearest / distance)^falloff."""
    nearest = distance.min(initial=np.inf)
    return np.asarray(rng.random(len(distance)) < (nearest / distance) ** falloff)


def warp_smoothly(
    points: NDArray[np.float64], on_part: NDArray[np.bool_], amount: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Bend space by a sum of waves, with a root mean square of `amount` over the part.

    What the waves do as a rigid motion of the part is taken out, so that its true pose stays the best fit.
    """
    wave = rng.normal(size=(_WAVES, 3))
    wave *= 2.0 * np.pi / rng.uniform(*_WAVELENGTHS, _WAVES)[:, None] / np.linalg.norm(wave, axis=1)[:, None]
    push = rng.normal(size=(_WAVES, 3))
    offset = np.sin(points @ wave.T + rng.uniform(0.0, 2.0 * np.pi, _WAVES)) @ push

    # Small rigid motion: t + omega x p, linear in its six numbers.
    def rigid(p: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = p.T
        o = np.zeros_like(x)
        turns = [np.stack([o, -z, y], axis=1), np.stack([z, o, -x], axis=1), np.stack([-y, x, o], axis=1)]
        shifts = [np.broadcast_to(axis, p.shape) for axis in np.eye(3)]
        return np.stack([*turns, *shifts], axis=-1)

    part = rigid(points[on_part]).reshape(-1, 6)
    motion = np.linalg.lstsq(part.T @ part, part.T @ offset[on_part].ravel(), rcond=None)[0]
    offset = offset - rigid(points) @ motion
    size = np.sqrt((offset[on_part] ** 2).sum(axis=1).mean()) if on_part.any() else 1.0
    return np.asarray(points + offset * (amount / size if size > 0.0 else 0.0))


def misplace(
    center: NDArray[np.float64], shift: float, turn_deg: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw the error of a view that is not quite where it is said to be.

    Args:
        center: (3,) what it turns about.
        shift, turn_deg: Standard deviations in, and about, each of three directions.

    Returns:
        (4, 4) rigid motion from where it is to where it is said to be.
    """
    vector = np.radians(turn_deg) * rng.normal(size=3)
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle > 0.0 else vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    error = np.eye(4)
    error[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    error[:3, 3] = center - error[:3, :3] @ center + shift * rng.normal(size=3)
    return error


def add_outliers(points: NDArray[np.float64], share: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw uniform points in the bounding box of `points`, so many that they are `share` of all."""
    count = round(len(points) * share / (1.0 - share))
    if count == 0:
        return np.empty((0, 3))
    return rng.uniform(points.min(axis=0), points.max(axis=0), (count, 3))
