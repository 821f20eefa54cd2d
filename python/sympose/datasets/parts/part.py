"""A part: a mesh with the truth about its symmetry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["Part"]


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh of diameter 1 with the truth about its symmetry, all in the frame of the mesh.

    Attributes:
        name: For example "propeller_3".
        family: "propeller", "impeller", "wheel_hub", "small_part", "continuous" or "asymmetric".
        order: Largest n for which the part comes to itself when turned by 360/n degrees, "continuous" for a
            surface of revolution, None where there is no such n.
        mesh: The surface.
        axis: (3,) unit direction of the symmetry axis; +z for an asymmetric part.
        center: (3,) area centroid of what cameras can see of the part, projected on the axis.
        dihedral: Whether the part also comes to itself when turned over, so that the sign of the axis is
            undefined.
    """

    name: str
    family: str
    order: int | Literal["continuous"] | None
    mesh: Trimesh = field(repr=False)
    axis: NDArray[np.float64]
    center: NDArray[np.float64]
    dihedral: bool = False
