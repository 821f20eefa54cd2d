"""Text: XYZ, TXT, CSV, PTS.

One point a line; the columns are parted by blanks, tabs, commas or semicolons (with semicolons, a comma is a
decimal comma). Lines that start with `#` or `//` are comments. A header line, also as a comment, names the
columns: x y z, and nx ny nz or normal_x normal_y normal_z, and r g b or red green blue, in any order; others
are ignored, and may hold text or nothing. Without a header there are 3, 6 or 9 columns: x y z, then normals
or colours or both, told by their values. Cells may be quoted; what is empty after the last delimiter of a
line is no column. A first line that is one whole number counts the points, as in PTS; then there may be 4 or
7 columns without a header, of which the fourth is the intensity.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sympose.errors import InvalidInputError
from sympose.io.columns import find_columns, known_normals, plain_nan, split_unnamed, to_colors
from sympose.scene import Scene

__all__ = ["read_table", "write_csv", "write_xyz"]


def read_table(path: Path) -> Scene:
    """Read a text file of points."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{path}: not a text file (it is not UTF-8: {error.reason})") from error
    layout, rows = _split_header(plain_nan(text.encode()).decode(), path)
    names = layout.names
    if names is None:
        # In the files that count their points, the intensity may stand between place and colour.
        has_intensity = layout.promised is not None and layout.width in (4, 7)
        used = [column for column in range(layout.width) if not has_intensity or column != 3]
        columns = split_unnamed(_numbers(rows, layout, used, path), str(path))
    else:
        found = find_columns(names)
        if "points" not in found:
            raise InvalidInputError(f"{path}: the header names no columns x y z, only {', '.join(names)}")
        used = [names.index(name) for trio in found.values() for name in trio]
        table = _numbers(rows, layout, used, path)
        columns = {part: table[:, 3 * k : 3 * k + 3] for k, part in enumerate(found)}
    found_rows = len(columns["points"])
    if layout.promised not in (None, found_rows):
        raise InvalidInputError(
            f"{path}: the first line counts {layout.promised} points, the file holds {found_rows}"
        )
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


_UNIT_SEPARATOR = "\x1f"
"""Of ASCII, for what no text holds."""


class _Layout(NamedTuple):
    """How a table is written; without a delimiter its columns are parted by blanks."""

    names: list[str] | None
    delimiter: str | None
    width: int
    first: int
    """Number of the line of the first row."""
    promised: int | None
    """How many points the first line promises."""


def _split_header(text: str, path: Path) -> tuple[_Layout, list[str]]:
    """Return the layout, and the lines from the first row on."""
    names: list[str] | None = None
    likely: str | None = None
    promised: int | None = None
    line = ""
    lines = [line.strip() for line in text.split("\n")]
    for k, line in enumerate(lines):
        comment = line.startswith(("#", "//"))
        # What follows a # in a row is a comment, as NumPy takes it.
        content = line.lstrip("#/ \t") if comment else line.partition("#")[0].rstrip()
        if not content:
            continue
        if not comment and names is None and promised is None and content.isascii() and content.isdecimal():
            promised = int(content)
            continue
        delimiter = _delimiter(content)
        title = _without_open_end(_cells(content, delimiter), delimiter)
        named = names is not None and "points" in find_columns(names)
        if not comment and (named or _is_number(title[0].replace(",", "."))):
            delimiter = _delimiter(content, likely)
            row = _without_open_end(_cells(content, delimiter), delimiter)
            return _Layout(names, delimiter, len(names or row), k + 1, promised), lines[k:]
        if not comment or "points" in find_columns(title):
            if names is not None and not comment:
                break
            names, likely = title, delimiter
    found = line[:40] or text.strip()[:40]
    raise InvalidInputError(f"{path}: expected rows of numbers x y z, found {found!r}")


def _numbers(lines: list[str], layout: _Layout, used: Sequence[int], path: Path) -> NDArray[np.float64]:
    """Read the columns that are used."""
    rows = []
    quoted = False
    for number, line in enumerate(lines, start=layout.first):
        if not line or line.startswith(("#", "//")):
            continue
        row = line.partition("#")[0].rstrip()
        quoted = quoted or '"' in row
        width = _width(row, layout)
        if width != layout.width:
            source = "in the first row" if layout.names is None else "named by the header"
            raise InvalidInputError(f"{path}: line {number}: {width} columns, but {layout.width} {source}")
        rows.append(row)
    delimiter = layout.delimiter
    if quoted:
        # NumPy minds quotes, but not behind a blank. A cell may hold the delimiter, which makes it no number.
        cells = (_cells(row, delimiter) for row in rows)
        rows = [_UNIT_SEPARATOR.join(row[column] for column in used) for row in cells]
        used, delimiter = range(len(used)), _UNIT_SEPARATOR
    if layout.delimiter == ";":
        rows = [row.replace(",", ".") for row in rows]
    try:
        return np.loadtxt(rows, delimiter=delimiter, usecols=used, comments=None, ndmin=2)
    except ValueError as error:
        raise InvalidInputError(f"{path}: not a table of numbers: {error}") from error


def _width(row: str, layout: _Layout) -> int:
    """Number of columns in a row; what is empty after its last delimiter counts where one is missing."""
    if layout.delimiter is None or '"' in row:
        width = len(_cells(row, layout.delimiter))
    else:
        width = row.count(layout.delimiter) + 1
    open_end = layout.delimiter is not None and row.endswith(layout.delimiter)
    return width - 1 if open_end and width == layout.width + 1 else width


def _delimiter(line: str, likely: str | None = None) -> str | None:
    return next((delimiter for delimiter in (likely, ";", ",") if delimiter and delimiter in line), None)


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Take a line apart; a quoted cell may hold the delimiter."""
    if delimiter is None:
        return [cell[1:].removesuffix('"') if cell.startswith('"') else cell for cell in line.split()]
    if '"' in line:
        (cells,) = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    else:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def _without_open_end(cells: list[str], delimiter: str | None) -> list[str]:
    return cells[:-1] if delimiter is not None and not cells[-1] else cells


def _is_number(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True
