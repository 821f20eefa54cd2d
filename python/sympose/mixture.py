"""A Gaussian mixture of the depths that a view sees, and where it parts foreground from background.

The paper takes the clusters with the smaller means for the foreground. The depths of a single object are not
Gaussian, though: a mixture splits them into four or five components. So the mixture serves as the density,
and the cut goes through a valley of it only where all of this holds:

- The valley lies between two neighbouring components that are far apart, and is deep.
- There is a gap: the bulk of the points on either side leaves a stretch of depth free.
- What lies behind is a background rather than the rear of the same object. A background goes on beyond the
  border of the image; where it does not, or where what lies in front may be one object, since it ends inside
  the image or a background was cut off before, the gap must be the longer, compared with the size of what
  lies in front.
- What lies on either side is more than stray points.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture  # type: ignore[import-untyped]

__all__ = ["DepthSample", "ViewMixture", "fit_mixture"]

_MIN_POINTS = 50
_FIT_SIZE = 1000  # so many evenly spaced quantiles stand for the depths
_TRIM = 0.01  # share of the nearest and of the farthest depths that the fit leaves out
_BULK = (0.02, 0.98)  # quantiles between which the bulk of a side lies
_MIN_SEPARATION = 2.0  # Ashman's D; two equal Gaussians have two peaks beyond it
_MAX_VALLEY = 0.7  # density in the valley over that of the lower of the peaks beside it
_MIN_SHARE = 0.02  # of the points, on either side of a cut
_BORDER_SHARE = 0.01  # of the points on the border, for a side that reaches it; 0.04 if it fills the image
# The least gap, as a share of the size of what lies in front, where
_MIN_GAP = 0.15  # both sides reach the border (a table before a wall),
_MIN_GAP_COMPACT = 0.4  # only what lies behind does (an object before a wall),
_MIN_GAP_INSIDE = 1.0  # not even that does (two objects, or one).


@dataclass(frozen=True, eq=False)
class DepthSample:
    """A sample of the points that a view sees.

    Attributes:
        points_camera: (M, 3) in the camera frame.
        on_border: (M,) whether the pixel lies at the border of the image.
    """

    points_camera: NDArray[np.float64]
    on_border: NDArray[np.bool_]

    @property
    def depth(self) -> NDArray[np.float64]:
        """(M,) z in the camera frame."""
        return self.points_camera[:, 2]


@dataclass(frozen=True, eq=False)
class ViewMixture:
    """The Gaussian mixture of the depths in one view; lengths are in the unit of the cloud.

    Attributes:
        weights: (K,) shares of the components, which add up to 1; K is 0 where there was nothing to fit.
        means: (K,) in increasing order.
        sigmas: (K,) standard deviations.
        threshold: Depth beyond which the view calls a point background, or None where it removes nothing.
        reason: Why there is no cut, or what was cut.
        reaches_border: Whether what the view sees goes on beyond the border of the image.
        converged: Whether the fit did.
        depths: (M,) the depths that were fitted: evenly spaced quantiles of what the view sees.
    """

    weights: NDArray[np.float64]
    means: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    threshold: float | None
    reason: str
    reaches_border: bool = False
    converged: bool = True
    depths: NDArray[np.float64] = field(default_factory=lambda: np.empty(0), repr=False)

    def component_densities(self, depth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (M, K), the weighted density of each component at (M,) depths."""
        z = (np.asarray(depth)[:, None] - self.means) / self.sigmas
        densities: NDArray[np.float64] = (
            self.weights / (self.sigmas * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * z * z)
        )
        return densities

    def density(self, depth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (M,), the density of the mixture at (M,) depths."""
        return np.asarray(self.component_densities(depth).sum(axis=1))


def fit_mixture(sample: DepthSample, *, max_components: int = 5, again: bool = False) -> ViewMixture:
    """Fit a mixture to the depths of a view and find the cut, if there is one.

    The number of components, up to `max_components`, is that with the lowest Bayesian information criterion.
    The same sample gives the same result: nothing is drawn at random. With `again` a background was cut off
    before: what is left may well be one object, even where the border of the image cuts it.

    Raises:
        ImportError: scikit-learn is missing.
    """
    count = len(sample.depth)
    if count < _MIN_POINTS:
        return _unfitted(f"the view sees {count} points, at least {_MIN_POINTS} are needed", sample)
    levels = _TRIM + (1.0 - 2.0 * _TRIM) * (np.arange(_FIT_SIZE) + 0.5) / _FIT_SIZE
    depths = np.quantile(sample.depth, levels)
    middle, spread = float(depths.mean()), float(depths.std())
    if not spread > 1e-9 * middle:
        return _unfitted(f"all points are at depth {middle:.4g}", sample)
    # scikit-learn's regularisation is absolute, so the depths are standardised.
    model = _fit((depths - middle) / spread, max_components)
    order = np.argsort(model.means_[:, 0])
    mixture = ViewMixture(
        weights=model.weights_[order],
        means=model.means_[order, 0] * spread + middle,
        sigmas=np.sqrt(model.covariances_[order]) * spread,
        threshold=None,
        reason="",
        reaches_border=_reaches_border(sample.on_border),
        converged=bool(model.converged_),
        depths=depths,
    )
    threshold, reason = _choose_cut(mixture, sample, again)
    return replace(mixture, threshold=threshold, reason=reason)


def _unfitted(reason: str, sample: DepthSample) -> ViewMixture:
    none = np.empty(0)
    return ViewMixture(none, none, none, None, reason, _reaches_border(sample.on_border))


def _reaches_border(on_border: NDArray[np.bool_]) -> bool:
    return len(on_border) > 0 and bool(on_border.mean() >= _BORDER_SHARE)


def _fit(depths: NDArray[np.float64], max_components: int) -> GaussianMixture:
    """Fit mixtures of 1 to `max_components` to sorted, standardised depths; return the one of lowest BIC."""
    try:
        from sklearn.mixture import GaussianMixture
    except ImportError as error:
        raise ImportError("segmentation needs scikit-learn: pip install 'sympose[segment]'") from error

    column = depths[:, None]
    models = []
    with warnings.catch_warnings():
        # Empty clusters and fits that do not converge: the one is harmless, the other is in `converged_`.
        warnings.simplefilter("ignore")
        for components in range(1, max_components + 1):
            model = GaussianMixture(
                components,
                covariance_type="spherical",
                init_params="random_from_data",  # without effect, and cheap: the start is given
                random_state=0,
                **_start(depths, components),
            )
            models.append(model.fit(column))
    return min(models, key=lambda model: model.bic(column))


def _start(depths: NDArray[np.float64], components: int) -> dict[str, NDArray[Any]]:
    """Clusters of k-means from seeds evenly over the range, so that a sparse background gets one too.

    scikit-learn's own start is random, slower, and finds such a background less often.
    """
    from scipy.cluster.vq import kmeans2  # type: ignore[import-untyped]

    steps = (2 * np.arange(components) + 1) / (2 * components)
    seeds = depths[0] + steps * (depths[-1] - depths[0])
    _, label = kmeans2(depths[:, None], seeds[:, None], minit="matrix")
    count = np.bincount(label, minlength=components)
    filled = np.maximum(count, 1)
    means = np.where(count > 0, np.bincount(label, depths, components) / filled, seeds)
    variances = np.bincount(label, (depths - means[label]) ** 2, components) / filled
    return {
        "weights_init": filled / filled.sum(),
        "means_init": means[:, None],
        "precisions_init": 1.0 / np.maximum(variances, 1e-6),
    }


def _choose_cut(mixture: ViewMixture, sample: DepthSample, again: bool) -> tuple[float | None, str]:
    """Return the depth of the valley with the longest gap and what it is, or None and why there is no cut."""
    longest, cut = 0.0, None
    reason = "the mixture has no deep valley between two neighbouring components"
    for depth in _valleys(mixture):
        gap, objection = _gap_at(depth, sample, again)
        if objection:
            reason = objection
        elif gap > longest:
            longest, cut = gap, depth
    return (None, reason) if cut is None else (cut, f"a gap of {longest:.4g} about depth {cut:.4g}")


def _valleys(mixture: ViewMixture) -> list[float]:
    """Depths of the deep valleys of the density between neighbouring components that are far apart."""
    means, sigmas = mixture.means, mixture.sigmas
    # The means themselves too, since a sharp peak falls between the steps of a grid.
    grid = np.sort(np.concatenate([np.linspace(means[0], means[-1], 512), means]))
    density = mixture.density(grid)
    depths = []
    for k in range(len(means) - 1):
        separation = (means[k + 1] - means[k]) / np.sqrt((sigmas[k] ** 2 + sigmas[k + 1] ** 2) / 2.0)
        if separation < _MIN_SEPARATION:
            continue
        first, last = np.searchsorted(grid, means[k : k + 2])
        lowest = first + int(np.argmin(density[first : last + 1]))
        peak = min(density[: lowest + 1].max(), density[lowest:].max())
        if density[lowest] <= _MAX_VALLEY * peak:
            depths.append(float(grid[lowest]))
    return depths


def _gap_at(cut: float, sample: DepthSample, again: bool) -> tuple[float, str]:
    """Return the length of the gap about the depth `cut`, and what speaks against a cut there, if any."""
    behind = sample.depth > cut
    share = float(behind.mean())
    if min(share, 1.0 - share) < _MIN_SHARE:
        side = "behind" if share < 0.5 else "in front of"
        return 0.0, f"only {min(share, 1.0 - share):.1%} of the points lie {side} depth {cut:.4g}"
    near, far = np.quantile(sample.points_camera[~behind], _BULK, axis=0)
    size = float((far - near).max())
    gap = float(np.quantile(sample.depth[behind], _BULK[0]) - far[2])
    if not _reaches_border(sample.on_border[behind]):
        needed = _MIN_GAP_INSIDE * size
    elif again or not _reaches_border(sample.on_border[~behind]):
        needed = _MIN_GAP_COMPACT * size
    else:
        needed = _MIN_GAP * size
    # What has no size is no object either, but the same point again and again.
    if gap > needed > 0.0:
        return gap, ""
    return gap, f"the gap about depth {cut:.4g} is {max(gap, 0.0):.4g} long, {needed:.4g} would be needed"
