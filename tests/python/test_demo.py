"""The demonstration, on a small scan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sympose

for library in ("trimesh", "manifold3d", "embreex", "sklearn", "matplotlib", "plyfile"):
    pytest.importorskip(library)

from PIL import Image  # noqa: E402

from sympose import demo  # noqa: E402
from sympose.cli import main  # noqa: E402
from sympose.evaluation.metrics import axis_angle_deg  # noqa: E402

SMALL = ["--part", "wheel_hub_6", "--views", "2", "--seed", "1"]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo") / "new" / "out"
    assert main(["demo", *SMALL, "--out", str(folder)]) == 0
    return folder


def test_all_files_are_written(out: Path) -> None:
    assert {path.name for path in out.iterdir()} == {
        "scan.ply",
        "estimate.json",
        "completed.ply",
        "estimate.png",
    }


def test_the_picture_opens(out: Path) -> None:
    with Image.open(out / "estimate.png") as image:
        image.load()
        assert min(image.size) > 600


def test_the_files_agree(out: Path) -> None:
    found = sympose.Estimate.load(out / "estimate.json")
    scan = sympose.read(out / "scan.ply")
    completed = sympose.read(out / "completed.ply")
    np.testing.assert_allclose(completed.points, found.completed, atol=1e-6)
    assert completed.colors is not None
    assert len(np.unique(completed.colors, axis=0)) == 2
    # The raw scan holds more than the part: the table, the wall.
    assert len(found.inliers) < 0.8 * len(scan)
    assert found.inliers.max() < len(scan)
    assert found.ground is not None


def test_the_pose_is_that_of_the_part(out: Path) -> None:
    from sympose.datasets import part, scan

    truth = scan(part("wheel_hub_6"), "table", views=2, seed=1)
    found = sympose.Estimate.load(out / "estimate.json")
    assert axis_angle_deg(found.axis, truth.axis) < 1.0
    assert np.linalg.norm(np.cross(truth.center - found.center, truth.axis)) < 0.02


def test_a_wrong_axis_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    right = demo.estimate

    def tilted(*scene: object, **options: object) -> sympose.Estimate:
        hint = np.asarray([0.0, 0.0, 1.0]) if "axis_hint" in options else None
        if hint is not None:  # the reference of the yaw
            return right(*scene, **options)  # type: ignore[arg-type]
        found = right(*scene, **options)  # type: ignore[arg-type]
        pose = np.array(found.pose)
        angle = np.radians(2.0)
        tilt = np.eye(4)
        tilt[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        return _moved(found, pose @ tilt)

    monkeypatch.setattr(demo, "estimate", tilted)
    assert main(["demo", *SMALL, "--out", str(tmp_path)]) == 1
    captured = capsys.readouterr()
    assert "1 deg" in captured.err
    assert "2.0" in captured.out


@pytest.mark.parametrize("name", ["nonsense", "asymmetric"])
def test_a_part_that_cannot_be_estimated_is_refused(name: str, tmp_path: Path) -> None:
    from sympose.datasets import names

    chosen = names("asymmetric")[0] if name == "asymmetric" else name
    assert main(["demo", "--part", chosen, "--out", str(tmp_path), "--quiet"]) == 2


def _moved(found: sympose.Estimate, pose: np.ndarray) -> sympose.Estimate:
    import json

    quaternion = _quaternion(pose[:3, :3])
    text = json.loads(found.to_json())
    text |= {"pose": pose.tolist(), "axis": pose[:3, 2].tolist(), "quaternion": quaternion.tolist()}
    return sympose.Estimate.from_json(json.dumps(text))


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_quat())
