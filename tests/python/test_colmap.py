"""COLMAP models written here as COLMAP documents them, binary and text; pycolmap is an oracle where it is."""

import importlib.util
import json
import struct
import subprocess
import sys

import numpy as np
import pytest

from sympose.errors import InvalidInputError
from sympose.io import read, read_colmap

MODELS = {
    "SIMPLE_PINHOLE": (0, (500.0, 320.0, 240.0)),
    "PINHOLE": (1, (500.0, 510.0, 320.0, 240.0)),
    "SIMPLE_RADIAL": (2, (500.0, 320.0, 240.0, -0.1)),
    "RADIAL": (3, (500.0, 320.0, 240.0, -0.1, 0.02)),
    "OPENCV": (4, (500.0, 510.0, 320.0, 240.0, -0.1, 0.02, 1e-3, -2e-3)),
    "OPENCV_FISHEYE": (5, (500.0, 510.0, 320.0, 240.0, 0.1, 0.0, 0.0, 0.0)),
    "FULL_OPENCV": (6, (500.0, 510.0, 320.0, 240.0, *(0.0,) * 8)),
}
CAMERAS = [(1, "SIMPLE_PINHOLE"), (2, "PINHOLE"), (7, "SIMPLE_RADIAL"), (8, "RADIAL"), (9, "OPENCV")]


def make_model(cameras=CAMERAS):
    """Images with one of the cameras in turn, and points with their tracks; image 3 sees none."""
    rng = np.random.default_rng(5)
    images = []
    for k in range(6):
        quaternion = rng.normal(size=4)
        images.append(
            {
                "id": 40 - 3 * k,  # not in order
                "q": quaternion / np.linalg.norm(quaternion),
                "t": rng.normal(size=3),
                "camera": cameras[k % len(cameras)][0],
                "name": f"folder/image {k}.jpg",
                "points": [(1.5, 2.5, -1)] if k == 5 else [],
            }
        )
    points = []
    for k in range(30):
        seen_by = [images[i] for i in rng.choice([0, 1, 2, 4, 5], size=rng.integers(2, 5), replace=False)]
        track = [(image["id"], len(image["points"])) for image in seen_by]
        for image in seen_by:
            image["points"].append((*rng.uniform(0, 400, 2).tolist(), 1000 - k))
        color = rng.integers(0, 256, 3)
        points.append({"id": 1000 - k, "xyz": rng.normal(size=3), "rgb": color, "track": track})
    return cameras, images, points


def write_binary(folder, cameras, images, points):
    data = struct.pack("<Q", len(cameras))
    for number, model in cameras:
        code, parameters = MODELS[model]
        data += struct.pack("<IiQQ", number, code, 640, 480)
        data += struct.pack(f"<{len(parameters)}d", *parameters)
    (folder / "cameras.bin").write_bytes(data)
    data = struct.pack("<Q", len(images))
    for image in images:
        data += struct.pack("<I7dI", image["id"], *image["q"], *image["t"], image["camera"])
        data += image["name"].encode() + b"\0" + struct.pack("<Q", len(image["points"]))
        for observation in image["points"]:
            data += struct.pack("<ddq", *observation)
    (folder / "images.bin").write_bytes(data)
    data = struct.pack("<Q", len(points))
    for point in points:
        data += struct.pack("<Q3d3Bd", point["id"], *point["xyz"], *point["rgb"], 0.5)
        data += struct.pack("<Q", len(point["track"]))
        for entry in point["track"]:
            data += struct.pack("<II", *entry)
    (folder / "points3D.bin").write_bytes(data)


def write_text(folder, cameras, images, points):
    def words(values):
        return " ".join(repr(value) for value in np.asarray(values).tolist())

    lines = [
        "# Camera list with one line of data per camera:",
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
    ]
    lines += [f"{number} {model} 640 480 {words(MODELS[model][1])}" for number, model in cameras]
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Image list with two lines of data per image:"]
    for image in images:
        lines.append(
            f"{image['id']} {words(image['q'])} {words(image['t'])} {image['camera']} {image['name']}"
        )
        lines.append(" ".join(f"{x!r} {y!r} {point}" for x, y, point in image["points"]))
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    lines = ["# 3D point list with one line of data per point:"]
    for point in points:
        track = " ".join(f"{image} {place}" for image, place in point["track"])
        lines.append(f"{point['id']} {words(point['xyz'])} {words(point['rgb'])} 0.5 {track}")
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n")


WRITERS = {"bin": write_binary, "txt": write_text}


def rotation(quaternion):
    """Rotation of a unit quaternion w x y z, column by column: q e q*."""

    def multiply(a, b):
        return np.array(
            [a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))]
        )

    conjugate = quaternion * [1, -1, -1, -1]
    return np.stack(
        [multiply(multiply(quaternion, np.array([0.0, *axis])), conjugate)[1:] for axis in np.eye(3)], axis=1
    )


