"""The evaluation: metrics against closed forms, the noise bound, resuming, tables, captured scenes."""

from __future__ import annotations

import doctest
import importlib
import json
import platform
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("manifold3d")
pytest.importorskip("embreex")

from sympose import datasets  # noqa: E402
from sympose.datasets import Part, names, part  # noqa: E402
from sympose.errors import InvalidInputError, NoSymmetryError  # noqa: E402
from sympose.evaluation import (  # noqa: E402
    Scenario,
    Store,
    Subject,
    cases,
    measure,
    methods,
    noise_bound,
    pose_errors,
    reference_of,
    report,
    run,
    statistics,
)
from sympose.evaluation.bound import axis_bound  # noqa: E402
from sympose.evaluation.check import checks_table  # noqa: E402
from sympose.evaluation.cli import main  # noqa: E402
from sympose.evaluation.metrics import axis_angle_deg, axis_offset, wrap_deg  # noqa: E402
from sympose.evaluation.page import circumstances, write_page  # noqa: E402
from sympose.evaluation.pose_checks import check_pose  # noqa: E402
from sympose.evaluation.reference import about_z, mesh_from_object, turned_over  # noqa: E402
from sympose.evaluation.surface import Surface  # noqa: E402
from sympose.evaluation.tables import TABLE_1, TABLE_2, TABLE_3, paper_tables  # noqa: E402

Row = dict[str, Any]
Floats = NDArray[np.float64]

# ---- metrics -------------------------------------------------------------------------------


def pose_from(rotation: Floats, translation: list[float]) -> Floats:
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = translation
    return pose


def about_x(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return pose_from(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), [0.0, 0.0, 0.0])


@pytest.mark.parametrize("angle_deg", [0.0, 1e-7, 0.001, 1.0, 45.0, 90.0])
def test_the_angle_between_axes_is_exact_and_ignores_the_sign(angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    first, second = np.array([0.0, 0.0, 1.0]), np.array([0.0, np.sin(angle), np.cos(angle)])
    assert axis_angle_deg(first, second) == pytest.approx(angle_deg, rel=1e-12, abs=1e-15)
    assert axis_angle_deg(first, -second) == pytest.approx(angle_deg, rel=1e-12, abs=1e-15)


def test_the_offset_is_the_distance_of_the_centre_from_the_line() -> None:
    axis = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    assert axis_offset(np.array([1.0, 0.0, 3.0]), np.array([0.0, 0.0, 3.0]), axis) == pytest.approx(
        np.sqrt(0.5)
    )
    assert axis_offset(np.array([5.0, 5.0, 0.0]), np.zeros(3), axis) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("angle", "period", "expected"),
    [(0.0, 72.0, 0.0), (71.0, 72.0, -1.0), (-145.0, 72.0, -1.0), (37.0, 120.0, 37.0)],
)
def test_yaw_is_taken_modulo_the_sector(angle: float, period: float, expected: float) -> None:
    assert wrap_deg(angle, period) == pytest.approx(expected)


@pytest.fixture(scope="module")
def propeller() -> Subject:
    one = part("propeller_3")
    return Subject("own", one, (one.order,))


def test_the_reference_comes_to_itself_when_turned(propeller: Subject) -> None:
    reference = reference_of(propeller.part)
    assert reference.symmetries.shape == (3, 4, 4)
    rounded = {tuple(p) for p in (reference.points * 1e9).round().astype(int).tolist()}
    turned = reference.points @ reference.symmetries[1][:3, :3].T
    assert sum(tuple(p) in rounded for p in (turned * 1e9).round().astype(int).tolist()) > 0.98 * len(turned)


@pytest.mark.parametrize("turns", [0, 1, 2])
@pytest.mark.parametrize("flipped", [False, True])
def test_the_exact_pose_scores_zero_in_every_equivalent_form(
    propeller: Subject, turns: int, flipped: bool
) -> None:
    reference = reference_of(propeller.part)
    truth = pose_from(about_x(0.7)[:3, :3] @ about_z(0.3)[:3, :3], [3.0, -2.0, 5.0])
    guess = truth @ about_z(2.0 * np.pi * turns / 3.0 + 0.2)
    if flipped:
        guess = guess @ turned_over()
    errors = pose_errors(reference, truth, guess, yaw=0.2)
    assert errors.success
    assert errors.axis_deg < 1e-5
    figures = (errors.offset, errors.along, errors.yaw_deg, errors.adds, errors.adds_aligned, errors.mssd)
    assert all(value is not None and abs(value) < 1e-6 for value in (*figures, errors.mssd_aligned))


