"""What the columns of a point cloud file mean: shared by the formats."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sympose.errors import InvalidInputError

__all__ = ["find_columns", "known_normals", "plain_nan", "split_unnamed", "to_colors"]

_ODD_NAN = re.compile(rb"nan\(\w*\)", re.IGNORECASE)

# The names that files use, for each of the three columns.
_NAMES = {
    "points": (("x", "y", "z"),),
    "normals": (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz")),
    "colors": (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")),
}


def find_columns(names: Iterable[str]) -> dict[str, tuple[str, str, str]]:
    """Return which of the column names hold `points`, `normals` and `colors`; case does not matter."""
    by_lower: dict[str, str] = {}
    for name in names:
        by_lower.setdefault(name.lower(), name)
    found = {}
    for part, variants in _NAMES.items():
        for x, y, z in variants:
            if x in by_lower and y in by_lower and z in by_lower:
                found[part] = (by_lower[x], by_lower[y], by_lower[z])
                break
    return found


def split_unnamed(table: NDArray[Any], source: str) -> dict[str, NDArray[Any]]:
    """Split a table without column names: x y z, then normals and colours in either order, told by content.

    Normals are rows of length 1; colours are whole numbers from 0 to 255 or any numbers from 0 to 1.

    Args:
        table: (N, 3), (N, 6) or (N, 9).
        source: For error messages.

    Raises:
        InvalidInputError: Another number of columns, or columns that are neither normals nor colours.
    """
    if table.ndim != 2 or table.shape[1] not in (3, 6, 9):
        raise InvalidInputError(
            f"{source}: expected the columns x y z, alone or with normals or colours (3, 6 or 9 columns), "
            f"found an array of shape {table.shape}; name them in a first line, such as x y z intensity, or "
            "use PLY or NPZ"
        )
    parts = {"points": table[:, :3]}
    for first in range(3, table.shape[1], 3):
        columns = table[:, first : first + 3]
        finite = columns[np.isfinite(columns).all(axis=1)]
        if np.allclose(np.linalg.norm(finite, axis=1), 1.0, atol=0.01):
            part = "normals"
        elif (finite >= 0.0).all() and (
            (finite <= 1.0).all() or ((finite <= 255.0) & (finite == np.rint(finite))).all()
        ):
            part = "colors"
        else:
            part = "neither"
        if part == "neither" or part in parts:
            raise InvalidInputError(
                f"{source}: columns {first + 1} to {first + 3} are neither unit normals nor "
                "colours (0 to 255, or 0 to 1); name the columns, as in CSV with a header, PLY or NPZ"
            )
        parts[part] = columns
    return parts


def known_normals(normals: NDArray[Any] | None) -> NDArray[Any] | None:
    """Return None for normals that are all zero or not finite, which is how some programs write none."""
    if normals is None or not (np.isfinite(normals) & (normals != 0.0)).any():
        return None
    return normals


def to_colors(values: NDArray[Any] | None) -> NDArray[np.uint8] | None:
    """Return (N, 3) colours as uint8: 16 bits, floats from 0 to 1 and whole floats to 255 are converted.

    Colours are an extra: None is returned where the numbers are not colours.
    """
    if values is None or values.dtype == np.uint8:
        return values
    if not ((values >= 0) & (values <= 65535)).all():
        return None
    top = values.max(initial=0)
    if values.dtype.kind == "f" and top <= 1.0:
        return np.rint(values * 255.0).astype(np.uint8)
    return (values if top <= 255 else values / 257.0).astype(np.uint8)


def plain_nan(text: bytes) -> bytes:
    """Text with NaN as all read it: programs of Microsoft's C library write some kinds as `-nan(ind)`."""
    return _ODD_NAN.sub(b"nan", text) if b"(" in text else text
