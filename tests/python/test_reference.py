"""Teach once: the frame of the first scan is found again in the next ones."""

from __future__ import annotations

import json
import pickle
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

pytest.importorskip("trimesh")
pytest.importorskip("manifold3d")
pytest.importorskip("embreex")

import sympose
from conftest import ORDER, Part, make_part
from sympose import Estimate, InvalidInputError, NoSymmetryError, Reference
from sympose.datasets import Scan, part, scan
from sympose.evaluation.reference import about_z, reference_of
from sympose.metrics import mssd

PARTS = ("propeller_3", "wheel_hub_5", "can")


@lru_cache
def scanned(name: str, views: int, seed: int) -> Scan:
    return scan(part(name), "sphere", views=views, seed=seed)


def estimated(one: Scan, **arguments: object) -> Estimate:
    points, viewpoints = one.scene.points, one.scene.viewpoints
    return sympose.estimate(points, viewpoints=viewpoints, **arguments)  # type: ignore[arg-type]


@lru_cache
def taught(name: str) -> tuple[Reference, NDArray[np.float64]]:
    """The reference, and the frame that it was taught in the frame of the mesh."""
    one = scanned(name, 5, 1)
    first = estimated(one, order=part(name).order)
    return first.as_reference(), np.linalg.inv(one.world_from_object) @ first.pose


def error(name: str, one: Scan, pose: NDArray[np.float64]) -> float:
    """MSSD between the taught frame in this scan and where it truly is [diameters]."""
    truth = reference_of(part(name))
    world_from_object = one.world_from_object @ truth.mesh_from_object
    found = pose @ np.linalg.inv(taught(name)[1]) @ truth.mesh_from_object
    symmetries = truth.symmetries
    if one.order == "continuous":
        # Any angle will do: the nearest one.
        apart = np.linalg.inv(world_from_object) @ found
        symmetries = about_z(float(np.arctan2(apart[1, 0] - apart[0, 1], apart[0, 0] + apart[1, 1])))[None]
    return mssd(truth.points, found, world_from_object, symmetries) / one.diameter


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize(("views", "seed"), [(5, 2), (1, 3)])
def test_the_taught_frame_is_found_again(name: str, views: int, seed: int) -> None:
    one = scanned(name, views, seed)
    found = estimated(one, reference=taught(name)[0])
    assert error(name, one, found.pose) <= 0.001
    assert found.order == part(name).order
    assert found.diagnostics["reference_overlap"] > 0.8
    assert 0.0 < found.diagnostics["reference_sigma"] < 0.003
    covariance = found.covariance
    if found.order == "continuous":
        assert "yaw" in found.unobservable
        assert np.isinf(covariance[2, 2])
        assert not np.delete(covariance[2], 2).any()
    else:
        assert found.unobservable == ()
        assert (np.linalg.eigvalsh(covariance) > 0.0).all()


@pytest.mark.parametrize("views", [5, 1])
def test_the_taught_frame_is_as_uncertain_as_stated(views: int) -> None:
    # A copy of a point about the axis, or its neighbour, has the same error.
    names = ("propeller_4", "impeller_5", "impeller_7", "wheel_hub_10", "flange_8", "gear_12")
    inside = 0
    for name in names:
        one = scanned(name, views, 1062)
        found = estimated(one, reference=taught(name)[0])
        turns = [about_z(2.0 * np.pi * k / found.order) for k in range(found.order)]
        apart = [np.linalg.inv(found.pose) @ one.world_from_object @ taught(name)[1] @ turn for turn in turns]
        nearest = max(apart, key=np.trace)
        error = np.r_[Rotation.from_matrix(nearest[:3, :3]).as_rotvec(), nearest[:3, 3]]
        inside += bool(error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.95, 6))
    assert inside >= 5


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize(("views", "seed"), [(5, 2), (1, 3)])
def test_the_taught_frame_is_found_without_viewpoints(name: str, views: int, seed: int) -> None:
    # The reference was taught with them, and knows which way its normals point; such a scan does not.
    one = scanned(name, views, seed)
    found = sympose.estimate(one.scene.points, reference=taught(name)[0])
    assert error(name, one, found.pose) <= 0.002
    assert found.diagnostics["reference_overlap"] > 0.8


def test_a_scan_that_does_not_tell_the_turn_says_so() -> None:
    # Past the rim of this wheel the camera sees no spoke.
    found = estimated(scanned("wheel_hub_5", 1, 2), reference=taught("wheel_hub_5")[0])
    assert found.unobservable == ("yaw",)
    assert np.isinf(found.covariance[2, 2])
    assert any("yaw" in warning for warning in found.warnings)


def test_a_reference_taught_from_one_side_is_found_and_warned_of() -> None:
    # All five views of this scan stand above the part, three of the next one below.
    found = estimated(scanned("wheel_hub_6", 5, 2), reference=taught("wheel_hub_6")[0])
    assert error("wheel_hub_6", scanned("wheel_hub_6", 5, 2), found.pose) <= 0.001
    assert found.diagnostics["reference_overlap"] < 0.8
    assert any("taught" in warning for warning in found.warnings)


