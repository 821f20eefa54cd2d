"""The one way in for arrays: checked for type and shape, float64, C-order."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sympose.errors import InvalidInputError

T = TypeVar("T", bound=np.generic)

__all__ = ["as_floats", "as_points", "copy_points", "read_only"]


def as_floats(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return real numbers of any shape as a float64 array in C-order; copies only where it must.

    What a masked array hides is NaN.

    Raises:
        InvalidInputError: `value` is ragged or does not hold real numbers.
    """
    return np.require(_as_real(value, name), np.float64, ["C_CONTIGUOUS", "ALIGNED"])


def as_points(value: ArrayLike, name: str = "points") -> NDArray[np.float64]:
    """Return `value` as a float64 array of shape (N, 3) in C-order; NaN is let through.

    Any real dtype, memory order, stride and read-only array is accepted and gives the same result; of a
    structured array, as ROS has it, the fields x, y and z. What a masked array hides is NaN.

    Raises:
        InvalidInputError: `value` is not numeric or not of shape (N, 3).
    """
    return _checked_rows(as_floats(value, name), name)


def copy_points(value: ArrayLike, name: str = "points") -> NDArray[np.float64]:
    """Return what `as_points` does, as an array that no one else holds.

    Raises:
        InvalidInputError: `value` is not numeric or not of shape (N, 3).
    """
    return np.array(_checked_rows(_as_real(value, name), name), np.float64, order="C", copy=True)


def read_only(array: NDArray[T]) -> NDArray[T]:
    """Return a view that cannot be written through, and leaves the caller's own array as it is."""
    view = array.view()
    view.flags.writeable = False
    return view


def _as_real(value: ArrayLike, name: str) -> NDArray[np.generic]:
    if not isinstance(value, np.ndarray) and callable(tensor := getattr(value, "numpy", None)):
        value = tensor()  # of Open3D, whose tensors NumPy takes for lists of tensors
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InvalidInputError(f"{name} is not a rectangular array: {error}") from error
    if {"x", "y", "z"} <= set(array.dtype.names or ()):
        return np.stack([array[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    if array.dtype.kind not in "fiub":
        if hasattr(value, "points"):
            kind = type(value).__name__
            raise InvalidInputError(f"{name} must be an array, got {kind}; pass the points that it holds")
        if array.dtype == object and array.size and hasattr(array.flat[0], "points"):
            raise InvalidInputError(f"{name} is a list of scenes or clouds; join them, with Scene.merge")
        raise InvalidInputError(f"{name} must hold real numbers, got dtype {array.dtype}")
    if np.ma.is_masked(value):
        # `asarray` shows the numbers under the mask.
        return np.asarray(np.ma.filled(np.ma.asarray(value, np.float64), np.nan))
    return array


def _checked_rows(array: NDArray[T], name: str) -> NDArray[T]:
    if array.ndim != 2 or array.shape[1] != 3:
        organised = array.ndim == 3 and array.shape[2] == 3
        advice = "; an organised cloud is .reshape(-1, 3)" if organised else ""
        raise InvalidInputError(f"{name} must have shape (N, 3), got {array.shape}{advice}")
    return array
