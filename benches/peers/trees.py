"""The k-d tree beside SciPy's, scikit-learn's and small_gicp's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import sympose
from peers import clouds
from peers.report import Row, alternate, library, skipped

__all__ = ["rows"]

Points = NDArray[np.float64]

_THREADS = 2
_K = 20
_GOALS = {"SciPy": 2.0, "small_gicp": 1.0, "scikit-learn": None}


def rows(repeats: int) -> Iterator[Row]:
    """Build, nearest and k nearest; queries beside the points, in the order of the scan."""
    found: dict[tuple[str, str], float] = {}
    for name, points in [
        ("scan, 120,000", clouds.part_scan(120_000).points),
        ("noise, 120,000", clouds.noise(120_000)),
        ("lattice, 120,000", clouds.lattice(120_000)),
        ("scan, 1,000,000", clouds.part_scan(1_000_000).points),
        ("noise, 1,000,000", clouds.noise(1_000_000)),
    ]:
        queries = points + np.random.default_rng(4).normal(0.0, 0.001, points.shape)
        for what, calls in _jobs(points, queries).items():
            times, busy, results = alternate(calls, repeats)
            found[what, name] = times["sympose"]
            for peer, goal in _GOALS.items():
                if peer not in calls:
                    yield skipped(what, name, peer)
                    continue
                agrees, text = (True, "") if "build" in what else _alike(results["sympose"], results[peer])
                goal = None if "lattice" in name else goal
                yield Row(
                    what,
                    name,
                    peer,
                    times["sympose"],
                    times[peer],
                    times[peer] / times["sympose"],
                    goal,
                    cpu=busy[peer] / busy["sympose"],
                    agrees=agrees,
                    results=text,
                )
    for what in dict.fromkeys(what for what, _ in found):
        flat, even = found[what, "lattice, 120,000"], found[what, "noise, 120,000"]
        yield Row(what, "lattice, 120,000", "ours on noise", flat, even, flat / even, 3.0, at_most=True)


def _jobs(points: Points, queries: Points) -> dict[str, dict[str, Callable[[], Any]]]:
    """The calls of each library by job; results are distances (N,) or (N, k)."""
    ours = sympose.KdTree(points)
    build: dict[str, Callable[[], Any]] = {"sympose": lambda: sympose.KdTree(points)}
    nearest: dict[str, Callable[[], Any]] = {"sympose": lambda: ours.query(queries)[0]}
    several: dict[str, Callable[[], Any]] = {"sympose": lambda: ours.query(queries, _K)[0]}

    scipy = cKDTree(points)
    build["SciPy"] = lambda: cKDTree(points)
    nearest["SciPy"] = lambda: scipy.query(queries, workers=_THREADS)[0]
    several["SciPy"] = lambda: scipy.query(queries, _K, workers=_THREADS)[0]

    if (gicp := library("small_gicp")) is not None:
        other = gicp.KdTree(points, num_threads=_THREADS)
        build["small_gicp"] = lambda: gicp.KdTree(points, num_threads=_THREADS)
        # The call for one neighbour returns lists of Python numbers, that for several arrays.
        nearest["small_gicp"] = lambda: np.sqrt(other.batch_knn_search(queries, 1, num_threads=_THREADS)[1])
        several["small_gicp"] = lambda: np.sqrt(other.batch_knn_search(queries, _K, num_threads=_THREADS)[1])

    # Five to ten times as slow as the others: a million points would take the time of all other rows.
    if len(points) <= 200_000 and (neighbors := library("sklearn.neighbors")) is not None:
        model = neighbors.NearestNeighbors(algorithm="kd_tree", n_jobs=_THREADS).fit(points)
        build["scikit-learn"] = lambda: neighbors.KDTree(points)
        nearest["scikit-learn"] = lambda: model.kneighbors(queries, 1)[0]
        several["scikit-learn"] = lambda: model.kneighbors(queries, _K)[0]
    return {"tree: build": build, "tree: nearest": nearest, "tree: k = 20": several}


def _alike(ours: Points, theirs: Any) -> tuple[bool, str]:
    apart = float(np.abs(ours.reshape(len(ours), -1) - np.asarray(theirs).reshape(len(ours), -1)).max())
    return apart < 1e-9, f"distances {apart:.0e} apart"
