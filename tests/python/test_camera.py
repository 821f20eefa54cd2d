"""Cameras and views: projection against a brute-force oracle, distortion and its inverse, validation."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sympose.camera import PinholeCamera, View
from sympose.errors import InvalidInputError

DISTORTIONS = [
    (),
    (0.08,),
    (-0.2,),
    (-0.3, 0.12),
    (-0.28, 0.07, 1e-3, -2e-3),
    (0.1, -0.05, -3e-3, 1e-3, 0.02),
]


def make(distortion=(), **changes):
    sizes = {"width": 64, "height": 48, "fx": 60.0, "fy": 62.0, "cx": 31.2, "cy": 23.9}
    return PinholeCamera(**{**sizes, **changes}, distortion=distortion)


def rotation(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def pose(seed, scale=1.0):
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(seed)
    matrix[:3, 3] = scale * np.random.default_rng(seed + 1).normal(size=3)
    return matrix


def project_one(camera, point):
    """The camera equations one point at a time, as OpenCV's documentation writes them."""
    k1, k2, p1, p2, k3 = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    x, y = point[0] / point[2], point[1] / point[2]
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    yd = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return camera.fx * xd + camera.cx, camera.fy * yd + camera.cy


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_projection_follows_the_camera_equations(distortion):
    camera = make(distortion)
    points = np.random.default_rng(0).uniform([-0.5, -0.4, 1.0], [0.5, 0.4, 3.0], (200, 3))
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(pixels, [project_one(camera, point) for point in points], atol=1e-9)
    np.testing.assert_array_equal(depth, points[:, 2])


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_unproject_inverts_project_on_every_pixel(distortion):
    camera = make(distortion)
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    depth = np.random.default_rng(1).uniform(0.5, 4.0, len(pixels))
    points = camera.unproject(pixels, depth)
    back, depth_back = camera.project(points)
    np.testing.assert_allclose(back, pixels, atol=1e-7)
    np.testing.assert_allclose(depth_back, depth)


@given(
    st.floats(-0.6, 0.6),
    st.floats(-0.3, 0.3),
    st.floats(-5e-3, 5e-3),
    st.floats(-5e-3, 5e-3),
    st.integers(0, 2**31),
)
def test_a_point_seen_in_the_image_is_the_point_that_its_pixel_unprojects_to(k1, k2, p1, p2, seed):
    """No point from far off the axis may be folded back into the image."""
    camera = make((k1, k2, p1, p2))
    points = np.random.default_rng(seed).uniform([-6.0, -6.0, 0.1], [6.0, 6.0, 3.0], (300, 3))
    pixels, depth = camera.project(points)
    seen = camera.contains(pixels)
    back = camera.unproject(pixels[seen], depth[seen])
    found = np.isfinite(back[:, 0])
    # Tangential terms shift the edge of the reach a little; next to it the inverse is not unique.
    radius = np.linalg.norm(points[seen][:, :2] / depth[seen][:, None], axis=1)
    clear = found & (radius < 0.9 * np.sqrt(camera._radius_limit_sq()))
    np.testing.assert_allclose(back[clear], points[seen][clear], atol=1e-4)


def test_points_beyond_the_reach_of_the_distortion_have_no_pixel():
    camera = make((-0.5,))  # r (1 - r^2 / 2) turns round at r = sqrt(2 / 3)
    reach = np.sqrt(2.0 / 3.0)
    points = np.array([[0.99 * reach, 0.0, 1.0], [1.01 * reach, 0.0, 1.0], [np.sqrt(2.0), 0.0, 1.0]])
    pixels, _ = camera.project(points)
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1:]).all()
    # The last one would land on the principal point.
    assert project_one(camera, points[2]) == pytest.approx((camera.cx, camera.cy))


def test_unproject_gives_nan_where_the_distortion_does_not_reach():
    camera = make((-0.5,), fx=20.0, fy=20.0)
    corner = camera.unproject([[0.0, 0.0], [31.0, 24.0]], 1.0)
    assert np.isnan(corner[0, :2]).all()
    assert np.isfinite(corner[1]).all()


@pytest.mark.parametrize("bad", [[0, 0, 0], [0, 0, -1], [np.nan, 0, 1], [0, np.inf, 1], [0, 0, np.inf]])
def test_points_without_a_pixel(bad):
    pixels, depth = make().project([bad, [0.0, 0.0, 1.0]])
    assert np.isnan(pixels[0]).all()
    assert np.isfinite(pixels[1]).all()
    assert depth.shape == (2,)


def test_the_image_ends_half_a_pixel_beyond_the_outer_centres():
    camera = make()
    pixels = np.array([[-0.5, -0.5], [63.49, 47.49], [-0.51, 0.0], [63.5, 0.0], [0.0, 47.5], [np.nan, 0.0]])
    assert camera.contains(pixels).tolist() == [True, True, False, False, False, False]


def test_no_points():
    pixels, depth = make((0.1, 0.0)).project(np.empty((0, 3)))
    assert pixels.shape == (0, 2)
    assert depth.shape == (0,)
    assert make((0.1,)).unproject(np.empty((0, 2)), np.empty(0)).shape == (0, 3)


@pytest.mark.parametrize(
    "variant",
    [
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: a.T.copy().T,
        lambda a: a.tolist(),
    ],
)
def test_memory_order_does_not_matter(variant):
    points = np.random.default_rng(3).uniform([-1, -1, 1], [1, 1, 3], (50, 3))
    view = View(make((-0.1, 0.01)), pose(4))
    expected = view.project(points)
    for got, want in zip(view.project(variant(points)), expected, strict=True):
        np.testing.assert_array_equal(got, want)


