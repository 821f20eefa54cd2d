"""A virtual depth camera: casts one ray for each pixel and adds noise along it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.camera import PinholeCamera, View
from sympose.datasets.optional import load
from sympose.errors import InvalidInputError

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["DEPTH_CAMERA", "LOW_RESOLUTION", "DepthImage", "cast", "pinhole", "render", "turn"]


def pinhole(width: int, height: int, field_of_view_deg: float) -> PinholeCamera:
    """A camera without distortion that looks through its middle; the field of view is the horizontal one."""
    focal = width / 2.0 / np.tan(np.radians(field_of_view_deg) / 2.0)
    return PinholeCamera(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)


DEPTH_CAMERA = pinhole(320, 240, 35.0)
LOW_RESOLUTION = pinhole(160, 120, 35.0)


@dataclass(frozen=True, eq=False)
class DepthImage:
    """What one view measured.

    Attributes:
        view: The camera and its pose.
        distance: (height, width) along the ray of the pixel, NaN where nothing came back.
        face: (height, width) index of the face that was hit, -1 where nothing came back.
    """

    view: View
    distance: NDArray[np.float64]
    face: NDArray[np.int64]

    @property
    def depth(self) -> NDArray[np.float64]:
        """(height, width) z coordinate in the camera frame, NaN where nothing came back."""
        return self.distance * _rays(self.view.camera)[:, 2].reshape(self.distance.shape)

    def points(self) -> NDArray[np.float64]:
        """(M, 3) measured points in the world, row by row; `face[face >= 0]` belongs to them."""
        hit = self.face.ravel() >= 0
        rays = _rays(self.view.camera)[hit] * self.distance.ravel()[hit, None]
        return turn(self.view.world_from_camera[:3, :3], rays) + self.view.center


def render(
    mesh: Trimesh, view: View, rng: np.random.Generator | None = None, *, sigma: float = 0.001
) -> DepthImage:
    """Measure `mesh`, given in world coordinates, from `view`.

    Args:
        mesh: Of a closed mesh only the outside returns an echo.
        view: Lens distortion is taken into account.
        rng: Source of the noise; needed unless `sigma` is 0.
        sigma: Standard deviation of the noise along the ray, as a share of the mean depth of the view.

    Raises:
        InvalidInputError: `sigma` is negative or not finite, or there is noise but no `rng`.
        ImportError: trimesh or embreex is not installed.

    Example:
        >>> import numpy as np, trimesh
        >>> view = View(DEPTH_CAMERA, np.eye(4))
        >>> ball = trimesh.creation.icosphere(4, 0.5).apply_translation([0.0, 0.0, 2.2])
        >>> image = render(ball, view, sigma=0.0)
        >>> bool(abs(image.points()[:, 2].min() - 1.7) < 1e-3)
        True
    """
    if not (np.isfinite(sigma) and sigma >= 0.0):
        raise InvalidInputError(f"sigma must be a share of the depth, zero or more, got {sigma!r}")
    camera = view.camera
    shape = (camera.height, camera.width)
    rays = _rays(camera)
    distance, face = cast(mesh, view.center, turn(view.world_from_camera[:3, :3], rays))
    hit = face >= 0
    if sigma > 0.0 and hit.any():
        if rng is None:
            raise InvalidInputError("noise needs an rng: pass numpy.random.default_rng(seed), or sigma=0")
        mean_depth = float((distance[hit] * rays[hit, 2]).mean())
        distance[hit] += rng.normal(0.0, sigma * mean_depth, int(hit.sum()))
    return DepthImage(view, distance.reshape(shape), face.reshape(shape))


def cast(
    mesh: Trimesh, origin: ArrayLike, directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """First hit of rays from one point.

    Args:
        mesh: Closed or not.
        origin: (3,).
        directions: (N, 3) of unit length.

    Returns:
        distance (N,), NaN for a miss, and face (N,), -1 for a miss.
    """
    load("embreex")  # without it trimesh falls back to a caster that takes minutes
    start = np.asarray(origin, dtype=np.float64)
    distance = np.full(len(directions), np.nan)
    face = np.full(len(directions), -1, dtype=np.int64)

    # Only rays through the bounding sphere are worth casting.
    middle = mesh.bounds.mean(axis=0)
    radius_sq = float(((mesh.bounds[1] - middle) ** 2).sum()) * (1.0 + 1e-6)
    to_middle = middle - start
    along = np.einsum("ij,j->i", directions, to_middle)
    near = np.nonzero(float(to_middle @ to_middle) - along * along <= radius_sq)[0]
    rays = directions[near]
    first = np.asarray(mesh.ray.intersects_first(np.broadcast_to(start, rays.shape), rays), dtype=np.int64)
    near, rays, first = near[first >= 0], rays[first >= 0], first[first >= 0]

    # Embree works in float32 and names the face; the distance is taken from the plane of the face in float64,
    # and held within the reach of its corners, since the plane of a face seen edge-on gives anything.
    corners = mesh.vertices.view(np.ndarray)[mesh.faces.view(np.ndarray)[first]] - start
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.einsum("ij,ij->i", normal, rays)
    reach = np.einsum("ijk,ik->ij", corners, rays)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.einsum("ij,ij->i", normal, corners[:, 0]) / facing
    exact = np.clip(np.nan_to_num(exact, nan=np.inf), reach.min(axis=1), reach.max(axis=1))

    # A ray that slips between two faces of a closed mesh would see its inside.
    seen = facing < 0.0 if mesh.is_watertight else np.ones(len(first), dtype=bool)
    distance[near[seen]], face[near[seen]] = exact[seen], first[seen]
    return distance, face


def turn(rotation: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a (3, 3) rotation to (N, 3) vectors; for three columns BLAS is slower under load."""
    return np.asarray(np.einsum("ij,nj->ni", rotation, vectors))


@lru_cache(maxsize=8)
def _rays(camera: PinholeCamera) -> NDArray[np.float64]:
    """(height * width, 3) unit directions of the pixels in the camera frame, row by row."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1), 1.0)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays.flags.writeable = False
    return rays
