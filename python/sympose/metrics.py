"""How far an estimated pose is from the truth, for parts that look the same in several poses."""

from __future__ import annotations

from sympose._core import adds, mssd

__all__ = ["adds", "mssd"]
