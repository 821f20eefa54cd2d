"""PCD, through pypcd4."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sympose._core import viewpoints_from_order
from sympose.arrays import as_points
from sympose.errors import InvalidInputError
from sympose.io.columns import find_columns, known_normals, plain_nan, to_colors
from sympose.scene import Scene

if TYPE_CHECKING:
    from pypcd4 import PointCloud  # type: ignore[attr-defined]

__all__ = ["read_pcd", "write_pcd"]

_AWAY = 0.1  # distance of a sensor from the origin that matters, as a share of that to the points


def read_pcd(path: Path) -> Scene:
    """Read an ascii, binary or binary_compressed PCD file."""
    try:
        from pypcd4 import PointCloud  # type: ignore[attr-defined]
    except ImportError as error:
        raise ImportError("reading PCD needs pypcd4: pip install 'sympose[io]'") from error

    cloud = PointCloud.from_fileobj(io.BytesIO(_plain(path.read_bytes(), path)))  # type: ignore[arg-type]
    header, table = cloud.metadata, np.atleast_1d(cloud.pc_data)
    if len(table) != header.points or header.width * header.height != header.points:
        raise InvalidInputError(
            f"{path}: the PCD header announces {header.points} points ({header.width} x {header.height}), "
            f"the file holds {len(table)}"
        )
    found = find_columns(table.dtype.names or ())
    if "points" not in found:
        raise InvalidInputError(f"{path}: the PCD file has no x y z, only {table.dtype.names}")
    columns = {part: np.stack([table[name] for name in names], axis=1) for part, names in found.items()}
    *position, qw, qx, qy, qz = header.viewpoint
    is_default = not any(position) and (qw, qx, qy, qz) == (1.0, 0.0, 0.0, 0.0)
    if is_default and header.height > 1:
        is_known = _may_be_seen_from_origin(columns["points"])
    else:
        is_known = not is_default and bool(np.isfinite(position).all())
    return Scene(
        columns["points"],
        _packed_colors(cloud) if "colors" not in columns else to_colors(columns["colors"]),
        known_normals(columns.get("normals")),
        position if is_known else None,
        name=path.name,
    )


def write_pcd(path: Path, scene: Scene, single: bool) -> None:
    """Write a binary PCD file."""
    try:
        from pypcd4 import Encoding, PointCloud  # type: ignore[attr-defined]
    except ImportError as error:
        raise ImportError("writing PCD needs pypcd4: pip install 'sympose[io]'") from error

    real = np.float32 if single else np.float64
    columns: list[NDArray[Any]] = [column.astype(real) for column in scene.points.T]
    fields = ["x", "y", "z"]
    if scene.normals is not None:
        columns += [column.astype(real) for column in scene.normals.T]
        fields += ["normal_x", "normal_y", "normal_z"]
    if scene.colors is not None:
        columns.append(PointCloud.encode_rgb(scene.colors).reshape(-1))
        fields.append("rgb")
    cloud = PointCloud.from_points(columns, fields, [column.dtype for column in columns])
    if scene.viewpoints is not None:
        # No rotation, with another sign than that of PCL, which at a place of zeros means "unknown".
        cloud.metadata.viewpoint = (*scene.viewpoints[0].tolist(), -1.0, 0.0, 0.0, 0.0)
    cloud.save(str(path), Encoding.BINARY)


def _plain(content: bytes, path: Path) -> bytes:
    """Bring what PCL accepts, and pypcd4 does not, into the form that both do.

    That is headers of older versions or in the other case, headers without COUNT, and ascii rows parted by
    tabs or several blanks.
    """
    header: list[bytes] = []
    rest = content
    while not (header and header[-1].startswith(b"DATA")):
        line, newline, rest = rest.partition(b"\n")
        if not newline:
            raise InvalidInputError(f"{path}: the PCD header ends without a line DATA")
        header.append(b" ".join(line.split()))
    header[-1] = b"DATA " + header[-1][4:].strip().lower()
    kept = [line for line in header if line and not line.startswith((b"#", b"VERSION"))]
    kept = [line.upper() if line.startswith(b"TYPE") else line for line in kept]
    fields = next((line for line in kept if line.startswith(b"FIELDS")), b"FIELDS")
    if not any(line.startswith(b"COUNT") for line in kept):
        kept.insert(-1, b"COUNT" + b" 1" * (len(fields.split()) - 1))
    if header[-1].split()[-1] == b"ascii":
        rest = plain_nan(b"\n".join(b" ".join(line.split()) for line in rest.splitlines()))
    return b"\n".join(kept) + b"\n" + rest


def _may_be_seen_from_origin(points: NDArray[Any]) -> bool:
    """Whether the order of the points of an image does not tell that the sensor stood elsewhere.

    Programs that move an image to another frame seldom move its VIEWPOINT, too.
    """
    finite = as_points(points[np.isfinite(points).all(axis=1)])
    places = viewpoints_from_order(finite) if len(finite) else None
    if places is None:
        return True
    far = np.linalg.norm(finite.mean(axis=0) - places, axis=1)
    return bool((np.linalg.norm(places, axis=1) <= _AWAY * far).all())


def _packed_colors(cloud: PointCloud) -> NDArray[np.uint8] | None:
    """Colours of the field rgb or rgba: four bytes in one float or integer, blue lowest."""
    for name in ("rgb", "rgba"):
        if name in cloud.fields and cloud.pc_data.dtype[name].itemsize == 4:
            return np.asarray(cloud.decode_rgb(np.atleast_1d(cloud.pc_data)[name]))
    return None
