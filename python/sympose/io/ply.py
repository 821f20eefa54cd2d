"""PLY, through plyfile."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sympose.errors import InvalidInputError
from sympose.io.columns import find_columns, known_normals, plain_nan, to_colors
from sympose.scene import MeshVertices, Scene

if TYPE_CHECKING:
    from plyfile import PlyData  # type: ignore[import-untyped]

__all__ = ["read_ply", "write_ply"]


def read_ply(path: Path) -> Scene:
    """Read the vertices of a PLY file."""
    try:
        from plyfile import PlyData
    except ImportError as error:
        raise ImportError("reading PLY needs plyfile: pip install 'sympose[io]'") from error

    ply = PlyData.read(_in_ascii(path))
    if "vertex" not in ply:
        elements = ", ".join(element.name for element in ply) or "none"
        raise InvalidInputError(f"{path}: the PLY file has no element vertex, only {elements}")
    vertices = ply["vertex"].data
    found = find_columns(vertices.dtype.names or ())
    if "points" not in found:
        raise InvalidInputError(
            f"{path}: the vertices of the PLY file have no x y z, only {vertices.dtype.names}"
        )
    columns = {part: np.stack([vertices[name] for name in names], axis=1) for part, names in found.items()}
    is_mesh = any(name in ply and ply[name].count > 0 for name in ("face", "tristrips"))
    return (MeshVertices if is_mesh else Scene)(
        columns["points"],
        to_colors(columns.get("colors")),
        known_normals(columns.get("normals")),
        _viewpoint(ply),
        name=path.name,
    )


def write_ply(path: Path, scene: Scene, single: bool) -> None:
    """Write a binary, little-endian PLY file."""
    try:
        from plyfile import PlyData, PlyElement
    except ImportError as error:
        raise ImportError("writing PLY needs plyfile: pip install 'sympose[io]'") from error

    real = "<f4" if single else "<f8"
    columns: list[tuple[str, str, NDArray[Any]]] = []
    for names, array, kind in (
        ("x y z", scene.points, real),
        ("nx ny nz", scene.normals, real),
        ("red green blue", scene.colors, "u1"),
    ):
        if array is not None:
            columns += [(name, kind, column) for name, column in zip(names.split(), array.T, strict=True)]
    vertices = np.empty(len(scene), dtype=[(name, kind) for name, kind, _ in columns])
    for name, _, column in columns:
        vertices[name] = column
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))


def _in_ascii(path: Path) -> str | io.BytesIO:
    """The file, without what plyfile refuses: other letters in its header, and odd kinds of NaN."""
    with path.open("rb") as file:
        header = file.read(65536).partition(b"end_header")[0]
    is_text = b"format ascii" in header
    if header.isascii() and not is_text:
        return str(path)
    body = path.read_bytes()[len(header) :]
    plain = header.decode("ascii", "replace").replace("\N{REPLACEMENT CHARACTER}", "?").encode()
    return io.BytesIO(plain + (plain_nan(body) if is_text else body))


def _viewpoint(ply: PlyData) -> NDArray[np.float64] | None:
    """Position of the sensor in the `camera` element that PCL writes; at the origin it says nothing."""
    names = ("view_px", "view_py", "view_pz")
    if "camera" not in ply or ply["camera"].count != 1:
        return None
    camera = ply["camera"].data
    if not set(names) <= set(camera.dtype.names or ()):
        return None
    position = np.array([camera[name][0] for name in names], dtype=np.float64)
    return position if np.isfinite(position).all() and position.any() else None
