"""Drawings of clouds, poses and the evidence for them; needs the extra `sympose[plot]` (matplotlib).

Everything draws into figures and axes that are handed over, never through pyplot, so that it works in
threads, services and notebooks alike.
"""

from __future__ import annotations

from sympose.plotting.charts import draw_depths, draw_match_curve, draw_yaw
from sympose.plotting.cloud import Eye, draw_cloud
from sympose.plotting.pose import plot_estimate, show_estimate
from sympose.plotting.scene import plot_scene, show_scene
from sympose.plotting.stages import plot_stages

__all__ = [
    "Eye",
    "draw_cloud",
    "draw_depths",
    "draw_match_curve",
    "draw_yaw",
    "plot_estimate",
    "plot_scene",
    "plot_stages",
    "show_estimate",
    "show_scene",
]
