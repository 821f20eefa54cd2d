"""Which cameras saw each point of a cloud that was fused from several pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.arrays import as_points, read_only
from sympose.errors import InvalidInputError

__all__ = ["Tracks"]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Which cameras saw each point, where points are such as several agree on.

    Attributes:
        places: (P, 3) float64, where the cameras stood.
        counts: (N,) uint32, how many saw each point, at least one.
        seen_from: (sum of the counts,) uint32, rows of `places`, one point after the other: the nearest
            camera first, the others in any order.

    Raises:
        InvalidInputError: The arrays do not fit together.
    """

    places: NDArray[np.float64]
    counts: NDArray[np.uint32]
    seen_from: NDArray[np.uint32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", read_only(as_points(self.places, "places")))
        for name in ("counts", "seen_from"):
            object.__setattr__(self, name, read_only(_as_numbers(getattr(self, name), name)))
        if not self.counts.all():
            raise InvalidInputError("counts must be at least one, the camera that saw a point")
        if self.counts.sum(dtype=np.int64) != len(self.seen_from):
            raise InvalidInputError(
                f"seen_from must have as many rows as counts add up to, {self.counts.sum(dtype=np.int64)}, "
                f"got {len(self.seen_from)}"
            )
        if len(self.seen_from) and self.seen_from.max() >= len(self.places):
            raise InvalidInputError(
                f"seen_from must name rows of the {len(self.places)} places, got {self.seen_from.max()}"
            )

    def nearest(self) -> NDArray[np.float64]:
        """(N, 3) place of the nearest camera that saw each point."""
        nearest: NDArray[np.float64] = self.places[self.seen_from[self._first()]]
        return nearest

    def select(self, rows: NDArray[np.bool_] | NDArray[np.integer[Any]]) -> Tracks:
        """The tracks of some points, by a mask or by their rows."""
        counts, first = self.counts[rows], self._first()[rows]
        ends = np.cumsum(counts, dtype=np.int64)
        # Each track from its first camera on.
        shift = np.repeat(first - (ends - counts), counts)
        return Tracks(self.places, counts, self.seen_from[shift + np.arange(len(shift))])

    @classmethod
    def join(cls, tracks: Sequence[Tracks]) -> Tracks:
        """Those of several scenes, one after the other."""
        before = np.cumsum([0] + [len(each.places) for each in tracks[:-1]])
        return cls(
            np.concatenate([each.places for each in tracks]),
            np.concatenate([each.counts for each in tracks]),
            np.concatenate([each.seen_from + start for each, start in zip(tracks, before, strict=True)]),
        )

    def _first(self) -> NDArray[np.int64]:
        """Where the track of each point begins."""
        return np.cumsum(self.counts, dtype=np.int64) - self.counts


def _as_numbers(value: ArrayLike, name: str) -> NDArray[np.uint32]:
    numbers = np.asarray(value)
    is_whole = numbers.dtype.kind in "iu" and numbers.ndim == 1
    if not is_whole or (len(numbers) and (numbers.min() < 0 or numbers.max() >= 2**32)):
        raise InvalidInputError(
            f"{name} must be a list of whole numbers from 0 to 2^32 - 1, got {numbers.dtype} of shape "
            f"{numbers.shape}"
        )
    return np.ascontiguousarray(numbers, dtype=np.uint32)
