"""Segmentation: the background goes, the part stays whole, and doubt is said."""

import functools

import numpy as np
import pytest
import sklearn.mixture
from hypothesis import given, settings
from hypothesis import strategies as st

from sympose.camera import PinholeCamera, View
from sympose.errors import InvalidInputError
from sympose.segmentation import segment

CAMERA = PinholeCamera(320, 240, fx=507.0, fy=507.0, cx=159.5, cy=119.5)
WIDE = PinholeCamera(320, 240, fx=507.0, fy=507.0, cx=159.5, cy=119.5, distortion=(-0.1, 0.02, 1e-3, -1e-3))


def look_at(center, target=(0.0, 0.0, 0.0), camera=CAMERA, name=None):
    center, target = np.asarray(center, float), np.asarray(target, float)
    forward = (target - center) / np.linalg.norm(target - center)
    helper = [0.0, 0.0, 1.0] if abs(forward[2]) < 0.99 else [0.0, 1.0, 0.0]
    right = np.cross(forward, helper)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(forward, right), forward, center
    return View(camera, pose, name)


def around(count, cosine=0.5, sector=1.0, distance=2.2, camera=CAMERA):
    """Views from above, all on the side of -y."""
    azimuths = -np.pi / 2 + np.linspace(-sector, sector, count) if count > 1 else [-np.pi / 2]
    sine = np.sqrt(1.0 - cosine**2)
    return [
        look_at(distance * np.array([sine * np.cos(a), sine * np.sin(a), cosine]), camera=camera)
        for a in azimuths
    ]


# Parts of diameter 1 about the z axis; all are surfaces with a little noise.


def disc(rng, n=6000, r_min=0.0, r_max=0.5, z=0.0):
    r = np.sqrt(rng.uniform(r_min**2, r_max**2, n))
    a = rng.uniform(0, 2 * np.pi, n)
    return np.stack([r * np.cos(a), r * np.sin(a), np.full(n, z)], axis=1) + rng.normal(0, 1e-3, (n, 3))


def ring(rng, n=6000, radius=0.5, height=0.1):
    a = rng.uniform(0, 2 * np.pi, n)
    z = rng.uniform(-height / 2, height / 2, n)
    return np.stack([radius * np.cos(a), radius * np.sin(a), z], axis=1) + rng.normal(0, 1e-3, (n, 3))


def blades(rng, n=6000, count=2, hub=0.12):
    """Blades without anything between them: the hub gives no echo."""
    r, w = rng.uniform(hub, 0.5, n), rng.uniform(-0.06, 0.06, n)
    a = rng.integers(count, size=n) * 2 * np.pi / count
    x, y, z = r * np.cos(a) - w * np.sin(a), r * np.sin(a) + w * np.cos(a), 0.3 * w
    return np.stack([x, y, z], axis=1) + rng.normal(0, 1e-3, (n, 3))


