"""Files of the BOP benchmark, read back as its toolkit reads them."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from conftest import ORDER, make_part
from sympose import Estimate, InsufficientDataError, InvalidInputError
from sympose.bop import BopResult, model_info, write_models_info, write_results

METRES = 1000.0


def camera() -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    pose[:3, 3] = [0.3, -2.0, 1.0]
    return pose


def continuous(estimate: Estimate) -> Estimate:
    return Estimate.from_json(json.dumps(estimate.to_dict() | {"order": "continuous"}))


def test_models_info(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "models_info.json"
    write_models_info(path, {12: continuous(estimate), 3: estimate}, mm_per_unit=METRES)
    models = json.loads(path.read_text())
    assert list(models) == ["3", "12"]
    one = models["3"]

    local = METRES * (
        np.linalg.inv(estimate.pose) @ np.c_[estimate.completed, np.ones(len(estimate.completed))].T
    )
    for axis, values in zip("xyz", local, strict=False):
        assert one[f"min_{axis}"] == pytest.approx(values.min())
        assert one[f"size_{axis}"] == pytest.approx(values.max() - values.min())
    # The dish of the tests has a diameter of 1 m.
    assert one["diameter"] == pytest.approx(1000.0, rel=0.05)

    turns = np.reshape(one["symmetries_discrete"], (-1, 4, 4))
    assert len(turns) == ORDER - 1
    assert "symmetries_continuous" not in one
    assert models["12"]["symmetries_continuous"] == [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]
    assert "symmetries_discrete" not in models["12"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_diameter_is_the_largest_distance(estimate: Estimate, seed: int) -> None:
    cloud = make_part(1500, seed=seed, noise=0.02).points
    values = estimate.to_dict() | {"completed": cloud.tolist(), "completed_sector": [0] * len(cloud)}
    largest = max(np.linalg.norm(cloud - point, axis=1).max() for point in cloud)
    found = model_info(Estimate.from_json(json.dumps(values)))["diameter"]
    assert 0.999 * largest <= found <= largest * (1.0 + 1e-12)


def test_results(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "sympose_parts-test.csv"
    late = BopResult(2, 7, 3, estimate, camera(), seconds=0.5)
    write_results(path, [late, BopResult(1, 0, 12, estimate)], mm_per_unit=METRES)
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]
    assert [(row["scene_id"], row["im_id"], row["obj_id"], float(row["time"])) for row in rows] == [
        ("1", "0", "12", -1.0),
        ("2", "7", "3", 0.5),
    ]
    for row, world_from_camera in zip(rows, (np.eye(4), camera()), strict=True):
        assert float(row["score"]) == estimate.score
        camera_from_object = np.eye(4)
        camera_from_object[:3, :3] = np.array(row["R"].split(), dtype=float).reshape(3, 3)
        camera_from_object[:3, 3] = np.array(row["t"].split(), dtype=float) / METRES
        np.testing.assert_allclose(world_from_camera @ camera_from_object, estimate.pose, atol=1e-12)


def test_what_makes_no_sense_is_refused(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    for scale in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InvalidInputError, match="mm_per_unit"):
            write_results(path, [], mm_per_unit=scale)
        with pytest.raises(InvalidInputError, match="mm_per_unit"):
            model_info(estimate, mm_per_unit=scale)
    with pytest.raises(InvalidInputError, match="world_from_camera"):
        write_results(path, [BopResult(1, 0, 1, estimate, 2.0 * np.eye(4))])
    with pytest.raises(InvalidInputError, match=r"scene 1, image 0: 0\.1 and 0\.2 seconds"):
        write_results(path, [BopResult(1, 0, k, estimate, seconds=0.1 * k) for k in (1, 2)])
    short = estimate.to_dict() | {"completed": [], "completed_sector": []}
    with pytest.raises(InsufficientDataError, match="completed"):
        write_models_info(path, {1: Estimate.from_json(json.dumps(short))})
    assert not path.exists()
