"""Rust and Python read the same from the same bytes, whoever wrote them.

The Rust reader is asked through `sympose filter` with a filter that drops nothing; what it writes is read in
Python.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sympose.cli import main
from sympose.errors import InvalidInputError
from sympose.io import read, write
from sympose.scene import Scene

RNG = np.random.default_rng(3)
POINTS = RNG.normal(size=(60, 3)) * [1.0, 30.0, 1e-3] + [4e5, 0.0, -2.0]
NORMALS = RNG.normal(size=(60, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
COLORS = RNG.integers(0, 256, (60, 3), dtype=np.uint8)
LABELS = RNG.integers(0, 4, 60, dtype=np.uint8)


def through_rust(path: Path) -> Scene:
    """What the Rust reader makes of a file."""
    copy = path.with_name("copy.ply")
    keep_all = ["--radius", "1e9", "--min-neighbors", "0", "--quiet"]
    assert main(["filter", str(path), str(copy), *keep_all]) == 0
    return read(copy)


def same(path: Path) -> Scene:
    """Check that both readers agree to the last bit; returns what they read."""
    here, there = read(path), through_rust(path)
    # The filter drops what is not finite, and so does the estimate.
    finite = np.isfinite(here.points).all(axis=1)
    for name in ("points", "normals", "colors", "viewpoints"):
        mine, other = getattr(here, name), getattr(there, name)
        assert (mine is None) == (other is None), name
        if mine is not None:
            np.testing.assert_array_equal(mine[finite], other, err_msg=name, strict=True)
    return here


def vertices(real: str, *, normals: bool = True, colors: bool = True, label: bool = True) -> NDArray[Any]:
    columns: list[tuple[str, str, NDArray[Any]]] = [
        (n, real, c) for n, c in zip("xyz", POINTS.T, strict=True)
    ]
    if label:
        columns.append(("label", "u1", LABELS))
    if normals:
        columns += [(n, real, c) for n, c in zip(("nx", "ny", "nz"), NORMALS.T, strict=True)]
    if colors:
        columns += [(n, "u1", c) for n, c in zip(("red", "green", "blue"), COLORS.T, strict=True)]
    table = np.empty(len(POINTS), dtype=[(name, kind) for name, kind, _ in columns])
    for name, _, column in columns:
        table[name] = column
    return table


@pytest.mark.parametrize("real", ["f4", "f8"])
@pytest.mark.parametrize(("text", "order"), [(True, "="), (False, "<"), (False, ">")])
def test_ply_of_plyfile(tmp_path: Path, real: str, text: bool, order: str) -> None:
    from plyfile import PlyData, PlyElement

    faces = np.array([([0, 1, 2],)], dtype=[("vertex_indices", "i4", (3,))])
    elements = [
        PlyElement.describe(faces, "face"),
        PlyElement.describe(vertices(real), "vertex", comments=["a remark"]),
    ]
    PlyData(elements, text=text, byte_order=order).write(str(tmp_path / "cloud.ply"))
    scene = same(tmp_path / "cloud.ply")
    if real == "f8" and not text:
        np.testing.assert_array_equal(scene.points, POINTS)
        np.testing.assert_array_equal(scene.normals, NORMALS)
    np.testing.assert_array_equal(scene.colors, COLORS)


@pytest.mark.parametrize("letters", ["utf-8", "latin-1"])
@pytest.mark.parametrize("text", [True, False])
def test_ply_with_any_letters_in_a_comment(tmp_path: Path, letters: str, text: bool) -> None:
    from plyfile import PlyData, PlyElement

    element = PlyElement.describe(vertices("f8"), "vertex", comments=["made of part.stl"])
    path = tmp_path / "cloud.ply"
    PlyData([element], text=text).write(str(path))
    plain = same(path)
    path.write_bytes(path.read_bytes().replace(b"part.stl", "größe.stl".encode(letters)))
    np.testing.assert_array_equal(same(path).points, plain.points)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_little_endian"])
def test_ply_of_trimesh(tmp_path: Path, encoding: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    rgba = np.column_stack([COLORS, np.full(len(COLORS), 255, dtype=np.uint8)])
    mesh = trimesh.Trimesh(POINTS, [[0, 1, 2], [2, 3, 4]], vertex_colors=rgba, process=False)
    mesh.vertex_normals = NORMALS.copy()  # trimesh makes it read-only
    path = tmp_path / "mesh.ply"
    path.write_bytes(trimesh.exchange.ply.export_ply(mesh, encoding=encoding, vertex_normal=True))
    scene = same(path)
    assert scene.normals is not None
    np.testing.assert_array_equal(scene.colors, COLORS)


PCL = (
    "ply\nformat {encoding} 1.0\ncomment PCL generated\nelement vertex 60\n"
    "property float x\nproperty float y\nproperty float z\n"
    "element camera 1\nproperty float view_px\nproperty float view_py\nproperty float view_pz\nend_header\n"
)


@pytest.mark.parametrize(
    ("encoding", "kind"), [("binary_little_endian", "<f4"), ("binary_big_endian", ">f4")]
)
def test_ply_of_pcl_with_a_sensor(tmp_path: Path, encoding: str, kind: str) -> None:
    body = np.vstack([POINTS, [[1.5, -2.0, 0.1]]]).astype(kind).tobytes()
    (tmp_path / "cloud.ply").write_bytes(PCL.format(encoding=encoding).encode() + body)
    assert same(tmp_path / "cloud.ply").viewpoints is not None


@pytest.mark.parametrize("encoding", ["ASCII", "BINARY", "BINARY_COMPRESSED"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("sensor", [None, (0.5, -1.0, 0.1)])
def test_pcd_of_pypcd4(tmp_path: Path, encoding: str, kind: type, sensor: tuple[float, ...] | None) -> None:
    from pypcd4 import Encoding, PointCloud  # type: ignore[attr-defined]

    points = POINTS.copy()
    points[7] = np.nan
    names = ("x", "y", "z", "label", "normal_x", "normal_y", "normal_z", "rgb")
    columns = [
        *points.T.astype(kind),
        LABELS.astype(np.uint32),
        *NORMALS.T.astype(kind),
        PointCloud.encode_rgb(COLORS).reshape(-1),
    ]
    cloud = PointCloud.from_points(columns, names, [column.dtype for column in columns])
    if sensor:
        cloud.metadata.viewpoint = (*sensor, 1.0, 0.0, 0.0, 0.0)
    cloud.save(str(tmp_path / "cloud.pcd"), getattr(Encoding, encoding))
    scene = same(tmp_path / "cloud.pcd")
    assert (scene.viewpoints is None) == (sensor is None)
    assert scene.normals is not None
    if encoding != "ASCII":  # there, pypcd4 rounds the float that holds the colours
        np.testing.assert_array_equal(scene.colors, COLORS)


def rows(*columns: NDArray[Any], delimiter: str = " ", decimal: str = ".") -> str:
    cells = zip(*(column.tolist() for column in columns), strict=True)
    table = [delimiter.join(str(cell) for part in row for cell in part) for row in cells]
    return "\n".join(table).replace(".", decimal) + "\n"


QUOTED = np.array([[f'"{number!r}"' for number in row] for row in POINTS.tolist()], dtype=object)
TEXTS = {
    "bare.xyz": rows(POINTS),
    "normals_and_colors.txt": rows(POINTS, NORMALS, COLORS),
    "colors_of_one.txt": rows(POINTS, COLORS / 255.0),
    "cloudcompare.txt": "//X Y Z R G B Nx Ny Nz\n" + rows(POINTS, COLORS, NORMALS),
    "labels.csv": "label,x,y,z\n" + rows(LABELS[:, None], POINTS, delimiter=","),
    "german.csv": "x;y;z;r;g;b\n" + rows(POINTS, COLORS, delimiter=";", decimal=","),
    "text.csv": "x,y,z,label\n" + rows(POINTS, np.full((60, 1), "bolt no. 1"), delimiter=","),
    "text_first.csv": "label,x,y,z\n" + rows(np.full((60, 1), "bolt"), POINTS, delimiter=","),
    "quoted_text.csv": "label;x;y;z\n" + rows(np.full((60, 1), '"a ""b""; c"'), POINTS, delimiter=";"),
    "text.xyz": "# x y z label\n" + rows(POINTS, np.full((60, 1), "bolt")),
    "nothing.csv": "x,intensity,y,z\n"
    + rows(POINTS[:, :1], np.full((60, 1), ""), POINTS[:, 1:], delimiter=","),
    "open_ends.csv": "x,y,z\n" + rows(POINTS, delimiter=",").replace("\n", ",\n"),
    "open_header.csv": "x,y,z,\n" + rows(POINTS, delimiter=","),
    "open_ends_alone.csv": rows(POINTS, delimiter=",").replace("\n", ",\n"),
    "open_ends_of_names.csv": "x,y,z,note,\n" + rows(POINTS, delimiter=",").replace("\n", ",,\n"),
    "quoted.csv": '"x", "y", "z"\n' + rows(QUOTED, delimiter=", "),
    "quoted_alone.csv": rows(QUOTED, delimiter=","),
    "quoted.txt": rows(QUOTED),
    "quoted_german.csv": rows(QUOTED, delimiter=";", decimal=","),
    "first_remark.xyz": rows(POINTS).replace("\n", " # seen first, of many\n", 1),
    "remarks.csv": "x,y,z\n" + rows(POINTS, delimiter=",").replace("\n", " # seen\n// and\n\n"),
    "twice.csv": "X,x,y,z\n" + rows(POINTS[:, :1], LABELS[:, None], POINTS[:, 1:], delimiter=","),
    "old_mac.txt": "# x y z\r" + rows(POINTS).replace("\n", "\r"),
    "windows.csv": "\ufeff" + ("X\tY\tZ\n" + rows(POINTS, delimiter="\t")).replace("\n", "\r\n"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_text(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(TEXTS[name], encoding="utf-8", newline="")
    np.testing.assert_array_equal(same(tmp_path / name).points, POINTS)


@pytest.mark.parametrize(
    "text",
    [
        "x,y,z,label\n1,2,3\n",
        "x,y,z\n1,2,3,4\n",
        "x,y,z\n1,2,3,,\n",
        "x,y,z\n1,2,3\n4,5\n",
        "x,y,z,label\n1,2,,a\n",
        "x,y,z,label\n1,2,b,a\n",
        "x,y,label\n1,2,a\n",
        "1,2,\n",
        "1,2,3,a\n",
        "1,,2,3\n",
        'x,y,z,label\n1,2,3,"a\n4,5,6",b\n',
        "a title\nx,y,z\n1,2,3\n",
        'x,y,z\n"367,024","-35,253","-14,735"\n',
        '"1,234.5","2,3","4.5"\n',
    ],
)
def test_what_both_refuse(tmp_path: Path, text: str, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cloud.csv"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=r"cloud\.csv"):
        read(path)
    assert main(["info", str(path)]) == 2
    assert "cloud.csv" in capfd.readouterr().err


XYZ = "property float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("suffix", "header"),
    [
        ("ply", f"ply\nformat ascii 2.0\nelement vertex 1\n{XYZ}end_header\n"),
        ("ply", f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}element vertex 1\n{XYZ}end_header\n"),
        ("ply", f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}property float x\nend_header\n"),
        (
            "pcd",
            "VERSION .7\nFIELDS x y z x\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
            "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n",
        ),
    ],
)
def test_headers_that_both_refuse(
    tmp_path: Path, suffix: str, header: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"cloud.{suffix}"
    path.write_text(f"{header}1 2 3 4\n")
    with pytest.raises(InvalidInputError, match="cloud"):
        read(path)
    assert main(["filter", str(path), str(tmp_path / "copy.ply"), "--radius", "1e9", "--quiet"]) == 2
    assert re.search("twice|expected ascii", capfd.readouterr().err)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("end", ["\r", "\r\n"])
def test_ply_with_line_ends_of_other_systems(tmp_path: Path, encoding: str, end: str) -> None:
    names = "".join(f"property double {name}\n" for name in "xyz")
    header = f"ply\nformat {encoding} 1.0\nelement vertex 60\n{names}end_header\n".replace("\n", end)
    body = rows(POINTS).replace("\n", end).encode() if encoding == "ascii" else POINTS.astype("<f8").tobytes()
    (tmp_path / "cloud.ply").write_bytes(header.encode() + body)
    np.testing.assert_array_equal(same(tmp_path / "cloud.ply").points, POINTS)


@pytest.mark.parametrize(
    ("viewpoint", "known"),
    [
        ("nan nan nan nan nan nan nan", False),
        ("nan nan nan 1 0 0 0", False),
        ("0 inf 0 1 0 0 0", False),
        ("1 2 3 nan nan nan nan", True),
    ],
)
@pytest.mark.parametrize("height", [1, 4])
def test_a_pcd_sensor_that_is_not_finite_is_unknown(
    tmp_path: Path, viewpoint: str, known: bool, height: int
) -> None:
    header = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {60 // height}\n"
        f"HEIGHT {height}\nVIEWPOINT {viewpoint}\nPOINTS 60\nDATA binary\n"
    )
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + POINTS.tobytes())
    scene = same(tmp_path / "cloud.pcd")
    np.testing.assert_array_equal(scene.points, POINTS)
    assert (scene.viewpoints is not None) == known


@pytest.mark.parametrize("suffix", ["ply", "pcd", "xyz", "txt", "csv"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("with_normals", [False, True])
@pytest.mark.parametrize("with_colors", [False, True])
def test_what_python_writes(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    suffix: str,
    kind: type,
    with_normals: bool,
    with_colors: bool,
) -> None:
    path = tmp_path / f"cloud.{suffix}"
    normals, colors = NORMALS if with_normals else None, COLORS if with_colors else None
    write(path, POINTS.astype(kind), normals=normals, colors=colors)
    np.testing.assert_array_equal(same(path).points, POINTS.astype(kind))
    assert main(["info", str(path), "--json"]) == 0
    info = json.loads(capfd.readouterr().out)
    assert (info["points"], info["normals"], info["colors"]) == (60, with_normals, with_colors)


@pytest.mark.parametrize("suffix", ["ply", "pcd", "xyz"])
@pytest.mark.parametrize("options", [{}, {"write_ascii": True}, {"compressed": True}])
def test_what_open3d_writes(tmp_path: Path, suffix: str, options: dict[str, bool]) -> None:
    # Installed without the system library that it needs, it cannot be imported either.
    o3d = pytest.importorskip("open3d", exc_type=ImportError)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS))
    cloud.normals = o3d.utility.Vector3dVector(NORMALS)
    cloud.colors = o3d.utility.Vector3dVector(COLORS / 255.0)
    path = tmp_path / f"cloud.{suffix}"
    assert o3d.io.write_point_cloud(str(path), cloud, **options)
    scene = same(path)
    if suffix != "xyz":
        assert scene.normals is not None
        np.testing.assert_array_equal(scene.colors, COLORS)


@pytest.mark.parametrize("encoding", ["ascii", "ASCII", "Binary"])
def test_pcd_in_either_case_and_with_remarks(tmp_path: Path, encoding: str) -> None:
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z _ _\nSIZE 8 8 8 1 1\nTYPE f F f u U\nCOUNT 1 1 1 1 3\n"
        f"WIDTH 60\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 60\nDATA {encoding}\n"
    )
    text = "".join(f"{x!r} {y!r} {z!r} 1 2 3 4\n" for x, y, z in POINTS.tolist())
    rows = [point.tobytes() + b"abcd" for point in POINTS]
    body = b"".join(rows) if encoding == "Binary" else f"# made by hand\n{text}".encode()
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + body)
    np.testing.assert_array_equal(same(tmp_path / "cloud.pcd").points, POINTS)


@pytest.mark.parametrize("written", ["-nan(ind)", "nan(snan)", "NAN(IND)"])
def test_other_ways_to_write_nan(tmp_path: Path, written: str) -> None:
    rows = [" ".join(map(repr, row)) for row in POINTS.tolist()]
    rows[7] = " ".join([written] * 3)
    body = "\n".join(rows) + "\n"
    ply = "ply\nformat ascii 1.0\nelement vertex 60\n" + "".join(f"property double {n}\n" for n in "xyz")
    pcd = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA ascii\n"
    headers = {"xyz": "", "ply": ply + "end_header\n", "pcd": pcd}
    for suffix, header in headers.items():
        path = tmp_path / f"cloud.{suffix}"
        path.write_text(header + body)
        scene = same(path)
        assert np.isnan(scene.points[7]).all()
        assert np.isfinite(scene.points).sum() == 3 * 59


def test_a_pcd_header_with_many_comments(tmp_path: Path) -> None:
    comments = "".join(f"# remark {k} {'-' * 60}\n" for k in range(100))
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\n{comments}VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\n"
        "TYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA binary\n"
    )
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + POINTS.tobytes())
    np.testing.assert_array_equal(same(tmp_path / "cloud.pcd").points, POINTS)


@pytest.mark.parametrize("suffix", ["xyzn", "xyzrgb"])
def test_the_text_files_of_open3d(tmp_path: Path, suffix: str) -> None:
    columns = [POINTS, NORMALS] if suffix == "xyzn" else [POINTS, COLORS / 255.0]
    np.savetxt(tmp_path / f"cloud.{suffix}", np.hstack(columns), fmt="%.10f")
    scene = same(tmp_path / f"cloud.{suffix}")
    assert (scene.normals is not None) == (suffix == "xyzn")
    assert (scene.colors is not None) == (suffix == "xyzrgb")


@pytest.mark.parametrize("moved", [False, True])
def test_an_image_that_was_moved_to_another_frame_does_not_stand_at_its_origin(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], moved: bool
) -> None:
    u, v = np.meshgrid(np.arange(80.0), np.arange(60.0))
    depth = 2.0 + 0.2 * np.sin(0.2 * u) * np.cos(0.15 * v)
    points = np.stack([(u - 40) / 90 * depth, (v - 30) / 90 * depth, depth], axis=-1).reshape(-1, 3)
    points[::50] = np.nan
    if moved:
        points = points @ np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]) + [0.5, 0.2, 1.4]
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 80\nHEIGHT 60\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4800\nDATA binary\n"
    )
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + points.tobytes())
    assert (read(tmp_path / "cloud.pcd").viewpoints is None) == moved
    assert main(["info", str(tmp_path / "cloud.pcd"), "--json"]) == 0
    assert (json.loads(capfd.readouterr().out)["viewpoint"] is None) == moved