@pytest.fixture(params=["bin", "txt"])
def kind(request):
    return request.param


def test_points_views_and_viewpoints(tmp_path, kind):
    cameras, images, points = make_model()
    WRITERS[kind](tmp_path, cameras, images, points)
    scene = read_colmap(tmp_path)
    np.testing.assert_array_equal(scene.points, [point["xyz"] for point in points])
    np.testing.assert_array_equal(scene.colors, [point["rgb"] for point in points])
    by_id = sorted(images, key=lambda image: image["id"])
    assert [view.name for view in scene.views] == [image["name"] for image in by_id]
    for view, image in zip(scene.views, by_id, strict=True):
        expected = np.eye(4)
        expected[:3, :3], expected[:3, 3] = rotation(image["q"]), image["t"]
        np.testing.assert_allclose(view.camera_from_world, expected, atol=1e-12)
    center = {image["id"]: view.center for view, image in zip(scene.views, by_id, strict=True)}
    for point, viewpoint in zip(points, scene.viewpoints, strict=True):
        distances = [np.linalg.norm(center[image] - point["xyz"]) for image, _ in point["track"]]
        nearest = center[point["track"][int(np.argmin(distances))][0]]
        np.testing.assert_array_equal(viewpoint, nearest)
    assert scene.name == tmp_path.name


def test_camera_models(tmp_path, kind):
    WRITERS[kind](tmp_path, *make_model())
    cameras = {view.camera.distortion: view.camera for view in read_colmap(tmp_path).views}
    assert set(cameras) == {(), (-0.1,), (-0.1, 0.02), (-0.1, 0.02, 1e-3, -2e-3)}
    for camera in cameras.values():
        assert (camera.width, camera.height, camera.fx) == (640, 480, 500.0)
        # COLMAP's pixel centres are at one half.
        assert (camera.cx, camera.cy) == (319.5, 239.5)
    assert cameras[(-0.1,)].fy == 500.0
    assert cameras[(-0.1, 0.02, 1e-3, -2e-3)].fy == 510.0


@pytest.mark.parametrize("model", ["OPENCV_FISHEYE", "FULL_OPENCV"])
def test_other_camera_models_are_refused_by_name(tmp_path, kind, model):
    WRITERS[kind](tmp_path, *make_model([(3, model)]))
    with pytest.raises(InvalidInputError, match=f"cameras.{kind}.*{model}"):
        read_colmap(tmp_path)


def test_unknown_camera_model(tmp_path):
    write_binary(tmp_path, *make_model([(3, "PINHOLE")]))
    content = bytearray((tmp_path / "cameras.bin").read_bytes())
    content[12] = 99
    (tmp_path / "cameras.bin").write_bytes(content)
    with pytest.raises(InvalidInputError, match="99"):
        read_colmap(tmp_path)


def test_read_takes_the_folder_and_binary_wins(tmp_path):
    cameras, images, points = make_model()
    write_binary(tmp_path, cameras, images, points)
    write_text(tmp_path, cameras, images, points[:3])
    assert len(read(tmp_path)) == len(points)


@pytest.mark.parametrize("change", ["no track", "foreign image", "no images"])
def test_viewpoints_are_none_where_a_track_names_no_image(tmp_path, kind, change):
    cameras, images, points = make_model()
    if change == "no track":
        points[4]["track"] = []
    elif change == "foreign image":
        points[4]["track"] = [(999, 0)]
    else:
        images = []
    WRITERS[kind](tmp_path, cameras, images, points)
    scene = read_colmap(tmp_path)
    assert len(scene) == len(points)
    assert scene.viewpoints is None


def test_a_point_that_is_not_finite_leaves_the_viewpoints_of_the_others(tmp_path, kind):
    cameras, images, points = make_model()
    whole = tmp_path / "whole"
    whole.mkdir()
    WRITERS[kind](whole, cameras, images, points)
    points[4]["xyz"] = [np.nan, 0.0, 1.0]
    WRITERS[kind](tmp_path, cameras, images, points)
    others = np.arange(len(points)) != 4
    np.testing.assert_array_equal(
        read_colmap(tmp_path).viewpoints[others], read_colmap(whole).viewpoints[others]
    )


def test_an_image_beyond_the_model_does_not_disturb_the_rest_of_a_track(tmp_path, kind):
    cameras, images, points = make_model()
    points[4]["track"] = [(999, 0), (images[0]["id"], 0), (1, 0)]
    WRITERS[kind](tmp_path, cameras, images, points)
    scene = read_colmap(tmp_path)
    center = -rotation(images[0]["q"]).T @ images[0]["t"]
    np.testing.assert_allclose(scene.viewpoints[4], center)


