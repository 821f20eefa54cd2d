"""`sympose` and `python -m sympose`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympose
from conftest import ORDER, Part, heed_ctrl_c, make_part
from sympose.cli import main


@pytest.fixture
def scan(part: Part, tmp_path: Path) -> Path:
    path = tmp_path / "scan.xyz"
    np.savetxt(path, part.points)
    return path


def test_estimate_prints_the_schema(scan: Path, part: Part, capfd: pytest.CaptureFixture[str]) -> None:
    options = ["--order", str(ORDER), "--viewpoint", *map(str, part.viewpoint), "--json", "-", "--full"]
    code = main(["estimate", str(scan), *options])
    output = capfd.readouterr().out
    found = sympose.Estimate.from_json(output)
    assert code == (0 if found.score >= 0.5 else 1)
    here = sympose.estimate(np.loadtxt(scan), order=ORDER, viewpoints=part.viewpoint)
    assert found.pose.tobytes() == here.pose.tobytes()


def test_estimate_takes_what_only_python_reads(
    part: Part, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    places = np.tile(part.viewpoint, (len(part.points), 1))
    places[::2] += 1e-3
    np.savez(tmp_path / "places.npz", points=part.points, viewpoints=places)
    np.save(tmp_path / "points.npy", part.points)
    for name in ("places.npz", "points.npy"):
        path = str(tmp_path / name)
        main(["estimate", path, "--order", str(ORDER), "--json", "-", "--full"])
        found = sympose.Estimate.from_json(capfd.readouterr().out)
        here = sympose.estimate(path, order=ORDER)
        assert found.pose.tobytes() == here.pose.tobytes()
        assert found.inliers.tobytes() == here.inliers.tobytes()


def test_estimate_segments_a_scene_with_views(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for library in ("trimesh", "manifold3d", "embreex", "sklearn"):
        pytest.importorskip(library)
    scene = sympose.datasets.scan(sympose.datasets.part("wheel_hub_5"), "table", views=1, seed=2)
    (view,) = scene.scene.views
    depth = np.zeros((view.camera.height, view.camera.width))
    pixels, depths, _ = view.project(scene.scene.points)
    column, row = np.floor(pixels[:, :2] + 0.5).astype(int).T
    depth[row, column] = depths
    path = str(tmp_path / "view.npz")
    np.savez(path, depth=depth, K=view.camera.matrix, world_from_camera=view.world_from_camera)
    code = main(["estimate", path, "--order", "5", "--json", "-", "--full"])
    found = sympose.Estimate.from_json(capfd.readouterr().out)
    here = sympose.estimate(path, order=5)
    assert code == 0
    assert (found.pose.tobytes(), found.warnings) == (here.pose.tobytes(), here.warnings)
    assert found.inliers.tobytes() == here.inliers.tobytes()
    assert found.inliers.max() > found.inliers.size


@pytest.mark.timed
def test_a_timeout_counts_segmentation_too(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("sklearn")
    path, report = str(tmp_path / "view.npz"), tmp_path / "pose.json"
    depth = np.linspace(1.0, 2.0, 640 * 480).reshape(480, 640)
    np.savez(path, depth=depth, K=[[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    started = time.perf_counter()
    code = main(["estimate", path, "--order", "5", "--timeout", "0.01", "--json", str(report)])
    assert (code, json.loads(report.read_text())["error"]) == (1, "deadline_exceeded")
    assert time.perf_counter() - started < 2.0
    # A place where nothing can be written is named before the work.
    assert main(["estimate", path, "--order", "5", "--json", str(tmp_path / "none" / "pose.json")]) == 2
    assert "none" in capfd.readouterr().err


def test_other_commands_take_what_only_python_reads(
    part: Part, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, thinned = str(tmp_path / "scan.npz"), str(tmp_path / "thinned.ply")
    places = np.random.default_rng(1).normal(size=part.points.shape)
    colors = np.full(part.points.shape, 7, dtype=np.uint8)
    np.savez(path, points=part.points, colors=colors, viewpoints=places)
    assert main(["info", path, "--json"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["points"] == len(part.points)
    assert (json.loads(said.out)["colors"], json.loads(said.out)["normals"]) == (True, False)
    assert "viewpoints of its points count for estimate only" in said.err
    assert main(["filter", path, thinned, "--voxel-size", "0.1"]) == 0
    assert set(sympose.read(thinned).colors.ravel().tolist()) == {7}
    assert main(["plane", path, "--distance", "0.01", "--json"]) == 0
    assert main(["estimate", str(tmp_path)]) == 2
    assert "not a COLMAP model" in capfd.readouterr().err


def test_the_plane_is_told_where_nothing_else_is_left(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    flat = np.random.default_rng(0).uniform(size=(500, 3)) * [1.0, 1.0, 0.0]
    np.savetxt(tmp_path / "flat.xyz", flat)
    arguments = ["plane", str(tmp_path / "flat.xyz"), "--distance", "0.01", "--json"]
    assert main([*arguments, "--remove", str(tmp_path / "rest.ply")]) == 1
    said = capfd.readouterr()
    assert json.loads(said.out)["inliers"] == 500
    assert "0 usable points" in said.err


def test_a_low_score_does_not_look_like_the_limit(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    # A cube has other four-fold axes, which halves what the score would be.
    grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 40)] * 2), axis=-1).reshape(-1, 2)
    faces = [np.insert(grid, axis, side, axis=1) for axis in range(3) for side in (-1.0, 1.0)]
    np.savetxt(tmp_path / "cube.xyz", np.concatenate(faces))
    assert main(["estimate", str(tmp_path / "cube.xyz"), "--order", "4"]) == 1
    assert "the score 0.4" in capfd.readouterr().err


def test_info_and_plane_share_the_code_of_rust(scan: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(scan), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["points"] == 3000
    assert main(["plane", str(scan), "--json", "--distance", "0.01"]) == 0
    assert len(json.loads(capfd.readouterr().out)["coefficients"]) == 4


@pytest.mark.parametrize(
    "arguments", [[], ["nonsense"], ["estimate"], ["estimate", "nothing.ply"], ["view", "nothing.json"]]
)
def test_bad_usage_and_input_exit_with_2(arguments: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err


def test_a_cloud_without_a_pose_exits_with_1(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "line.xyz"
    np.savetxt(path, np.linspace(0, 1, 100)[:, None] * [1, 2, 3])
    assert main(["estimate", str(path), "--order", "3"]) == 1
    assert "collinear" in capfd.readouterr().err


def test_help_lists_the_commands_of_both_languages(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    output = capfd.readouterr().out
    for command in ("estimate", "filter", "plane", "info", "demo", "view", "segment", "dataset", "evaluate"):
        assert f"  {command} " in output


@pytest.mark.parametrize("command", ["demo", "view", "segment", "dataset", "evaluate", "estimate"])
def test_help_knows_the_commands_of_both_languages(command: str, capfd: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["help", command])
    except SystemExit as ended:
        code = ended.code
    output = capfd.readouterr()
    assert (code, output.err) == (0, "")
    assert f"sympose {command} " in output.out


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["help", "demo"],
        ["dataset", "--help"],
        ["dataset", "propeller_3", "{out}", "--views", "1"],
    ],
    ids=" ".join,
)
def test_a_closed_pipe_is_no_error(tmp_path: Path, arguments: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "sympose", *(word.format(out=tmp_path / "a.npz") for word in arguments)]
    with os.fdopen(writer, "w") as closed:
        result = subprocess.run(command, stdout=closed, stderr=subprocess.PIPE, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "a.npz").exists() == ("{out}" in arguments)


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
def test_a_closed_output_is_no_error(scan: Path, tmp_path: Path) -> None:
    answer = tmp_path / "answer.json"
    view = " ".join(map(str, make_part().viewpoint))
    command = f"'{sys.executable}' -m sympose estimate '{scan}' --order {ORDER} --viewpoint {view}"
    command += f" --json '{answer}' >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(answer.read_text(encoding="utf-8"))["order"] == ORDER


def test_dataset_writes_a_scan_and_its_truth(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scan, truth = tmp_path / "scan.npy", tmp_path / "truth.json"
    assert main(["dataset", "propeller_3", str(scan), "--views", "1", "--truth", str(truth)]) == 0
    assert capfd.readouterr().out.endswith("points of propeller_3, order 3\n")
    assert np.load(scan).shape[1] == 3
    assert json.loads(truth.read_text())["order"] == 3


def test_dataset_keeps_the_viewpoints_or_says_that_it_cannot(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "propeller_3", str(tmp_path / "scan.npz"), "--views", "2"]) == 0
    assert capfd.readouterr().err == ""
    assert len(np.unique(sympose.read(tmp_path / "scan.npz").viewpoints, axis=0)) == 2
    assert main(["dataset", "propeller_3", str(tmp_path / "scan.xyz"), "--views", "2"]) == 0
    assert "cannot hold the viewpoints" in capfd.readouterr().err


def test_segment_needs_views(scan: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["segment", str(scan), str(tmp_path / "out.xyz")]) == 2
    assert "view" in capfd.readouterr().err


def test_the_module_runs() -> None:
    command = [sys.executable, "-m", "sympose", "--version"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout == f"sympose {sympose.__version__}\n"


@contextmanager
def reading(pipe: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """`sympose` in a process of its own, waiting for the scan that `pipe` is to bring."""
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "sympose", *arguments]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, preexec_fn=heed_ctrl_c, **pipes)
    with process:
        try:
            yield process
        finally:
            process.kill()


def interrupted(process: subprocess.Popen[str], within: float) -> None:
    sent = time.perf_counter()
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=30)
    assert time.perf_counter() - sent < within
    assert (process.returncode, output, errors) == (130, "", "sympose: cancelled\n")


@pytest.mark.timed
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_ctrl_c_ends_a_long_estimate(tmp_path: Path) -> None:
    pipe = tmp_path / "scan.xyz"
    with reading(pipe, "estimate", str(pipe), "--voxel-size", "0.001", "--threads", "1") as process:
        # Opening waits for the reader: from then on the Rust half is at work.
        with pipe.open("w") as file:
            np.savetxt(file, make_part(400_000).points, fmt="%.7f")
        time.sleep(0.5)
        interrupted(process, within=2.5)


@pytest.mark.timed
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_ctrl_c_ends_a_read_that_hangs(tmp_path: Path) -> None:
    pipe = tmp_path / "scan.xyz"
    with reading(pipe, "info", str(pipe)) as process, pipe.open("w") as file:
        file.write("0 0 0\n")
        file.flush()
        interrupted(process, within=5.0)