def test_each_error_is_told_from_the_others(propeller: Subject) -> None:
    reference = reference_of(propeller.part)
    truth = pose_from(about_x(-1.1)[:3, :3], [0.2, 0.4, 0.6])
    reach = np.linalg.norm(reference.points[:, :2], axis=1).max()

    slid = pose_errors(reference, truth, truth @ pose_from(np.eye(3), [0.0, 0.0, 0.01]), yaw=0.0)
    assert slid.along == pytest.approx(0.01)
    assert (slid.offset, slid.axis_deg, slid.yaw_deg) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert slid.mssd == pytest.approx(0.01)
    assert 0.0 < slid.adds_aligned <= 0.01

    turned = pose_errors(reference, truth, truth @ about_z(np.radians(1.5)), yaw=0.0)
    assert turned.yaw_deg == pytest.approx(1.5)
    assert turned.mssd == pytest.approx(2.0 * reach * np.sin(np.radians(0.75)))
    assert turned.mssd_aligned == pytest.approx(0.0, abs=1e-9)
    assert turned.adds is not None
    assert turned.adds > 10.0 * turned.adds_aligned

    shifted = pose_errors(reference, truth, truth @ pose_from(np.eye(3), [0.03, 0.0, 0.0]), yaw=0.0)
    assert shifted.offset == pytest.approx(0.03)
    assert not shifted.success

    tilted = pose_errors(reference, truth, truth @ about_x(np.radians(2.5)), yaw=0.0)
    assert tilted.axis_deg == pytest.approx(2.5)
    assert tilted.offset == pytest.approx(0.0, abs=1e-9)
    assert not tilted.success


def test_errors_are_in_diameters(propeller: Subject) -> None:
    reference = reference_of(propeller.part)
    truth = pose_from(np.eye(3), [10.0, 20.0, 30.0])
    guess = truth @ pose_from(np.eye(3), [0.5, 0.0, 2.0])
    errors = pose_errors(reference, truth, guess, diameter=100.0, yaw=0.0)
    assert (errors.offset, errors.along) == pytest.approx((0.005, 0.02))


def test_a_surface_of_revolution_has_no_yaw() -> None:
    one = part(names("continuous")[0])
    reference = reference_of(one)
    errors = pose_errors(reference, np.eye(4), about_z(1.234), yaw=0.0)
    assert (errors.yaw_deg, errors.adds, errors.mssd) == (None, None, None)
    assert max(errors.adds_aligned, errors.mssd_aligned) < 1e-9


def test_the_distance_to_a_surface_is_exact() -> None:
    rng = np.random.default_rng(1)
    box = trimesh.creation.box([0.6, 0.5, 0.4])
    points = rng.uniform(-1.0, 1.0, (2000, 3)) * [0.32, 0.27, 0.22]
    outside = np.abs(points) - [0.3, 0.25, 0.2]
    expected = np.abs(np.linalg.norm(np.maximum(outside, 0.0), axis=1) + np.minimum(outside.max(axis=1), 0.0))
    near = expected < 0.01
    assert near.sum() > 100
    np.testing.assert_allclose(Surface(box).distance(points[near]), expected[near], atol=1e-9)


# ---- noise bound ---------------------------------------------------------------------------


def test_the_bound_of_a_flat_ring_has_a_closed_form() -> None:
    # On a disc seen from the front the normals are z: only the tilt is fixed, by sum (r sin)^2 = N r^2 / 2.
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    ring = 0.4 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (400, 1))
    out = ring / 0.4
    axis, center = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    sigma = 0.002
    both = axis_bound(np.vstack([ring, ring]), np.vstack([up, out]), np.full(800, sigma), axis, center)
    assert both.axis_deg == pytest.approx(np.degrees(np.sqrt(2.0 / 200.0) * sigma / 0.4))
    assert both.offset == pytest.approx(np.sqrt(2.0 / 200.0) * sigma)
    with pytest.raises(ValueError, match="no axis"):
        axis_bound(ring, up, np.full(400, sigma), axis, center)
    with pytest.raises(ValueError, match="noise"):
        axis_bound(ring, out, np.zeros(400), axis, center)


