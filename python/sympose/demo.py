"""The demonstration: a part on a table before a wall, from the raw points of a scan to a pose with its error.

From the command line: `sympose demo` or `python -m sympose demo`.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sympose.estimation import estimate

if TYPE_CHECKING:
    from sympose._core import Estimate
    from sympose.datasets import Part, Scan
    from sympose.evaluation.metrics import PoseErrors

__all__ = ["MAX_AXIS_DEG", "Demo", "add_arguments", "demo", "run_demo"]

MAX_AXIS_DEG = 1.0


@dataclass(frozen=True, eq=False)
class Demo:
    """What the demonstration did.

    Attributes:
        scan: The synthetic scan with its truth.
        estimate: What was made of it.
        errors: What separates the two.
        files: What was written.
    """

    scan: Scan
    estimate: Estimate
    errors: PoseErrors
    files: tuple[Path, ...]

    @property
    def passed(self) -> bool:
        """Whether the axis is within a degree."""
        return self.errors.axis_deg <= MAX_AXIS_DEG


def run_demo(
    name: str = "wheel_hub_5", *, views: int = 5, seed: int = 1, out: str | Path = "out", quiet: bool = False
) -> Demo:
    """Scan the part `name` on a table, estimate its pose, and write what was found.

    Args:
        name: One of `sympose.datasets.names()` that has a symmetry.
        views: Depth images from which the scan is merged.
        seed: Of the scan: another pose, other views, other noise.
        out: Folder for `scan.ply`, `estimate.json`, `completed.ply` and `estimate.png`.
        quiet: Without remarks on standard error.

    Raises:
        SymposeError: The estimate failed.
        InvalidInputError: There is no such part, or it has no symmetry.
        ImportError: The extra `sympose[all]` is not installed.
        OSError: A file cannot be written.
    """
    from sympose import write
    from sympose.datasets import part, scan
    from sympose.errors import InvalidInputError
    from sympose.plotting import plot_stages
    from sympose.plotting.pose import sector_colors
    from sympose.segmentation import segment

    log = _Log(quiet)
    folder = Path(out)
    subject = part(name)
    if subject.order is None:
        raise InvalidInputError(f"{name} has no symmetry, so that it has no pose to find")
    folder.mkdir(parents=True, exist_ok=True)

    log.write(f"scan {name}, order {subject.order}, on a table before a wall, {views} views")
    one = scan(subject, "table", views=views, seed=seed)
    write(folder / "scan.ply", one.scene.points)

    found = estimate(one.scene, order=one.order, progress=lambda stage, _: log.write(f"estimate: {stage}"))
    errors = _errors(subject, one, found)

    log.write("draw")
    found.save(folder / "estimate.json")
    colors = np.rint(255.0 * sector_colors(found.completed_sector)).astype(np.uint8)
    write(folder / "completed.ply", found.completed, colors=colors)
    # Once more, for the picture: the estimate does not keep what the segmentation saw.
    segmentation = segment(one.scene.points, one.scene.views)
    plot_stages(
        one.scene,
        segmentation,
        found,
        folder / "estimate.png",
        title=f"From a raw scan to a pose: {name}, {views} views, seed {seed}",
        remarks=_remarks(errors),
    )
    log.write("done")
    files = tuple(folder / file for file in ("scan.ply", "estimate.json", "completed.ply", "estimate.png"))
    return Demo(one, found, errors, files)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `demo`."""
    parser.add_argument(
        "--part", default="wheel_hub_5", help="a part of sympose.datasets (default: wheel_hub_5)"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the scan (default: 1)")
    parser.add_argument("--views", type=int, default=5, help="depth images (default: 5)")
    parser.add_argument("--out", default="out", help="folder of the results (default: out)")
    parser.add_argument("--quiet", action="store_true", help="no remarks on standard error")


def demo(options: argparse.Namespace) -> int:
    """Run the demonstration, print the pose and its error; 1 where the axis is off by more than a degree."""
    done = run_demo(
        options.part, views=options.views, seed=options.seed, out=options.out, quiet=options.quiet
    )
    pose = np.array2string(done.estimate.pose, precision=6, suppress_small=True, floatmode="fixed")
    lines = [
        "pose (world_from_object):",
        pose,
        f"order {done.estimate.order}, score {done.estimate.score:.2f}",
        "error against the truth (the part has diameter 1):",
        *(f"  {name:<18}{value}" for name, value in _rows(done.errors, done.scan.order)),
        "written: " + ", ".join(str(path) for path in done.files),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    for warning in done.estimate.warnings:
        sys.stderr.write(f"sympose: {warning}\n")
    if not done.passed:
        sys.stderr.write(f"sympose: the axis is off by more than {MAX_AXIS_DEG:g} deg\n")
    return 0 if done.passed else 1


def _errors(subject: Part, one: Scan, found: Estimate) -> PoseErrors:
    from sympose.evaluation.metrics import pose_errors
    from sympose.evaluation.reference import reference_of

    reference = reference_of(subject)
    truth = one.world_from_object @ reference.mesh_from_object
    truth[:3, 3] = one.center
    yaw = None
    if isinstance(one.order, int):
        # The yaw of a part is a convention: true is what the same rule chooses on the surface without noise.
        exact = estimate(
            reference.points, order=one.order, normals=reference.normals, axis_hint=[0.0, 0.0, 1.0]
        )
        yaw = float(np.arctan2(exact.pose[1, 0], exact.pose[0, 0]))
    return pose_errors(reference, truth, found.pose, diameter=one.diameter, yaw=yaw)


def _rows(errors: PoseErrors, order: object) -> list[tuple[str, str]]:
    """Name and value of each error, for a person to read."""
    rows = [
        ("of the axis", f"{errors.axis_deg:.4f} deg"),
        ("across the axis", f"{errors.offset:.6f}"),
        ("along the axis", f"{errors.along:+.6f}"),
    ]
    if errors.yaw_deg is not None and isinstance(order, int):
        rows.append(("of the yaw", f"{errors.yaw_deg:+.4f} deg (modulo {360.0 / order:g})"))
    return rows


def _remarks(errors: PoseErrors) -> list[tuple[str, str]]:
    """The same in few words, for the picture."""
    yaw = "" if errors.yaw_deg is None else f", yaw {errors.yaw_deg:+.2g}°"
    return [
        ("true error", f"axis {errors.axis_deg:.2g}°{yaw}"),
        ("", f"across {errors.offset:.2g}, along {errors.along:+.2g}"),
    ]


class _Log:
    """Remarks with the time since the start, on standard error."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._started = time.perf_counter()

    def write(self, text: str) -> None:
        if not self._quiet:
            sys.stderr.write(f"{time.perf_counter() - self._started:6.1f} s  {text}\n")
            sys.stderr.flush()
