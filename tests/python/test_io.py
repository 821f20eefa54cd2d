"""Files: what is written reads back, every layout reads the same, and what is no point cloud is refused."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sympose.errors import InvalidInputError
from sympose.io import read, write
from sympose.io.files import write_scene
from sympose.scene import Scene

SUFFIXES = ["ply", "pcd", "xyz", "txt", "csv", "npy", "npz"]
RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(20, 3)) * 100.0
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
COLORS = RNG.integers(0, 256, (20, 3), dtype=np.uint8)


def check(path, points=POINTS, normals=None, colors=None, **tolerance):
    scene = read(path)
    np.testing.assert_allclose(scene.points, points, **(tolerance or {"rtol": 0.0}))
    for got, want in ((scene.normals, normals), (scene.colors, colors)):
        if want is None:
            assert got is None
        else:
            np.testing.assert_allclose(got, want, **(tolerance or {"rtol": 0.0}))
    assert scene.name == path.name
    return scene


# ---- round trips ---------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("with_normals", [False, True])
@pytest.mark.parametrize("with_colors", [False, True])
def test_what_is_written_reads_back_exactly(tmp_path, suffix, with_normals, with_colors):
    path = tmp_path / f"cloud.{suffix}"
    normals, colors = NORMALS if with_normals else None, COLORS if with_colors else None
    if suffix == "npy" and with_colors:
        with pytest.raises(InvalidInputError, match="NPZ"):
            write(path, POINTS, normals=normals, colors=colors)
        return
    write(path, POINTS, normals=normals, colors=colors)
    check(path, normals=normals, colors=colors)


@settings(max_examples=25)
@given(
    points=arrays(np.float64, st.tuples(st.integers(1, 8), st.just(3)), elements=st.floats(-1e300, 1e300)),
    suffix=st.sampled_from(SUFFIXES),
)
def test_every_double_survives(tmp_path_factory, points, suffix):
    path = tmp_path_factory.mktemp("doubles") / f"cloud.{suffix}"
    write(path, points)
    np.testing.assert_array_equal(read(path).points, points)


@pytest.mark.parametrize("suffix", ["ply", "pcd", "npy", "npz"])
def test_float32_points_stay_float32_in_the_file(tmp_path, suffix):
    single, double = tmp_path / f"single.{suffix}", tmp_path / f"double.{suffix}"
    points = RNG.normal(size=(1000, 3))
    write(single, points.astype(np.float32))
    write(double, points)
    assert single.stat().st_size < 0.7 * double.stat().st_size
    np.testing.assert_array_equal(read(single).points, points.astype(np.float32))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "variant", [np.asfortranarray, lambda a: np.repeat(a, 2, axis=0)[::2], lambda a: a.tolist()]
)
def test_memory_order_does_not_matter(tmp_path, suffix, variant):
    path = tmp_path / f"cloud.{suffix}"
    write(path, variant(POINTS))
    check(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_points_without_measurement_are_kept(tmp_path, suffix):
    points = POINTS.copy()
    points[3] = np.nan
    write(tmp_path / f"cloud.{suffix}", points)
    check(tmp_path / f"cloud.{suffix}", points)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_one_point(tmp_path, suffix):
    write(tmp_path / f"cloud.{suffix}", [[1.0, 2.0, 3.0]])
    check(tmp_path / f"cloud.{suffix}", [[1.0, 2.0, 3.0]])


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("cloud.stl", {"points": POINTS}),
        ("cloud", {"points": POINTS}),
        ("cloud.ply", {"points": np.empty((0, 3))}),
        ("cloud.ply", {"points": POINTS[:, :2]}),
        ("cloud.ply", {"points": POINTS, "normals": NORMALS[:3]}),
        ("cloud.ply", {"points": POINTS, "colors": COLORS[:3]}),
    ],
)
def test_what_cannot_be_written(tmp_path, name, arguments):
    with pytest.raises(InvalidInputError):
        write(tmp_path / name, **arguments)
    assert not (tmp_path / name).exists()


def test_a_folder_that_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError):
        write(tmp_path / "no" / "cloud.xyz", POINTS)


# ---- PLY -----------------------------------------------------------------------------------------


def ply(path, fmt, body, properties="float x,float y,float z", count=20, extra=""):
    lines = "".join(f"property {p}\n" for p in properties.split(","))
    header = f"ply\nformat {fmt} 1.0\ncomment test\nelement vertex {count}\n{lines}{extra}end_header\n"
    path.write_bytes(header.encode() + body)


@pytest.mark.parametrize(("fmt", "order"), [("binary_little_endian", "<"), ("binary_big_endian", ">")])
@pytest.mark.parametrize(("kind", "code"), [("float", "f4"), ("double", "f8"), ("int", "i4")])
def test_ply_binary(tmp_path, fmt, order, kind, code):
    body = POINTS.astype(order + code)
    properties = ",".join(f"{kind} {name}" for name in "xyz")
    ply(tmp_path / "cloud.ply", fmt, body.tobytes(), properties)
    check(tmp_path / "cloud.ply", body)


def test_ply_ascii_with_other_properties_and_faces(tmp_path):
    rows = [
        f"7 {r} {g} {b} {z!r} {y!r} {x!r}"
        for (x, y, z), (r, g, b) in zip(POINTS.tolist(), COLORS.tolist(), strict=True)
    ]
    ply(
        tmp_path / "mesh.ply",
        "ascii",
        ("\n".join(rows) + "\n3 0 1 2\n").encode(),
        "uchar label,uchar red,uchar green,uchar blue,double z,double y,double x",
        extra="element face 1\nproperty list uchar int vertex_indices\n",
    )
    check(tmp_path / "mesh.ply", colors=COLORS)


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)])
def test_ply_camera_of_pcl_is_the_viewpoint_unless_at_the_origin(tmp_path, position):
    camera = "element camera 1\n" + "".join(f"property float view_p{axis}\n" for axis in "xyz")
    body = POINTS.astype("<f4").tobytes() + np.array(position, dtype="<f4").tobytes()
    ply(tmp_path / "cloud.ply", "binary_little_endian", body, extra=camera)
    viewpoints = read(tmp_path / "cloud.ply").viewpoints
    if any(position):
        np.testing.assert_array_equal(viewpoints, [position] * 20)
    else:
        assert viewpoints is None


def test_ply_normals_that_are_all_zero_are_none(tmp_path):
    write(tmp_path / "cloud.ply", POINTS, normals=np.zeros((20, 3)))
    assert read(tmp_path / "cloud.ply").normals is None


@pytest.mark.parametrize(
    ("kind", "code", "scale"), [("float", "<f4", 1 / 255), ("ushort", "<u2", 257), ("int", "<i4", 1)]
)
def test_ply_colors_of_other_types(tmp_path, kind, code, scale):
    fields = [(n, "<f4") for n in "xyz"] + [(n, code) for n in ("red", "green", "blue")]
    table = np.zeros(20, dtype=fields)
    for k, name in enumerate(("red", "green", "blue")):
        table[name] = COLORS[:, k].astype(np.float64) * scale
    properties = f"float x,float y,float z,{kind} red,{kind} green,{kind} blue"
    ply(tmp_path / "cloud.ply", "binary_little_endian", table.tobytes(), properties)
    np.testing.assert_array_equal(read(tmp_path / "cloud.ply").colors, COLORS)


# ---- PCD -----------------------------------------------------------------------------------------


def lzf_literals(data):
    """LZF without back references: runs of up to 32 literal bytes."""
    return b"".join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))


def pcd(path, data, *, points=POINTS, viewpoint="0 0 0 1 0 0 0", height=1, drop=(), count=None):
    count = len(points) if count is None else count
    single = points.astype("<f4")
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS x y z",
        "SIZE 4 4 4",
        "TYPE F F F",
        "COUNT 1 1 1",
        f"WIDTH {count // height}",
        f"HEIGHT {height}",
        f"VIEWPOINT {viewpoint}",
        f"POINTS {count}",
        f"DATA {data}",
    ]
    text = "\n".join(line for line in header if not line.startswith(tuple(drop) or ("-",))) + "\n"
    if data == "ascii":
        body = "\n".join("\t".join(f"{value:.9g} " for value in row) for row in single).encode() + b"\n"
    elif data == "binary":
        body = single.tobytes()
    else:
        columns = single.T.tobytes()
        packed = lzf_literals(columns)
        body = struct.pack("<II", len(packed), len(columns)) + packed
    path.write_bytes(text.encode() + body)


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_of_each_kind(tmp_path, data):
    points = POINTS.copy()
    points[4] = np.nan
    pcd(tmp_path / "cloud.pcd", data, points=points)
    scene = check(tmp_path / "cloud.pcd", points.astype(np.float32))
    assert scene.viewpoints is None


@pytest.mark.parametrize("drop", [("VERSION",), ("COUNT",), ("VIEWPOINT",), ("#", "VERSION", "COUNT")])
def test_pcd_headers_of_older_versions(tmp_path, drop):
    pcd(tmp_path / "cloud.pcd", "binary", drop=drop)
    check(tmp_path / "cloud.pcd", POINTS.astype(np.float32))


@pytest.mark.parametrize(
    ("viewpoint", "height", "expected"),
    [
        ("0 0 0 1 0 0 0", 1, None),
        ("0 0 0 1 0 0 0", 4, [0.0, 0.0, 0.0]),
        ("0 0 0 0 1 0 0", 1, [0.0, 0.0, 0.0]),
        ("0.5 -1 2.5e-1 1 0 0 0", 1, [0.5, -1.0, 0.25]),
    ],
)
def test_pcd_viewpoint(tmp_path, viewpoint, height, expected):
    pcd(tmp_path / "cloud.pcd", "binary", viewpoint=viewpoint, height=height)
    viewpoints = read(tmp_path / "cloud.pcd").viewpoints
    if expected is None:
        assert viewpoints is None
    else:
        np.testing.assert_array_equal(viewpoints, [expected] * 20)


# ---- text ----------------------------------------------------------------------------------------


def rows(table, delimiter):
    return "\n".join(delimiter.join(map(repr, row)) for row in table.tolist()) + "\n"


@pytest.mark.parametrize("delimiter", [" ", "\t", ",", ";", ", ", "   "])
@pytest.mark.parametrize("name", ["cloud.xyz", "cloud.txt", "cloud.csv", "cloud"])
def test_text_delimiters(tmp_path, delimiter, name):
    (tmp_path / name).write_text(rows(POINTS, delimiter))
    check(tmp_path / name)


@pytest.mark.parametrize(
    "header",
    [
        "x,y,z,nx,ny,nz,r,g,b",
        "X,Y,Z,Normal_X,Normal_Y,Normal_Z,Red,Green,Blue",
        '"x","y","z","nx","ny","nz","red","green","blue"',
        "# x,y,z,nx,ny,nz,r,g,b",
        "//X,Y,Z,Nx,Ny,Nz,R,G,B",
        "# made by hand\n\n# another line\nx,y,z,nx,ny,nz,r,g,b",
        "",
    ],
)
def test_text_headers(tmp_path, header):
    table = np.hstack([POINTS, NORMALS, COLORS])
    (tmp_path / "cloud.csv").write_text(header + "\n" + rows(table, ","))
    check(tmp_path / "cloud.csv", normals=NORMALS, colors=COLORS)


def test_text_columns_by_name_in_any_order(tmp_path):
    table = np.hstack([np.arange(20.0)[:, None], POINTS[:, ::-1]])
    (tmp_path / "cloud.csv").write_text("\ufefftime;z;y;x\r\n" + rows(table, ";").replace("\n", "\r\n"))
    check(tmp_path / "cloud.csv")


def test_text_with_decimal_commas(tmp_path):
    (tmp_path / "cloud.csv").write_text(rows(POINTS, ";").replace(".", ","))
    check(tmp_path / "cloud.csv")


def test_text_colors_and_normals_are_told_apart_by_their_values(tmp_path):
    for columns, kind in ((NORMALS, "normals"), (COLORS, "colors"), (COLORS / 255.0, "colors")):
        (tmp_path / "cloud.xyz").write_text(rows(np.hstack([POINTS, columns]), " "))
        expected = COLORS if kind == "colors" else NORMALS
        np.testing.assert_array_equal(getattr(read(tmp_path / "cloud.xyz"), kind), expected)


# ---- viewpoints ----------------------------------------------------------------------------------


@pytest.mark.parametrize("intensity", [False, True])
@pytest.mark.parametrize("colored", [False, True])
def test_text_whose_first_line_counts_the_points(tmp_path, intensity, colored):
    between = [np.linspace(-700.0, 900.0, 20)[:, None]] if intensity else []
    table = rows(np.hstack([POINTS, *between, *([COLORS] if colored else [])]), " ")
    (tmp_path / "cloud.pts").write_text(f"20\n{table}")
    check(tmp_path / "cloud.pts", colors=COLORS if colored else None)
    (tmp_path / "cloud.pts").write_text(f"21\n{table}")
    with pytest.raises(InvalidInputError, match="counts 21 points, the file holds 20"):
        read(tmp_path / "cloud.pts")
    if intensity:
        (tmp_path / "cloud.xyz").write_text(table)
        with pytest.raises(InvalidInputError, match="name them in a first line, such as x y z intensity"):
            read(tmp_path / "cloud.xyz")


def test_viewpoints_are_written_where_the_format_holds_them(tmp_path):
    one, each = np.array([1.0, 2.0, 3.0]), np.linspace([1.0, 2.0, 3.0], [2.0, 2.0, 3.0], 20)
    write_scene(tmp_path / "cloud.npz", Scene(POINTS, viewpoints=each))
    np.testing.assert_array_equal(read(tmp_path / "cloud.npz").viewpoints, each)
    # A sensor at the origin, too, though a file of PCL has zeros there where it is not known.
    for place in (one, np.zeros(3)):
        write_scene(tmp_path / "cloud.pcd", Scene(POINTS, viewpoints=place))
        np.testing.assert_array_equal(read(tmp_path / "cloud.pcd").viewpoints, [place] * 20)
    for name, viewpoints in (("cloud.pcd", each), ("cloud.ply", one), ("cloud.xyz", one)):
        with pytest.raises(InvalidInputError, match="NPZ"):
            write_scene(tmp_path / name, Scene(POINTS, viewpoints=viewpoints))


# ---- what is no point cloud ----------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [*SUFFIXES, "las"])
def test_missing_and_empty_files(tmp_path, suffix):
    path = tmp_path / f"cloud.{suffix}"
    with pytest.raises(FileNotFoundError, match=f"cloud.{suffix}"):
        read(path)
    path.touch()
    with pytest.raises(InvalidInputError, match=f"cloud.{suffix}.*empty"):
        read(path)


@pytest.mark.parametrize("suffix", [*SUFFIXES, "las", ""])
@pytest.mark.parametrize(
    "content",
    [
        b"\x89PNG\r\n\x1a\n" + bytes(100),
        bytes(range(256)) * 10,
        b"\0" * 1000,
        b"<html><body>not found</body></html>",
        b'{"points": [[1, 2, 3]]}',
        b"hello\n",
        b"\xff\xfeh\0i\0",
        b"1 2\n3 4\n",
        b"1 2 3\n4 5\n",
        b"1 2 3\n4 5 x\n",
        b"x y\n1 2\n",
        b"x,y,z\n",
        b"x,y,z\n1,2\n",
        b"a,b,c\n1,2,3\n",
        b"# x y z\n",
        b"1 2 3 0.5 7 -2\n",
        b"\n\n\n",
    ],
)
def test_foreign_files(tmp_path, suffix, content):
    path = tmp_path / f"cloud.{suffix}".rstrip(".")
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match="cloud"):
        read(path)


@pytest.mark.parametrize("suffix", ["ply", "pcd", "npy", "npz"])
@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.9, 0.999])
def test_files_that_are_cut_off(tmp_path, suffix, share):
    path = tmp_path / f"cloud.{suffix}"
    write(path, RNG.normal(size=(500, 3)), normals=RNG.normal(size=(500, 3)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InvalidInputError, match=f"cloud.{suffix}"):
        read(path)


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_that_holds_another_number_of_points(tmp_path, data):
    pcd(tmp_path / "cloud.pcd", data, count=24)
    with pytest.raises(InvalidInputError, match=r"cloud\.pcd"):
        read(tmp_path / "cloud.pcd")
    pcd(tmp_path / "cloud.pcd", data, points=POINTS[:0])
    with pytest.raises(InvalidInputError, match=r"cloud\.pcd"):
        read(tmp_path / "cloud.pcd")


@pytest.mark.parametrize("fmt", ["ascii", "binary_little_endian"])
def test_ply_that_promises_too_much(tmp_path, fmt):
    ply(tmp_path / "cloud.ply", fmt, b"1 2 3\n" * 10, count=10**9)
    with pytest.raises(InvalidInputError, match=r"cloud\.ply"):
        read(tmp_path / "cloud.ply")


def test_ply_without_vertices_or_coordinates(tmp_path):
    ply(tmp_path / "a.ply", "ascii", b"", count=0)
    ply(tmp_path / "b.ply", "ascii", b"1 2\n", "float x,float y", count=1)
    (tmp_path / "c.ply").write_text(
        "ply\nformat ascii 1.0\nelement point 1\nproperty float x\nend_header\n1\n"
    )
    for name in "abc":
        with pytest.raises(InvalidInputError, match=f"{name}.ply"):
            read(tmp_path / f"{name}.ply")


@settings(max_examples=150)
@given(
    suffix=st.sampled_from(["ply", "pcd", "npy", "npz", "xyz"]),
    place=st.floats(0.0, 0.999),
    garbage=st.binary(min_size=1, max_size=8),
)
def test_damaged_files_read_or_are_refused(tmp_path_factory, suffix, place, garbage):
    """Whatever byte is damaged, nothing but a scene or an InvalidInputError may come of it."""
    path = tmp_path_factory.mktemp("damaged") / f"cloud.{suffix}"
    write(path, POINTS, normals=NORMALS)
    content = bytearray(path.read_bytes())
    start = int(place * len(content))
    content[start : start + len(garbage)] = garbage
    path.write_bytes(content)
    try:
        scene = read(path)
    except InvalidInputError:
        return
    assert scene.points.shape[1] == 3
