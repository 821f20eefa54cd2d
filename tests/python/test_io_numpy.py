"""NumPy's own files: arrays with and without a name, depth images, and what is wrong with them."""

import numpy as np
import pytest

from sympose.errors import InvalidInputError
from sympose.io import read, write

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(20, 3)) * 100.0
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)


def test_npy_with_six_columns(tmp_path):
    np.save(tmp_path / "cloud.npy", np.asfortranarray(np.hstack([POINTS, NORMALS])))
    scene = read(tmp_path / "cloud.npy")
    np.testing.assert_array_equal(scene.points, POINTS)
    np.testing.assert_array_equal(scene.normals, NORMALS)
    assert scene.colors is None


def test_npz_with_viewpoints(tmp_path):
    np.savez(tmp_path / "cloud.npz", points=POINTS, viewpoints=np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(read(tmp_path / "cloud.npz").viewpoints, [[1.0, 2.0, 3.0]] * 20)


@pytest.mark.parametrize("suffix", ["npy", "npz"])
@pytest.mark.parametrize("shape", [(20, 3), (4, 5, 3)])
def test_an_array_without_a_name(tmp_path, suffix, shape):
    save = np.save if suffix == "npy" else np.savez
    save(tmp_path / f"cloud.{suffix}", POINTS.reshape(shape))
    np.testing.assert_array_equal(read(tmp_path / f"cloud.{suffix}").points, POINTS)


@pytest.mark.parametrize("key", ["depth", "depth_m"])
def test_npz_with_a_depth_image(tmp_path, key):
    depth = np.full((4, 5), 2000, dtype=np.uint16)
    depth[0, 0] = 0
    pose = np.eye(4)
    pose[:3, 3] = [1.0, 2.0, 3.0]
    rgb = np.full((4, 5, 3), 9, dtype=np.uint8)
    matrix = np.array([[6.0, 0.0, 2.1], [0.0, 6.5, 1.4], [0.0, 0.0, 1.0]])
    np.savez(tmp_path / "d.npz", **{key: depth}, K=matrix, rgb=rgb, world_from_camera=pose, depth_scale=0.001)
    scene = read(tmp_path / "d.npz")
    (view,) = scene.views
    pixels, z, _ = view.project(scene.points)
    assert len(scene) == 19
    np.testing.assert_allclose(pixels[0], [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(z, 2.0)
    np.testing.assert_array_equal(view.camera.matrix, matrix)
    np.testing.assert_array_equal(scene.viewpoints, [[1.0, 2.0, 3.0]] * 19)
    np.testing.assert_array_equal(scene.colors, 9)
    assert scene.name == "d.npz"


@pytest.mark.parametrize(
    "content",
    [
        {"cloud": POINTS},
        {"depth": np.ones((4, 5))},
        {"depth": np.ones((4, 5)), "K": np.eye(4)},
        {"depth": np.ones((4, 5)), "K": np.ones((3, 3))},
        {"depth": np.ones((4, 5)), "K": [[5.0, 0.0, 2.0], [0.1, 5.0, 2.0], [0.0, 0.0, 1.0]]},
        {"depth": np.ones(20), "K": np.eye(3)},
        {"depth": np.zeros((4, 5)), "K": np.eye(3)},
        {"points": POINTS[:, :2]},
        {"points": np.array([{"x": 1}], dtype=object)},
    ],
)
def test_npz_without_what_is_needed(tmp_path, content):
    np.savez(tmp_path / "cloud.npz", **content)
    with pytest.raises(InvalidInputError):
        read(tmp_path / "cloud.npz")


def test_npy_of_the_wrong_shape_or_type(tmp_path):
    for array in (POINTS[:, :2], POINTS[0], POINTS[None, None], np.array(["a"]), np.empty((0, 3))):
        np.save(tmp_path / "cloud.npy", array)
        with pytest.raises(InvalidInputError, match=r"cloud\.npy"):
            read(tmp_path / "cloud.npy")


def test_npz_with_a_scale_in_an_array(tmp_path):
    depth, matrix = np.full((4, 5), 2000), np.array([[6.0, 0.0, 2.1], [0.0, 6.5, 1.4], [0.0, 0.0, 1.0]])
    path = tmp_path / "d.npz"
    for shape in ((), (1,), (1, 1)):
        np.savez(path, depth=depth, K=matrix, depth_scale=np.full(shape, 0.001))
        np.testing.assert_array_equal(read(path).points[:, 2], 2.0)
    for scale in ([0.001, 0.001], [], ["0.001"]):
        np.savez(path, depth=depth, K=matrix, depth_scale=np.array(scale))
        with pytest.raises(InvalidInputError, match=r"d\.npz: depth_scale must") as caught:
            read(path)
        assert "damaged" not in str(caught.value)


def test_npz_whose_directory_lies_before_the_file(tmp_path):
    path = tmp_path / "cloud.npz"
    write(path, POINTS)
    content = bytearray(path.read_bytes())
    # The offset of the central directory, in the last record of the archive.
    content[-3] = 1
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match=r"cloud\.npz"):
        read(path)
