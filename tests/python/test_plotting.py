"""Drawings: they are made without pyplot, can be opened, and show what they claim."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import sympose

matplotlib = pytest.importorskip("matplotlib")

from matplotlib.figure import Figure  # noqa: E402
from PIL import Image  # noqa: E402

from sympose.plotting import Eye, draw_cloud, draw_yaw, plot_estimate, plot_scene  # noqa: E402
from sympose.plotting.charts import describe  # noqa: E402

ORDER = 3
VIEWPOINT = [0.5, 0.4, 3.0]


def wavy_dish(order: int = ORDER, count: int = 4000) -> NDArray[np.float64]:
    """A dish about z whose rim lobes stand out to all sides by `order`; round where it is 0."""
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    lobe = 0.08 * np.cos(order * angle) if order else 0.0
    radius = (0.42 + lobe) * np.sqrt(rng.uniform(0.02, 1.0, count))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.6 * radius**2], axis=1)


@pytest.fixture(scope="module")
def found() -> sympose.Estimate:
    return sympose.estimate(wavy_dish(), order=ORDER, viewpoints=VIEWPOINT)


def text_of(figure: Figure) -> str:
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    return "\n".join(texts + titles)


def test_names_of_files_are_no_formulas(tmp_path: Path) -> None:
    for name in ("part$_{$.ply", "part\udcff.ply"):
        plot_scene(sympose.Scene(wavy_dish(), name=name), tmp_path / "scene.png")


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_plot_saves_what_can_be_opened(found: sympose.Estimate, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"pose.{suffix}"
    assert isinstance(found.plot(path), Figure)
    if suffix == "png":
        with Image.open(path) as image:
            image.load()
            assert min(image.size) > 600
            assert len(image.convert("RGB").getcolors(1 << 24) or []) > 100
    else:
        assert path.stat().st_size > 10_000


def test_every_panel_is_named(found: sympose.Estimate) -> None:
    figure = plot_estimate(found)
    text = text_of(figure)
    for name in (
        "Object points and axis",
        "Completed cloud",
        "Match when turned",
        "Yaw histogram",
        "Estimate",
    ):
        assert name in text
    assert f"{found.score:.2f}" in text
    assert f"{len(found.completed):,} completed" in text


def test_neither_pyplot_nor_a_backend_is_touched(found: sympose.Estimate, tmp_path: Path) -> None:
    found.save(tmp_path / "found.json")
    program = (
        "import sys, sympose; sympose.Estimate.load('found.json').plot('pose.png');"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=tmp_path, check=True)


def test_a_summary_without_points_can_be_drawn(found: sympose.Estimate) -> None:
    summary = json.loads(found.to_json())
    for name in (
        "points",
        "normals",
        "inliers",
        "point_of_inlier",
        "completed",
        "completed_sector",
        "match_curve",
    ):
        del summary[name]
    text = text_of(plot_estimate(sympose.Estimate.from_json(json.dumps(summary))))
    assert text.count("no points") == 2


def test_a_free_yaw_is_called_free() -> None:
    found = sympose.estimate(wavy_dish(order=0), order="continuous", viewpoints=VIEWPOINT)
    assert "yaw is free" in text_of(plot_estimate(found))
    assert ("order", "continuous") in describe(found)


def test_the_histogram_is_drawn_from_the_chosen_direction(found: sympose.Estimate) -> None:
    axes = Figure().add_subplot(projection="polar")
    draw_yaw(axes, found)
    (band,) = [
        c for c in axes.collections if type(c).__name__ in ("PolyCollection", "FillBetweenPolyCollection")
    ]
    outline = band.get_paths()[0].vertices
    outer = outline[outline[:, 1] > outline[:, 1].min() + 1e-9]
    bins = 36
    place = (outer[:, 0] % (2.0 * np.pi) / (2.0 * np.pi) * bins).astype(int) % bins
    drawn = np.bincount(place, outer[:, 1], bins) / np.maximum(np.bincount(place, minlength=bins), 1)

    # Area of the dish by angle, from its equation; the histogram weighs the surface, not the points.
    heading = np.arctan2(found.pose[1, 0], found.pose[0, 0])
    middle = (np.arange(bins) + 0.5) / bins * 2.0 * np.pi + heading
    rim = 0.42 + 0.08 * np.cos(ORDER * middle)
    area = (1.0 + 1.44 * rim**2) ** 1.5
    agreement = [np.corrcoef(np.roll(area, shift), drawn)[0, 1] for shift in range(bins // ORDER)]
    assert int(np.argmax(agreement)) in (0, 1, bins // ORDER - 1)
    assert max(agreement) > 0.9


def test_the_axis_of_a_pose_is_upright(found: sympose.Estimate) -> None:
    eye = Eye.of_pose(found.pose)
    frame = np.stack([eye.right, eye.up, eye.toward])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    (foot, tip), _ = eye.project(np.stack([found.center, found.center + found.axis]))
    assert abs(tip[0] - foot[0]) < 1e-12
    assert tip[1] > foot[1]


def test_the_axis_passes_between_what_is_behind_and_before_it() -> None:
    eye = Eye.at([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    rng = np.random.default_rng(0)
    wall = np.stack([np.zeros(500), *rng.uniform(-1.0, 1.0, (2, 500))], axis=1)
    points = np.concatenate([wall - [0.5, 0.0, 0.0], wall[:200] + [0.5, 0.0, 0.0]])
    axes = Figure().add_subplot()
    draw_cloud(axes, eye, points, "#0072B2", pose=np.eye(4))
    behind, before = sorted(axes.collections, key=lambda dots: dots.get_zorder())
    (axis, ghost) = sorted(axes.lines, key=lambda line: line.get_zorder())
    assert behind.get_zorder() < axis.get_zorder() < before.get_zorder() < ghost.get_zorder()
    assert len(behind.get_offsets()) > len(before.get_offsets()) > 100


def test_near_points_cover_far_ones() -> None:
    eye = Eye.at([0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    points = np.random.default_rng(0).uniform(size=(300, 3))
    axes = Figure().add_subplot()
    draw_cloud(axes, eye, points, points)
    dots = max(axes.collections, key=lambda dots: len(dots.get_offsets()))
    places, nearness = eye.project(points)
    row = [int(np.argmin(np.linalg.norm(places - place, axis=1))) for place in np.asarray(dots.get_offsets())]
    assert (np.diff(nearness[row]) >= 0.0).all()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_points_are_drawn(count: int, tmp_path: Path) -> None:
    figure = Figure()
    points = np.random.default_rng(0).uniform(size=(count, 3))
    draw_cloud(figure.add_subplot(), Eye.of_pose(np.eye(4)), points, "#0072B2")
    figure.savefig(tmp_path / "few.png")


def test_a_scene_is_drawn_in_its_colours(tmp_path: Path) -> None:
    points = wavy_dish()
    points[7] = np.nan
    scene = sympose.Scene(points, colors=np.full((len(points), 3), [200, 0, 0]), viewpoints=VIEWPOINT)
    plot_scene(scene, tmp_path / "scene.png")
    with Image.open(tmp_path / "scene.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    reddish = (pixels[:, 0] > 60) & (pixels[:, 1] < 40) & (pixels[:, 2] < 40)
    assert reddish.mean() > 0.05


def test_an_unknown_suffix_is_refused(found: sympose.Estimate, tmp_path: Path) -> None:
    with pytest.raises(sympose.InvalidInputError, match="nonsense"):
        found.plot(tmp_path / "pose.nonsense")
    with pytest.raises(OSError, match="missing"):
        found.plot(tmp_path / "missing" / "pose.png")


def test_without_matplotlib_the_extra_is_named(
    found: sympose.Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"sympose\[plot\]"):
        found.plot()


def test_without_a_display_show_says_what_to_do(found: sympose.Estimate) -> None:
    matplotlib.use("agg")
    with pytest.raises(sympose.SymposeError, match="save"):
        found.show()


def test_the_depths_of_each_view_are_drawn_with_their_cut(tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    from sympose.camera import PinholeCamera, View

    rng = np.random.default_rng(0)
    part = rng.uniform(-0.3, 0.3, (3000, 3)) + [0.0, 0.0, 2.0]
    wall = rng.uniform(-3.0, 3.0, (5000, 3)) * [1.0, 1.0, 0.01] + [0.0, 0.0, 5.0]
    camera = PinholeCamera(160, 120, 140.0, 140.0, 79.5, 59.5)
    segmentation = sympose.segment(np.concatenate([part, wall]), [View(camera, np.eye(4))] * 2)
    figure = segmentation.plot(tmp_path / "depths.png")
    assert (tmp_path / "depths.png").stat().st_size > 5000
    assert len(figure.axes) == 2
    for axes, mixture in zip(figure.axes, segmentation.mixtures, strict=True):
        cuts = [line for line in axes.lines if line.get_label() == "cut"]
        assert mixture.threshold is not None
        assert [float(line.get_xdata()[0]) for line in cuts] == [mixture.threshold]
        curves = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
        components, (mixed,) = curves[: len(mixture.means)], curves[len(mixture.means) : -1]
        np.testing.assert_allclose(np.sum(components, axis=0), mixed)
