"""Filters, normals and planes beside those of Open3D and small_gicp."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import sympose
from peers import clouds
from peers.report import Row, alternate, library, skipped

__all__ = ["normals", "plane", "radius", "statistical", "voxel"]

Points = NDArray[np.float64]

_THREADS = 2
_LEAF = 0.01
_K = 20


def voxel(repeats: int) -> Iterator[Row]:
    """Voxel grids without the way back to the points.

    The cells of small_gicp start at the origin, Open3D's and ours half a cell below the cloud; on two threads
    small_gicp splits some cells.
    """
    for name, points, counts in [
        ("scan, 500,000", clouds.part_scan(500_000).points, True),
        ("scan, 1,000,000", clouds.part_scan(1_000_000).points, True),
        ("lattice, 250,000", clouds.lattice(250_000), False),
        ("noise, 120,000", clouds.noise(120_000), False),
    ]:
        cells = len(np.unique(np.floor(points / _LEAF).astype(np.int64), axis=0))

        def same(ours: Points, cloud: Any) -> tuple[bool, str]:
            theirs = np.asarray(cloud.points)
            apart = cKDTree(theirs).query(ours)[0].max()
            same = len(ours) == len(theirs) and bool(apart < 1e-9)
            return same, f"{len(ours):,} and {len(theirs):,} means, {apart:.0e} apart"

        def split(ours: Points, cloud: Any, cells: int = cells) -> tuple[bool, str]:
            more = cloud.size() / cells - 1.0
            return 0.0 <= more < 0.1, f"other cells; of {cells:,} it splits {more:.1%}"

        yield from _compare(
            "voxel grid",
            name,
            points,
            repeats,
            ours=lambda points: sympose.voxel_downsample(points, _LEAF),
            open3d=(lambda cloud: cloud.voxel_down_sample(_LEAF), 4.0 if counts else None, same),
            small_gicp=(
                lambda gicp, cloud: gicp.voxelgrid_sampling(cloud, _LEAF, num_threads=_THREADS),
                3.0 if counts else None,
                split,
            ),
        )


def radius(repeats: int) -> Iterator[Row]:
    """Radius filter: Open3D counts the point itself and wants more than `nb_points`, the same rule."""
    for name, points, reach, goal in [
        ("scan, 120,000; 0.02", clouds.part_scan(120_000).points, 0.02, 10.0),
        ("scan, 120,000; 0.01", clouds.part_scan(120_000).points, 0.01, 10.0),
        ("lattice, 120,000; 0.01", clouds.lattice(120_000), 0.01, None),
        ("noise, 120,000; 0.03", clouds.noise(120_000), 0.03, None),
    ]:
        yield from _compare(
            "radius filter",
            name,
            points,
            repeats,
            ours=lambda points, reach=reach: sympose.remove_radius_outliers(points, reach, 16)[1],
            open3d=(lambda cloud, reach=reach: cloud.remove_radius_outlier(16, reach)[1], goal, _same_rows),
        )


def statistical(repeats: int) -> Iterator[Row]:
    """Statistical filter; Open3D drops points that coincide with all their neighbours."""
    for name, points, goal in _for_neighbors():
        yield from _compare(
            "statistical filter",
            name,
            points,
            repeats,
            ours=lambda points: sympose.remove_statistical_outliers(points, _K, 2.0)[1],
            open3d=(lambda cloud: cloud.remove_statistical_outlier(_K, 2.0)[1], goal, _same_rows),
        )


def normals(repeats: int) -> Iterator[Row]:
    """Normals of any sign; each builds its own tree."""

    def estimated(cloud: Any) -> Any:
        # The default solver of Open3D; without it normals that are there already would be kept.
        import open3d

        cloud.normals = open3d.utility.Vector3dVector()
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(_K))
        return cloud

    def fitted(gicp: Any, cloud: Any) -> Any:
        tree = gicp.KdTree(cloud, num_threads=_THREADS)
        gicp.estimate_normals(cloud, tree, num_neighbors=_K, num_threads=_THREADS)
        return cloud

    def parallel(ours: Points, cloud: Any) -> tuple[bool, str]:
        theirs = np.asarray(cloud.normals() if callable(cloud.normals) else cloud.normals)[:, :3]
        cosine = np.abs(np.einsum("ij,ij->i", ours, theirs))
        alike = float((cosine > 0.999).mean())
        # Where neighbours are at the same distance, or lie in no plane, the fit is not unique.
        return alike > 0.99, f"{alike:.2%} within 2.6 deg"

    for name, points, goal in _for_neighbors():
        yield from _compare(
            "normals",
            name,
            points,
            repeats,
            ours=lambda points: sympose.estimate_normals(points, _K),
            open3d=(estimated, goal, parallel),
            small_gicp=(fitted, goal and 1.5, parallel),
        )


def plane(repeats: int) -> Iterator[Row]:
    """RANSAC with the same bounds on trials and probability; and the share of its inliers that we have."""

    def counted(ours: NDArray[np.int64], theirs: Any) -> tuple[bool, str]:
        share = len(ours) / len(theirs)
        return share > 0.99, f"{share:.2%} of its {len(theirs):,} inliers"

    for name, points, goal in [
        ("table, 500,000", clouds.table_scan(500_000), 30.0),
        ("scan, 500,000", clouds.part_scan(500_000).points, None),
    ]:
        for row in _compare(
            "plane",
            name,
            points,
            repeats,
            ours=lambda points: sympose.segment_plane(
                points, _LEAF, max_iterations=1000, probability=0.99999999
            )[1],
            open3d=(lambda cloud: cloud.segment_plane(_LEAF, 3, 1000, 0.99999999)[1], goal, counted),
        ):
            yield row
            if goal and row.measured is not None:
                share = float(row.results.partition("%")[0])
                yield Row("plane: inliers", name, row.peer, measured=share, goal=99.9, unit="%")


def _for_neighbors() -> list[tuple[str, Points, float | None]]:
    return [
        ("scan, 120,000", clouds.part_scan(120_000).points, 3.0),
        ("scan, 1,000,000", clouds.part_scan(1_000_000).points, 3.0),
        ("lattice, 120,000", clouds.lattice(120_000), None),
        ("noise, 120,000", clouds.noise(120_000), None),
    ]


Check = Callable[[Any, Any], tuple[bool, str]]


def _compare(
    what: str,
    cloud: str,
    points: Points,
    repeats: int,
    *,
    ours: Callable[[Points], Any],
    open3d: tuple[Callable[[Any], Any], float | None, Check],
    small_gicp: tuple[Callable[[Any, Any], Any], float | None, Check] | None = None,
) -> Iterator[Row]:
    """One row for each peer; with each come its goal and what to make of its result."""
    calls: dict[str, Callable[[], Any]] = {"sympose": lambda: ours(points)}
    peers: dict[str, tuple[float | None, Check]] = {"Open3D": open3d[1:]}
    if (o3d := library("open3d")) is not None:
        o3d_cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        calls["Open3D"] = lambda: open3d[0](o3d_cloud)
    if small_gicp is not None:
        peers["small_gicp"] = small_gicp[1:]
        if (gicp := library("small_gicp")) is not None:
            gicp_cloud = gicp.PointCloud(points)
            calls["small_gicp"] = lambda: small_gicp[0](gicp, gicp_cloud)
    times, busy, results = alternate(calls, repeats)
    for peer, (goal, check) in peers.items():
        if peer not in calls:
            yield skipped(what, cloud, peer)
            continue
        agrees, text = check(results["sympose"], results[peer])
        ratio = times[peer] / times["sympose"]
        cpu = busy[peer] / busy["sympose"]
        yield Row(
            what,
            cloud,
            peer,
            times["sympose"],
            times[peer],
            ratio,
            goal,
            cpu=cpu,
            agrees=agrees,
            results=text,
        )


def _same_rows(ours: NDArray[np.int64], theirs: Any) -> tuple[bool, str]:
    """Whether both kept the same points; a few may lie on the threshold to within rounding."""
    differ = len(np.setxor1d(ours, np.asarray(theirs)))
    return differ <= 1e-5 * len(ours), f"{len(ours):,} kept, {differ} differ"
