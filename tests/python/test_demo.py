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
from sympose.evaluation.metrics import axis_angle_deg, pose_errors  # noqa: E402
from sympose.evaluation.reference import reference_of  # noqa: E402

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
    assert found.ground is not None
    assert len(found.inliers) < 0.8 * len(scan)
    assert found.inliers.max() < len(scan)


def test_the_pose_is_that_of_the_part(out: Path) -> None:
    from sympose.datasets import part, scan

    truth = scan(part("wheel_hub_6"), "table", views=2, seed=1)
    found = sympose.Estimate.load(out / "estimate.json")
    assert axis_angle_deg(found.axis, truth.axis) < 1.0
    assert np.linalg.norm(np.cross(truth.center - found.center, truth.axis)) < 0.02


@pytest.mark.parametrize(("tilt_deg", "code"), [(0.9, 0), (1.1, 1), (179.0, 0)])
def test_the_exit_code_follows_the_axis(
    tilt_deg: float, code: int, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sympose.datasets import part, scan

    one = scan(part("wheel_hub_6"), "table", views=2, seed=1)
    c, s = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    tilt = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    truth = np.array(one.world_from_object)
    truth[:3, 3] = one.center
    errors = pose_errors(reference_of(part("wheel_hub_6")), truth, truth @ tilt, diameter=one.diameter)
    done = demo.Demo(one, sympose.Estimate.load(out / "estimate.json"), errors, ())
    monkeypatch.setattr(demo, "run_demo", lambda *_, **__: done)
    assert main(["demo"]) == code
    captured = capsys.readouterr()
    assert f"{min(tilt_deg, 180.0 - tilt_deg):.4f} deg" in captured.out
    assert ("more than 1 deg" in captured.err) == bool(code)


@pytest.mark.parametrize("name", ["nonsense", "asymmetric"])
def test_a_part_that_cannot_be_estimated_is_refused(name: str, tmp_path: Path) -> None:
    from sympose.datasets import names

    chosen = names("asymmetric")[0] if name == "asymmetric" else name
    assert main(["demo", "--part", chosen, "--out", str(tmp_path), "--quiet"]) == 2


@pytest.mark.parametrize("file", ["estimate.json", "scan.ply", "completed.ply"])
def test_view_draws_what_was_written(file: str, out: Path, tmp_path: Path) -> None:
    picture = tmp_path / "view.png"
    assert main(["view", str(out / file), "--save", str(picture)]) == 0
    with Image.open(picture) as image:
        assert len(image.convert("RGB").getcolors(1 << 24) or []) > 50


def test_view_without_a_file_to_read_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(tmp_path / "missing.ply"), "--save", str(tmp_path / "view.png")]) == 2
    assert "missing.ply" in capsys.readouterr().err