def test_missing_folder_and_missing_files(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        read_colmap(tmp_path / "nowhere")
    with pytest.raises(InvalidInputError, match=r"cameras, images, points3D"):
        read(tmp_path)
    write_binary(tmp_path, *make_model())
    (tmp_path / "images.bin").unlink()
    with pytest.raises(InvalidInputError, match="COLMAP"):
        read_colmap(tmp_path)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_binary_files_that_are_cut_off(tmp_path, part, share):
    write_binary(tmp_path, *make_model())
    path = tmp_path / f"{part}.bin"
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InvalidInputError, match=f"{part}.bin"):
        read_colmap(tmp_path)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("content", [b"\xff" * 200, b"ply\nformat ascii 1.0\n" * 20])
def test_foreign_binary_files(tmp_path, part, content):
    write_binary(tmp_path, *make_model())
    (tmp_path / f"{part}.bin").write_bytes(content)
    with pytest.raises(InvalidInputError, match=f"{part}.bin"):
        read_colmap(tmp_path)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_bytes_after_the_last_record(tmp_path, part):
    write_binary(tmp_path, *make_model())
    path = tmp_path / f"{part}.bin"
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(InvalidInputError, match="1 bytes follow"):
        read_colmap(tmp_path)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
@pytest.mark.parametrize(
    "line", ["hello", "1 2 3", "a b c d e f g h i j k", "1 PINHOLE 640 480 500 x 320 240", "\xff\xfe"]
)
def test_foreign_text_files_with_the_line(tmp_path, part, line):
    write_text(tmp_path, *make_model())
    (tmp_path / f"{part}.txt").write_bytes(b"# comment\n" + line.encode("latin-1") + b"\n")
    with pytest.raises(InvalidInputError, match=f"{part}.txt"):
        read_colmap(tmp_path)


@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_an_image_without_a_rotation(tmp_path, kind, value):
    cameras, images, points = make_model()
    images[2]["q"] = np.full(4, value)
    WRITERS[kind](tmp_path, cameras, images, points)
    with pytest.raises(InvalidInputError, match="image 2"):
        read_colmap(tmp_path)


def test_an_image_of_a_camera_that_is_not_there(tmp_path, kind):
    cameras, images, points = make_model()
    images[2]["camera"] = 77
    WRITERS[kind](tmp_path, cameras, images, points)
    with pytest.raises(InvalidInputError, match="77"):
        read_colmap(tmp_path)


def test_a_model_without_points(tmp_path, kind):
    cameras, images, _ = make_model()
    WRITERS[kind](tmp_path, cameras, images, [])
    with pytest.raises(InvalidInputError, match="no points"):
        read_colmap(tmp_path)


def test_pycolmap_is_never_imported(tmp_path):
    write_binary(tmp_path, *make_model())
    code = (
        f"import sys; from sympose.io import read; read({str(tmp_path)!r}); print('pycolmap' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


_ORACLE = """
import json, sys
import numpy as np
import pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
centers, pixels = {}, {}
points = {number: point.xyz for number, point in model.points3D.items()}
# By number: pycolmap cuts names in text files at the first blank.
for image in model.images.values():
    centers[image.image_id] = image.projection_center().tolist()
    pixels[image.image_id] = {}
    for number, xyz in points.items():
        pixel = image.project_point(xyz)
        if pixel is not None:
            pixels[image.image_id][number] = np.asarray(pixel).tolist()
print(json.dumps([centers, pixels]))
"""


@pytest.mark.skipif(importlib.util.find_spec("pycolmap") is None, reason="pycolmap is not installed")
def test_centers_and_pixels_agree_with_pycolmap(tmp_path, kind):
    """In a process of its own, since pycolmap does not share one with every other native library."""
    cameras, images, points = make_model()
    WRITERS[kind](tmp_path, cameras, images, points)
    done = subprocess.run(
        [sys.executable, "-c", _ORACLE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        pytest.skip(f"pycolmap does not run here: {done.stderr[-200:]}")
    centers, pixels = json.loads(done.stdout)
    scene = read_colmap(tmp_path)
    compared = 0
    for number, view in zip(sorted(image["id"] for image in images), scene.views, strict=True):
        np.testing.assert_allclose(view.center, centers[str(number)], atol=1e-9)
        got, depth, _ = view.project(scene.points)
        for k, point in enumerate(points):
            expected = pixels[str(number)].get(str(point["id"]))
            if expected is not None and depth[k] > 0.0 and np.isfinite(got[k, 0]):
                np.testing.assert_allclose(got[k] + 0.5, expected, rtol=1e-9, atol=1e-6)
                compared += 1
    assert compared > 20
