"""The frame on the axis repeats from scan to scan: where a robot was taught, it must find the same again."""

from __future__ import annotations

import numpy as np
import pytest

import sympose

for library in ("trimesh", "manifold3d", "embreex"):
    pytest.importorskip(library)

from sympose.datasets import part, scan  # noqa: E402


@pytest.mark.parametrize("name", ["propeller_3", "flange_8"])
def test_yaw_and_origin_repeat(name: str) -> None:
    one = part(name)
    order = one.order
    assert isinstance(order, int)
    yaws, heights = [], []
    for seed in (1, 2, 3):
        seen = scan(one, views=5, seed=seed)
        found = sympose.estimate(seen.scene.points, order=order, viewpoints=seen.scene.viewpoints)
        in_part = np.linalg.inv(seen.world_from_object) @ found.pose
        up = np.sign(in_part[:3, 2] @ one.axis)
        yaws.append((up, np.arctan2(in_part[1, 0], in_part[0, 0])))
        heights.append(one.axis @ (in_part[:3, 3] - one.center))
    # Turned by a sector the part looks the same.
    steps = [(yaw - yaws[0][1]) * order / (2.0 * np.pi) for up, yaw in yaws if up == yaws[0][0]]
    assert len(steps) >= 2
    away = [np.degrees(2.0 * np.pi / order) * (step - round(step)) for step in steps]
    assert max(away) - min(away) < 0.3
    assert np.ptp(heights) < 0.01
