"""COLMAP models and fused clouds: points, views, and for each point the camera that saw it from nearest."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sympose.camera import PinholeCamera, View
from sympose.errors import InvalidInputError
from sympose.io.colmap_files import (
    ColmapCamera,
    ColmapImage,
    ColmapPoints,
    read_binary,
    read_text,
    read_visibility,
)
from sympose.io.damage import read_whole
from sympose.io.ply import read_ply
from sympose.scene import Scene
from sympose.tracks import Tracks

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
    """Read a COLMAP model, or the dense cloud of a workspace.

    A model is the folder that holds cameras, images and points3D, all .bin or all .txt. A folder with
    `fused.ply` is a workspace of COLMAP's stereo_fusion: the points are those of that file, the cameras those
    of the model in `sparse`, and which of them saw a point is in `fused.ply.vis`.

    Camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV. COLMAP puts the centre of the
    top left pixel at (0.5, 0.5), here it is at (0, 0): the principal points are shifted.

    Args:
        folder: In a project of COLMAP often `sparse/0`, or `dense`, which has many more points.

    Returns:
        The points in the order of the file, with colours, and normals where the file has them; the views in
        the order of their numbers. `tracks` are the cameras that saw each point, and its viewpoint is the
        nearest of these; there are none if for some point no camera is known. To estimate a piece, use `roi`
        or `Scene.select`: the viewpoints alone would look as if the other cameras had lost the point.

    Raises:
        FileNotFoundError: There is no such folder.
        InvalidInputError: The folder holds no whole COLMAP model, or one with another camera model, or
            `fused.ply.vis` does not fit the cloud.
        ImportError: The package that reads PLY files is missing, and there is one.
    """
    root = Path(folder)
    if not root.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(root))
    name = root.resolve().name
    fused = root / "fused.ply"
    if not fused.is_file():
        model = _Model.read(root)
        if len(model.points.xyz) == 0:
            raise InvalidInputError(f"{root}: the COLMAP model holds no points")
        cloud, tracks = Scene(model.points.xyz, model.points.rgb), _sparse_tracks(model)
    else:
        cloud = read_whole(read_ply, fused, "PLY")
        model = _Model.read(root / "sparse" if (root / "sparse").is_dir() else root)
        tracks = _dense_tracks(cloud.points, Path(f"{fused}.vis"), model)
    return Scene(cloud.points, cloud.colors, cloud.normals, None, model.views, name, tracks=tracks)


@dataclass(frozen=True)
class _Model:
    """A model as it was read: the images in the order of the file, their views in that of their numbers."""

    images: list[ColmapImage]
    views: list[View]
    points: ColmapPoints

    @classmethod
    def read(cls, root: Path) -> Self:
        found = [
            suffix
            for suffix in (".bin", ".txt")
            if all((root / (part + suffix)).is_file() for part in _PARTS)
        ]
        if not found:
            raise InvalidInputError(
                f"{root}: not a COLMAP model; expected {', '.join(_PARTS)} in it, all .bin or all .txt "
                "(in a COLMAP project the model is often in sparse/0, the dense cloud in dense)"
            )
        cameras_path, images_path, points_path = (root / (part + found[0]) for part in _PARTS)
        read_parts = read_binary if found[0] == ".bin" else read_text
        cameras, images, points = read_parts(cameras_path, images_path, points_path)
        try:
            camera_of = {camera.number: _camera(camera) for camera in cameras}
        except InvalidInputError as error:
            raise InvalidInputError(f"{cameras_path}: {error}") from error
        try:
            in_order = sorted(images, key=lambda image: image.number)
            views = [_view(image, camera_of) for image in in_order]
        except InvalidInputError as error:
            raise InvalidInputError(f"{images_path}: {error}") from error
        return cls(images, views, points)


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


def _sparse_tracks(model: _Model) -> Tracks | None:
    """The cameras of each track; images that are not in the model do not count."""
    points = model.points
    numbers = np.sort([image.number for image in model.images])
    view = np.searchsorted(numbers, points.track_images)
    is_known = np.isin(points.track_images, numbers)
    return _nearest_first(points.xyz, points.track_lengths, view, is_known, model.views)


def _dense_tracks(xyz: NDArray[np.float64], path: Path, model: _Model) -> Tracks | None:
    """The cameras that saw each point; without the file that tells, none."""
    if not path.is_file():
        return None
    lengths, images = read_visibility(path)
    if len(lengths) != len(xyz):
        raise InvalidInputError(
            f"{path}: tells what saw {len(lengths)} points, but the cloud beside it has {len(xyz)}; leave "
            "that as stereo_fusion wrote it, and cut it with roi, or take this file away"
        )
    if len(images) and images.max() >= len(model.images):
        raise InvalidInputError(
            f"{path}: names image {images.max()}, but the model has {len(model.images)}, from 0; they do not "
            "belong together"
        )
    # COLMAP counts the images as they come in the file that it wrote, which need not be the order of their
    # numbers.
    view_of_image = np.argsort(np.argsort([image.number for image in model.images], kind="stable"))
    view = view_of_image[images]
    _check_seen(xyz, lengths, view, model.views, path)
    return _nearest_first(xyz, lengths, view, np.ones(len(view), dtype=np.bool_), model.views)


def _check_seen(
    xyz: NDArray[np.float64],
    lengths: NDArray[np.int64],
    view: NDArray[np.int64],
    views: list[View],
    path: Path,
) -> None:
    """Refuse a file of another cloud or model: a camera has what it saw in its picture."""
    # So many observations are looked at, and this share may be beside the picture.
    looked_at, beside = 20_000, 0.1
    step = max(1, len(view) // looked_at)
    point, view = np.repeat(np.arange(len(xyz)), lengths)[::step], view[::step]
    finite = np.isfinite(xyz[point]).all(axis=1)
    point, view = point[finite], view[finite]
    outside = 0
    with np.errstate(over="ignore", invalid="ignore"):
        for k in np.unique(view):
            outside += int((~views[k].project(xyz[point[view == k]])[2]).sum())
    if outside > beside * len(view):
        raise InvalidInputError(
            f"{path}: {outside} of {len(view)} points are not in the picture of a camera that is said to "
            "have seen them; the file is not of this cloud, or of another model"
        )


def _nearest_first(
    xyz: NDArray[np.float64],
    lengths: NDArray[np.int64],
    view: NDArray[np.int64],
    is_known: NDArray[np.bool_],
    views: list[View],
) -> Tracks | None:
    """The tracks without what is not known; None where nothing is left of one."""
    owner = np.repeat(np.arange(len(xyz)), lengths)[is_known]
    view = view[is_known]
    counts = np.bincount(owner, minlength=len(xyz))
    if not counts.all():
        return None
    centers = np.array([view.center for view in views])
    # Points that are not finite are dropped later, whatever saw them.
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.nan_to_num(np.linalg.norm(centers[view] - xyz[owner], axis=1))
    first = np.cumsum(counts) - counts
    least = np.flatnonzero(distance == np.minimum.reduceat(distance, first)[owner])
    # Of cameras equally near the first one.
    nearest = least[np.flatnonzero(np.diff(owner[least], prepend=-1))]
    view[first], view[nearest] = view[nearest], view[first]
    return Tracks(centers, counts.astype(np.uint32), view.astype(np.uint32))
