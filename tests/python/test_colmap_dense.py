"""Workspaces of COLMAP's stereo_fusion: the cloud, the cameras, and which of them saw a point."""

import importlib.util
import struct
import subprocess
import sys

import numpy as np
import pytest
from trimesh.transformations import quaternion_from_matrix

import sympose
from sympose import datasets
from sympose.errors import InvalidInputError
from sympose.io import read, read_colmap, write
from sympose.io.files import write_scene
from sympose.scene import Scene


def cameras_on_a_circle(toward):
    """Eight views from a circle of radius 5 about the origin, `toward` it (1) or away from it (-1)."""
    camera = sympose.PinholeCamera(64, 48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
    views = []
    for angle in 2.0 * np.pi * np.arange(8) / 8:
        pose = np.eye(4)
        pose[:3, 3] = 5.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
        pose[:3, 2] = -toward / 5.0 * pose[:3, 3]
        pose[:3, 1] = [0.0, 0.0, -1.0]
        pose[:3, 0] = np.cross(pose[:3, 1], pose[:3, 2])
        views.append(sympose.View(camera, pose))
    return views


def write_views(folder, views):
    """The model of a workspace: pinhole cameras, and images that are not in the order of their numbers."""
    (folder / "sparse").mkdir()
    cameras, images = "", ""
    for k, view in enumerate(views):
        camera, pose = view.camera, view.camera_from_world
        number = (5 * k + 3) % len(views)
        cameras += f"{k} PINHOLE {camera.width} {camera.height} {camera.fx} {camera.fy} "
        cameras += f"{camera.cx + 0.5} {camera.cy + 0.5}\n"
        numbers = " ".join(str(x) for x in (*quaternion_from_matrix(pose), *pose[:3, 3]))
        images += f"{number} {numbers} {k} {k}.png\n\n"
    (folder / "sparse/cameras.txt").write_text(cameras)
    (folder / "sparse/images.txt").write_text(images)
    (folder / "sparse/points3D.txt").write_text("")


def make_workspace(folder, count=40):
    """A cloud in sight of all cameras, each point seen by some of them; of each the nearest that saw it."""
    views = cameras_on_a_circle(1)
    write_views(folder, views)
    rng = np.random.default_rng(6)
    xyz = rng.uniform(-0.5, 0.5, size=(count, 3))
    write(folder / "fused.ply", xyz, normals=rng.normal(size=(count, 3)))
    tracks = [rng.choice(len(views), size=rng.integers(1, 5), replace=False) for _ in xyz]
    write_visibility(folder, tracks)
    centers = np.array([view.center for view in views])
    nearest = [
        centers[track[np.linalg.norm(centers[track] - point, axis=1).argmin()]]
        for point, track in zip(xyz, tracks, strict=True)
    ]
    return xyz, np.array(nearest)


def write_visibility(folder, tracks):
    data = struct.pack("<Q", len(tracks))
    for track in tracks:
        data += struct.pack(f"<{1 + len(track)}I", len(track), *track)
    (folder / "fused.ply.vis").write_bytes(data)


def test_the_cloud_with_the_cameras_that_saw_it(tmp_path):
    xyz, nearest = make_workspace(tmp_path)
    scene = read_colmap(tmp_path)
    np.testing.assert_array_equal(scene.points, xyz)
    # Images are named by their place in the file, and views come in the order of their numbers.
    np.testing.assert_allclose(scene.viewpoints, nearest, atol=1e-12)
    assert scene.normals.shape == xyz.shape
    assert len(scene.views) == 8
    assert scene.name == tmp_path.name
    np.testing.assert_array_equal(read(tmp_path).viewpoints, scene.viewpoints)


def test_without_the_file_that_tells_what_saw_a_point(tmp_path):
    xyz, _ = make_workspace(tmp_path)
    (tmp_path / "fused.ply.vis").unlink()
    scene = read_colmap(tmp_path)
    assert len(scene) == len(xyz)
    assert scene.viewpoints is None
    assert len(scene.views) == 8


def test_a_point_that_nothing_saw(tmp_path):
    xyz, _ = make_workspace(tmp_path)
    write_visibility(tmp_path, [[0]] * (len(xyz) - 1) + [[]])
    assert read_colmap(tmp_path).viewpoints is None


@pytest.mark.parametrize(
    ("tracks", "message"),
    [([[0]] * 39, "39 points.*has 40"), ([[0]] * 39 + [[8]], "image 8.*has 8")],
    ids=["of another cloud", "of another model"],
)
def test_visibility_that_does_not_fit(tmp_path, tracks, message):
    make_workspace(tmp_path)
    write_visibility(tmp_path, tracks)
    with pytest.raises(InvalidInputError, match=f"fused.ply.vis: .*{message}"):
        read_colmap(tmp_path)


def test_visibility_of_another_model(tmp_path):
    """Points said to be seen by cameras that look elsewhere, as where images were numbered anew."""
    views = cameras_on_a_circle(-1)
    write_views(tmp_path, views)
    write(tmp_path / "fused.ply", [2.0 * view.center for view in views])
    write_visibility(tmp_path, [[k] for k in range(8)])
    np.testing.assert_allclose(read_colmap(tmp_path).viewpoints, [view.center for view in views], atol=1e-12)
    write_visibility(tmp_path, [[(k + 4) % 8] for k in range(8)])
    with pytest.raises(InvalidInputError, match="8 of 8 points are not in the picture"):
        read_colmap(tmp_path)


def test_points_that_are_not_finite_or_too_far_leave_the_others(tmp_path):
    xyz, nearest = make_workspace(tmp_path)
    xyz[[3, 17]] = [[np.nan, 0.0, 0.0], [1e200, 0.0, 0.0]]
    write(tmp_path / "fused.ply", xyz)
    others = np.delete(np.arange(len(xyz)), [3, 17])
    np.testing.assert_allclose(read_colmap(tmp_path).viewpoints[others], nearest[others], atol=1e-12)


def test_a_model_beside_the_cloud(tmp_path):
    xyz, _ = make_workspace(tmp_path)
    for path in (tmp_path / "sparse").iterdir():
        path.rename(tmp_path / path.name)
    (tmp_path / "sparse").rmdir()
    assert len(read_colmap(tmp_path)) == len(xyz)


@pytest.mark.parametrize("name", ["fused.ply", "fused.ply.vis"])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.99])
def test_files_that_are_cut_off(tmp_path, name, share):
    make_workspace(tmp_path)
    path = tmp_path / name
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InvalidInputError, match=f"{name}: "):
        read_colmap(tmp_path)