@pytest.mark.parametrize("views", [5, 1])
@pytest.mark.parametrize(("reference", "name"), [("propeller_3", "knob_3"), ("wheel_hub_5", "sprocket_6")])
def test_another_part_is_refused(reference: str, name: str, views: int) -> None:
    with pytest.raises(NoSymmetryError, match=r"^the scan does not fit the reference") as refusal:
        estimated(scanned(name, views, 2), reference=taught(reference)[0])
    evidence = refusal.value.evidence
    assert isinstance(evidence, dict)
    assert "reference" in evidence["reason"]
    # It has a symmetry, and an axis that is right.
    assert evidence["score"] > 0.5


@pytest.mark.parametrize("views", [5, 1])
@pytest.mark.parametrize(("reference", "name"), [("propeller_3", "knob_3"), ("wheel_hub_5", "sprocket_6")])
def test_another_part_is_refused_without_viewpoints(reference: str, name: str, views: int) -> None:
    with pytest.raises(NoSymmetryError, match="does not fit the reference"):
        sympose.estimate(scanned(name, views, 2).scene.points, reference=taught(reference)[0])


def test_another_order_or_size_is_refused(part: Part, estimate: Estimate) -> None:
    reference = estimate.as_reference()
    with pytest.raises(NoSymmetryError, match="order 10, but the reference has 5"):
        sympose.estimate(part.points, order=10, viewpoints=part.viewpoint, reference=reference)
    with pytest.raises(NoSymmetryError, match="its radius is"):
        sympose.estimate(1.5 * part.points, viewpoints=1.5 * part.viewpoint, reference=reference)


def test_files_and_pickles_find_the_same_pose(part: Part, estimate: Estimate, tmp_path: Path) -> None:
    reference = estimate.as_reference()
    path = tmp_path / "part.json"
    reference.save(path)
    later = make_part(seed=2)
    poses = [
        sympose.estimate(later.points, viewpoints=later.viewpoint, reference=one).pose
        for one in (reference, Reference.load(str(path)), pickle.loads(pickle.dumps(reference)))
    ]
    assert np.array_equal(poses[0], poses[1])
    assert np.array_equal(poses[0], poses[2])
    assert path.stat().st_size < 1_000_000
    assert "\n" not in repr(reference)
    assert "order=5" in repr(reference)


def test_a_reference_shows_what_it_holds(estimate: Estimate) -> None:
    reference = estimate.as_reference()
    assert reference.order == ORDER
    assert reference.diameter == pytest.approx(1.0, rel=0.1)
    assert reference.points.shape == reference.normals.shape
    assert 50 <= len(reference.points) <= 60_000
    assert np.allclose(np.linalg.norm(reference.normals, axis=1), 1.0)
    assert not reference.points.flags.writeable


def test_the_preferred_pose_chooses_among_the_equivalent_ones(part: Part, estimate: Estimate) -> None:
    reference = estimate.as_reference()
    for equivalent in estimate.equivalent_poses():
        prefer = equivalent @ about_z(0.2)
        pose = sympose.estimate(
            part.points, viewpoints=part.viewpoint, reference=reference, prefer=prefer
        ).pose
        assert np.allclose(pose, equivalent, atol=2e-3)


def test_without_viewpoints_it_is_found_too(part: Part) -> None:
    reference = sympose.estimate(part.points, order=ORDER).as_reference()
    later = make_part(seed=2)
    pose = sympose.estimate(later.points, reference=reference).pose
    assert np.degrees(np.arccos(abs(pose[:3, 2] @ later.axis))) < 0.5


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"schema_version": 9}', b"\xff\xfe", b"ply\n"])
def test_a_foreign_file_is_no_reference(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "part.json"
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match=r"part\.json"):
        Reference.load(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("schema_version", 2),
        ("order", "auto"),
        ("order", 1),
        ("cell", 0.0),
        ("cell", 1e-12),
        ("points", []),
        ("points", [[1e39, 0.0, 0.0]] * 60),
        ("normals", [[0.0, 0.0, 0.0]] * 60),
    ],
)
def test_a_damaged_file_is_no_reference(estimate: Estimate, tmp_path: Path, name: str, value: object) -> None:
    path = tmp_path / "part.json"
    estimate.as_reference().save(path)
    content = json.loads(path.read_text())
    assert name in content
    path.write_text(json.dumps(content | {name: value}))
    with pytest.raises(InvalidInputError, match=r"part\.json"):
        Reference.load(path)


