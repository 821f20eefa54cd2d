"""The command line: `sympose evaluate` and `python -m sympose.evaluation`."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sympose.errors import SymposeError
from sympose.evaluation.measure import Row
from sympose.evaluation.methods import METHODS
from sympose.evaluation.page import circumstances, write_page
from sympose.evaluation.plots import save_figures
from sympose.evaluation.progress import ProgressBar
from sympose.evaluation.runner import Store, cases, run
from sympose.evaluation.scenario import STRESS, Scenario, Subject
from sympose.evaluation.suites import SUITES, Suite, run_suite
from sympose.evaluation.summary import report, write_csv, write_json

__all__ = ["add_arguments", "evaluate", "main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 2 bad usage or input."""
    parser = argparse.ArgumentParser(prog="python -m sympose.evaluation", description=__doc__.splitlines()[0])
    add_arguments(parser)
    return evaluate(parser.parse_args(argv))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `evaluate` reads, so that `sympose evaluate` has the same options."""
    parser.epilog = (
        "A folder of meshes has a manifest.json, a list of objects such as "
        '{"name": "hub", "class": "wheel_hub", "file": "hub.stl", "order": 5}: order 0 is a surface of '
        "revolution, 1 a part without symmetry. The diameter of a mesh is 1, its axis +z."
    )
    parser.add_argument(
        "--parts", default="own", help="own, or folders of meshes with a manifest, by comma (default: own)"
    )
    parser.add_argument(
        "--suite", choices=sorted(SUITES), help="a ready-made run, with scenarios and methods of its own"
    )
    parser.add_argument(
        "--only", default="", help="only parts whose name or family holds one of these, by comma"
    )
    parser.add_argument(
        "--every", action="store_true", help="also parts that are continuous or not symmetric"
    )
    parser.add_argument(
        "--scenario", default="sphere", help="sphere, edge, upper, table or alone; several by comma"
    )
    parser.add_argument("--views", default="5", help="number of views; several by comma (default: 5)")
    parser.add_argument(
        "--sigma", default="1", help="noise in multiples of 0.001 of the depth; several by comma"
    )
    parser.add_argument("--stress", default="", help=f"several by comma, all at once: {', '.join(STRESS)}")
    parser.add_argument("--clutter", type=int, default=0, help="boxes on the table")
    parser.add_argument("--seeds", help="such as 1-3 or 1,5 (default: 1-3, or those of the suite)")
    parser.add_argument("--methods", default="default", help=f"several by comma: {', '.join(METHODS)}")
    parser.add_argument(
        "--out", default="out/evaluation", help="folder of the results (default: out/evaluation)"
    )
    parser.add_argument(
        "--page",
        metavar="FILE.md",
        help="also write the report as a page with its circumstances and pictures",
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes; 0: one for each core (default: 1)")


def evaluate(options: argparse.Namespace) -> int:
    """Run what the options say, write the results and print the tables."""
    out, started = Path(options.out), time.monotonic()
    try:
        if options.jobs < 0:
            raise ValueError(f"--jobs {options.jobs}: expected a number of processes, or 0 for all cores")
        options.jobs = options.jobs or os.cpu_count() or 1
        rows, text = _suite(options, out) if options.suite else _chosen(options, out)
    except (SymposeError, ValueError, OSError, ImportError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    text = f"# Evaluation\n\n{circumstances(_command(options), time.monotonic() - started)}\n\n{text}\n"
    (out / "report.md").write_text(text, encoding="utf-8")
    if options.page:
        write_page(Path(options.page), text, figures=out)
    write_csv(rows, out / "rows.csv")
    write_json(rows, out / "rows.json")
    sys.stdout.write(text)
    return 0


def _command(options: argparse.Namespace) -> str:
    """What to type for the same figures; of folders the last name, since where they lie says nothing."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = ["sympose evaluate"]
    for name, default in vars(parser.parse_args([])).items():
        value = getattr(options, name)
        if name in ("out", "page", "jobs") or value == default:
            continue
        if name == "parts":
            value = ",".join(Path(source).name for source in _words(value))
        words.append(f"--{name}" if value is True else f"--{name} {value}")
    return " ".join(words)


def _suite(options: argparse.Namespace, out: Path) -> tuple[list[Row], str]:
    suite = Suite(
        out,
        sources=_words(options.parts),
        seeds=_numbers(options.seeds) if options.seeds else None,
        jobs=options.jobs,
        choose=_choice(options),
        progress=ProgressBar(),
    )
    return run_suite(options.suite, suite)


def _chosen(options: argparse.Namespace, out: Path) -> tuple[list[Row], str]:
    views, multiples = [int(n) for n in _words(options.views)], [float(k) for k in _words(options.sigma)]
    stress = {key: value for name in _words(options.stress) for key, value in _stress(name).items()}
    scenarios = [
        Scenario(place, count, multiple, clutter=options.clutter if place == "table" else 0, **stress)
        for place in _words(options.scenario)
        for count in views
        for multiple in multiples
    ]
    todo = [
        case
        for source in _words(options.parts)
        for case in cases(
            source,
            scenarios,
            _numbers(options.seeds or "1-3"),
            _words(options.methods),
            every=options.every,
            choose=_choice(options),
        )
    ]
    if not todo:
        raise ValueError("nothing to run: no part fits --only and --methods")
    rows = run(todo, Store(out / "rows.jsonl"), jobs=options.jobs, progress=ProgressBar())
    save_figures(rows, out)
    return rows, report(rows)


def _choice(options: argparse.Namespace) -> Callable[[Subject], bool]:
    only = _words(options.only)
    return lambda one: not only or any(word in f"{one.part.name} {one.part.family}" for word in only)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _numbers(text: str) -> list[int]:
    numbers: list[int] = []
    for word in _words(text):
        first, _, last = word.partition("-")
        found = range(int(first), int(last or first) + 1)
        if not found:
            raise ValueError(f"{word!r}: the last number is before the first")
        numbers += found
    return numbers


def _stress(name: str) -> dict[str, Any]:
    if name not in STRESS:
        raise ValueError(f"there is no stress {name!r}; there are {', '.join(STRESS)}")
    return STRESS[name]
