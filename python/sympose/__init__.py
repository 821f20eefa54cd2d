"""6-DoF pose of rotationally symmetric parts from raw point clouds, without a CAD model.

>>> import sympose
>>> estimate = sympose.estimate("scan.ply", order=5)  # doctest: +SKIP
>>> estimate.pose, estimate.score  # doctest: +SKIP

Lengths are in the unit of the cloud, angles in radians; a transform is a (4, 4) target_from_source.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from sympose import metrics
from sympose._core import (
    Candidate,
    Estimate,
    KdTree,
    Reference,
    __version__,
    estimate_normals,
    remove_radius_outliers,
    remove_statistical_outliers,
    segment_plane,
    viewpoints_from_order,
    voxel_downsample,
)
from sympose.camera import PinholeCamera, View
from sympose.config import Config
from sympose.errors import (
    CancelledError,
    DeadlineExceededError,
    InsufficientDataError,
    InvalidInputError,
    NoSymmetryError,
    SymposeError,
)
from sympose.estimation import estimate
from sympose.scene import Scene

if TYPE_CHECKING:
    from sympose.io import read, read_colmap, write
    from sympose.segmentation import Segmentation, segment

__all__ = [
    "CancelledError",
    "Candidate",
    "Config",
    "DeadlineExceededError",
    "Estimate",
    "InsufficientDataError",
    "InvalidInputError",
    "KdTree",
    "NoSymmetryError",
    "PinholeCamera",
    "Reference",
    "Scene",
    "Segmentation",
    "SymposeError",
    "View",
    "__version__",
    "estimate",
    "estimate_normals",
    "metrics",
    "read",
    "read_colmap",
    "remove_radius_outliers",
    "remove_statistical_outliers",
    "segment",
    "segment_plane",
    "viewpoints_from_order",
    "voxel_downsample",
    "write",
]

# Imported on first use: they bring other libraries, or time, that many callers do not need.
_LAZY = {
    "Segmentation": "sympose.segmentation",
    "read": "sympose.io",
    "read_colmap": "sympose.io",
    "segment": "sympose.segmentation",
    "write": "sympose.io",
}
_LAZY_MODULES = ("bop", "datasets", "evaluation", "io", "plotting", "segmentation")


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        value = getattr(import_module(_LAZY[name]), name)
        globals()[name] = value
        return value
    if name in _LAZY_MODULES:
        return import_module(f"sympose.{name}")
    raise AttributeError(f"module 'sympose' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_LAZY_MODULES})
