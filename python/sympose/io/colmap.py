"""COLMAP models: points, colours and views, and for each point the camera that saw it from nearest."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sympose.camera import PinholeCamera, View
from sympose.errors import InvalidInputError
from sympose.io.colmap_files import ColmapCamera, ColmapImage, ColmapPoints, read_binary, read_text
from sympose.scene import Scene

__all__ = ["read_colmap"]

_PARTS = ("cameras", "images", "points3D")
# For each model that can be read, how many focal lengths and distortion coefficients it has.
_MODELS = {
    "SIMPLE_PINHOLE": (1, 0),
    "PINHOLE": (2, 0),
    "SIMPLE_RADIAL": (1, 1),
    "RADIAL": (1, 2),
    "OPENCV": (2, 4),
}


def read_colmap(folder: str | os.PathLike[str]) -> Scene:
    """Read a COLMAP model: the folder that holds cameras, images and points3D, all .bin or all .txt.

    Camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV. COLMAP puts the centre of the
    top left pixel at (0.5, 0.5), here it is at (0, 0): the principal points are shifted.

    Args:
        folder: In a COLMAP workspace it is often `sparse/0`.

    Returns:
        The points in the order of the file, with colours; the views in the order of their numbers. The
        viewpoint of a point is the nearest camera of its track; there are none if the track of any point
        names no image of the model.

    Raises:
        FileNotFoundError: There is no such folder.
        InvalidInputError: The folder holds no whole COLMAP model, or one with another camera model.
    """
    root = Path(folder)
    if not root.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(root))
    found = [
        suffix for suffix in (".bin", ".txt") if all((root / (part + suffix)).is_file() for part in _PARTS)
    ]
    if not found:
        raise InvalidInputError(
            f"{root}: not a COLMAP model; expected {', '.join(_PARTS)} in it, all .bin or all .txt "
            "(in a COLMAP workspace the model is often in sparse/0)"
        )
    cameras_path, images_path, points_path = (root / (part + found[0]) for part in _PARTS)
    read_parts = read_binary if found[0] == ".bin" else read_text
    cameras, images, points = read_parts(cameras_path, images_path, points_path)
    if len(points.xyz) == 0:
        raise InvalidInputError(f"{points_path}: the COLMAP model holds no points")
    images.sort(key=lambda image: image.number)
    try:
        camera_of = {camera.number: _camera(camera) for camera in cameras}
    except InvalidInputError as error:
        raise InvalidInputError(f"{cameras_path}: {error}") from error
    try:
        views = [_view(image, camera_of) for image in images]
    except InvalidInputError as error:
        raise InvalidInputError(f"{images_path}: {error}") from error
    return Scene(points.xyz, points.rgb, None, _viewpoints(points, images, views), views, root.resolve().name)


def _camera(camera: ColmapCamera) -> PinholeCamera:
    if camera.model not in _MODELS:
        raise InvalidInputError(
            f"camera {camera.number} has the model {camera.model}, which cannot be read; expected one of "
            f"{', '.join(_MODELS)} (COLMAP's image_undistorter makes PINHOLE of the others)"
        )
    focals, coefficients = _MODELS[camera.model]
    if len(camera.parameters) != focals + 2 + coefficients:
        raise InvalidInputError(
            f"camera {camera.number}: {camera.model} has {focals + 2 + coefficients} parameters, "
            f"got {len(camera.parameters)}"
        )
    cx, cy, *distortion = camera.parameters[focals:]
    return PinholeCamera(
        camera.width,
        camera.height,
        fx=camera.parameters[0],
        fy=camera.parameters[focals - 1],
        cx=cx - 0.5,
        cy=cy - 0.5,
        distortion=tuple(distortion),
    )


def _view(image: ColmapImage, camera_of: dict[int, PinholeCamera]) -> View:
    if image.camera not in camera_of:
        raise InvalidInputError(
            f"image {image.name!r} refers to camera {image.camera}, which is not in the model"
        )
    norm = float(np.linalg.norm(image.quaternion))
    if not np.isfinite(norm) or norm == 0.0:
        raise InvalidInputError(f"image {image.name!r} has the rotation {image.quaternion}, expected w x y z")
    w, x, y, z = (value / norm for value in image.quaternion)
    camera_from_world = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = camera_from_world.T
    world_from_camera[:3, 3] = -camera_from_world.T @ np.array(image.translation)
    return View(camera_of[image.camera], world_from_camera, image.name)


def _viewpoints(
    points: ColmapPoints, images: list[ColmapImage], views: list[View]
) -> NDArray[np.float64] | None:
    """Centre of the nearest camera of each track."""
    if not views or not (points.track_lengths > 0).all():
        return None
    numbers = np.array([image.number for image in images], dtype=np.int64)
    centers = np.array([view.center for view in views])
    view = np.minimum(np.searchsorted(numbers, points.track_images), len(numbers) - 1)
    owner = np.repeat(np.arange(len(points.xyz)), points.track_lengths)
    distance = np.linalg.norm(centers[view] - points.xyz[owner], axis=1)
    distance[numbers[view] != points.track_images] = np.inf
    by_distance = np.lexsort((distance, owner))
    nearest = by_distance[np.cumsum(points.track_lengths) - points.track_lengths]
    is_known = np.isfinite(distance[nearest]) | ~np.isfinite(points.xyz).all(axis=1)
    return centers[view[nearest]] if is_known.all() else None
