"""The public surface: names, signatures, and what an estimate holds."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympose
from conftest import ORDER, Part
from sympose import Config, Estimate, InvalidInputError

ARRAYS = (
    "pose",
    "axis",
    "center",
    "quaternion",
    "covariance",
    "points",
    "normals",
    "inliers",
    "point_of_inlier",
    "completed",
    "completed_sector",
    "match_curve",
)
PARAMETERS = {
    "estimate": "scene order viewpoints normals views roi axis_hint initial reference prefer config seed "
    "threads timeout progress",
    "voxel_downsample": "points voxel_size return_inverse",
    "remove_radius_outliers": "points radius min_neighbors",
    "remove_statistical_outliers": "points k std_ratio",
    "segment_plane": "points distance max_iterations probability seed",
    "estimate_normals": "points k viewpoints",
    "viewpoints_from_order": "points",
    "segment": "points views max_components min_views seed",
    "read": "path",
    "write": "path points normals colors",
    "read_colmap": "folder",
}


@pytest.mark.parametrize("name", sympose.__all__)
def test_every_public_name_exists_and_is_documented(name: str) -> None:
    value = getattr(sympose, name)
    assert name == "__version__" or inspect.getdoc(value)


@pytest.mark.parametrize("name", PARAMETERS)
def test_arguments_keep_their_names_and_order(name: str) -> None:
    assert list(inspect.signature(getattr(sympose, name)).parameters) == PARAMETERS[name].split()


def test_import_brings_no_heavy_library() -> None:
    heavy = "sklearn", "matplotlib", "scipy", "trimesh", "PIL", "plyfile", "pypcd4", "open3d", "pycolmap"
    code = f"import sys, sympose; print([name for name in {heavy!r} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_errors_are_also_what_python_calls_them() -> None:
    assert issubclass(sympose.InvalidInputError, ValueError)
    assert issubclass(sympose.DeadlineExceededError, TimeoutError)
    for name in ("InvalidInput", "InsufficientData", "NoSymmetry", "Cancelled", "DeadlineExceeded"):
        assert issubclass(getattr(sympose, f"{name}Error"), sympose.SymposeError)


def test_the_pose_is_near_the_truth(part: Part, estimate: Estimate) -> None:
    cosine = abs(float(estimate.axis @ part.axis))
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 0.5
    offset = np.cross(part.world_from_object[:3, 3] - estimate.center, estimate.axis)
    assert np.linalg.norm(offset) < 0.005


def test_an_estimate_agrees_with_itself(part: Part, estimate: Estimate) -> None:
    pose = estimate.pose
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert pose[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert np.array_equal(estimate.axis, pose[:3, 2])
    assert np.array_equal(estimate.center, pose[:3, 3])
    x, y, z, w = estimate.quaternion
    assert np.allclose(pose[:3, 2], [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    assert estimate.order == ORDER
    assert isinstance(estimate.order, int)
    assert 0.0 <= estimate.score <= 1.0
    assert 0.0 <= estimate.explained <= 1.0
    assert estimate.covariance.shape == (6, 6)
    assert np.allclose(estimate.covariance, estimate.covariance.T, rtol=1e-9, atol=0.0)
    assert set(estimate.unobservable) <= {"yaw", "slide", "tilt", "shift"}
    assert estimate.points.shape == estimate.normals.shape == (len(estimate.points), 3)
    assert np.allclose(np.linalg.norm(estimate.normals, axis=1), 1.0)
    assert np.array_equal(np.sort(np.unique(estimate.point_of_inlier)), np.arange(len(estimate.points)))
    # A refined point is the mean of its voxel, moved by at most about a voxel.
    distance = part.points[estimate.inliers] - estimate.points[estimate.point_of_inlier]
    assert np.linalg.norm(distance, axis=1).max() < 0.1
    assert estimate.completed.shape == (len(estimate.completed_sector), 3)
    assert set(np.unique(estimate.completed_sector)) <= set(range(ORDER))
    assert estimate.match_curve.shape[1] == 2
    assert ((estimate.match_curve[:, 1] >= 0.0) & (estimate.match_curve[:, 1] <= 1.0)).all()
    for candidate in estimate.candidates:
        assert np.linalg.norm(candidate.axis) == pytest.approx(1.0)
        assert candidate.center.shape == (3,)
        assert 0.0 <= candidate.score <= 1.0
    scores = [candidate.score for candidate in estimate.candidates]
    assert scores == sorted(scores, reverse=True)
    assert all(seconds >= 0.0 for seconds in estimate.timings.values())


def test_the_order_of_an_estimate_is_never_auto(estimate: Estimate) -> None:
    document = estimate.to_dict() | {"order": "auto"}
    with pytest.raises(InvalidInputError, match="order = auto: expected the order that was found"):
        Estimate.from_json(json.dumps(document))


def test_candidates_are_frozen_and_can_be_copied_and_pickled(estimate: Estimate) -> None:
    assert estimate.candidates
    for candidate in estimate.candidates:
        for array in (candidate.axis, candidate.center):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
        for twin in (copy.deepcopy(candidate), pickle.loads(pickle.dumps(candidate))):
            assert (twin.order, twin.score) == (candidate.order, candidate.score)
            assert twin.axis.tobytes() == candidate.axis.tobytes()
            assert twin.center.tobytes() == candidate.center.tobytes()
    with pytest.raises(InvalidInputError, match="no candidate"):
        sympose.Candidate.from_json("{}")


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_read_only_and_kept(estimate: Estimate, name: str) -> None:
    array = getattr(estimate, name)
    assert array is getattr(estimate, name)
    with pytest.raises(ValueError, match="read-only"):
        array[...] = 0


def test_an_estimate_is_frozen(estimate: Estimate) -> None:
    with pytest.raises(AttributeError):
        estimate.score = 1.0  # type: ignore[misc]
    for mapping in (estimate.timings, estimate.diagnostics):
        assert isinstance(mapping, Mapping)
        with pytest.raises(TypeError):
            mapping["input"] = 0.0  # type: ignore[index]


def test_repr_is_one_line_with_the_essentials(estimate: Estimate) -> None:
    text = repr(estimate)
    assert "\n" not in text
    assert "order=5" in text
    assert f"score={estimate.score:.2f}" in text


def test_equivalent_poses_turn_about_the_axis(estimate: Estimate) -> None:
    poses = estimate.equivalent_poses()
    assert poses.shape == (ORDER, 4, 4)
    assert np.allclose(poses[0], estimate.pose, atol=1e-15)
    assert np.allclose(poses[:, :3, 2], estimate.axis)
    assert np.allclose(poses[:, :3, 3], estimate.center)
    step = poses[0, :3, :3].T @ poses[1, :3, :3]
    assert np.arctan2(step[1, 0], step[0, 0]) == pytest.approx(2.0 * np.pi / ORDER)


def test_bop_symmetries_map_the_object_onto_itself(estimate: Estimate) -> None:
    symmetries = estimate.bop_symmetries()
    assert symmetries["symmetries_continuous"] == []
    turns = np.array(symmetries["symmetries_discrete"]).reshape(-1, 4, 4)
    assert len(turns) == ORDER - 1
    assert np.allclose(estimate.pose @ turns, estimate.equivalent_poses()[1:])


def continuous(estimate: Estimate) -> Estimate:
    return Estimate.from_json(json.dumps(estimate.to_dict() | {"order": "continuous"}))


def test_a_continuous_symmetry(estimate: Estimate) -> None:
    whole = continuous(estimate)
    assert whole.order == "continuous"
    assert whole.equivalent_poses(steps=7).shape == (7, 4, 4)
    symmetries = whole.bop_symmetries()
    assert symmetries["symmetries_discrete"] == []
    assert symmetries["symmetries_continuous"] == [{"axis": [0.0, 0.0, 1.0], "offset": [0.0, 0.0, 0.0]}]
    for steps in (0, -1, 10**9):
        with pytest.raises(InvalidInputError, match="steps"):
            whole.equivalent_poses(steps)


def same(one: Estimate, other: Estimate) -> bool:
    return one.to_json() == other.to_json() and all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in ARRAYS
    )


def test_json_loses_nothing(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "pose.json"
    estimate.save(path)
    estimate.save(str(path))
    assert same(Estimate.load(path), estimate)
    assert same(pickle.loads(pickle.dumps(estimate)), estimate)
    assert path.read_text() == estimate.to_json()


def test_the_dict_has_the_names_of_the_attributes(estimate: Estimate) -> None:
    values = estimate.to_dict()
    assert values["schema_version"] == 1
    for name in ARRAYS:
        expected = getattr(estimate, name)
        found = np.array(values[name], dtype=float)
        assert np.array_equal(np.where(np.isnan(found), np.inf, found), expected)
    assert values["order"] == ORDER
    assert values["timings"] == dict(estimate.timings)
    assert values["diagnostics"].keys() == estimate.diagnostics.keys()


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"schema_version": 9}', b"\xff\xfe", b"ply\n"])
def test_a_foreign_file_is_no_estimate(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "pose.json"
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match=r"pose\.json"):
        Estimate.load(path)


def test_files_that_cannot_be_used(estimate: Estimate, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nothing"):
        Estimate.load(tmp_path / "nothing.json")
    with pytest.raises(IsADirectoryError):
        estimate.save(tmp_path)


def test_the_paper_has_settings_of_its_own(tmp_path: Path) -> None:
    paper = Config.paper()
    assert (paper.residual, paper.yaw) == ("point_to_point", "histogram")
    # What the paper lacks is off, and stays off in a file.
    assert (paper.outliers.scattered, paper.smoothing.max_angle) == (None, None)
    (tmp_path / "paper.toml").write_text(paper.to_toml())
    assert Config.from_toml(tmp_path / "paper.toml") == paper


def test_no_symmetry_error_carries_its_evidence() -> None:
    error = sympose.NoSymmetryError("none", {"score": 0.1})
    copy: Any = pickle.loads(pickle.dumps(error))
    assert (str(copy), copy.evidence) == ("none", {"score": 0.1})


def test_modules_are_there_without_an_import_of_their_own() -> None:
    modules = "bop", "datasets", "evaluation", "io", "metrics", "plotting", "segmentation"
    code = "import sympose\n" + "\n".join(f"sympose.{name}" for name in modules)
    subprocess.run([sys.executable, "-c", code], check=True)
