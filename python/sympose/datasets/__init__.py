"""Synthetic data: procedural parts, a virtual depth camera, and scans with their truth.

Needs the extra `sympose[datasets]` (trimesh, manifold3d, embreex), loaded only when a part is built or scanned.
"""

from __future__ import annotations

from sympose.datasets.depth_camera import DEPTH_CAMERA, LOW_RESOLUTION, DepthImage, render
from sympose.datasets.parts import Part, names, part
from sympose.datasets.scenarios import LABELS, SCENARIOS, Scan, scan

__all__ = [
    "DEPTH_CAMERA",
    "LABELS",
    "LOW_RESOLUTION",
    "SCENARIOS",
    "DepthImage",
    "Part",
    "Scan",
    "names",
    "part",
    "render",
    "scan",
]
