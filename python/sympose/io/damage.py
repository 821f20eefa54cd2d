"""What libraries raise on damaged files, made into our errors."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path

from sympose.errors import InvalidInputError, SymposeError
from sympose.scene import Scene

__all__ = ["read_whole"]


def read_whole(reader: Callable[[Path], Scene], path: Path, kind: str) -> Scene:
    """Read a file of a kind, which must hold points.

    Raises:
        InvalidInputError: It is damaged, something else, or empty.
        ImportError: The package that reads such files is missing.
    """
    try:
        scene = reader(path)
    except (SymposeError, ImportError):
        raise
    # A damaged file can raise anything inside the libraries that parse it, and EINVAL from the system when
    # they are sent to a place before its beginning.
    except Exception as error:
        if isinstance(error, OSError) and error.errno != errno.EINVAL:
            raise
        raise InvalidInputError(f"{path}: damaged or not a {kind} file: {error}") from error
    if len(scene) == 0:
        raise InvalidInputError(f"{path}: the {kind} file holds no points")
    return scene
