"""A part: a mesh with the truth about its symmetry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from sympose.datasets.optional import load
from sympose.datasets.visibility import visible_centroid

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["Order", "Part", "diameter"]

Order = int | Literal["continuous"] | None


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
    order: Order
    mesh: Trimesh = field(repr=False)
    axis: NDArray[np.float64]
    center: NDArray[np.float64]
    dihedral: bool = False

    @classmethod
    def from_mesh(
        cls, mesh: Trimesh, name: str = "mesh", *, family: str = "asymmetric", order: Order = None
    ) -> Part:
        """Make a part of `mesh`, whose axis is +z through its origin, scaled to diameter 1.

        Example:
            >>> import trimesh
            >>> rod = Part.from_mesh(trimesh.creation.cylinder(30.0, 80.0), order="continuous")
            >>> rod.mesh.extents.round(6).tolist()
            [0.6, 0.6, 0.8]
        """
        scaled = mesh.copy()
        scaled.vertices = mesh.vertices / diameter(mesh)
        center = np.array([0.0, 0.0, visible_centroid(scaled)[2]])
        return cls(name, family, order, scaled, np.array([0.0, 0.0, 1.0]), center)


def diameter(mesh: Trimesh) -> float:
    """Distance between the two points of `mesh` that are farthest apart."""
    corners = np.asarray(load("trimesh").convex.convex_hull(mesh.vertices).vertices)
    # The hull of a surface of revolution has thousands of corners. Both ends of the longest chord are at
    # least its length minus the largest radius away from the middle.
    radius = np.linalg.norm(corners - corners.mean(axis=0), axis=1)
    end = corners[np.argmax(radius)]
    corners = corners[radius >= np.linalg.norm(corners - end, axis=1).max() - radius.max() - 1e-9]
    return float(np.sqrt(max(((corners - corner) ** 2).sum(axis=1).max() for corner in corners)))
