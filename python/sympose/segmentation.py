"""Foreground and background by depth: the paper's segmentation, a Gaussian mixture in each view."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.arrays import as_points
from sympose.camera import View, as_views
from sympose.errors import InvalidInputError
from sympose.mixture import DepthSample, ViewMixture, fit_mixture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Segmentation", "ViewMixture", "segment", "segment_heeding"]

_SAMPLE_SIZE = 40_000  # points of a view that the fits and the checks of a cut look at
_MAX_ROUNDS = 4
_BORDER = 0.01  # width of the border, as a share of the image
_FEW = 0.01  # of the points
_DISSENT = 0.5  # of the foreground that a view sees and calls background, for a warning


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Which points are foreground, and why.

    Attributes:
        mask: (N,) bool, True for foreground.
        votes: (N, 2) how many views called the point foreground, and how many saw it.
        mixtures: One for each view, of the round in which it cut last.
        warnings: What to know before relying on the mask.
    """

    mask: NDArray[np.bool_]
    votes: NDArray[np.int64]
    mixtures: tuple[ViewMixture, ...]
    warnings: tuple[str, ...] = ()

    def plot(self, path: str | PathLike[str] | None = None, *, max_views: int = 6) -> Figure:
        """Draw the histogram of the depths of each view, the mixture with its components, and the cut.

        Args:
            path: Where to save the figure; it is not saved where this is not given.
            max_views: Of more views, evenly chosen ones are shown.

        Returns:
            A matplotlib figure, made without pyplot: no window opens and the backend does not matter.

        Raises:
            ImportError: matplotlib is missing.
            InvalidInputError: The suffix of `path` names no kind of image.
        """
        from sympose.plotting.charts import draw_depths
        from sympose.plotting.style import new_figure, save

        count = max(1, min(max_views, len(self.mixtures)))
        columns = min(3, count)
        rows = -(-count // columns)
        figure = new_figure(4.5 * columns, 3.2 * rows)
        for place, k in enumerate(np.linspace(0, len(self.mixtures) - 1, count).astype(int), start=1):
            draw_depths(figure.add_subplot(rows, columns, place), self.mixtures[k], f"view {k}")
        if path is not None:
            save(figure, path)
        return figure


def segment(
    points: ArrayLike,
    views: Sequence[View],
    *,
    max_components: int = 5,
    min_views: int | None = None,
    seed: int = 0,
) -> Segmentation:
    """Tell the foreground of a scene from its background by the depths that its views see.

    In each view all points are projected, a Gaussian mixture is fitted to their depths, and where it has a
    deep valley with a background behind it, points beyond the valley are background. A view judges a point by
    its depth, not by its pixel alone, since a point of the background can lie hidden behind the foreground. A
    view without such a valley calls all that it sees foreground, so that a scene without background comes
    back whole. The votes of the views are counted, and the views look again at what is left until none of
    them finds more to remove.

    Args:
        points: (N, 3) in the world. Points that are not finite are never foreground.
        views: The cameras; each one sees every point in front of it and inside its image, hidden or not.
        max_components: Most components of a mixture.
        min_views: So many views must call a point foreground. By default at least half of those that see it;
            a point that no view sees is then foreground only if no view found a background.
        seed: Of the sample of the points that a view looks at where there are many; the same seed gives the
            same result.

    Returns:
        The mask, the votes, and the mixture of each view. `warnings` says when the scene goes on beyond the
        images and yet no view could part foreground from background.

    Raises:
        InvalidInputError: No points or views, or an argument out of its range.
        ImportError: scikit-learn is missing.

    Example:
        >>> import numpy as np
        >>> from sympose.camera import PinholeCamera
        >>> rng = np.random.default_rng(0)
        >>> part = rng.uniform(-0.5, 0.5, (2000, 3)) + [0.0, 0.0, 2.0]
        >>> wall = rng.uniform(-2.0, 2.0, (3000, 3)) * [1.0, 1.0, 0.01] + [0.0, 0.0, 5.0]
        >>> view = View(PinholeCamera(320, 240, 300.0, 300.0, 159.5, 119.5), np.eye(4))
        >>> result = segment(np.concatenate([part, wall]), [view])
        >>> bool(result.mask[:2000].all()), bool(result.mask[2000:].any())
        (True, False)
    """
    return segment_heeding(points, views, lambda _share: None, max_components, min_views, seed)


def segment_heeding(
    points: ArrayLike,
    views: Sequence[View],
    heed: Callable[[float], object],
    max_components: int = 5,
    min_views: int | None = None,
    seed: int = 0,
) -> Segmentation:
    """Do what `segment` does; before each view of each round call `heed` with the share that is done.

    What `heed` raises ends the segmentation.
    """
    cloud = as_points(points)
    views = as_views(views)
    _check(cloud, views, max_components, min_views, seed)
    # All views are projected and fitted once, and again in each round.
    steps = itertools.count()
    total = len(views) * 2 * (1 + _MAX_ROUNDS)
    finite = np.asarray(np.isfinite(cloud).all(axis=1))
    seen = np.zeros(len(cloud), dtype=np.int64)
    samples = []
    for k, view in enumerate(views):
        heed(next(steps) / total)
        pixels, _, visible = view.project(cloud)
        seen += visible
        samples.append(_Sample.draw(cloud, view, pixels, visible, np.random.default_rng([seed, k])))
    needed = (seen + 1) // 2 if min_views is None else np.full_like(seen, min_views)

    mask: NDArray[np.bool_] = finite & (seen >= (0 if min_views is None else min_views))
    mixtures = []
    for sample in samples:
        heed(next(steps) / total)
        mixtures.append(fit_mixture(sample.where(mask), max_components=max_components))
    foreground = seen.copy()
    notes: list[str] = []
    fresh = [k for k, mixture in enumerate(mixtures) if mixture.threshold is not None]
    limits = np.full(len(views), np.inf)
    for _ in range(_MAX_ROUNDS):
        if not fresh:
            break
        votes = foreground.copy()
        for k in fresh:
            heed(next(steps) / total)
            limit = float(mixtures[k].threshold or np.inf)
            _, depth, visible = views[k].project(cloud)
            votes -= visible & (depth > limit) & (depth <= limits[k])
            limits[k] = limit
        smaller: NDArray[np.bool_] = finite & (seen > 0) & (votes >= needed)
        if smaller.sum() < _FEW * finite.sum():
            notes.append(
                f"the views contradict each other and would leave {smaller.sum()} of {finite.sum()} points; "
                "their last round was not applied"
            )
            break
        removed, mask, foreground = mask & ~smaller, smaller, votes
        fresh = []
        for k, sample in enumerate(samples):
            heed(next(steps) / total)
            # A view that saw hardly any of what was removed would fit the same again.
            if removed[sample.index].sum() > _FEW * len(sample.index):
                mixture = fit_mixture(sample.where(mask), max_components=max_components, again=True)
                if mixture.threshold is not None:
                    mixtures[k] = mixture
                    fresh.append(k)
    notes += _diagnose(samples, mixtures, mask, seen, finite)
    return Segmentation(mask, np.stack([foreground, seen], axis=1), tuple(mixtures), tuple(notes))


@dataclass(frozen=True, eq=False)
class _Sample:
    """Some of the points that a view sees: `index` into the cloud, and where they are for the view."""

    index: NDArray[np.int64]
    seen: DepthSample

    @classmethod
    def draw(
        cls,
        cloud: NDArray[np.float64],
        view: View,
        pixels: NDArray[np.float64],
        visible: NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> _Sample:
        index = np.flatnonzero(visible)
        if len(index) > _SAMPLE_SIZE:
            index = index[rng.integers(0, len(index), _SAMPLE_SIZE)]
        size = np.array([view.camera.width, view.camera.height])
        margin = np.maximum(_BORDER * size, 1.0)
        inner = (pixels[index] >= margin - 0.5) & (pixels[index] < size - margin - 0.5)
        on_border = np.asarray(~inner.all(axis=1))
        return cls(index, DepthSample(view.to_camera(cloud[index]), on_border))

    def where(self, mask: NDArray[np.bool_]) -> DepthSample:
        kept = mask[self.index]
        return DepthSample(self.seen.points_camera[kept], self.seen.on_border[kept])


def _diagnose(
    samples: list[_Sample],
    mixtures: list[ViewMixture],
    mask: NDArray[np.bool_],
    seen: NDArray[np.int64],
    finite: NDArray[np.bool_],
) -> list[str]:
    """Say what makes the result doubtful."""
    notes = []
    blind = [k for k, mixture in enumerate(mixtures) if len(mixture.means) == 0]
    if len(blind) == len(mixtures):
        notes.append(f"no view could be used: {mixtures[0].reason}; check the poses of the views")
    elif mask.sum() == finite.sum() and 2 * sum(mixture.reaches_border for mixture in mixtures) > len(
        mixtures
    ):
        notes.append(
            "foreground and background overlap in depth in every view: the scene goes on beyond the images, "
            "but nothing was removed; pass a region of interest if a background remains"
        )
    unseen = int((finite & (seen == 0)).sum())
    if unseen:
        notes.append(f"no view sees {unseen} of {len(seen)} points")
    failed = [k for k, mixture in enumerate(mixtures) if not mixture.converged]
    if failed:
        notes.append(f"the mixture did not converge in {len(failed)} views: {_listed(failed)}")
    outvoted = []
    for k, (sample, mixture) in enumerate(zip(samples, mixtures, strict=True)):
        depth = sample.where(mask).depth
        if mixture.threshold is not None and (depth > mixture.threshold).sum() > _DISSENT * len(depth):
            outvoted.append(k)
    if outvoted:
        notes.append(f"{len(outvoted)} views call most of the foreground background: {_listed(outvoted)}")
    return notes


def _listed(views: list[int]) -> str:
    return ", ".join(map(str, views[:5])) + (", ..." if len(views) > 5 else "")


def _check(
    cloud: NDArray[np.float64],
    views: tuple[View, ...],
    max_components: int,
    min_views: int | None,
    seed: int,
) -> None:
    if not np.isfinite(cloud).all(axis=1).any():
        raise InvalidInputError(f"points must hold at least one finite point, got {len(cloud)} points")
    if not views:
        raise InvalidInputError("views must hold at least one View: without cameras there are no depths")
    for name, value, low, high in (
        ("max_components", max_components, 1, 100),
        ("min_views", 1 if min_views is None else min_views, 1, len(views)),
        ("seed", seed, 0, 2**63 - 1),
    ):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not low <= value <= high:
            raise InvalidInputError(f"{name} must be a whole number from {low} to {high}, got {value!r}")
