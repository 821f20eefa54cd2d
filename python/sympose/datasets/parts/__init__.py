"""Procedural parts in the four classes of the paper, each with its exact symmetry.

The parts are closed meshes of diameter 1 whose axis is +z through the origin. Besides the 14 cyclic parts
there are surfaces of revolution and parts without symmetry.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from sympose.datasets.parts.impeller import IMPELLERS
from sympose.datasets.parts.model import Order, Part
from sympose.datasets.parts.plain import ASYMMETRIC, CONTINUOUS
from sympose.datasets.parts.propeller import PROPELLERS
from sympose.datasets.parts.small_part import SMALL_PARTS
from sympose.datasets.parts.solid import Solid, to_mesh
from sympose.datasets.parts.wheel_hub import WHEEL_HUBS
from sympose.errors import InvalidInputError

__all__ = ["Part", "names", "part"]

_FAMILIES: dict[str, dict[str, tuple[Order, Callable[[], Solid]]]] = {
    "propeller": {**PROPELLERS},
    "impeller": {**IMPELLERS},
    "wheel_hub": {**WHEEL_HUBS},
    "small_part": {**SMALL_PARTS},
    "continuous": {name: ("continuous", build) for name, build in CONTINUOUS.items()},
    "asymmetric": {name: (None, build) for name, build in ASYMMETRIC.items()},
}
_CYCLIC = ("propeller", "impeller", "wheel_hub", "small_part")


def names(kind: str | None = None) -> tuple[str, ...]:
    """Names of the parts, for `part`.

    Args:
        kind: A family ("propeller", "impeller", "wheel_hub", "small_part", "continuous", "asymmetric"), or
            "cyclic" for the 14 parts of the first four; all 20 where it is not given.

    Raises:
        InvalidInputError: There is no such kind.

    Example:
        >>> names("propeller")
        ('propeller_2', 'propeller_3', 'propeller_4', 'propeller_5')
    """
    kinds: dict[str | None, tuple[str, ...]] = {None: tuple(_FAMILIES), "cyclic": _CYCLIC}
    kinds.update({family: (family,) for family in _FAMILIES})
    if kind not in kinds:
        raise InvalidInputError(f"kind must be one of {[k for k in kinds if k]} or None, got {kind!r}")
    return tuple(name for family in kinds[kind] for name in _FAMILIES[family])


@cache
def part(name: str) -> Part:
    """Build a part; later calls return the same object.

    Raises:
        InvalidInputError: There is no part of that name.
        ImportError: manifold3d, trimesh or embreex is not installed.

    Example:
        >>> wheel = part("propeller_4")
        >>> wheel.order, wheel.mesh.is_watertight
        (4, True)
    """
    for family, catalogue in _FAMILIES.items():
        if name in catalogue:
            order, build = catalogue[name]
            return Part.from_mesh(to_mesh(build()), name, family=family, order=order)
    raise InvalidInputError(f"there is no part {name!r}; there are {', '.join(names())}")
