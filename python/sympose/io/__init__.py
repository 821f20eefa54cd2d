"""Reading and writing point clouds: PLY, PCD, XYZ, CSV, NPY, NPZ, and COLMAP models."""

from __future__ import annotations

from sympose.io.colmap import read_colmap
from sympose.io.files import read, write

__all__ = ["read", "read_colmap", "write"]
