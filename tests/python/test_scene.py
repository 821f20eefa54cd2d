"""Scenes: what goes in comes out checked, depth images become points, scenes join."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sympose.camera import PinholeCamera, View
from sympose.errors import InvalidInputError
from sympose.scene import Scene
from sympose.tracks import Tracks

CAMERA = PinholeCamera(8, 6, fx=7.0, fy=7.5, cx=3.4, cy=2.6)
TURNED = np.array([[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]])
POINTS = np.arange(12.0).reshape(4, 3)


def depth_image():
    return np.random.default_rng(0).uniform(1.0, 2.0, (6, 8))


def test_arrays_are_float64_c_order_and_read_only():
    scene = Scene(np.asfortranarray(POINTS.astype(np.float32)), normals=POINTS[::-1], viewpoints=[1, 2, 3])
    for array in (scene.points, scene.normals, scene.viewpoints):
        assert array.dtype == np.float64
        assert array.shape == (4, 3)
        assert array.flags.c_contiguous
        assert not array.flags.writeable
    np.testing.assert_array_equal(scene.points, POINTS)
    np.testing.assert_array_equal(scene.viewpoints, [[1, 2, 3]] * 4)


def test_one_viewpoint_is_that_of_all_points_as_a_row_too():
    for one in ([1, 2, 3], [[1, 2, 3]]):
        np.testing.assert_array_equal(Scene(POINTS, viewpoints=one).viewpoints, [[1, 2, 3]] * 4)
    with pytest.raises(InvalidInputError, match="viewpoints must have a row"):
        Scene(POINTS, viewpoints=np.empty((0, 3)))


def test_the_callers_array_stays_writable():
    points = POINTS.copy()
    Scene(points)
    points[0, 0] = 5.0


def test_nan_points_pass():
    assert np.isnan(Scene([[np.nan] * 3, [0, 0, 0]]).points[0]).all()


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int16])
def test_what_a_mask_hides_is_nan(kind):
    hidden = np.ma.masked_equal(POINTS.astype(kind), 4)
    for array in (Scene(hidden).points, Scene(POINTS, normals=hidden).normals):
        assert not isinstance(array, np.ma.MaskedArray)
        np.testing.assert_array_equal(array, np.where(POINTS == 4, np.nan, POINTS))
    nothing = np.ma.masked_equal(POINTS.astype(kind), 99)
    np.testing.assert_array_equal(Scene(nothing).points, POINTS)


def test_a_masked_pixel_is_no_return():
    image = np.ma.masked_greater(depth_image(), 1.5)
    scene = Scene.from_depth(image, CAMERA)
    np.testing.assert_array_equal(scene.points, Scene.from_depth(image.filled(0.0), CAMERA).points)
    assert 0 < len(scene) < image.size
    millimetres = np.ma.masked_greater(np.rint(1000 * depth_image()).astype(np.uint16), 1500)
    assert len(Scene.from_depth(millimetres, CAMERA, depth_scale=0.001)) == millimetres.count()
    with pytest.raises(InvalidInputError, match="masked"):
        Scene.from_depth(np.ma.masked_all((6, 8)), CAMERA)


def test_masked_colors_are_refused():
    colors = np.ma.masked_equal(np.arange(12, dtype=np.uint8).reshape(4, 3), 5)
    with pytest.raises(InvalidInputError, match=r"colors\.filled"):
        Scene(POINTS, colors)
    image = np.ma.masked_equal(np.zeros((6, 8, 3), dtype=np.uint8), 0)
    with pytest.raises(InvalidInputError, match=r"color\.filled"):
        Scene.from_depth(depth_image(), CAMERA, color=image)


@pytest.mark.parametrize(
    ("colors", "expected"),
    [
        (np.full((4, 3), 200, dtype=np.uint8), 200),
        (np.full((4, 3), 200, dtype=np.int64), 200),
        (np.full((4, 3), 1.0), 255),
        (np.full((4, 3), 0.5, dtype=np.float32), 128),
        (np.zeros((4, 3)), 0),
    ],
)
def test_colors_become_uint8(colors, expected):
    scene = Scene(POINTS, colors)
    assert scene.colors.dtype == np.uint8
    assert (scene.colors == expected).all()


@pytest.mark.parametrize(
    "arguments",
    [
        {"points": np.zeros((4, 2))},
        {"points": np.zeros(3)},
        {"points": [[1, 2, 3], [4, 5]]},
        {"points": [["x", "y", "z"]]},
        {"points": np.zeros((4, 3), dtype=complex)},
        {"points": None},
        {"points": POINTS, "colors": np.full((4, 3), 1.5)},
        {"points": POINTS, "colors": np.full((4, 3), 256)},
        {"points": POINTS, "colors": np.full((4, 3), np.nan)},
        {"points": POINTS, "colors": np.zeros((3, 3), dtype=np.uint8)},
        {"points": POINTS, "normals": np.zeros((3, 3))},
        {"points": POINTS, "viewpoints": np.zeros((2, 3))},
        {"points": POINTS, "viewpoints": [1.0, 2.0]},
        {"points": POINTS, "views": [np.eye(4)]},
    ],
)
def test_what_does_not_fit_is_refused(arguments):
    with pytest.raises(InvalidInputError):
        Scene(**arguments)


def test_length_and_text():
    view = View(CAMERA, np.eye(4))
    scene = Scene(POINTS, normals=POINTS, views=[view, view], name="part")
    assert len(scene) == 4
    assert repr(scene) == "Scene('part': 4 points, normals, 2 views)"
    assert repr(Scene(np.empty((0, 3)))) == "Scene(0 points)"


def test_depth_image_becomes_the_points_that_project_back_to_it():
    depth = depth_image()
    scene = Scene.from_depth(depth, CAMERA, TURNED)
    pixels, z, visible = scene.views[0].project(scene.points)
    v, u = np.mgrid[:6, :8]
    np.testing.assert_allclose(pixels, np.stack([u.ravel(), v.ravel()], axis=1), atol=1e-9)
    np.testing.assert_allclose(z, depth.ravel())
    assert visible.all()
    np.testing.assert_array_equal(scene.viewpoints, [[1.0, 2.0, 3.0]] * 48)


def test_pixels_without_measurement_are_dropped_and_colors_follow():
    depth = depth_image()
    depth[0, :5] = [0.0, np.nan, np.inf, -1.0, -np.inf]
    color = np.random.default_rng(1).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    scene = Scene.from_depth(depth, CAMERA, color=color)
    assert len(scene) == 43
    np.testing.assert_array_equal(scene.colors, color.reshape(-1, 3)[5:])


@given(st.floats(1e-6, 1e6))
def test_depth_scale_multiplies(scale):
    scene = Scene.from_depth(np.full((6, 8), 2000, dtype=np.uint16), CAMERA, depth_scale=scale)
    np.testing.assert_allclose(scene.points[:, 2], 2000 * scale)


def test_corners_beyond_the_distortion_are_dropped():
    camera = PinholeCamera(8, 6, fx=2.0, fy=2.0, cx=3.5, cy=2.5, distortion=(-0.5,))
    scene = Scene.from_depth(np.ones((6, 8)), camera)
    assert 0 < len(scene) < 48
    assert np.isfinite(scene.points).all()


def test_16_bit_png(tmp_path):
    depth = np.random.default_rng(2).integers(0, 2**16, (6, 8)).astype(np.uint16)
    color = np.random.default_rng(3).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    Image.fromarray(depth).save(tmp_path / "depth.png")
    Image.fromarray(color).save(tmp_path / "color.png")
    scene = Scene.from_depth(
        tmp_path / "depth.png", CAMERA, depth_scale=0.001, color=str(tmp_path / "color.png")
    )
    expected = Scene.from_depth(depth, CAMERA, depth_scale=0.001, color=color)
    np.testing.assert_array_equal(scene.points, expected.points)
    np.testing.assert_array_equal(scene.colors, expected.colors)
    assert scene.name == "depth.png"


def test_files_that_are_no_depth_image(tmp_path):
    Image.fromarray(np.zeros((6, 8, 3), dtype=np.uint8)).save(tmp_path / "rgb.png")
    Image.fromarray(np.ones((6, 8), dtype=np.uint16)).save(tmp_path / "whole.png")
    whole = (tmp_path / "whole.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.png").write_text("no image")
    (tmp_path / "empty.png").touch()
    for name in ("rgb", "cut", "text", "empty"):
        with pytest.raises(InvalidInputError, match=f"{name}.png"):
            Scene.from_depth(tmp_path / f"{name}.png", CAMERA)
    with pytest.raises(FileNotFoundError):
        Scene.from_depth(tmp_path / "missing.png", CAMERA)


@pytest.mark.parametrize(
    "arguments",
    [
        {"depth": np.ones((8, 6))},
        {"depth": np.ones((6, 8, 1))},
        {"depth": np.zeros((6, 8))},
        {"depth": np.full((6, 8), np.nan)},
        {"depth": np.ones((6, 8)), "depth_scale": 0.0},
        {"depth": np.ones((6, 8)), "depth_scale": -1.0},
        {"depth": np.ones((6, 8)), "depth_scale": np.nan},
        {"depth": np.ones((6, 8)), "depth_scale": None},
        {"depth": np.ones((6, 8)), "depth_scale": "large"},
        {"depth": np.ones((6, 8)), "depth_scale": [0.001, 0.001]},
        {"depth": np.ones((6, 8)), "color": np.zeros((6, 8), dtype=np.uint8)},
        {"depth": np.ones((6, 8)), "color": np.full((6, 8, 3), 7.0)},
        {"depth": np.ones((6, 8)), "world_from_camera": 2.0 * np.eye(4)},
    ],
)
def test_bad_depth_arguments(arguments):
    with pytest.raises(InvalidInputError):
        Scene.from_depth(camera=CAMERA, **arguments)


def test_a_depth_image_that_is_all_beyond_the_distortion_model():
    camera = PinholeCamera(8, 6, fx=5.0, fy=5.0, cx=-400.0, cy=2.5, distortion=(1e300, 1e300))
    with pytest.raises(InvalidInputError, match="distortion"):
        Scene.from_depth(np.ones((6, 8)), camera)


def test_merge_keeps_what_all_know():
    a = Scene.from_depth(depth_image(), CAMERA)
    b = Scene.from_depth(depth_image(), CAMERA, TURNED, color=np.ones((6, 8, 3), dtype=np.uint8))
    both = Scene.merge([a, b])
    assert len(both) == 96
    np.testing.assert_array_equal(both.points, np.concatenate([a.points, b.points]))
    np.testing.assert_array_equal(both.viewpoints, np.concatenate([a.viewpoints, b.viewpoints]))
    assert both.views == (*a.views, *b.views)
    assert both.colors is None
    assert Scene.merge([b, b]).colors.shape == (96, 3)
    assert Scene.merge([a, Scene(POINTS)]).viewpoints is None


def test_merge_counts_a_shared_view_once():
    view = View(CAMERA, np.eye(4))
    merged = Scene.merge([Scene(POINTS, views=[view], name="a"), Scene(POINTS, views=[view], name="a")])
    assert merged.views == (view,)
    assert merged.name == "a"
    assert Scene.merge([Scene(POINTS, name="a"), Scene(POINTS, name="b")]).name is None


@pytest.mark.parametrize("scenes", [[], [POINTS]])
def test_merge_needs_scenes(scenes):
    with pytest.raises(InvalidInputError):
        Scene.merge(scenes)


TRACKS = Tracks([[0.0, 0.0, 5.0], [9.0, 0.0, 5.0], [1.0, 1.0, 1.0]], [2, 1, 3], [1, 0, 2, 0, 1, 2])


def test_the_nearest_of_the_cameras_is_the_viewpoint():
    scene = Scene(np.eye(3), tracks=TRACKS)
    np.testing.assert_array_equal(scene.viewpoints, TRACKS.places[[1, 2, 0]])
    assert not scene.tracks.seen_from.flags.writeable


@pytest.mark.parametrize("rows", [[True, False, True], [0, 2]])
def test_some_points_keep_what_is_known_of_them(rows):
    whole = Scene(np.eye(3), np.eye(3), np.eye(3), tracks=TRACKS, name="it")
    some = whole.select(rows)
    for field in ("points", "colors", "normals", "viewpoints"):
        np.testing.assert_array_equal(getattr(some, field), getattr(whole, field)[[0, 2]])
    assert some.tracks.counts.tolist() == [2, 3]
    assert some.tracks.seen_from.tolist() == [1, 0, 0, 1, 2]
    assert some.name == "it"


@pytest.mark.parametrize("rows", [[True, False], [3], [-1], [0.5], [[0]]])
def test_rows_that_are_none_of_the_points(rows):
    with pytest.raises(InvalidInputError, match="rows"):
        Scene(np.eye(3)).select(rows)


def test_merged_scenes_keep_the_cameras_of_all():
    merged = Scene.merge([Scene(np.eye(3), tracks=TRACKS)] * 2)
    assert merged.tracks.counts.tolist() == [2, 1, 3] * 2
    assert merged.tracks.seen_from.tolist() == [1, 0, 2, 0, 1, 2, 4, 3, 5, 3, 4, 5]
    assert Scene.merge([Scene(np.eye(3), tracks=TRACKS), Scene(np.eye(3))]).tracks is None


@pytest.mark.parametrize(
    ("counts", "seen_from", "message"),
    [
        ([1, 0, 1], [0, 1], "at least one"),
        ([1, 1, 1], [0, 1], "add up to, 3"),
        ([1, 1, 1], [0, 1, 3], "3 places, got 3"),
        ([1, 1, -1], [0], "counts must be"),
        ([1, 1, 1], [0.0, 1.0, 0.0], "seen_from must be"),
    ],
)
def test_tracks_that_do_not_fit(counts, seen_from, message):
    with pytest.raises(InvalidInputError, match=message):
        Tracks(TRACKS.places, counts, seen_from)
    with pytest.raises(InvalidInputError, match="2 points"):
        Scene(np.eye(3)[:2], tracks=TRACKS)