def hub(rng, n=6000):
    """A flange with a boss, and nothing between them."""
    return np.concatenate([disc(rng, n // 2, 0.2), disc(rng, n // 2, 0.0, 0.2, z=0.25)])


def ball(rng, n=6000):
    p = rng.normal(size=(n, 3))
    return 0.49 * p / np.linalg.norm(p, axis=1, keepdims=True)


PARTS = [disc, ring, blades, functools.partial(blades, count=5), hub, ball]


def rectangle(rng, n, x, y, z):
    return rng.uniform(*np.array([x, y, z], float).T, (n, 3)) + rng.normal(0, 1e-3, (n, 3))


def table(rng, n=12000):
    return rectangle(rng, n, (-1.5, 1.5), (-2.5, 1.0), (-0.5, -0.5))


def wall(rng, n=12000):
    return rectangle(rng, n, (-7, 7), (3.0, 3.0), (-4, 5))


def clear_part(rng):
    return ring(rng) + [0.0, 0.0, 0.1]


# ---- a part alone -------------------------------------------------------------------------------


@settings(max_examples=40)
@given(
    part=st.sampled_from(PARTS),
    seed=st.integers(0, 10_000),
    views=st.sampled_from([1, 2, 5]),
    camera=st.sampled_from([CAMERA, WIDE]),
)
def test_a_part_alone_comes_back_whole(part, seed, views, camera):
    rng = np.random.default_rng(seed)
    points = part(rng)
    directions = rng.normal(size=(views, 3))
    centers = 2.3 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    result = segment(points, [look_at(center, camera=camera) for center in centers])
    assert result.mask.all()
    assert all(mixture.threshold is None for mixture in result.mixtures)
    assert all(mixture.reason for mixture in result.mixtures)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("center", [(2.3, 0, 0), (0, 2.2, 0.2), (0, 0, 2.3), (1.5, 0, 1.6)])
def test_a_part_seen_edge_on_or_from_its_front_comes_back_whole(part, center):
    result = segment(part(np.random.default_rng(0)), [look_at(center)])
    assert result.mask.all()
    assert result.mixtures[0].threshold is None
    assert not [warning for warning in result.warnings if "overlap" in warning]


# ---- background ---------------------------------------------------------------------------------


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("views", [1, 2, 5])
@pytest.mark.parametrize("camera", [CAMERA, WIDE])
def test_the_wall_behind_a_part_goes_also_where_the_part_hides_it(part, views, camera):
    rng = np.random.default_rng(1)
    points = np.concatenate([part(rng), wall(rng)])
    result = segment(points, around(views, cosine=0.2, sector=0.3, camera=camera))
    assert result.mask[:6000].all()
    assert not result.mask[6000:].any()
    for mixture in result.mixtures:
        assert 2.5 < mixture.threshold < 5.0


@pytest.mark.parametrize("views", [1, 2, 3, 5])
def test_part_and_table_stay_when_the_wall_goes(views):
    rng = np.random.default_rng(2)
    points = np.concatenate([clear_part(rng), table(rng), wall(rng)])
    result = segment(points, around(views, cosine=0.4, sector=0.4))
    assert result.mask[:6000].all()
    seen_table = result.votes[6000:18000, 1] > 0
    assert result.mask[6000:18000][seen_table].mean() > 0.98
    assert result.mask[18000:].mean() < 0.01


def test_a_second_background_is_found_in_a_later_round():
    """Far, sparse points stretch the depths so far that at first only they are told apart."""
    rng = np.random.default_rng(3)
    far = rectangle(rng, 4000, (-120, 120), (300, 320), (-120, 80))
    points = np.concatenate([ball(rng), wall(rng, 8000), far])
    result = segment(points, around(1, cosine=0.2))
    assert result.mask[:6000].all()
    assert not result.mask[6000:].any()


def test_stray_points_in_front_do_not_win():
    rng = np.random.default_rng(4)
    stray = rectangle(rng, 60, (-0.1, 0.1), (-1.6, -1.4), (0.1, 0.2))
    points = np.concatenate([ball(rng), wall(rng), stray])
    result = segment(points, around(3, cosine=0.2, sector=0.3))
    assert result.mask[:6000].all()
    assert not result.mask[6000:18000].any()


def test_one_bad_view_does_not_delete_the_part():
    """A camera behind a fence sees the fence first and calls the part background."""
    rng = np.random.default_rng(5)
    part = ball(rng)
    fence = rectangle(rng, 9000, (-2, 2), (3.0, 3.0), (-2, 2))
    good = around(2, cosine=0.2, sector=0.4)
    bad = look_at((0.0, 4.5, 0.3))
    result = segment(np.concatenate([part, fence]), [*good, bad])
    assert result.mixtures[2].threshold is not None
    assert result.mask[:6000].all()
    assert (result.votes[:6000] == [2, 3]).all()
    assert any("2" in warning and "call most" in warning for warning in result.warnings)


def test_overlap_in_every_view_is_said():
    rng = np.random.default_rng(6)
    cloud = rng.uniform([-3, -3, -1], [3, 3, 1], (20000, 3))
    result = segment(cloud, around(3, cosine=0.6))
    assert result.mask.all()
    assert any("overlap in depth in every view" in warning for warning in result.warnings)


# ---- votes --------------------------------------------------------------------------------------


def scene():
    rng = np.random.default_rng(7)
    return np.concatenate([ball(rng), table(rng), wall(rng)]), around(5, cosine=0.4, sector=0.5)


def test_votes_count_the_views_that_see_a_point():
    points, views = scene()
    result = segment(points, views)
    depths, visible = zip(*(view.project(points)[1:] for view in views), strict=True)
    np.testing.assert_array_equal(result.votes[:, 1], np.sum(visible, axis=0))
    foreground = [
        seen & (depth <= (np.inf if mixture.threshold is None else mixture.threshold))
        for depth, seen, mixture in zip(depths, visible, result.mixtures, strict=True)
    ]
    np.testing.assert_array_equal(result.votes[:, 0], np.sum(foreground, axis=0))
    majority = (result.votes[:, 1] > 0) & (2 * result.votes[:, 0] >= result.votes[:, 1])
    np.testing.assert_array_equal(result.mask, majority)


@pytest.mark.parametrize("min_views", [1, 3, 5])
def test_min_views(min_views):
    points, views = scene()
    result = segment(points, views, min_views=min_views)
    np.testing.assert_array_equal(result.mask, result.votes[:, 0] >= min_views)
    assert result.mask[:6000].all()


def test_points_that_no_view_sees():
    rng = np.random.default_rng(8)
    behind_the_camera = rectangle(rng, 500, (-1, 1), (-5, -4), (-1, 1))
    alone = segment(np.concatenate([ball(rng), behind_the_camera]), around(1))
    assert alone.mask.all()
    assert (alone.votes[6000:] == 0).all()
    assert any("500 of 6500" in warning for warning in alone.warnings)
    before_a_wall = segment(np.concatenate([ball(rng), behind_the_camera, wall(rng)]), around(1, cosine=0.2))
    assert before_a_wall.mask[:6000].all()
    assert not before_a_wall.mask[6000:].any()


def test_views_that_see_nothing():
    result = segment(ball(np.random.default_rng(9)), [look_at((0, -2, 0), target=(0, -9, 0))] * 2)
    assert result.mask.all()
    assert any("check the poses" in warning for warning in result.warnings)


def test_points_that_are_not_finite_are_never_foreground():
    points, views = scene()
    points[::7] = np.nan
    points[5, 1] = np.inf
    result = segment(points, views)
    broken = ~np.isfinite(points).all(axis=1)
    assert not result.mask[broken].any()
    assert (result.votes[broken] == 0).all()
    clean = segment(points[~broken], views)
    np.testing.assert_array_equal(result.mask[~broken], clean.mask)


# ---- what must not matter -----------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_unit_and_place_do_not_matter(scale):
    points, views = scene()
    expected = segment(points, views)
    shift = np.array([4.5e5, 5.4e6, 300.0]) * scale
    moved = []
    for view in views:
        pose = view.world_from_camera.copy()
        pose[:3, 3] = scale * pose[:3, 3] + shift
        moved.append(View(view.camera, pose))
    result = segment(scale * points + shift, moved)
    assert (result.mask != expected.mask).mean() < 1e-4


@pytest.mark.parametrize(
    "variant", [np.asfortranarray, lambda a: np.repeat(a, 2, axis=0)[::2], lambda a: a.tolist()]
)
def test_memory_order_does_not_matter(variant):
    points, views = scene()
    np.testing.assert_array_equal(segment(variant(points), views).mask, segment(points, views).mask)


def test_the_order_of_points_and_views_does_not_matter():
    points, views = scene()
    order = np.random.default_rng(0).permutation(len(points))
    expected = segment(points, views)
    np.testing.assert_array_equal(segment(points[order], views).mask, expected.mask[order])
    np.testing.assert_array_equal(segment(points, views[::-1]).mask, expected.mask)


def test_the_same_seed_gives_the_same_bytes_also_where_points_are_drawn():
    points, views = scene()
    many = np.concatenate([points + np.random.default_rng(k).normal(0, 1e-3, points.shape) for k in range(4)])
    first, second = segment(many, views, seed=3), segment(many, views, seed=3)
    assert first.mask.tobytes() == second.mask.tobytes()
    for a, b in zip(first.mixtures, second.mixtures, strict=True):
        assert a.means.tobytes() == b.means.tobytes()
        assert a.threshold == b.threshold
    other = segment(many, views, seed=4)
    assert (other.mask != first.mask).mean() < 0.01


def test_the_input_is_left_alone():
    points, views = scene()
    points.flags.writeable = False
    segment(points, views)
    segment(points.astype(np.float32), views)


# ---- degenerate input ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "points",
    [
        [[0.0, 0.0, 0.0]],
        np.zeros((500, 3)),
        np.linspace([0, 0, 0], [0.2, 0, 0], 500),
        np.random.default_rng(0).normal(size=(30, 3)) * 0.1,
        np.repeat([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]], 300, axis=0),
    ],
)
def test_degenerate_clouds_come_back_whole(points):
    result = segment(points, around(2))
    assert result.mask.all()
    assert len(result.mixtures) == 2


@pytest.mark.parametrize(
    "change",
    [
        {"points": np.empty((0, 3))},
        {"points": np.full((5, 3), np.nan)},
        {"points": np.zeros((5, 2))},
        {"views": []},
        {"views": [np.eye(4)]},
        {"max_components": 0},
        {"max_components": 2.5},
        {"min_views": 0},
        {"min_views": 6},
        {"min_views": True},
        {"seed": -1},
        {"seed": "x"},
    ],
)
def test_bad_arguments(change):
    points, views = scene()
    with pytest.raises(InvalidInputError):
        segment(**{"points": points, "views": views, **change})


# ---- mixtures and plot --------------------------------------------------------------------------


def test_mixtures_are_densities_of_the_depths():
    points, views = scene()
    for mixture in segment(points, views).mixtures:
        assert 1 <= len(mixture.means) <= 5
        assert mixture.weights.sum() == pytest.approx(1.0)
        assert (np.diff(mixture.means) >= 0).all()
        grid = np.linspace(0.0, 30.0, 20001)
        assert np.trapezoid(mixture.density(grid), grid) == pytest.approx(1.0, abs=1e-3)
        share = np.trapezoid(mixture.density(grid[grid <= 2.5]), grid[grid <= 2.5])
        assert share == pytest.approx((mixture.depths <= 2.5).mean(), abs=0.1)


def test_one_component_means_no_cut():
    points, views = scene()
    result = segment(points, views, max_components=1)
    assert result.mask.all()
    assert all(len(mixture.means) == 1 for mixture in result.mixtures)


def test_a_fit_that_does_not_converge_is_said_and_warns_nobody(monkeypatch):
    hasty = functools.partial(sklearn.mixture.GaussianMixture, max_iter=1, tol=1e-12)
    monkeypatch.setattr(sklearn.mixture, "GaussianMixture", hasty)
    points, views = scene()
    assert any("converge" in warning for warning in segment(points, views).warnings)


@pytest.mark.parametrize("views", [1, 5, 9])
def test_plot(tmp_path, views):
    points, _ = scene()
    blind = look_at((0, -2, 0), target=(0, -9, 0))
    figure = segment(points, [*around(views, cosine=0.4, sector=0.4), blind]).plot(tmp_path / "depths.png")
    assert (tmp_path / "depths.png").read_bytes().startswith(b"\x89PNG")
    assert len(figure.axes) == min(views + 1, 6)
