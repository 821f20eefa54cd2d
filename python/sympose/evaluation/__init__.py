"""The instrument with which the project measures itself: scans with known truth, methods side by side.

Needs the extra `sympose[evaluation]`. From the command line:

    python -m sympose.evaluation --parts own --scenario sphere --views 5 --seeds 1-3 --methods default,cad_icp

Lengths are in diameters of the part, angles in degrees.
"""

from __future__ import annotations

from sympose.evaluation.bound import NoiseBound, noise_bound
from sympose.evaluation.metrics import PoseErrors, pose_errors
from sympose.evaluation.reference import Reference, reference_of
from sympose.evaluation.runner import Case, Store, cases, run
from sympose.evaluation.scenario import Scenario, Subject, subjects
from sympose.evaluation.summary import Statistics, report, statistics

__all__ = [
    "Case",
    "NoiseBound",
    "PoseErrors",
    "Reference",
    "Scenario",
    "Statistics",
    "Store",
    "Subject",
    "cases",
    "noise_bound",
    "pose_errors",
    "reference_of",
    "report",
    "run",
    "statistics",
    "subjects",
]
