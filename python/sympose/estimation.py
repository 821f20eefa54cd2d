"""The main call: `estimate`."""

from __future__ import annotations

import math
import operator
import time
from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose import _core
from sympose._core import Estimate, Reference
from sympose.arrays import as_points
from sympose.camera import View, as_views, field_of_view
from sympose.config import Config
from sympose.errors import DeadlineExceededError, InsufficientDataError, InvalidInputError
from sympose.scene import MeshVertices, Scene

__all__ = ["SceneLike", "estimate"]


class _HasPoints(Protocol):
    @property
    def points(self) -> Any: ...


class _HasVertices(Protocol):
    @property
    def vertices(self) -> Any: ...


SceneLike: TypeAlias = ArrayLike | str | PathLike[str] | Scene | _HasPoints | _HasVertices
Progress: TypeAlias = Callable[[str, float], object]

_SEGMENTATION = 0.2  # share of the whole that the segmentation is reported to be


def estimate(
    scene: SceneLike,
    *,
    order: int | Literal["continuous"] | None = None,
    viewpoints: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    views: Sequence[View] | None = None,
    roi: ArrayLike | None = None,
    axis_hint: ArrayLike | None = None,
    initial: Estimate | ArrayLike | None = None,
    reference: Reference | None = None,
    prefer: Estimate | ArrayLike | None = None,
    config: Config | None = None,
    seed: int = 0,
    threads: int | None = None,
    timeout: float | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Find the pose of a rotationally symmetric part in a point cloud.

    Args:
        scene: (N, 3) points in any unit, the path of a file that `read` knows, a `Scene`, or anything with
            `.points` or `.vertices` (Open3D, PyVista, trimesh), with `.normals` where an Open3D cloud has
            them. Of a mesh the vertices count, with a warning: sample the surface of a model. NaN points are
            left out, those at a place that many share, as zeros where a sensor got no return, and those of
            which a coordinate lies farther from the median than a hundred interquartile ranges, of the
            coordinate that is spread most.
        order: Order of the symmetry, a whole number of at least 2, or "continuous" for a surface of
            revolution. None: that of `config`, by default "auto": found.
        viewpoints: (3,) one position of the sensor, or (N, 3) one for each point. They orient the normals and
            tell free space, which makes the answer a good deal more certain. [0, 0, 0] for points in the
            frame of their camera. Without, they are found where the points come in the order in which a depth
            sensor read them out (`viewpoints_from_order`).
        normals: (N, 3), oriented or not; estimated where absent.
        views: Pinhole views of the scene. With them, or with a scene that has them, the foreground is
            segmented first; `views=()` leaves that out. They do not tell which camera measured which point:
            that is what `viewpoints` say, which a scene made from depth images has. With both, a pixel
            without a return counts as one.
        roi: (2, 3) lower and upper corner; points outside are ignored.
        axis_hint: (3,) rough axis, sign ignored; the search stays within 30 degrees of it.
        initial: Pose to start from, (4, 4) or an earlier estimate: for tracking. It is refined on fewer
            points (`Config.tracking`), below a score of 0.8 on all; only if that fails is the axis searched.
            The axis keeps its sign; without `prefer` the equivalent pose nearest to this one is returned.
        reference: A taught part, from `Estimate.as_reference`: the pose is found in its frame, which fixes
            the origin along the axis and the turn about it. Its order counts where none is given.
        prefer: (4, 4) or an earlier estimate; among equivalent poses the one nearest to this is returned.
        config: All other settings. An argument given here wins over the same setting in `config`.
        seed: Seed of everything random; 0 leaves that of `config`.
        threads: Worker threads, in a pool of its own; None: all cores. The result does not depend on it.
        timeout: Seconds until `DeadlineExceededError`, segmentation included.
        progress: Called in this thread with the stage and the share of the whole that is done. An exception
            raised in it cancels the estimate and is raised here.

    Returns:
        The pose, how far to trust it, and what was done to find it.

    Raises:
        InvalidInputError: An argument or the file is wrong; the message says what was found.
        InsufficientDataError: Too few points, or points that span no surface.
        NoSymmetryError: No axis explains the cloud; `evidence` says how good the best one was. Or the scan
            does not fit the reference.
        DeadlineExceededError: The timeout passed.
        OSError: The file cannot be read.
    """
    if not isinstance(config, (Config, type(None))):
        raise InvalidInputError(f"config must be a sympose.Config, got {type(config).__name__}")
    if not isinstance(reference, (Reference, type(None))):
        raise InvalidInputError(f"reference must be a sympose.Reference, got {type(reference).__name__}")
    given = {
        "order": _as_order(order),
        "seed": seed or None,
        "threads": threads,
        "roi": roi,
        "axis_hint": axis_hint,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    settings = (config or Config()).replace(**changes)
    watch = Watch(timeout, progress)
    source = _as_scene(scene)
    views = source.views if views is None else as_views(views)
    cloud = cloud_of(source, views, settings, watch)
    if viewpoints is not None:
        cloud["viewpoints"] = viewpoints
    if normals is not None:
        cloud["normals"] = normals
    return _core.estimate(
        **cloud,
        config=settings.to_json(),
        initial=initial.pose if isinstance(initial, Estimate) else initial,
        prefer=prefer.pose if isinstance(prefer, Estimate) else prefer,
        reference=reference,
        timeout=watch.remaining(),
        progress=watch.progress if views else progress,
    )


def cloud_of(
    source: Scene, views: Sequence[View], settings: Config, watch: Watch | None = None
) -> dict[str, Any]:
    """What `_core` takes of a scene, its foreground segmented where there are views."""
    pictures = [(view.world_from_camera, field_of_view(view.camera)) for view in views or source.views]
    foreground: NDArray[np.bool_] | None = None
    warnings = [_core.MESH_WARNING] if isinstance(source, MeshVertices) else []
    if views:
        finite = _finite(source.points, settings)
        foreground, remarks = _segmented(source.points, views, settings.seed, watch or Watch())
        warnings += remarks
        # No view sees points that are not finite; they go on, to be counted among those that are dropped.
        foreground |= ~finite
    return {
        "points": source.points,
        "viewpoints": source.viewpoints if source.tracks is None else source.tracks,
        "normals": source.normals,
        "foreground": foreground,
        "pictures": [(pose, corners) for pose, corners in pictures if corners is not None],
        "warnings": warnings,
    }


def _as_order(order: Any) -> int | str | None:
    """The order as the configuration takes it, which also knows its range."""
    if order is None or isinstance(order, str):
        return order
    try:
        if not isinstance(order, (bool, np.bool_)):
            return operator.index(order)
    except TypeError:
        pass
    raise InvalidInputError(
        f'order = {order!r}: expected a whole number of at least 2, "continuous", or None to find it'
    )


def _as_scene(scene: SceneLike) -> Scene:
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, (str, PathLike)):
        from sympose.io import read

        return read(scene)
    if not isinstance(scene, (np.ndarray, list, tuple)):
        # Open3D, PyVista and trimesh are known by what they have, so that none of them is imported.
        if hasattr(scene, "point") and "positions" in scene.point:
            return _of_tensors(scene.point)
        if hasattr(scene, "geometry") and not hasattr(scene, "points"):
            raise InvalidInputError(
                f"scene must be a point cloud, got {type(scene).__name__}; pass one of its geometries"
            )
        for name in ("points", "vertices"):
            if hasattr(scene, name):
                points = as_points(getattr(scene, name), f"scene.{name}")
                if name == "vertices" and _has_faces(scene):
                    return MeshVertices(points)
                normals: Any = getattr(scene, "normals", None) if name == "points" else None
                # A cloud of Open3D without normals has an empty list of them.
                return Scene(points, normals=normals if np.shape(normals) == points.shape else None)
    return Scene(as_points(cast(ArrayLike, scene), "scene"))


def _of_tensors(attributes: Any) -> Scene:
    """The cloud in a tensor geometry of Open3D."""
    points = as_points(attributes["positions"], "scene.point.positions")
    normals = as_points(attributes["normals"], "scene.point.normals") if "normals" in attributes else None
    return Scene(points, normals=normals)


def _has_faces(mesh: Any) -> bool:
    """Whether what has vertices is a mesh of trimesh or Open3D, which also hold clouds like that."""
    return any(np.size(getattr(mesh, name, ())) > 0 for name in ("faces", "triangles"))


def _finite(points: NDArray[np.float64], settings: Config) -> NDArray[np.bool_]:
    """Which points are finite; refuses others before the segmentation where the settings ask for that."""
    finite = np.asarray(np.isfinite(points).all(axis=1))
    bad = int((~finite).sum())
    if bad and settings.non_finite == "error":
        raise InvalidInputError(
            f"{bad} of {len(points)} points have a NaN or infinite coordinate; remove them, or leave "
            'non_finite at "drop"'
        )
    return finite


class Watch:
    """Deadline and progress of a call of which the segmentation is the first part."""

    def __init__(self, timeout: float | None = None, progress: Progress | None = None) -> None:
        if progress is not None and not callable(progress):
            raise InvalidInputError(f"progress = {progress!r}: expected a function, or None")
        self._timeout, self._listener = _seconds(timeout), progress
        self._started = time.perf_counter()

    def heed(self, share: float) -> None:
        """Report how much of the segmentation is done, and look at the clock."""
        if self._listener is not None:
            self._listener("segment", _SEGMENTATION * share)
        self.remaining("during segmentation")

    def remaining(self, when: str = "before the search") -> float | None:
        """Return the seconds that are left for the rest, or None where there is no deadline.

        Raises:
            DeadlineExceededError: None is left.
        """
        if self._timeout is None:
            return None
        elapsed = time.perf_counter() - self._started
        if elapsed >= self._timeout:
            raise DeadlineExceededError(f"the deadline passed {when} (after {elapsed:.3f} s)")
        return self._timeout - elapsed

    @property
    def progress(self) -> Progress | None:
        """What the stages after the segmentation report to."""
        listener = self._listener
        if listener is None:
            return None
        return lambda stage, share: listener(stage, _SEGMENTATION + (1.0 - _SEGMENTATION) * share)


def _seconds(timeout: Any) -> float | None:
    """A deadline as a positive number."""
    if timeout is None:
        return None
    try:
        seconds = float("nan" if isinstance(timeout, (str, bytes)) else timeout)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        seconds = math.nan
    if not seconds > 0.0:
        raise InvalidInputError(f"timeout = {timeout!r}: expected a positive number of seconds, or None")
    return seconds


def _segmented(
    points: NDArray[np.float64], views: Sequence[View], seed: int, watch: Watch
) -> tuple[NDArray[np.bool_], list[str]]:
    """The mask of the foreground, and what the segmentation warns of."""
    from sympose.segmentation import segment_heeding

    segmentation = segment_heeding(points, views, watch.heed, seed=seed)
    if not segmentation.mask.any():
        raise InsufficientDataError(
            f"segmentation: none of the {len(points)} points is foreground in the {len(views)} views; "
            "check that world_from_camera takes camera to world coordinates, or pass views=()"
        )
    return segmentation.mask, list(segmentation.warnings)
