"""`read` and `write`: find the format of a file and hand it to the module that knows it."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.errors import InvalidInputError
from sympose.io.colmap import read_colmap
from sympose.io.damage import read_whole
from sympose.io.npz import read_npy, read_npz, write_npy, write_npz
from sympose.io.pcd import read_pcd, write_pcd
from sympose.io.ply import read_ply, write_ply
from sympose.io.table import read_table, write_csv, write_xyz
from sympose.scene import Scene

__all__ = ["read", "write"]

_READERS: dict[str, Callable[[Path], Scene]] = {
    "PLY": read_ply,
    "PCD": read_pcd,
    "NPY": read_npy,
    "NPZ": read_npz,
    "text": read_table,
}
_WRITERS: dict[str, Callable[[Path, Scene, bool], None]] = {
    ".ply": write_ply,
    ".pcd": write_pcd,
    ".xyz": write_xyz,
    ".txt": write_xyz,
    ".csv": write_csv,
    ".npy": write_npy,
    ".npz": write_npz,
}
_BINARY_SUFFIXES = {".ply": "PLY", ".pcd": "PCD", ".npy": "NPY", ".npz": "NPZ"}
_TEXT_SUFFIXES = (".xyz", ".xyzn", ".xyzrgb", ".txt", ".csv", ".pts", ".asc", ".tsv", "")
_NPY_START, _NPZ_START = b"\x93NUMPY", b"PK\x03\x04"
_IMAGE_STARTS = (b"\x89PNG", b"II*\0", b"MM\0*", b"\xff\xd8\xff")


def read(path: str | os.PathLike[str]) -> Scene:
    """Read a point cloud, or a COLMAP model or workspace from its folder.

    The format is found by content, and by suffix where the content does not tell. Points that are not finite,
    as in organised clouds, are kept.

    - PLY: ascii and binary of both endians. Of a mesh, the vertices. Normals, colours; the position in PCL's
      `camera` element is the viewpoint unless it is the origin.
    - PCD: ascii, binary, binary_compressed. The position in VIEWPOINT is the viewpoint of all points. The
      default (0 0 0 1 0 0 0) also stands in clouds that have none, so it counts as a sensor at the origin
      only where the cloud is organised (HEIGHT > 1), that is an image of one sensor, and the order of its
      points does not tell that this stood elsewhere. One that is not finite is unknown.
    - XYZ, TXT, CSV, PTS: see `sympose.io.table`.
    - NPY: (N, 3) points, or (N, 6) with normals or colours; of an organised cloud (H, W, 3).
    - NPZ: one array without a name, as in NPY; or keys `points`, and optionally `normals`, `colors`,
      `viewpoints`, and those of `Scene.tracks`, `track_places`, `track_counts` and `track_seen_from`; or
      `depth` (or `depth_m`) with `K`, and optionally `rgb`, `world_from_camera`,
      `depth_scale`: a depth image as in `Scene.from_depth`.
    - COLMAP: see `read_colmap`.

    Args:
        path: File or folder.

    Raises:
        FileNotFoundError: There is nothing at `path`.
        InvalidInputError: It is empty, truncated, or of another kind; the message says what was expected.
        ImportError: The package that reads the format is missing.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "cloud.ply"
        >>> write(path, [[0.0, 0.0, 1.0], [0.0, 2.0, 1.0]])
        >>> read(path)
        Scene('cloud.ply': 2 points)
    """
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file))
    if file.is_dir():
        return read_colmap(file)
    kind = _kind(file)
    return read_whole(_READERS[kind], file, kind)


def write(
    path: str | os.PathLike[str],
    points: ArrayLike,
    *,
    normals: ArrayLike | None = None,
    colors: ArrayLike | None = None,
) -> None:
    """Write a point cloud; the suffix says in which format.

    PLY (binary, little endian), PCD (binary), XYZ or TXT, CSV, NPY (no colours) and NPZ. Nothing is rounded:
    PLY, PCD and NumPy files hold float32 where `points` is float32, and float64 otherwise; text has as many
    digits as it takes. Old versions of PCL read only float32.

    Args:
        path: An existing file is replaced.
        points: (N, 3).
        normals: (N, 3).
        colors: (N, 3) integers from 0 to 255 or floats from 0 to 1.

    Raises:
        InvalidInputError: An unknown suffix, no points, or arrays that do not fit together.
        ImportError: The package that writes the format is missing.
    """
    write_scene(path, Scene(points, colors, normals), single=np.asarray(points).dtype == np.float32)


def write_scene(path: str | os.PathLike[str], scene: Scene, *, single: bool = False) -> None:
    """Write a scene as `write` does, with its viewpoints: NPZ holds them, PCD holds one for all points.

    Args:
        path: An existing file is replaced.
        scene: What is written, but for its views.
        single: Write float32.

    Raises:
        InvalidInputError: An unknown suffix, no points, or something that the format does not hold.
        ImportError: The package that writes the format is missing.
    """
    file = Path(path)
    writer = _WRITERS.get(file.suffix.lower())
    if writer is None:
        raise InvalidInputError(f"{file}: cannot write {file.suffix!r}, only {', '.join(_WRITERS)}")
    if len(scene) == 0:
        raise InvalidInputError(f"{file}: there are no points to write")
    if scene.viewpoints is not None and not holds_viewpoints(file, scene.viewpoints):
        raise InvalidInputError(
            f"{file}: only NPZ holds a viewpoint for each point, and PCD one for all; write NPZ, or leave "
            "viewpoints out"
        )
    writer(file, scene, single)


def holds_viewpoints(path: str | os.PathLike[str], viewpoints: NDArray[np.float64]) -> bool:
    """Whether a file of this suffix can say where the sensor stood."""
    suffix = Path(path).suffix.lower()
    return suffix == ".npz" or (suffix == ".pcd" and bool((viewpoints == viewpoints[0]).all()))


def is_only_read_here(path: str | os.PathLike[str]) -> bool:
    """Whether the Rust binary does not know files of this kind: those of NumPy, and COLMAP folders."""
    file = Path(path)
    if not file.is_file():
        return file.is_dir()
    with file.open("rb") as stream:
        return stream.read(6).startswith((_NPY_START, _NPZ_START))


def _kind(file: Path) -> str:
    with file.open("rb") as stream:
        start = stream.read(4096)
    if not start:
        raise InvalidInputError(f"{file}: the file is empty")
    if start.startswith((b"ply\n", b"ply\r")):
        return "PLY"
    if start.startswith(_NPY_START):
        return "NPY"
    if start.startswith(_NPZ_START):
        return "NPZ"
    suffix = file.suffix.lower()
    first_words = [line.split()[:1] for line in start.splitlines()]
    if start.startswith(b"# .PCD") or [b"FIELDS"] in first_words:
        return "PCD"
    if suffix in _BINARY_SUFFIXES:
        raise InvalidInputError(
            f"{file}: not a {_BINARY_SUFFIXES[suffix]} file; it starts with {start[:16]!r}"
        )
    if start.startswith(_IMAGE_STARTS):
        raise InvalidInputError(f"{file}: an image, not a point cloud; use Scene.from_depth for depth images")
    if suffix not in _TEXT_SUFFIXES or b"\0" in start:
        raise InvalidInputError(
            f"{file}: not a point cloud of a known format (PLY, PCD, XYZ, TXT, CSV, PTS, NPY, NPZ, or a "
            f"COLMAP folder); it starts with {start[:16]!r}"
        )
    return "text"
