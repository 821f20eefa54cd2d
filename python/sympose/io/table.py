"""Text: XYZ, TXT, CSV.

One point a line; the columns are parted by blanks, tabs, commas or semicolons (with semicolons, a comma is a
decimal comma). Lines that start with `#` or `//` are comments. A header line, also as a comment, names the
columns: x y z, and nx ny nz or normal_x normal_y normal_z, and r g b or red green blue, in any order; others
are ignored. Without a header there are 3, 6 or 9 columns: x y z, then normals or colours or both, told by
their values.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from sympose.errors import InvalidInputError
from sympose.io.columns import find_columns, known_normals, split_unnamed, to_colors
from sympose.scene import Scene

__all__ = ["read_table", "write_csv", "write_xyz"]


def read_table(path: Path) -> Scene:
    """Read a text file of points."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{path}: not a text file (it is not UTF-8: {error.reason})") from error
    names, delimiter, body = _split_header(text, path)
    if delimiter == ";":
        body = body.replace(",", ".")
    try:
        table = np.loadtxt(io.StringIO(body), delimiter=delimiter, ndmin=2)
    except ValueError as error:
        raise InvalidInputError(f"{path}: not a table of numbers: {error}") from error
    if names is None:
        columns = split_unnamed(table, str(path))
    else:
        found = find_columns(names)
        if "points" not in found:
            raise InvalidInputError(f"{path}: the header names no columns x y z, only {', '.join(names)}")
        if table.shape[1] != len(names):
            raise InvalidInputError(
                f"{path}: the header names {len(names)} columns, the rows have {table.shape[1]}"
            )
        columns = {part: table[:, [names.index(name) for name in trio]] for part, trio in found.items()}
    return Scene(
        columns["points"],
        to_colors(columns.get("colors")),
        known_normals(columns.get("normals")),
        name=path.name,
    )


def write_xyz(path: Path, scene: Scene, single: bool) -> None:
    """Write columns parted by blanks; a comment names them where there are more than x y z."""
    _write(path, scene, " ", "# ")


def write_csv(path: Path, scene: Scene, single: bool) -> None:
    """Write comma-separated columns under a header."""
    _write(path, scene, ",", "")


def _write(path: Path, scene: Scene, delimiter: str, header_start: str) -> None:
    names = ["x", "y", "z"]
    columns: list[list[float]] = scene.points.T.tolist()
    if scene.normals is not None:
        names += ["nx", "ny", "nz"]
        columns += scene.normals.T.tolist()
    if scene.colors is not None:
        names += ["red", "green", "blue"]
        columns += scene.colors.T.tolist()
    with path.open("w", encoding="ascii", newline="\n") as stream:
        if len(names) > 3 or not header_start:
            stream.write(header_start + delimiter.join(names) + "\n")
        # repr is the shortest text that reads back as the same number.
        stream.writelines(delimiter.join(map(repr, row)) + "\n" for row in zip(*columns, strict=True))


def _split_header(text: str, path: Path) -> tuple[list[str] | None, str | None, str]:
    """Return the names of the columns, the delimiter (None: blanks), and the text from the first row on."""
    names: list[str] | None = None
    start = 0
    for match in re.finditer(r"[^\n]*\n?", text):
        line = match.group().strip()
        comment = line.startswith(("#", "//"))
        content = line.lstrip("#/ \t")
        if not content:
            if match.end() == len(text):
                break
            continue
        delimiter = ";" if ";" in content else "," if "," in content else None
        tokens = [token.strip().strip('"') for token in content.split(delimiter)]
        if not comment and _is_number(tokens[0].replace(",", ".")):
            return names, delimiter, text[match.start() :]
        if not comment or "points" in find_columns(tokens):
            if names is not None and not comment:
                break
            names = tokens
        start = match.end()
    found = text[start : start + 40].strip() or text[:40].strip()
    raise InvalidInputError(f"{path}: expected rows of numbers x y z, found {found!r}")


def _is_number(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True
