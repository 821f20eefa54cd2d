"""Pinhole cameras with lens distortion, and views: a camera at a pose in the world.

The camera looks along its +z axis, +x points right in the image and +y down. The centre of the top left pixel
is (0, 0), as in OpenCV and ROS; COLMAP puts it at (0.5, 0.5), which `sympose.io.read_colmap` accounts for.
Depth is the z coordinate in the camera frame, not the length of the ray.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.arrays import as_floats, as_points, read_only
from sympose.errors import InvalidInputError

__all__ = ["PinholeCamera", "View"]

_RIGID_TOLERANCE = 1e-3  # poses printed with four digits are off by 1e-4
_UNDISTORT_STEPS = 30
_UNDISTORT_TOLERANCE = 1e-12  # in units of the focal length


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera; all lengths in pixels.

    Attributes:
        width, height: Size of the image.
        fx, fy: Focal lengths.
        cx, cy: Principal point; the centre of the top left pixel is (0, 0).
        distortion: The model goes by the number of coefficients, named as in COLMAP and ordered as in OpenCV:
            `()` none, `(k,)` SIMPLE_RADIAL, `(k1, k2)` RADIAL, `(k1, k2, p1, p2)` OPENCV,
            `(k1, k2, p1, p2, k3)` OpenCV's five (Brown-Conrady).

    Raises:
        InvalidInputError: A size or focal length is not positive, a number is not finite, or there is no
            distortion model with that many coefficients.

    Example:
        >>> camera = PinholeCamera(640, 480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
        >>> pixels, depth = camera.project([[0.0, 0.0, 2.0]])
        >>> pixels.tolist(), depth.tolist()
        ([[319.5, 239.5]], [2.0])
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if not isinstance(size, (int, np.integer)) or isinstance(size, bool) or size <= 0:
                raise InvalidInputError(f"{name} must be a positive whole number of pixels, got {size!r}")
            object.__setattr__(self, name, int(size))
        for name in ("fx", "fy", "cx", "cy"):
            value = as_floats(getattr(self, name), name)
            if value.ndim != 0 or not np.isfinite(value) or (name[0] == "f" and value <= 0.0):
                kind = "positive, finite" if name[0] == "f" else "finite"
                raise InvalidInputError(
                    f"{name} must be a {kind} number of pixels, got {getattr(self, name)!r}"
                )
            object.__setattr__(self, name, float(value))
        distortion = as_floats(self.distortion, "distortion")
        if distortion.ndim != 1 or distortion.size not in (0, 1, 2, 4, 5):
            raise InvalidInputError(
                "distortion must be (), (k,), (k1, k2), (k1, k2, p1, p2) or (k1, k2, p1, p2, k3), "
                f"got an array of shape {distortion.shape}"
            )
        if not np.isfinite(distortion).all():
            raise InvalidInputError(f"distortion must be finite, got {self.distortion!r}")
        object.__setattr__(self, "distortion", tuple(distortion.tolist()))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The (3, 3) calibration matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points_camera: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Project points of the camera frame into the image plane.

        Args:
            points_camera: (N, 3) points, z forward.

        Returns:
            pixels (N, 2), which may lie outside the image, and depth (N,). The pixel is NaN where the point
            has none: behind the camera, not finite, or so far off the axis that the distortion polynomial has
            turned round and would fold the point back into the image.

        Raises:
            InvalidInputError: `points_camera` is not (N, 3).
        """
        points = as_points(points_camera, "points_camera")
        depth = points[:, 2].copy()
        in_front = (depth > 0.0) & np.isfinite(depth)
        inverse = np.divide(1.0, depth, out=np.full_like(depth, np.nan), where=in_front)
        with np.errstate(over="ignore", invalid="ignore"):
            x, y = points[:, 0] * inverse, points[:, 1] * inverse
            if any(self.distortion):
                outside = ~(x * x + y * y < self._radius_limit_sq())
                x, y = self._distort(x, y)
                x[outside], y[outside] = np.nan, np.nan
            pixels = np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=1)
            pixels[~np.isfinite(pixels).all(axis=1)] = np.nan
        return pixels, depth

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Return the points of the camera frame that `project` takes to `pixels` and `depth`.

        Args:
            pixels: (N, 2).
            depth: (N,) z coordinates, or one number for all.

        Returns:
            (N, 3) points; NaN where the distortion model reaches the pixel from no direction.

        Raises:
            InvalidInputError: The shapes do not fit together.
        """
        image = as_floats(pixels, "pixels")
        if image.ndim != 2 or image.shape[1] != 2:
            raise InvalidInputError(f"pixels must have shape (N, 2), got {image.shape}")
        z = as_floats(depth, "depth")
        if z.shape not in ((), (len(image),)):
            raise InvalidInputError(f"depth must have shape ({len(image)},) like pixels, got {z.shape}")
        x, y = (image[:, 0] - self.cx) / self.fx, (image[:, 1] - self.cy) / self.fy
        if any(self.distortion):
            x, y = self._undistort(x, y)
        return np.stack([x * z, y * z, np.broadcast_to(z, x.shape)], axis=1)

    def contains(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (N,): which of the (N, 2) pixels lie in the image; a NaN pixel does not."""
        u, v = pixels[:, 0], pixels[:, 1]
        inside: NDArray[np.bool_] = (
            (u >= -0.5) & (u < self.width - 0.5) & (v >= -0.5) & (v < self.height - 0.5)
        )
        return inside

    def _coefficients(self) -> tuple[float, float, float, float, float]:
        k1, k2, p1, p2, k3 = (*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        return k1, k2, p1, p2, k3

    def _radius_limit_sq(self) -> float:
        """Squared radius up to which r (1 + k1 r^2 + k2 r^4 + k3 r^6) grows with r."""
        k1, k2, _, _, k3 = self._coefficients()
        # The derivative as a polynomial in 1 / r^2, whose leading coefficient is never zero.
        roots = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
        real = roots.real[np.abs(roots.imag) <= 1e-9 * np.abs(roots)]
        largest = float(real.max(initial=0.0))
        return 1.0 / largest if largest > 1e-12 else np.inf

    def _distort(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        k1, k2, p1, p2, k3 = self._coefficients()
        r_sq = x * x + y * y
        radial = 1.0 + r_sq * (k1 + r_sq * (k2 + r_sq * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r_sq + 2.0 * x * x),
            y * radial + 2.0 * p2 * x * y + p1 * (r_sq + 2.0 * y * y),
        )

    def _undistort(
        self, x_distorted: NDArray[np.float64], y_distorted: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Invert `_distort` by Newton's method, kept inside the radius in which it has an inverse."""
        k1, k2, p1, p2, k3 = self._coefficients()
        limit_sq = self._radius_limit_sq()
        x, y = x_distorted.copy(), y_distorted.copy()
        with np.errstate(all="ignore"):
            for _ in range(_UNDISTORT_STEPS):
                r_sq = x * x + y * y
                scale = np.minimum(1.0, 0.99 * np.sqrt(limit_sq / r_sq))
                np.copyto(scale, 1.0, where=r_sq < limit_sq)
                x, y = x * scale, y * scale
                x_error, y_error = self._distort(x, y)
                x_error -= x_distorted
                y_error -= y_distorted
                if np.nanmax(np.abs([x_error, y_error]), initial=0.0) < _UNDISTORT_TOLERANCE:
                    break
                r_sq = x * x + y * y
                radial = 1.0 + r_sq * (k1 + r_sq * (k2 + r_sq * k3))
                slope = 2.0 * (k1 + r_sq * (2.0 * k2 + r_sq * 3.0 * k3))
                j_xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
                j_yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
                j_xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
                determinant = j_xx * j_yy - j_xy * j_xy
                x = x - (j_yy * x_error - j_xy * y_error) / determinant
                y = y - (j_xx * y_error - j_xy * x_error) / determinant
            x_error, y_error = self._distort(x, y)
            failed = ~(np.hypot(x_error - x_distorted, y_error - y_distorted) < 1e-9)
            failed |= x * x + y * y >= limit_sq
        x[failed], y[failed] = np.nan, np.nan
        return x, y


@dataclass(frozen=True, eq=False, init=False)
class View:
    """A camera at a pose in the world.

    Attributes:
        camera: The pinhole camera.
        world_from_camera: (4, 4) rigid transform; its translation is the camera centre. A rotation that is
            off by rounding (up to 1e-3) is replaced by the nearest exact one.
        name: For example the name of the image.

    Raises:
        InvalidInputError: `world_from_camera` is not a rigid transform; the message says by how much.

    Example:
        >>> import numpy as np
        >>> view = View(PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5), np.eye(4))
        >>> pixels, depth, visible = view.project([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0]])
        >>> visible.tolist()
        [True, False]
    """

    camera: PinholeCamera
    world_from_camera: NDArray[np.float64]
    name: str | None = None

    # Written out, since what may be passed is wider than what is kept.
    def __init__(self, camera: PinholeCamera, world_from_camera: ArrayLike, name: str | None = None) -> None:
        if not isinstance(camera, PinholeCamera):
            raise InvalidInputError(f"camera must be a PinholeCamera, got {type(camera).__name__}")
        pose = as_rigid(world_from_camera, "world_from_camera")
        object.__setattr__(self, "camera", camera)
        object.__setattr__(self, "world_from_camera", read_only(pose))
        object.__setattr__(self, "name", name)

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) centre of the camera in the world."""
        return self.world_from_camera[:3, 3]

    @property
    def camera_from_world(self) -> NDArray[np.float64]:
        """(4, 4) inverse of `world_from_camera`."""
        rotation = self.world_from_camera[:3, :3].T
        inverse = np.eye(4)
        inverse[:3, :3] = rotation
        inverse[:3, 3] = -rotation @ self.center
        return inverse

    def project(
        self, points_world: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Project points of the world into the image.

        Args:
            points_world: (N, 3).

        Returns:
            pixels (N, 2) and depth (N,) as from `PinholeCamera.project`, and visible (N,): in front of the
            camera and inside the image. Whether something nearer hides the point is not looked at.

        Raises:
            InvalidInputError: `points_world` is not (N, 3).
        """
        pixels, depth = self.camera.project(self.to_camera(points_world))
        return pixels, depth, self.camera.contains(pixels)

    def to_camera(self, points_world: ArrayLike) -> NDArray[np.float64]:
        """Return (N, 3) points of the world in the camera frame.

        Raises:
            InvalidInputError: `points_world` is not (N, 3).
        """
        points = as_points(points_world, "points_world")
        # Relative to the centre first: with georeferenced coordinates R p + t would cancel.
        x, y, z = (points[:, k] - self.center[k] for k in range(3))
        # Not `@`: BLAS would start threads for this, and its rounding may depend on how many.
        rotation = self.world_from_camera[:3, :3]
        with np.errstate(invalid="ignore", over="ignore"):  # infinite points are none in the camera either
            return np.stack(
                [x * rotation[0, k] + y * rotation[1, k] + z * rotation[2, k] for k in range(3)], axis=1
            )


def field_of_view(camera: PinholeCamera) -> list[list[float]] | None:
    """The largest rectangle, about, of directions that lie in the image.

    Returns:
        (2, 2) least and largest x / z and y / z, or None where the distortion model does not reach the edges
        of the image.
    """
    columns, rows = np.linspace(0, camera.width - 1, 16), np.linspace(0, camera.height - 1, 16)

    def edge(u: NDArray[np.float64] | float, v: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return camera.unproject(np.stack(np.broadcast_arrays(u, v), axis=1), 1.0)

    left, right = edge(0.0, rows)[:, 0].max(), edge(columns[-1], rows)[:, 0].min()
    top, bottom = edge(columns, 0.0)[:, 1].max(), edge(columns, rows[-1])[:, 1].min()
    return [[left, top], [right, bottom]] if left < right and top < bottom else None


def as_views(views: Iterable[View]) -> tuple[View, ...]:
    """Return views as a tuple.

    Raises:
        InvalidInputError: `views` is one view, or holds something else.
    """
    if isinstance(views, View):
        raise InvalidInputError("views must be a sequence of View objects, got one View; pass [view]")
    if not isinstance(views, Iterable):
        raise InvalidInputError(f"views must be a sequence of View objects, got {type(views).__name__}")
    found = tuple(views)
    for view in found:
        if not isinstance(view, View):
            raise InvalidInputError(f"views must hold View objects, got {type(view).__name__}")
    return found


def as_rigid(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` as a (4, 4) rigid transform with an exact rotation, always a new array.

    Raises:
        InvalidInputError: Wrong shape, not finite, or further than 1e-3 from a rigid transform.
    """
    matrix = as_floats(value, name).copy()
    if matrix.shape != (4, 4):
        raise InvalidInputError(f"{name} must have shape (4, 4), got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise InvalidInputError(f"{name} must be finite, got\n{matrix}")
    if not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0], rtol=0.0, atol=1e-9):
        raise InvalidInputError(f"the last row of {name} must be 0 0 0 1, got {matrix[3]}")
    rotation = matrix[:3, :3]
    deviation = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if deviation > _RIGID_TOLERANCE:
        raise InvalidInputError(
            f"{name} must be a rigid transform, but the columns of its rotation are off by {deviation:.3g} "
            f"from orthonormal (up to {_RIGID_TOLERANCE:g} is taken as rounding)"
        )
    if np.linalg.det(rotation) < 0.0:
        raise InvalidInputError(
            f"{name} must be a rotation and a translation, but it mirrors (determinant -1)"
        )
    if deviation > 1e-12:
        u, _, vt = np.linalg.svd(rotation)
        matrix[:3, :3] = u @ vt
    return matrix
