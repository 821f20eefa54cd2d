"""A part that NumPy alone can make, with its truth."""

from __future__ import annotations

import signal
from dataclasses import dataclass

import hypothesis
import numpy as np
import pytest
from numpy.typing import NDArray

import sympose

ORDER = 5

# How long an example takes depends on what else the machine does.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


def heed_ctrl_c() -> None:
    """For `preexec_fn`: a job in the background starts its children with SIGINT ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@dataclass(frozen=True)
class Part:
    """A wavy dish of diameter 1, seen from above, somewhere in the world."""

    points: NDArray[np.float64]
    viewpoint: NDArray[np.float64]
    world_from_object: NDArray[np.float64]

    @property
    def axis(self) -> NDArray[np.float64]:
        return self.world_from_object[:3, 2]


def make_part(count: int = 3000, seed: int = 1, noise: float = 0.0005) -> Part:
    rng = np.random.default_rng(seed)
    radius = 0.5 * np.sqrt(rng.uniform(0.02, 1.0, count))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    height = 0.5 * radius**2 + 0.16 * radius * np.cos(ORDER * angle + 4.0 * radius)
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    local += rng.normal(0.0, noise, local.shape)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, rng.uniform(-3.0, 3.0, 3)
    return Part(local @ rotation.T + pose[:3, 3], pose[:3, 3] + rotation @ [0.3, 0.2, 2.0], pose)


@pytest.fixture(scope="session")
def part() -> Part:
    return make_part()


@pytest.fixture(scope="session")
def estimate(part: Part) -> sympose.Estimate:
    return sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint)
