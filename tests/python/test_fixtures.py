"""A part held by something that has no part in its symmetry."""

from __future__ import annotations

import numpy as np
import pytest

import sympose

trimesh = pytest.importorskip("trimesh")
for library in ("manifold3d", "embreex"):
    pytest.importorskip(library)

from sympose.datasets import Part, part, scan  # noqa: E402


def clamped(name: str, at: list[float], extents: list[float]) -> Part:
    """A part with a block at its rim, the name of the order that it has without."""
    held = part(name)
    block = trimesh.creation.box(extents=extents, transform=trimesh.transformations.translation_matrix(at))
    mesh = trimesh.util.concatenate([held.mesh, block])
    return Part(f"{name}_clamped", held.family, held.order, mesh, held.axis, held.center, held.dihedral)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_declared_order_looks_past_a_clamp(seed: int) -> None:
    held = scan(clamped("flange_8", [0.52, 0.05, 0.0], [0.2, 0.15, 0.15]), "sphere", views=3, seed=seed)
    found = sympose.estimate(held.scene, order=8)
    assert abs(found.axis @ held.axis) > np.cos(np.radians(0.1))
    assert np.linalg.norm(np.cross(found.center - held.center, held.axis)) < 0.001
    with pytest.raises(sympose.NoSymmetryError, match="such as what holds the part, set roi"):
        sympose.estimate(held.scene)
