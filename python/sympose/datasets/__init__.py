"""Synthetic data: procedural parts, a virtual depth camera, and scans with their truth.

Needs the extra `sympose[datasets]` (trimesh, manifold3d, embreex), which is loaded only when a part is built
or scanned.

    from sympose.datasets import names, part, scan

    for name in names("cyclic"):
        one = scan(part(name), "sphere", views=5, seed=1)
        one.scene, one.world_from_object, one.axis
"""

from __future__ import annotations

from sympose.datasets.depth_camera import DEPTH_CAMERA, LOW_RESOLUTION, DepthImage, render
from sympose.datasets.mesh_folder import load_mesh_folder
from sympose.datasets.parts import Part, names, part
from sympose.datasets.scenarios import Scan, scan
from sympose.datasets.stage import LABELS
from sympose.datasets.view_poses import SCENARIOS
from sympose.datasets.visibility import sample_visible

__all__ = [
    "DEPTH_CAMERA",
    "LABELS",
    "LOW_RESOLUTION",
    "SCENARIOS",
    "DepthImage",
    "Part",
    "Scan",
    "load_mesh_folder",
    "names",
    "part",
    "render",
    "sample_visible",
    "scan",
]