def test_a_cloud_without_points_or_without_a_model(tmp_path):
    make_workspace(tmp_path)
    for path in (tmp_path / "sparse").iterdir():
        path.unlink()
    with pytest.raises(InvalidInputError, match="sparse: not a COLMAP model"):
        read_colmap(tmp_path)
    columns = "".join(f"property float {name}\n" for name in "xyz")
    header = f"ply\nformat ascii 1.0\nelement vertex 0\n{columns}end_header\n"
    (tmp_path / "fused.ply").write_text(header)
    with pytest.raises(InvalidInputError, match=r"fused.ply: .* no points"):
        read_colmap(tmp_path)


def fuse(scan, size, least):
    """What `least` views of a scan agree on, and which these are: means over the cells of a grid."""
    points, views = scan.scene.points, len(scan.scene.views)
    _, cell = np.unique(np.floor(points / size).astype(int), axis=0, return_inverse=True)
    cell = cell.ravel()
    means = np.stack([np.bincount(cell, x) for x in points.T], axis=1) / np.bincount(cell)[:, None]
    owner, view = np.divmod(np.unique(cell * views + scan.view_of_point), views)
    ends = np.cumsum(np.bincount(owner))
    tracks = np.split(view, ends[:-1])
    agreed = [i for i, track in enumerate(tracks) if len(track) >= least]
    return means[agreed], [tracks[i] for i in agreed]


def test_holes_show_in_a_fused_cloud(tmp_path):
    """Were points measured by the nearest camera alone, the others would have lost them, and the holes."""
    flange = datasets.part("flange_8")
    scan = datasets.scan(flange, views=16, seed=7)
    xyz, tracks = fuse(scan, 0.006, 4)
    write(tmp_path / "fused.ply", xyz)
    write_visibility(tmp_path, tracks)
    write_views(tmp_path, scan.scene.views)
    scene = read_colmap(tmp_path)
    write_scene(tmp_path / "fused.npz", scene)
    estimate = sympose.estimate(scene)
    assert estimate.order == 8
    assert estimate.score > 0.9
    # What is kept of the scene, or written, knows the cameras, too.
    for again in (Scene.merge([scene]), scene.select(np.arange(len(scene))), read(tmp_path / "fused.npz")):
        assert sympose.estimate(again, views=()).order == 8
    axis = scan.world_from_object[:3, :3] @ flange.axis
    assert np.degrees(np.arccos(min(1.0, abs(estimate.axis @ axis)))) < 0.1


