"""A scene: points and whatever is known about how they were measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.arrays import as_floats, as_points, read_only
from sympose.camera import PinholeCamera, View, as_views
from sympose.errors import InvalidInputError
from sympose.tracks import Tracks

__all__ = ["Scene"]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Scene:
    """Points in the world, with colours, normals, viewpoints and views where they are known.

    The arrays are read-only. Arrays that already have the right type are not copied, so that they share
    memory with what was passed in.

    Attributes:
        points: (N, 3) float64. NaN points (of organised clouds) are let through; masked ones become NaN.
        colors: (N, 3) uint8, or None. Integers from 0 to 255 are taken as they are, floats from 0 to 1 are
            scaled.
        normals: (N, 3) float64, or None.
        viewpoints: (N, 3) float64, where the sensor stood that measured each point, or None. One position,
            (3,) or (1, 3), is taken for all points.
        views: The cameras that looked at the scene; with them, segmentation can tell foreground from
            background.
        name: For example the name of the file.
        tracks: All cameras that saw each point, or None; `viewpoints` are then the nearest of them. A point
            that several cameras agree on is lost to none of these, so keep them: cut a scene with `select`.

    Raises:
        InvalidInputError: An array has the wrong shape, type or range.

    Example:
        >>> scene = Scene([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]], viewpoints=[0.0, 0.0, 0.0])
        >>> len(scene), scene.viewpoints.shape
        (2, (2, 3))
    """

    points: NDArray[np.float64]
    colors: NDArray[np.uint8] | None = None
    normals: NDArray[np.float64] | None = None
    viewpoints: NDArray[np.float64] | None = None
    views: tuple[View, ...] = ()
    name: str | None = None
    tracks: Tracks | None = None

    # Written out, since what may be passed is wider than what is kept.
    def __init__(
        self,
        points: ArrayLike,
        colors: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        viewpoints: ArrayLike | None = None,
        views: Sequence[View] = (),
        name: str | None = None,
        *,
        tracks: Tracks | None = None,
    ) -> None:
        def keep(field: str, value: object) -> None:
            object.__setattr__(self, field, value)

        xyz = as_points(points)
        if tracks is not None:
            if len(tracks.counts) != len(xyz):
                raise InvalidInputError(
                    f"tracks must be those of the {len(xyz)} points, got those of {len(tracks.counts)}"
                )
            viewpoints = tracks.nearest() if viewpoints is None else viewpoints
        keep("points", read_only(xyz))
        keep("colors", None if colors is None else read_only(_as_colors(colors, len(xyz))))
        keep("normals", None if normals is None else read_only(_as_rows(normals, "normals", len(xyz))))
        keep(
            "viewpoints",
            None if viewpoints is None else read_only(_as_viewpoints(viewpoints, len(xyz))),
        )
        keep("views", as_views(views))
        keep("name", name)
        keep("tracks", tracks)

    @classmethod
    def from_depth(
        cls,
        depth: ArrayLike | str | PathLike[str],
        camera: PinholeCamera,
        world_from_camera: ArrayLike | None = None,
        *,
        depth_scale: float = 1.0,
        color: ArrayLike | str | PathLike[str] | None = None,
    ) -> Scene:
        """Make a scene of one depth image.

        Args:
            depth: (H, W) integers or floats, or the path of a 16-bit or float image (PNG, TIFF). It is the
                distance along the optical axis. Pixels that are zero, negative, not finite or masked (of a
                masked array) hold no measurement and are dropped.
            camera: Its size must be that of the image.
            world_from_camera: (4, 4) pose of the camera; the camera frame itself where it is not given.
            depth_scale: Factor from the numbers in the image to the unit of length: 0.001 turns a PNG in
                millimetres into metres.
            color: (H, W, 3) image of the same camera, or its path.

        Returns:
            The scene, row by row; the camera centre is the viewpoint of all points, and `views` holds the one
            view.

        Raises:
            InvalidInputError: The image is not a depth image of this camera, or has no valid pixel.
            FileNotFoundError: There is no such file.

        Example:
            >>> camera = PinholeCamera(4, 3, fx=4.0, fy=4.0, cx=1.5, cy=1.0)
            >>> len(Scene.from_depth([[0, 500, 500, 0]] * 3, camera, depth_scale=0.001))
            6
        """
        if not isinstance(camera, PinholeCamera):
            raise InvalidInputError(
                f"camera must be a PinholeCamera, got {type(camera).__name__}; "
                "pass PinholeCamera(width, height, fx, fy, cx, cy)"
            )
        name = None
        if isinstance(depth, (str, PathLike)):
            name = Path(depth).name
            depth = _read_image(
                depth, ("I;16", "I;16B", "I;16L", "I", "F"), "a depth image of 16 or 32 bits a pixel"
            )
        scale = as_floats(depth_scale, "depth_scale")
        if scale.ndim or not np.isfinite(scale) or scale <= 0.0:
            raise InvalidInputError(f"depth_scale must be a positive, finite number, got {depth_scale!r}")
        image = as_floats(depth, "depth")
        if image.shape != (camera.height, camera.width):
            raise InvalidInputError(
                f"depth must have the shape of the camera (height, width) = {(camera.height, camera.width)}, "
                f"got {image.shape}"
            )
        valid = np.isfinite(image) & (image > 0.0)
        rows, columns = np.nonzero(valid)
        if len(rows) == 0:
            raise InvalidInputError("depth has no valid pixel: all are zero, negative, not finite or masked")
        view = View(camera, np.eye(4) if world_from_camera is None else world_from_camera, name)
        points = camera.unproject(np.stack([columns, rows], axis=1), image[valid] * float(scale))
        # The corners of the image can lie beyond the reach of the distortion model.
        known = np.isfinite(points[:, 0])
        if not known.any():
            raise InvalidInputError("depth has no pixel within reach of the distortion model of the camera")
        points = points[known] @ view.world_from_camera[:3, :3].T + view.center
        colors = None
        if color is not None:
            if isinstance(color, (str, PathLike)):
                color = _read_image(color, (), "a colour image", convert="RGB")
            rgb = _unmasked(color, "color")
            if rgb.shape != (*image.shape, 3):
                raise InvalidInputError(
                    f"color must have shape {(*image.shape, 3)} like depth, got {rgb.shape}"
                )
            colors = rgb[valid][known]
        return cls(points, colors, None, view.center, (view,), name)

    @classmethod
    def merge(cls, scenes: Sequence[Scene]) -> Scene:
        """Join scenes of one world into one.

        Args:
            scenes: At least one.

        Returns:
            All points in order and all views. Colours, normals, viewpoints and tracks are kept where every
            scene has them. The name is kept where all agree.

        Raises:
            InvalidInputError: `scenes` is empty, or holds something else.

        Example:
            >>> len(Scene.merge([Scene([[0, 0, 0]]), Scene([[1, 0, 0]])]))
            2
        """
        if isinstance(scenes, Scene):
            raise InvalidInputError("merge takes a sequence of scenes, got one Scene; pass [scene, ...]")
        if not isinstance(scenes, Iterable):
            raise InvalidInputError(f"merge takes a sequence of scenes, got {type(scenes).__name__}")
        scenes = tuple(scenes)
        if not scenes:
            raise InvalidInputError("merge needs at least one scene, got none")
        for scene in scenes:
            if not isinstance(scene, Scene):
                raise InvalidInputError(f"merge takes Scene objects, got {type(scene).__name__}")

        def joined(field: str) -> NDArray[Any] | None:
            arrays = [getattr(scene, field) for scene in scenes]
            return None if any(array is None for array in arrays) else np.concatenate(arrays)

        tracks = [scene.tracks for scene in scenes if scene.tracks is not None]
        # The same view object in several scenes is one view, and must not vote twice.
        views = {id(view): view for scene in scenes for view in scene.views}
        names = {scene.name for scene in scenes}
        return cls(
            np.concatenate([scene.points for scene in scenes]),
            joined("colors"),
            joined("normals"),
            joined("viewpoints"),
            tuple(views.values()),
            names.pop() if len(names) == 1 else None,
            tracks=Tracks.join(tracks) if len(tracks) == len(scenes) else None,
        )

    def select(self, rows: ArrayLike) -> Scene:
        """The scene of some of its points, with all that is known of them.

        Args:
            rows: (N,) mask, or the rows of the points.

        Raises:
            InvalidInputError: It is neither.

        Example:
            >>> scene = Scene([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]], viewpoints=[0.0, 0.0, 0.0])
            >>> scene.select(scene.points[:, 1] > 0.5)
            Scene(1 points, viewpoints)
        """
        chosen = np.asarray(rows)
        is_mask = chosen.dtype == np.bool_ and chosen.shape == (len(self),)
        is_rows = chosen.dtype.kind in "iu" and chosen.ndim == 1 and (chosen < len(self)).all()
        if not is_mask and not (is_rows and (chosen >= 0).all()):
            raise InvalidInputError(
                f"rows must be a mask of the {len(self)} points or indices of them, got {chosen.dtype} of "
                f"shape {chosen.shape}"
            )

        def some(array: NDArray[Any] | None) -> NDArray[Any] | None:
            return None if array is None else array[chosen]

        return Scene(
            self.points[chosen],
            some(self.colors),
            some(self.normals),
            some(self.viewpoints),
            self.views,
            self.name,
            tracks=None if self.tracks is None else self.tracks.select(chosen),
        )

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        known = [field for field in ("colors", "normals", "viewpoints") if getattr(self, field) is not None]
        parts = [f"{len(self):,} points", *known]
        if self.views:
            parts.append(f"{len(self.views)} view{'s' if len(self.views) > 1 else ''}")
        label = "" if self.name is None else f"{self.name!r}: "
        return f"Scene({label}{', '.join(parts)})"


class MeshVertices(Scene):
    """The vertices of a mesh, which are the points of a scan only where the mesh was made of one."""


def _as_rows(value: ArrayLike, name: str, count: int) -> NDArray[np.float64]:
    rows = as_points(value, name)
    if len(rows) != count:
        raise InvalidInputError(f"{name} must have a row for each of the {count} points, got {len(rows)}")
    return rows


def _as_viewpoints(value: ArrayLike, count: int) -> NDArray[np.float64]:
    viewpoints = as_floats(value, "viewpoints")
    if viewpoints.shape in ((3,), (1, 3)):
        viewpoints = np.tile(viewpoints.reshape(1, 3), (count, 1))
    return _as_rows(viewpoints, "viewpoints", count)


def _unmasked(value: ArrayLike, name: str) -> NDArray[Any]:
    if np.ma.is_masked(value):
        raise InvalidInputError(
            f"{name} has masked values, and no colour means none; fill them before, with {name}.filled(0)"
        )
    return np.asarray(value)


def _as_colors(value: ArrayLike, count: int) -> NDArray[np.uint8]:
    array = _unmasked(value, "colors")
    colors = _as_rows(array, "colors", count)
    if array.dtype == np.uint8:
        return np.ascontiguousarray(array)
    whole = array.dtype.kind in "iub"
    top = 255.0 if whole else 1.0
    if not ((colors >= 0.0) & (colors <= top)).all():
        kind = "integers from 0 to 255" if whole else "floats from 0 to 1"
        raise InvalidInputError(
            f"colors must be {kind}, got values from {np.min(colors):g} to {np.max(colors):g}; "
            "convert to uint8 before"
        )
    return (colors if whole else np.rint(colors * 255.0)).astype(np.uint8)


def _read_image(
    path: str | PathLike[str], modes: tuple[str, ...], expected: str, convert: str | None = None
) -> NDArray[Any]:
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError("reading images needs Pillow: pip install 'sympose[io]'") from error

    try:
        with Image.open(path) as image:
            if modes and image.mode not in modes:
                raise InvalidInputError(f"{path}: expected {expected}, got an image of mode {image.mode}")
            return np.asarray(image.convert(convert) if convert else image)
    except FileNotFoundError:
        raise
    except (OSError, SyntaxError, ValueError) as error:
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(f"{path}: expected {expected}, but it cannot be read: {error}") from error