def test_float32_and_read_only_points():
    points = np.random.default_rng(3).uniform([-1, -1, 1], [1, 1, 3], (50, 3)).astype(np.float32)
    points.flags.writeable = False
    pixels, _ = make().project(points)
    np.testing.assert_array_equal(pixels, make().project(points.astype(np.float64))[0])


@given(st.integers(0, 2**31))
def test_view_projects_as_its_camera_does_in_the_camera_frame(seed):
    view = View(make((0.05, -0.01)), pose(seed, 3.0))
    points = np.random.default_rng(seed).normal(size=(30, 3))
    homogeneous = np.c_[points, np.ones(30)] @ np.linalg.inv(view.world_from_camera).T
    pixels, depth = view.camera.project(homogeneous[:, :3])
    got_pixels, got_depth, visible = view.project(points)
    np.testing.assert_allclose(got_depth, depth, atol=1e-12)
    both = np.isfinite(pixels[:, 0]) & np.isfinite(got_pixels[:, 0]) & (depth > 0.05)
    np.testing.assert_allclose(got_pixels[both], pixels[both], rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(visible, view.camera.contains(got_pixels))
    np.testing.assert_allclose(view.camera_from_world @ view.world_from_camera, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(view.to_camera([view.center]), [[0.0, 0.0, 0.0]], atol=1e-12)


def test_infinite_points_are_seen_by_none_and_warn_of_nothing():
    pixels, _, visible = View(make(()), pose(3)).project([[np.inf, 0.0, 0.0], [-np.inf, np.inf, 1.0]])
    assert not np.isfinite(pixels).any()
    assert not visible.any()


def test_georeferenced_coordinates_lose_nothing():
    origin = np.array([4.5e5, 5.4e6, 300.0])
    near, far = pose(5), pose(5)
    far[:3, 3] += origin
    points = near[:3, 3] + np.random.default_rng(6).normal(size=(20, 3))
    pixels, depth, _ = View(make(), near).project(points)
    far_pixels, far_depth, _ = View(make(), far).project(points + origin)
    np.testing.assert_allclose(far_depth, depth, atol=1e-8)
    close = depth > 0.1
    np.testing.assert_allclose(far_pixels[close], pixels[close], rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 0}, "width"),
        ({"height": -3}, "height"),
        ({"width": 64.5}, "width"),
        ({"width": True}, "width"),
        ({"fx": 0.0}, "fx"),
        ({"fy": -1.0}, "fy"),
        ({"fx": np.nan}, "fx"),
        ({"cx": np.inf}, "cx"),
        ({"cy": "middle"}, "cy"),
        ({"fx": [1.0, 2.0]}, "fx"),
        ({"distortion": (1.0, 2.0, 3.0)}, "distortion"),
        ({"distortion": (np.nan,)}, "distortion"),
        ({"distortion": ((1.0,),)}, "distortion"),
    ],
)
def test_camera_says_which_argument_is_wrong(changes, message):
    distortion = changes.pop("distortion", ())
    with pytest.raises(InvalidInputError, match=message):
        make(distortion, **changes)


def test_camera_is_a_value():
    camera = make([0.1, 0.2], width=np.int64(64), fx=np.float32(60.0))
    assert camera == make((0.1, 0.2))
    assert hash(camera) == hash(make((0.1, 0.2)))
    assert isinstance(camera.width, int)
    np.testing.assert_array_equal(camera.matrix, [[60.0, 0.0, 31.2], [0.0, 62.0, 23.9], [0.0, 0.0, 1.0]])
    with pytest.raises(AttributeError):
        camera.width = 3


@pytest.mark.parametrize(
    "call",
    [
        lambda: make().project(np.zeros((3, 2))),
        lambda: make().project([["a", "b", "c"]]),
        lambda: make().unproject(np.zeros((3, 3)), 1.0),
        lambda: make().unproject(np.zeros((3, 2)), np.ones(2)),
        lambda: View(make(), np.eye(4)).project(np.zeros(3)),
        lambda: View("camera", np.eye(4)),
    ],
)
def test_wrong_shapes_and_types(call):
    with pytest.raises(InvalidInputError):
        call()


def test_view_says_how_far_a_pose_is_off_rigid():
    scaled = np.diag([1.01, 1.0, 1.0, 1.0])
    with pytest.raises(InvalidInputError, match=r"off by 0\.0201"):
        View(make(), scaled)
    with pytest.raises(InvalidInputError, match="mirrors"):
        View(make(), np.diag([-1.0, 1.0, 1.0, 1.0]))
    with pytest.raises(InvalidInputError, match="last row"):
        View(make(), np.eye(4) + np.diag([1.0], -3))
    with pytest.raises(InvalidInputError, match="finite"):
        View(make(), np.full((4, 4), np.nan))
    with pytest.raises(InvalidInputError, match=r"\(4, 4\)"):
        View(make(), np.eye(3))


@given(st.integers(0, 2**31))
def test_a_pose_printed_with_four_digits_becomes_exactly_rigid(seed):
    exact = pose(seed)
    view = View(make(), exact.round(4))
    r = view.world_from_camera[:3, :3]
    np.testing.assert_allclose(r.T @ r, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(r, exact[:3, :3], atol=3e-4)


def test_view_keeps_its_own_pose_and_survives_copying():
    matrix = pose(9)
    view = View(make(), matrix, "left")
    matrix[:] = 0.0
    assert view.world_from_camera[3, 3] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        view.world_from_camera[0, 0] = 2.0
    for other in (copy.deepcopy(view), pickle.loads(pickle.dumps(view))):
        np.testing.assert_array_equal(other.world_from_camera, view.world_from_camera)
        assert (other.name, other.camera) == ("left", view.camera)
