"""The command line: that of the Rust binary, and what only Python can do.

Results go to standard output, remarks to standard error. Exit codes: 0 done, 1 no trustworthy pose, 2 bad
usage or input, 130 cancelled with Ctrl-C.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from sympose import _core
from sympose.errors import (
    CancelledError,
    DeadlineExceededError,
    InsufficientDataError,
    InvalidInputError,
    NoSymmetryError,
    SymposeError,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["main"]

_NO_POSE = (DeadlineExceededError, InsufficientDataError, NoSymmetryError)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line on `argv`, or on the arguments of the process; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as by `>&-`: no one reads, but the work is still wanted
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    try:
        try:
            return _run(arguments)
        finally:
            # Not left to the end of the process, where nothing could be done about a closed pipe.
            sys.stdout.flush()
    except (CancelledError, KeyboardInterrupt):
        sys.stderr.write("sympose: cancelled\n")
        return 130
    except _NO_POSE as error:
        sys.stderr.write(f"sympose: {error}\n")
        return 1
    except BrokenPipeError:
        # Whoever reads has seen enough. What is still in the buffer goes where it cannot fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (SymposeError, OSError, ImportError) as error:
        sys.stderr.write(f"sympose: {error}\n")
        return 2


def _run(arguments: Sequence[str]) -> int:
    match arguments:
        case ["help", name] if name in _COMMANDS:
            return _COMMANDS[name].run(["--help"])
        case [name, *rest] if name in _COMMANDS:
            return _COMMANDS[name].run(rest)
    return _rust(arguments)


def _rust(arguments: Sequence[str]) -> int:
    sys.stdout.flush()
    line = ["sympose", *arguments]
    code = _core.cli_main(line, **_given(line))
    if arguments in (["--help"], ["-h"], ["help"]):
        rows = (f"  {name:<10}{command.summary}\n" for name, command in _COMMANDS.items())
        sys.stdout.write(f"\nCommands of the Python package:\n{''.join(rows)}")
        sys.stdout.write("It also reads NPY and NPZ files, and COLMAP models from their folders.\n")
    return code


def _given(line: Sequence[str]) -> dict[str, Any]:
    """What stands for the file with the scan, where only the Python package reads files of its kind."""
    from sympose.io.files import is_only_read_here, read

    found = _core.cli_scan(line)
    if found is None or not is_only_read_here(found[0]):
        return {}
    path, settings, timeout = found
    started = time.perf_counter()
    if settings is not None:
        from sympose.config import Config
        from sympose.estimation import Watch, cloud_of

        watch = Watch(timeout)
        scene, config = read(path), Config(**json.loads(settings))
        try:
            cloud = cloud_of(scene, scene.views, config, watch)
        except DeadlineExceededError:
            # The estimate finds that, too, and says so as it says everything.
            cloud = cloud_of(scene, (), config)
        return {"cloud": cloud | {"elapsed": time.perf_counter() - started}}
    scene = read(path)
    places = scene.viewpoints
    one_place = places is None or (places == places[0]).all()
    if not one_place:
        sys.stderr.write(f"sympose: {path}: the viewpoints of its points count for estimate only\n")
    return {
        "scan": {
            "points": scene.points,
            "normals": scene.normals,
            "colors": None if scene.colors is None else scene.colors.tolist(),
            "viewpoint": places[0].tolist() if places is not None and one_place else None,
        }
    }


def _segment(arguments: Sequence[str]) -> int:
    parser = _parser("segment", "A scene needs views: a COLMAP folder, or an NPZ file with depth and K.")
    parser.add_argument("scene", help="file or folder")
    parser.add_argument("out", help="where to write the foreground: PLY, PCD, XYZ, CSV, NPY or NPZ")
    parser.add_argument("--max-components", type=int, default=5, help="Gaussians a view (default: 5)")
    parser.add_argument("--min-views", type=int, help="views that must agree (default: half)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", metavar="IMAGE", help="draw the depths of the views and the cuts")
    options = parser.parse_args(arguments)

    from sympose.io import read
    from sympose.io.files import write_scene
    from sympose.scene import Scene
    from sympose.segmentation import segment

    scene = read(options.scene)
    if not scene.views:
        raise InvalidInputError(f"{options.scene}: no view is known; segmentation needs at least one")
    segmentation = segment(
        scene.points,
        scene.views,
        max_components=options.max_components,
        min_views=options.min_views,
        seed=options.seed,
    )
    for warning in segmentation.warnings:
        sys.stderr.write(f"sympose: {warning}\n")
    if options.plot:
        segmentation.plot(options.plot)
    mask = segmentation.mask
    if not mask.any():
        raise InsufficientDataError("no point is foreground; nothing written")
    foreground = scene.select(mask)
    if _storable(options.out, foreground.viewpoints) is None:
        foreground = Scene(foreground.points, foreground.colors, foreground.normals)
    write_scene(options.out, foreground)
    sys.stdout.write(f"{mask.sum()} of {len(mask)} points are foreground\n")
    return 0


def _storable(path: str, viewpoints: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """The viewpoints where the file can hold them; says so where it cannot."""
    from sympose.io.files import holds_viewpoints

    if viewpoints is None or holds_viewpoints(path, viewpoints):
        return viewpoints
    sys.stderr.write(f"sympose: {path} cannot hold the viewpoints of the points; NPZ can\n")
    return None


def _dataset(arguments: Sequence[str]) -> int:
    from sympose.datasets import SCENARIOS, names, part, scan

    parser = _parser(
        "dataset", "Parts have diameter 1; the pose in the world is random and follows from the seed."
    )
    parser.add_argument("part", choices=names(), metavar="part", help=", ".join(names()))
    parser.add_argument("out", help="where to write the scan: PLY, PCD, XYZ, CSV, NPY or NPZ")
    parser.add_argument("--truth", metavar="JSON", help="where to write pose and order")
    parser.add_argument("--scenario", choices=list(SCENARIOS), default="sphere", help="(default: sphere)")
    parser.add_argument("--views", type=int, default=5, help="(default: 5)")
    parser.add_argument("--sigma", type=float, default=0.001, help="noise by depth (default: 0.001)")
    parser.add_argument("--seed", type=int, default=1, help="(default: 1)")
    options = parser.parse_args(arguments)

    from sympose.io.files import write_scene
    from sympose.scene import Scene

    one = scan(
        part(options.part), options.scenario, views=options.views, sigma=options.sigma, seed=options.seed
    )
    viewpoints = _storable(options.out, one.scene.viewpoints)
    write_scene(options.out, Scene(one.scene.points, viewpoints=viewpoints))
    truth = {
        "world_from_object": one.world_from_object.tolist(),
        "order": one.order,
        "axis": one.axis.tolist(),
    }
    if options.truth:
        with open(options.truth, "w", encoding="utf-8") as file:
            json.dump(truth, file, indent=2)
    sys.stdout.write(f"{len(one.scene)} points of {options.part}, order {one.order}\n")
    return 0


def _demo(arguments: Sequence[str]) -> int:
    from sympose.demo import add_arguments, demo

    parser = _parser("demo")
    add_arguments(parser)
    return demo(parser.parse_args(arguments))


def _view(arguments: Sequence[str]) -> int:
    parser = _parser("view")
    parser.add_argument("file", help="a scan, or an estimate as JSON")
    parser.add_argument("--save", metavar="IMAGE", help="draw into a file instead: PNG, SVG or PDF")
    options = parser.parse_args(arguments)

    if options.file.lower().endswith(".json"):
        found = _core.Estimate.load(options.file)
        found.plot(options.save) if options.save else found.show()
        return 0
    from sympose.io import read
    from sympose.plotting import plot_scene, show_scene

    scene = read(options.file)
    plot_scene(scene, options.save) if options.save else show_scene(scene)
    return 0


def _evaluate(arguments: Sequence[str]) -> int:
    from sympose.evaluation.cli import add_arguments, evaluate

    parser = _parser("evaluate")
    add_arguments(parser)
    return evaluate(parser.parse_args(arguments))


class _Command(NamedTuple):
    run: Callable[[Sequence[str]], int]
    summary: str


_COMMANDS = {
    "demo": _Command(_demo, "Scan a synthetic part on a table, estimate its pose, draw every stage"),
    "view": _Command(_view, "Draw a scan or an estimate, in a window or into a file"),
    "segment": _Command(_segment, "Tell the foreground of a scene with views from its background"),
    "dataset": _Command(_dataset, "Scan a synthetic part with a virtual depth camera"),
    "evaluate": _Command(_evaluate, "Measure the errors on scans whose truth is known"),
}


def _parser(command: str, details: str = "") -> argparse.ArgumentParser:
    summary = f"{_COMMANDS[command].summary}. {details}".strip()
    return argparse.ArgumentParser(prog=f"sympose {command}", description=summary)
