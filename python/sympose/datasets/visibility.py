"""The part of a surface that cameras can see: samples of it and their centroid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sympose.datasets.depth_camera import cast

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["sample_visible", "sphere_directions", "visible_centroid"]

_CAMERA_DISTANCE = 2.2  # diameters
_TOLERANCE = 2e-4  # diameters; a sample this close behind the first hit is the first hit
_STEEPEST = 0.1  # cosine; a surface seen flatter than this is hardly measured


def sphere_directions(count: int) -> NDArray[np.float64]:
    """(count, 3) unit directions, evenly over the sphere (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1)


def sample_visible(
    mesh: Trimesh, count: int, *, seed: int = 0, directions: int = 200
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sample the surface that cameras 2.2 diameters away can see, evenly by area.

    Args:
        mesh: Of diameter 1.
        count: Samples of the whole surface, visible or not.
        seed: The samples are stratified by area, random within.
        directions: Cameras, evenly over the sphere.

    Returns:
        points (M, 3) and unit normals (M, 3) with M <= count; on a closed mesh the normals point outward, on
        others to where the sample was seen from.

    Example:
        >>> import trimesh
        >>> points, normals = sample_visible(trimesh.creation.box([0.5, 0.5, 0.5]), 1000)
        >>> points.shape
        (1000, 3)
    """
    points, normals, visible = _sample(mesh, count, seed, directions)
    return points[visible], normals[visible]


def visible_centroid(mesh: Trimesh, *, samples: int = 20_000) -> NDArray[np.float64]:
    """(3,) area centroid of the surface that cameras can see; that of all of it where they see nothing.

    The centroid of the whole is exact, and what is hidden, mostly little, is taken off by sampling.
    """
    whole = np.asarray(mesh.area_faces @ mesh.triangles_center / mesh.area)
    points, _, visible = _sample(mesh, samples, 0, 200)
    share = visible.mean()
    if share in (0.0, 1.0):
        return whole
    return np.asarray((whole - (1.0 - share) * points[~visible].mean(axis=0)) / share)


def _sample(
    mesh: Trimesh, count: int, seed: int, directions: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Points and normals evenly over the whole surface, and which of them some camera sees."""
    rng = np.random.default_rng(seed)
    corners = np.asarray(mesh.triangles)
    area = np.cumsum(mesh.area_faces)
    chosen = np.searchsorted(area, (np.arange(count) + rng.random(count)) / count * area[-1])
    chosen = np.minimum(chosen, len(area) - 1)
    a, b = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - a, a * (1.0 - b), a * b], axis=1)
    points = np.einsum("ij,ijk->ik", weights, corners[chosen])
    normals = np.asarray(mesh.face_normals)[chosen].copy()

    middle = mesh.bounds.mean(axis=0)
    hidden = np.arange(count)
    # Far apart one after the other, so that most samples are seen by the first few cameras.
    for direction in sphere_directions(directions)[np.random.default_rng(0).permutation(directions)]:
        camera = middle + _CAMERA_DISTANCE * direction
        rays = points[hidden] - camera
        length = np.linalg.norm(rays, axis=1)
        rays /= length[:, None]
        facing = -np.einsum("ij,ij->i", rays, normals[hidden])
        steep = facing > _STEEPEST if mesh.is_watertight else np.abs(facing) > _STEEPEST
        candidates = hidden[steep]
        distance, _ = cast(mesh, camera, rays[steep])
        seen = distance > length[steep] - _TOLERANCE
        normals[candidates[seen]] *= np.sign(facing[steep][seen])[:, None]
        hidden = np.setdiff1d(hidden, candidates[seen], assume_unique=True)
        if len(hidden) == 0:
            break
    visible = np.ones(count, dtype=bool)
    visible[hidden] = False
    return points, normals, visible