def test_the_bound_grows_with_the_noise_and_falls_with_the_root_of_the_points(propeller: Subject) -> None:
    one = propeller.part
    scan = Scenario("sphere", 2).scan(one, 1)
    single, double = noise_bound(one, scan, 0.001), noise_bound(one, scan, 0.002)
    assert double.axis_deg == pytest.approx(2.0 * single.axis_deg)
    assert double.offset == pytest.approx(2.0 * single.offset)

    rng = np.random.default_rng(0)
    points = reference_of(one).points
    normals = reference_of(one).normals
    sparse = rng.choice(len(points), len(points) // 9, replace=False)
    z, origin = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    every = axis_bound(points, normals, np.full(len(points), 1e-3), z, origin)
    ninth = axis_bound(points[sparse], normals[sparse], np.full(len(sparse), 1e-3), z, origin)
    assert ninth.axis_deg / every.axis_deg == pytest.approx(3.0, rel=0.1)
    assert ninth.offset / every.offset == pytest.approx(3.0, rel=0.1)


def test_the_bound_does_not_depend_on_where_the_part_is(propeller: Subject) -> None:
    near = Scenario("sphere", 2).scan(propeller.part, 1)

    far = datasets.scan(propeller.part, "sphere", views=2, seed=1, scale=250.0)
    small, large = noise_bound(propeller.part, near, 0.001), noise_bound(propeller.part, far, 0.001)
    assert large.axis_deg == pytest.approx(small.axis_deg, rel=1e-3)
    assert large.offset == pytest.approx(small.offset, rel=1e-3)


# ---- the runner ----------------------------------------------------------------------------


def truth_of(subject: Subject, scan: datasets.Scan) -> Floats:
    return np.asarray(scan.world_from_object @ mesh_from_object(subject.part))


@pytest.fixture
def probes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Methods that are right, refuse or crash; what was run is noted."""
    ran: list[str] = []

    def right(subject: Subject, scenario: Scenario, scan: Any, seed: int) -> methods.Answer:
        ran.append(f"{subject.part.name} {scenario.label} {seed}")
        return methods.Answer(truth_of(subject, scan), "model")

    def refuse(subject: Subject, scenario: Scenario, scan: Any, seed: int) -> methods.Answer:
        raise NoSymmetryError("nothing here")

    def crash(subject: Subject, scenario: Scenario, scan: Any, seed: int) -> methods.Answer:
        raise ZeroDivisionError("oops")

    for name, one in {"right": right, "refuse": refuse, "crash": crash}.items():
        monkeypatch.setitem(methods.METHODS, name, one)
    return ran


def choose(name: str) -> Callable[[Subject], bool]:
    return lambda subject: subject.part.name == name


def test_every_case_becomes_a_row_whatever_happens(probes: list[str], tmp_path: Path) -> None:
    todo = cases("own", [Scenario("sphere", 1)], [1], ["right", "refuse", "crash"], choose=choose("knob_3"))
    rows = run(todo, Store(tmp_path / "rows.jsonl"))
    assert [row["outcome"] for row in rows] == ["ok", "refused", "error"]
    assert max(rows[0][key] for key in ("axis_deg", "offset", "adds", "mssd")) < 1e-5
    assert rows[0]["axis_over_bound"] < 0.01
    assert rows[1]["message"] == "NoSymmetryError: nothing here"
    assert rows[2]["message"] == "ZeroDivisionError: oops"
    text = report(rows)
    assert "oops" in text
    assert "knob_3" in text


def test_an_interrupted_run_goes_on_where_it_stopped(probes: list[str], tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    todo = cases("own", [Scenario("sphere", 1)], [1, 2, 3], ["right"], choose=choose("knob_3"))
    first = run(todo[:2], Store(path))
    assert len(probes) == 2
    with path.open("a", encoding="utf-8") as file:
        file.write('{"key": "own | knob_3 | sph')  # the power went
    seen: list[tuple[int, int]] = []
    rows = run(todo, Store(path), progress=lambda done, total, name: seen.append((done, total)))
    assert len(probes) == 3
    assert rows[:2] == first
    assert seen == [(2, 3), (3, 3)]
    lines = path.read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["seed"] for line in lines] == [1, 2, 3]
    assert run(todo, Store(path)) == rows
    assert len(probes) == 3


def test_figures_of_two_builds_do_not_mix(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    Store(path).add({"key": "a"})
    (tmp_path / "rows.build").write_text("0.0.0 deadbeef\n", encoding="utf-8")
    with pytest.raises(InvalidInputError, match="deadbeef"):
        Store(path)


def test_what_failed_is_tried_again_and_what_was_refused_is_not(probes: list[str], tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    todo = cases("own", [Scenario("sphere", 1)], [1], ["refuse", "crash"], choose=choose("knob_3"))
    run(todo, Store(path))
    methods.METHODS["refuse"] = methods.METHODS["crash"] = methods.METHODS["right"]
    assert [row["outcome"] for row in run(todo, Store(path))] == ["refused", "ok"]
    assert Store(path).rows[todo[0].row_keys()[1]]["outcome"] == "ok"


def mesh_folder(folder: Path, *names: str) -> str:
    folder.mkdir(parents=True)
    mesh = datasets.part("knob_3").mesh
    mesh.export(folder / "knob.ply")
    entries = [{"name": name, "class": "knob", "file": "knob.ply", "order": 3} for name in names]
    (folder / "manifest.json").write_text(json.dumps(entries), encoding="utf-8")
    return str(folder)


def test_parts_of_two_folders_of_one_name_do_not_mix(probes: list[str], tmp_path: Path) -> None:
    a, b = mesh_folder(tmp_path / "a" / "meshes", "one"), mesh_folder(tmp_path / "b" / "meshes", "one", "two")
    both = [case for source in (a, b) for case in cases(source, [Scenario("sphere", 1)], [1], ["right"])]
    with pytest.raises(InvalidInputError, match="other parts of a folder 'meshes'"):
        run(both, Store(tmp_path / "out" / "rows.jsonl"))
    first = run(both[:1], Store(tmp_path / "out" / "rows.jsonl"))
    assert run(both[:1], Store(tmp_path / "out" / "rows.jsonl")) == first
    assert len(probes) == 1
    with pytest.raises(InvalidInputError, match="more than one part of the name one"):
        cases(mesh_folder(tmp_path / "c", "one", "one"), [Scenario()], [1], ["right"])


@pytest.mark.parametrize(
    "arguments", ["--views 0", "--sigma -1", "--clutter -1 --scenario table", "--seeds 3-1", "--jobs -1"]
)
def test_wrong_arguments_are_named(
    arguments: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments.split(), "--only", "knob_3", "--out", str(tmp_path)]) == 2
    assert arguments.split()[1] in capsys.readouterr().err


def test_a_damaged_store_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    Store(path).add({"key": "a"})
    path.write_text('not a row\n{"key": "a"}\n', encoding="utf-8")
    with pytest.raises(InvalidInputError, match="line 1"):
        Store(path)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="banana"):
        cases("own", [Scenario()], [1], ["banana"])
    with pytest.raises(InvalidInputError, match="moon"):
        Scenario("moon")


def test_a_part_without_symmetry_is_only_given_to_methods_that_find_the_order() -> None:
    plain = Part.from_mesh(trimesh.creation.box([0.3, 0.5, 0.7]))
    subject = Subject("own", plain, (None,))
    assert methods.applies("order_unknown", subject)
    assert not methods.applies("default", subject)
    assert not methods.applies("cad_icp", subject)


@pytest.mark.parametrize("method", ["default", "no_viewpoints"])
def test_the_methods_of_the_package_are_measured(propeller: Subject, method: str) -> None:
    scenario = Scenario("sphere", 2)
    scan = scenario.scan(propeller.part, 1)
    row = measure.measure(propeller, scenario, scan, 1, method)
    assert row["outcome"] == "ok", row.get("message")
    assert row["axis_deg"] < 5.0
    assert row["order_right"] is True
    assert 0.0 < row["raw_error"] < 0.003
    assert sum(row["histogram_refined"]) == pytest.approx(1.0)
    json.dumps(row)


# ---- tables --------------------------------------------------------------------------------


def made_up(part_name: str, method: str, scenario: Scenario, **figures: Any) -> Row:
    return {
        "key": f"own | {part_name} | {scenario.label} | 1 | {method}",
        "source": "own",
        "part": part_name,
        "family": "wheel_hub",
        "order": 5,
        "scenario": scenario.label,
        "seed": 1,
        "method": method,
        "outcome": "ok",
        **figures,
    }


def test_statistics_are_of_absolute_values() -> None:
    s = statistics([{"e": -3.0}, {"e": 1.0}, {}, {"e": 2.0}], "e")
    assert (s.count, s.mean, s.median, s.worst) == (3, 2.0, 2.0, 3.0)
    assert statistics([], "e").count == 0


def test_the_papers_tables_stand_beside_ours() -> None:
    rows = [
        made_up("hub", "default", Scenario("sphere", views, sigma), adds=0.0123 * sigma, adds_aligned=0.001)
        for views, sigma in [(5, 1.0), (5, 2.0), (1, 1.0)]
    ]
    text = paper_tables(rows)
    for table in (TABLE_1, TABLE_2, TABLE_3):
        for numbers in table.values():
            assert all(f"| {number} " in text for number in numbers)
    lines = [line for line in text.splitlines() if line.startswith("| Sympose, default |")]
    assert lines[0].startswith("| Sympose, default | 0.0123 | - |")
    assert lines[1].startswith("| Sympose, default | 0.0123 | 0.0246 | - |")
    assert lines[2].startswith("| Sympose, default | 0.0123 | - |")


def test_promises_are_kept_or_broken_by_their_figures() -> None:
    good: Row = {"axis_deg": 0.01, "offset": 1e-4, "adds": 0.005, "adds_aligned": 0.004}
    good |= {"raw_error": 0.001, "voxel_error": 0.001, "refined_error": 0.0005}
    scenario = Scenario("sphere", 5)
    kept = check_pose([made_up("a", "default", scenario, **good)])
    assert len(kept) >= 6
    assert all(check.passed for check in kept)
    broken = check_pose(
        [made_up("a", "default", scenario, **good), {**made_up("b", "default", scenario), "outcome": "error"}]
    )
    worst = next(check for check in broken if check.what.startswith("axis_deg, worst"))
    assert worst.passed is False
    assert any("own | b |" in name for name in worst.failing)
    assert "**fail**" in checks_table(broken)


def test_the_command_line_writes_tables_and_figures(
    probes: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    arguments = ["--only", "knob_3", "--views", "1", "--seeds", "1", "--methods", "right,crash"]
    page = tmp_path / "docs" / "figures.md"
    assert main([*arguments, "--out", str(out), "--page", str(page)]) == 0
    printed = capsys.readouterr().out
    assert "knob_3" in printed
    assert page.read_text(encoding="utf-8") == printed
    assert "`sympose evaluate --only knob_3 --views 1 --seeds 1 --methods right,crash`" in printed
    for private in (str(tmp_path), str(Path.home()), platform.node()):
        assert private not in printed
    for name in ("report.md", "rows.csv", "rows.json", "rows.jsonl", "recall.png"):
        assert (out / name).stat().st_size > 0, name
    assert main(["--methods", "banana", "--out", str(out)]) == 2
    assert "banana" in capsys.readouterr().err
    assert main(["--parts", str(tmp_path), "--out", str(out)]) == 2


def test_a_page_brings_its_pictures(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "recall.png").write_bytes(b"picture")
    page = tmp_path / "docs" / "evaluation.md"
    write_page(page, "![Recall](recall.png) [more](BENCHMARK.md)\n", out)
    assert page.read_text(encoding="utf-8") == "![Recall](evaluation/recall.png) [more](BENCHMARK.md)\n"
    assert (tmp_path / "docs" / "evaluation" / "recall.png").read_bytes() == b"picture"


def test_the_circumstances_name_the_commit() -> None:
    facts = dict(re.findall(r"^\| (\w+) \| (.+) \|$", circumstances("sympose evaluate", 600.0), re.MULTILINE))
    assert facts["command"] == "`sympose evaluate`"
    assert facts["took"] == "10 min"
    assert re.fullmatch(r"(version \d+\.\d+\.\d+|.*[0-9a-f]{7,})(-dirty)?", facts["commit"])
    assert re.search(r"\d+ cores", facts["hardware"])


@pytest.mark.parametrize("module", ["reference", "scenario", "surface"])
def test_the_examples_in_the_docstrings_hold(module: str) -> None:
    result = doctest.testmod(importlib.import_module(f"sympose.evaluation.{module}"))
    assert result.attempted > 0
    assert result.failed == 0


# ---- captured scenes -----------------------------------------------------------------------


def test_a_captured_object_is_compared_with_the_known_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    from sympose.evaluation import real
    from sympose.io import write

    mesh = trimesh.creation.cylinder(0.03, 0.12, sections=64)
    points, _ = trimesh.sample.sample_surface(mesh, 4000, seed=1)
    (tmp_path / "gpd").mkdir()
    write(tmp_path / "gpd" / "can.ply", points)
    entry = {"axis_direction": [0.0, 0.0, 2.0], "axis_point": [0.0, 0.0, 0.0], "radius": 0.03}
    item = {"path": "gpd/can.ply", "object_order": 0, "what": "a can"}
    manifest = {"items": [item], "estimated_axes": {"gpd/can.ply": entry}}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    out = tmp_path / "out"
    assert real.main([str(tmp_path), "--out", str(out)]) == 0
    rows = json.loads((out / "rows.json").read_text(encoding="utf-8"))
    assert rows[0]["outcome"] == "ok"
    assert rows[0]["axis_deg"] < 1.0
    assert rows[0]["offset_over_radius"] < 0.05
    assert list(out.glob("*.png"))
    assert "gpd/can.ply" in capsys.readouterr().out
    assert real.main([str(tmp_path / "nowhere"), "--out", str(out)]) == 2
