"""NumPy's own files: NPY and NPZ."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sympose.arrays import as_floats
from sympose.camera import PinholeCamera
from sympose.errors import InvalidInputError
from sympose.io.columns import known_normals, split_unnamed, to_colors
from sympose.scene import Scene
from sympose.tracks import Tracks

__all__ = ["read_npy", "read_npz", "write_npy", "write_npz"]

_TRACKS = ("track_places", "track_counts", "track_seen_from")


def read_npy(path: Path) -> Scene:
    """Read an (N, 3) array of points, or (N, 6) and (N, 9) with normals or colours or both.

    An organised cloud has the shape (H, W, 3), and is read row by row.
    """
    return _unnamed(np.load(path, allow_pickle=False), path)


def read_npz(path: Path) -> Scene:
    """Read the keys that `write_npz` writes; a depth image and its K; or an unnamed array."""
    # Opened here, since np.load leaves a damaged archive open.
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        keys = set(archive.files)
        if "points" in keys:
            return Scene(
                archive["points"],
                to_colors(archive["colors"]) if "colors" in keys else None,
                known_normals(archive["normals"]) if "normals" in keys else None,
                archive["viewpoints"] if "viewpoints" in keys else None,
                name=path.name,
                tracks=Tracks(*(archive[key] for key in _TRACKS)) if keys.issuperset(_TRACKS) else None,
            )
        if keys == {"arr_0"}:
            return _unnamed(archive["arr_0"], path)
        depth_key = next((key for key in ("depth", "depth_m") if key in keys), None)
        if depth_key is not None and "K" in keys:
            depth = archive[depth_key]
            color_key = next((key for key in ("rgb", "color", "colors") if key in keys), None)
            scene = Scene.from_depth(
                depth,
                _camera(as_floats(archive["K"], f"{path}: K"), depth, path),
                archive["world_from_camera"] if "world_from_camera" in keys else None,
                depth_scale=_one_number(archive["depth_scale"], "depth_scale", path)
                if "depth_scale" in keys
                else 1.0,
                color=archive[color_key] if color_key is not None else None,
            )
            return Scene(scene.points, scene.colors, None, scene.viewpoints, scene.views, path.name)
    found = ", ".join(sorted(keys)) or "none"
    raise InvalidInputError(f"{path}: expected the key points, or depth and K; the keys found are: {found}")


def write_npy(path: Path, scene: Scene, single: bool) -> None:
    """Write (N, 3) points, or (N, 6) with normals."""
    if scene.colors is not None:
        raise InvalidInputError(f"{path}: NPY holds no colours; write NPZ or PLY")
    table = scene.points if scene.normals is None else np.hstack([scene.points, scene.normals])
    np.save(path, table.astype(_real(single)))


def write_npz(path: Path, scene: Scene, single: bool) -> None:
    """Write the keys points, normals, colors, viewpoints, and those of tracks."""
    arrays: dict[str, NDArray[Any]] = {"points": scene.points.astype(_real(single))}
    if scene.normals is not None:
        arrays["normals"] = scene.normals.astype(_real(single))
    if scene.colors is not None:
        arrays["colors"] = scene.colors
    if scene.viewpoints is not None:
        arrays["viewpoints"] = scene.viewpoints
    if scene.tracks is not None:
        arrays |= {f"track_{name}": array for name, array in vars(scene.tracks).items()}
    np.savez_compressed(path, allow_pickle=False, **arrays)


def _unnamed(array: NDArray[Any], path: Path) -> Scene:
    """What an array without names for its columns holds."""
    table = as_floats(array, str(path))
    columns = split_unnamed(table.reshape(-1, table.shape[-1]) if table.ndim == 3 else table, str(path))
    return Scene(columns["points"], to_colors(columns.get("colors")), columns.get("normals"), name=path.name)


def _real(single: bool) -> type[np.float32] | type[np.float64]:
    return np.float32 if single else np.float64


def _one_number(value: NDArray[Any], name: str, path: Path) -> float:
    """The number of an array that holds only one, whatever its shape."""
    numbers = as_floats(value, f"{path}: {name}")
    if numbers.size != 1:
        raise InvalidInputError(f"{path}: {name} must be one number, got an array of shape {numbers.shape}")
    return float(numbers.item())


def _camera(matrix: NDArray[np.float64], depth: NDArray[Any], path: Path) -> PinholeCamera:
    is_pinhole = matrix.shape == (3, 3) and matrix[0, 1] == matrix[1, 0] == 0.0
    if not is_pinhole or matrix[2].tolist() != [0.0, 0.0, 1.0]:
        raise InvalidInputError(f"{path}: K must be fx 0 cx, 0 fy cy, 0 0 1, got {matrix.tolist()}")
    if depth.ndim != 2:
        raise InvalidInputError(f"{path}: depth must have shape (H, W), got {depth.shape}")
    height, width = depth.shape
    return PinholeCamera(width, height, fx=matrix[0, 0], fy=matrix[1, 1], cx=matrix[0, 2], cy=matrix[1, 2])