_FUSE = """
import sys
import pycolmap
options = pycolmap.StereoFusionOptions()
options.min_num_pixels, options.num_threads = 2, 1
folder = sys.argv[1]
pycolmap.stereo_fusion(f"{folder}/fused.ply", folder, output_type="PLY", options=options)
"""


def make_depth_maps(folder, size=(64, 48), focal=60.0, distance=4.0):
    """A ball of radius 1 at the origin, as stereo leaves it: model, depth and normal maps, and images."""
    from PIL import Image

    width, height = size
    for name in ("sparse", "images", "stereo/depth_maps", "stereo/normal_maps"):
        (folder / name).mkdir(parents=True)
    rows, columns = np.mgrid[:height, :width]
    rays = np.stack(
        [(columns - width / 2 + 0.5) / focal, (rows - height / 2 + 0.5) / focal, np.ones(rows.shape)]
    )
    # |z ray - (0, 0, distance)| = 1, the nearer of two.
    square = (rays**2).sum(axis=0)
    with np.errstate(invalid="ignore"):
        depth = np.nan_to_num((distance - np.sqrt(distance**2 - square * (distance**2 - 1.0))) / square)
    normals = np.where(depth > 0.0, depth * rays - np.array([0.0, 0.0, distance])[:, None, None], 0.0)
    images, names = [], []
    for k in range(8):
        angle = np.pi * k / 8  # half of it about y, so that neighbours see the same
        number, name = (7 * k) % 8 + 1, f"{k}.png"
        images.append(
            (number, f"{number} {np.cos(angle)} 0 {np.sin(angle)} 0 0 0 {distance} 1 {name}\n0 0 1\n")
        )
        names.append(name)
        for kind, planes in (("depth", depth[None]), ("normal", normals)):
            header = f"{width}&{height}&{len(planes)}&".encode()
            path = folder / f"stereo/{kind}_maps/{name}.geometric.bin"
            path.write_bytes(header + planes.astype("<f4").tobytes())
        Image.fromarray(np.full((height, width, 3), 128, np.uint8)).save(folder / "images" / name)
    (folder / "stereo/fusion.cfg").write_text("\n".join(names) + "\n")
    (folder / "stereo/patch-match.cfg").write_text("".join(f"{name}\n__auto__, 8\n" for name in names))
    (folder / "sparse/cameras.txt").write_text(
        f"1 PINHOLE {width} {height} {focal} {focal} {width / 2} {height / 2}\n"
    )
    (folder / "sparse/images.txt").write_text("".join(line for _, line in sorted(images)))
    # One point that all see: COLMAP compares the depths of images that share one.
    track = " ".join(f"{number} 0" for number, _ in images)
    (folder / "sparse/points3D.txt").write_text(f"1 0 0 0 128 128 128 0.5 {track}\n")


@pytest.mark.skipif(importlib.util.find_spec("pycolmap") is None, reason="pycolmap is not installed")
def test_what_colmap_itself_fused(tmp_path):
    """In a process of its own, since pycolmap does not share one with every other native library."""
    make_depth_maps(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", _FUSE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        pytest.skip(f"pycolmap does not run here: {done.stderr[-200:]}")
    scene = read_colmap(tmp_path)
    assert len(scene) > 1000
    # COLMAP fuses as if the centre of a pixel were its corner: half a pixel is 0.03.
    np.testing.assert_allclose(np.linalg.norm(scene.points, axis=1), 1.0, atol=0.05)
    assert len(np.unique(scene.viewpoints, axis=0)) > 4
    # A camera at c sees the point p of the unit ball where c . p >= 1.
    assert ((scene.viewpoints * scene.points).sum(axis=1) > 0.9).all()
    assert ((scene.normals * scene.viewpoints).sum(axis=1) > 0.0).all()