def test_files_that_cannot_be_used(estimate: Estimate, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nothing"):
        Reference.load(tmp_path / "nothing.json")
    with pytest.raises(IsADirectoryError):
        estimate.as_reference().save(tmp_path)
    path = tmp_path / "cut.json"
    estimate.as_reference().save(path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InvalidInputError, match=r"cut\.json"):
        Reference.load(path)


def test_what_is_no_reference(part: Part, estimate: Estimate) -> None:
    with pytest.raises(InvalidInputError, match="reference must be"):
        sympose.estimate(part.points, reference=estimate)  # type: ignore[arg-type]
    bare = estimate.to_dict() | {"points": [], "normals": []}
    with pytest.raises(sympose.InsufficientDataError, match="reference"):
        Estimate.from_json(json.dumps(bare)).as_reference()


def test_the_height_is_free_where_a_scan_shows_only_the_wall() -> None:
    random = np.random.default_rng(0)

    def prism(count: int, half: float, *, closed: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A wall with five lobes, with or without its ends, and its normals."""
        angle, height = random.uniform(0.0, 2.0 * np.pi, count), random.uniform(-half, half, count)
        radius, slope = 0.2 + 0.04 * np.cos(5.0 * angle), 0.2 * np.sin(5.0 * angle)
        cosine, sine = np.cos(angle), np.sin(angle)
        points = np.c_[radius * cosine, radius * sine, height]
        normals = np.c_[radius * cosine - slope * sine, radius * sine + slope * cosine, np.zeros(count)]
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        points += normals * random.normal(0.0, 5e-4, (count, 1))
        if closed:
            for end in (-1.0, 1.0):
                inner = np.sqrt(random.uniform(0.0, 1.0, (count // 4, 1)))
                lid = np.c_[inner * points[: count // 4, :2], np.full(count // 4, end * half)]
                points = np.r_[points, lid]
                normals = np.r_[normals, np.tile([0.0, 0.0, end], (len(lid), 1))]
        return points, normals

    points, normals = prism(40_000, 0.5, closed=True)
    first = sympose.estimate(points, viewpoints=points + 2.0 * normals, order=5)
    points, normals = prism(20_000, 0.2, closed=False)
    found = sympose.estimate(points, viewpoints=points + 2.0 * normals, reference=first.as_reference())
    assert found.unobservable == ("slide",)
    assert np.isinf(found.covariance[5, 5])
    assert not np.delete(found.covariance[5], 5).any()
    assert np.degrees(np.sqrt(found.covariance[2, 2])) < 1.0
    assert any("height is arbitrary" in warning for warning in found.warnings)
    points, normals = prism(20_000, 0.5, closed=True)
    whole = sympose.estimate(points, viewpoints=points + 2.0 * normals, reference=first.as_reference())
    assert whole.unobservable == ()
    assert np.sqrt(whole.covariance[5, 5]) < 0.002


def test_sectors_and_angles_follow_the_frame_of_the_reference() -> None:
    """A reference that was taught the other way up than the convention of a scan."""
    first, one = scanned("wheel_hub_5", 5, 1), scanned("wheel_hub_5", 3, 1)
    over = estimated(first, order=5).pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    own = estimated(one, order=5)
    found = estimated(one, reference=estimated(first, order=5, initial=over).as_reference())
    assert own.axis @ found.axis < -0.99
    points = (found.completed - found.center) @ found.pose[:3, :3]
    measured = cKDTree(points[found.completed_sector == 0])
    for sector in range(1, 5):
        turned = (
            points[found.completed_sector == sector]
            @ Rotation.from_euler("z", 72.0 * sector, True).as_matrix()
        )
        assert np.quantile(measured.query(turned)[0], 0.99) < 1.5 * found.diagnostics["voxel_size"]
    np.testing.assert_allclose(found.match_curve[1:, 1], own.match_curve[:0:-1, 1], atol=1e-9)


def test_points_that_coincide_are_nothing_to_teach() -> None:
    stored = json.loads(estimated(scanned("can", 1, 1)).to_json())
    stored["points"] = [[1.0, 2.0, 3.0]] * len(stored["points"])
    with pytest.raises(InvalidInputError, match="coincide"):
        Estimate.from_json(json.dumps(stored)).as_reference()


@pytest.mark.parametrize("flip", [False, True])
def test_the_histogram_of_the_yaw_turns_with_the_taught_frame(flip: bool) -> None:
    one = scanned("propeller_3", 5, 1)
    found = estimated(one, order=3)
    turned = found.pose.copy()
    turned[:3, :3] = (
        turned[:3, :3] @ Rotation.from_euler("ZX", [20.0, 180.0 if flip else 0.0], True).as_matrix()
    )
    stored = json.loads(found.to_json())
    stored["pose"] = turned.tolist()
    stored["quaternion"] = Rotation.from_matrix(turned[:3, :3]).as_quat().tolist()
    again = estimated(one, reference=Estimate.from_json(json.dumps(stored)).as_reference())
    assert np.degrees(np.arccos(np.clip(again.axis @ turned[:3, 2], -1.0, 1.0))) < 0.1

    def from_x(estimate: Estimate) -> NDArray[np.float64]:
        """The histogram from +x on, about +z, in steps of a degree."""
        bins = np.asarray(estimate.diagnostics["yaw_histogram"])
        degrees = np.degrees(float(estimate.diagnostics["yaw_angle"])) + np.arange(360.0) + 0.5
        return bins[np.floor(degrees / 360.0 * len(bins)).astype(int) % len(bins)]

    before, after = from_x(found), from_x(again)
    expected = np.roll(before, -20)[::-1] if flip else np.roll(before, -20)
    assert np.corrcoef(expected, after)[0, 1] > 0.95
    assert np.corrcoef(before, after)[0, 1] < 0.9
