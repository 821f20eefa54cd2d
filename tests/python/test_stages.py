"""Every stage alone, against a brute-force oracle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import sympose
from sympose import InsufficientDataError, InvalidInputError, KdTree
from sympose.metrics import adds, mssd

Points = NDArray[np.float64]
BAD_NUMBERS = (0.0, -1.0, float("nan"), float("inf"))


def clouds(smallest: int = 1, largest: int = 40) -> st.SearchStrategy[Points]:
    """Points on a coarse grid, so that ties and duplicates are common."""
    shape = st.tuples(st.integers(smallest, largest), st.just(3))
    return arrays(np.float64, shape, elements=st.integers(-8, 8).map(lambda i: i / 4.0))


def distances(one: Points, other: Points) -> Points:
    return np.linalg.norm(one[:, None] - other[None], axis=2)


@given(clouds(), clouds(), st.integers(1, 6))
def test_query_finds_the_nearest(points: Points, queries: Points, k: int) -> None:
    distance, index = KdTree(points).query(queries, k)
    expected = np.sort(distances(queries, points), axis=1)[:, :k]
    found = min(k, len(points))
    distance, index = distance.reshape(-1, k), index.reshape(-1, k)
    assert np.allclose(distance[:, :found], expected)
    rows = np.arange(len(queries))[:, None]
    assert np.allclose(distances(queries, points)[rows, index[:, :found]], expected)
    assert np.isinf(distance[:, found:]).all()
    assert (index[:, found:] == len(points)).all()


def test_query_agrees_with_scipy_on_a_large_cloud() -> None:
    rng = np.random.default_rng(0)
    points, queries = rng.normal(size=(20_000, 3)), rng.normal(size=(2_000, 3))
    tree, oracle = KdTree(points), cKDTree(points)
    for k in (1, 8):
        distance, index = tree.query(queries, k)
        expected_distance, expected_index = oracle.query(queries, k)
        assert distance.shape == expected_distance.shape
        assert np.allclose(distance, expected_distance, rtol=1e-14)
        assert np.array_equal(index, expected_index)
    within = tree.query_radius(queries[:200], 0.3)
    for found, expected in zip(within, oracle.query_ball_point(queries[:200], 0.3), strict=True):
        assert found.tolist() == sorted(expected)


@given(clouds(), clouds(), st.sampled_from([0.25, 0.5, 1.0, 3.0]))
def test_query_radius_finds_all(points: Points, queries: Points, radius: float) -> None:
    found = KdTree(points).query_radius(queries, radius)
    expected = distances(queries, points) <= radius
    assert [row.tolist() for row in found] == [np.flatnonzero(row).tolist() for row in expected]


def test_a_tree_refuses_what_it_cannot_answer() -> None:
    tree = KdTree([[0.0, 0.0, 0.0]])
    assert len(tree) == 1
    for k in (0, -1, 2**63, 2**70):
        with pytest.raises(InvalidInputError, match="k = "):
            tree.query([[0.0, 0.0, 0.0]], k)
    for k in (10**9, 2**62):
        with pytest.raises(MemoryError):
            tree.query([[0.0, 0.0, 0.0]], k)
    for radius in BAD_NUMBERS:
        with pytest.raises(InvalidInputError, match="radius"):
            tree.query_radius([[0.0, 0.0, 0.0]], radius)
    for k in (1, 2):
        distance, index = tree.query(np.empty((0, 3)), k)
        assert distance.shape == index.shape == ((0,) if k == 1 else (0, 2))
    assert tree.query_radius(np.empty((0, 3)), 1.0) == []


@given(clouds(), st.sampled_from([0.3, 0.7, 1.0, 5.0]))
def test_voxels_hold_the_mean_of_their_points(points: Points, size: float) -> None:
    means, inverse = sympose.voxel_downsample(points, size, return_inverse=True)
    assert np.array_equal(means, sympose.voxel_downsample(points, size))
    cells = np.floor((points - (points.min(axis=0) - 0.5 * size)) / size).astype(int)
    assert len(means) == len(np.unique(cells, axis=0))
    for cell in range(len(means)):
        members = inverse == cell
        assert len(np.unique(cells[members], axis=0)) == 1
        assert np.allclose(means[cell], points[members].mean(axis=0))


@given(clouds(), st.sampled_from([0.25, 0.5, 1.0]), st.integers(0, 5))
def test_radius_filter_counts_other_points(points: Points, radius: float, needed: int) -> None:
    kept, indices = sympose.remove_radius_outliers(points, radius, needed)
    company = (distances(points, points) <= radius).sum(axis=1) - 1
    assert indices.tolist() == np.flatnonzero(company >= needed).tolist()
    assert np.array_equal(kept, points[indices])


def test_the_radius_filter_removes_a_point_far_away() -> None:
    square = np.random.default_rng(1).random((500, 3)) * [1.0, 1.0, 0.0]
    points = np.vstack([square, [[1e7, 0.0, 0.0]]])
    near = (np.linalg.norm(points[:, None] - points, axis=2) <= 0.05).sum(axis=1) > 3
    kept, rows = sympose.remove_radius_outliers(points, 0.05, 3)
    assert rows.tolist() == np.flatnonzero(near).tolist()
    assert kept.tobytes() == points[rows].tobytes()


@given(arrays(np.float64, (30, 3), elements=st.floats(-10, 10)), st.integers(2, 10), st.floats(0.5, 3.0))
def test_statistical_filter_cuts_beyond_the_average(points: Points, k: int, ratio: float) -> None:
    kept, indices = sympose.remove_statistical_outliers(points, k, ratio)
    mean = np.sort(distances(points, points), axis=1)[:, :k].mean(axis=1)
    threshold = mean.mean() + ratio * mean.std(ddof=1)
    # Points within rounding of the threshold may fall on either side.
    clear = np.abs(mean - threshold) > 1e-9 * (1.0 + threshold)
    expected = np.flatnonzero(clear & (mean < threshold))
    assert set(expected) <= set(indices.tolist())
    assert set(indices[clear[indices]].tolist()) == set(expected)
    assert np.array_equal(kept, points[indices])


def test_the_plane_is_that_of_least_squares_among_strays() -> None:
    for seed in range(5):
        random = np.random.default_rng(seed)
        plane = np.c_[random.uniform(-0.5, 0.5, (2000, 2)), random.normal(0.0, 0.002, 2000)]
        points = np.r_[plane, random.uniform(-0.5, 0.5, (1000, 3))]
        (*normal, d), inliers = sympose.segment_plane(points, 0.01, seed=seed)
        near = points[inliers]
        middle = near.mean(axis=0)
        wanted = np.linalg.svd(near - middle)[2][2]
        assert 1.0 - abs(wanted @ normal) < 1e-7
        assert abs(middle @ normal + d) < 1e-4


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.3, 0.9))
@example(62018, 0.375)
def test_plane_is_found_among_outliers(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    points = rng.uniform(-1.0, 1.0, (400, 3))
    on_plane = np.arange(400) < share * 400
    points[on_plane] -= np.outer(points[on_plane] @ normal, normal)
    points[on_plane] += 0.3 * normal
    plane, inliers = sympose.segment_plane(points, 1e-3, seed=seed)
    assert np.linalg.norm(plane[:3]) == pytest.approx(1.0)
    # The plane with the most points takes in strays near it, and tilts by up to the distance over the extent.
    assert abs(plane[:3] @ normal) == pytest.approx(1.0, abs=1e-6)
    assert inliers.tolist() == np.flatnonzero(np.abs(points @ plane[:3] + plane[3]) <= 1e-3).tolist()
    assert set(np.flatnonzero(on_plane)) <= set(inliers.tolist())


def test_normals_of_a_sphere_point_outward() -> None:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = sympose.estimate_normals(5.0 + directions, 12, viewpoints=5.0 + 3.0 * directions)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert np.degrees(np.arccos(np.clip((normals * directions).sum(axis=1), -1, 1))).max() < 5.0
    above = sympose.estimate_normals(5.0 + directions, 12, viewpoints=[5.0, 5.0, 99.0])
    assert ((above[:, 2] > 0.0) | (np.abs(directions[:, 2]) < 0.1)).all()
    unoriented = sympose.estimate_normals(5.0 + directions, 12)
    assert np.allclose(np.abs((unoriented * normals).sum(axis=1)), 1.0)


STAGES: dict[str, Any] = {
    "voxel_downsample": lambda points: sympose.voxel_downsample(points, 0.5),
    "remove_radius_outliers": lambda points: sympose.remove_radius_outliers(points, 0.5, 2),
    "remove_statistical_outliers": lambda points: sympose.remove_statistical_outliers(points, 5),
    "segment_plane": lambda points: sympose.segment_plane(points, 0.1),
    "estimate_normals": lambda points: sympose.estimate_normals(points, 5),
    "viewpoints_from_order": sympose.viewpoints_from_order,
    "KdTree": KdTree,
    "KdTree.query": lambda points: KdTree([[0.0, 0.0, 0.0]]).query(points),
    "KdTree.query_radius": lambda points: KdTree([[0.0, 0.0, 0.0]]).query_radius(points, 1.0),
    "adds": lambda points: adds(points, np.eye(4), np.eye(4)),
    "mssd": lambda points: mssd(points, np.eye(4), np.eye(4), [np.eye(4)]),
}


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_stages_refuse_points_that_are_not_finite(stage: str, bad: float) -> None:
    points = np.random.default_rng(0).normal(size=(30, 3))
    points[[3, 7], [0, 2]] = bad
    with pytest.raises(InvalidInputError, match="2 of 30"):
        STAGES[stage](points)


@pytest.mark.parametrize("stage", sorted(set(STAGES) - {"KdTree.query", "KdTree.query_radius"}))
def test_stages_refuse_an_empty_cloud(stage: str) -> None:
    with pytest.raises(InsufficientDataError):
        STAGES[stage](np.empty((0, 3)))


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("shape", [(3,), (4, 2), (4, 4), (2, 3, 3), ()])
def test_stages_name_the_shape_they_got(stage: str, shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"\(N, 3\), got \(" + ", ".join(map(str, shape))):
        STAGES[stage](np.zeros(shape))


@pytest.mark.parametrize("points", [np.zeros((60, 3)), np.linspace(0, 1, 60)[:, None] * [1.0, 2.0, 3.0]])
def test_degenerate_clouds_are_answered_or_refused(points: Points) -> None:
    for name, stage in STAGES.items():
        if name == "segment_plane":
            with pytest.raises(InsufficientDataError, match=r"identical|collinear"):
                stage(points)
        else:
            stage(points)
    normals = sympose.estimate_normals(points, 5)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_parameters_outside_their_domain_are_named() -> None:
    points = np.random.default_rng(0).normal(size=(30, 3))
    for bad in BAD_NUMBERS:
        with pytest.raises(InvalidInputError, match="voxel_size"):
            sympose.voxel_downsample(points, bad)
        with pytest.raises(InvalidInputError, match="radius"):
            sympose.remove_radius_outliers(points, bad, 2)
        with pytest.raises(InvalidInputError, match="std_ratio"):
            sympose.remove_statistical_outliers(points, 5, bad)
        with pytest.raises(InvalidInputError, match="distance"):
            sympose.segment_plane(points, bad)
    with pytest.raises(InvalidInputError, match="voxel_size"):
        sympose.voxel_downsample(points, 1e-9)
    with pytest.raises(InvalidInputError, match="min_neighbors"):
        sympose.remove_radius_outliers(points, 1.0, -1)
    for k in (0, -1):
        with pytest.raises(InvalidInputError, match="k = "):
            sympose.remove_statistical_outliers(points, k)
        with pytest.raises(InvalidInputError, match="k = "):
            sympose.estimate_normals(points, k)
    with pytest.raises(InvalidInputError, match="probability"):
        sympose.segment_plane(points, 0.1, probability=1.5)
    with pytest.raises(InvalidInputError, match="max_iterations"):
        sympose.segment_plane(points, 0.1, max_iterations=0)
    for seed in (-1, 2**63, 2**200):
        with pytest.raises(
            InvalidInputError, match=rf"seed = {seed}: expected a whole number from 0 to 2\^63"
        ):
            sympose.segment_plane(points, 0.1, seed=seed)
    with pytest.raises(InvalidInputError, match=f"k = {2**63}"):
        sympose.remove_statistical_outliers(points, 2**63)
    with pytest.raises(TypeError, match="k"):
        sympose.estimate_normals(points, 2.5)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="radius = -1: expected"):
        sympose.remove_radius_outliers(points, -1, 1)
    with pytest.raises(InvalidInputError, match="29 rows"):
        sympose.estimate_normals(points, viewpoints=points[1:])
    with pytest.raises(InvalidInputError, match="viewpoints"):
        sympose.estimate_normals(points, viewpoints=[np.nan, 0.0, 0.0])
    with pytest.raises(InvalidInputError, match="viewpoints has 0 rows"):
        sympose.estimate_normals(points, viewpoints=np.zeros((0, 3)))


def turn(angle: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Points:
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = shift
    return matrix


def moved(points: Points, pose: Points) -> Points:
    result: Points = points @ pose[:3, :3].T + pose[:3, 3]
    return result


def test_metrics_agree_with_their_definition() -> None:
    rng = np.random.default_rng(5)
    points = rng.normal(size=(200, 3))
    estimated, truth = turn(0.4, (0.1, 0.0, 0.2)), turn(0.1)
    found, target = moved(points, estimated), moved(points, truth)
    assert adds(points, estimated, truth) == pytest.approx(distances(found, target).min(axis=1).mean())
    symmetries = [turn(k * np.pi / 3.0) for k in range(1, 6)]
    targets = [moved(points, truth @ symmetry) for symmetry in [np.eye(4), *symmetries]]
    largest = [np.linalg.norm(found - target, axis=1).max() for target in targets]
    assert mssd(points, estimated, truth, symmetries) == pytest.approx(min(largest))
    assert mssd(points, estimated, truth, np.empty((0, 4, 4))) == pytest.approx(largest[0])
    with pytest.raises(InvalidInputError, match=r"\(S, 4, 4\), got \(4, 4\)"):
        mssd(points, estimated, truth, np.eye(4))
    with pytest.raises(InvalidInputError, match="estimated"):
        adds(points, 2.0 * np.eye(4), truth)
