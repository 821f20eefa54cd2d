"""Ready-made runs.

`short` is for the report in the repository, `pose` for the promises with a known order, `exact` for those
with the order left open and for scans of every kind of trouble.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sympose.evaluation.check import checks_table
from sympose.evaluation.exact import covariance_table, exact_cases, taught_rows
from sympose.evaluation.exact_checks import check_exact
from sympose.evaluation.invariance import measure_invariance
from sympose.evaluation.measure import Row
from sympose.evaluation.performance import measure_performance
from sympose.evaluation.plots import save_figures
from sympose.evaluation.pose_checks import ALONE, ONE_VIEW, SPHERE, TABLE, check_pose
from sympose.evaluation.runner import Case, Store, cases, run
from sympose.evaluation.scenario import Subject, subjects
from sympose.evaluation.summary import report
from sympose.evaluation.tables import paper_tables, table_cases

__all__ = ["SUITES", "Suite", "run_suite"]

_SPHERE_METHODS = ("default", "no_viewpoints", "no_viewpoints_shuffled", "paper", "paper_no_joint")
_PROMISED = tuple(scenario.label for scenario in (SPHERE, ONE_VIEW, TABLE, ALONE))
_SHOWN = ("default", "paper", "cad_icp", "cad_icp_far", "pca")


@dataclass(frozen=True, eq=False)
class Suite:
    """What a suite is run on, and how.

    Attributes:
        out: Folder of rows and figures; a run that was interrupted goes on.
        sources: "own" or folders of meshes.
        seeds: Those of the suite where they are not given.
        jobs: Processes.
        choose: Whether to take a part; None takes all.
        progress: As for `run`.
    """

    out: Path
    sources: Sequence[str] = ("own",)
    seeds: Sequence[int] | None = None
    jobs: int = 1
    choose: Callable[[Subject], bool] | None = None
    progress: Callable[[int, int, str], object] | None = None

    def rows(self, todo: Sequence[Case]) -> list[Row]:
        """Run the cases, no scan twice."""
        return run(_merged(todo), Store(self.out / "rows.jsonl"), jobs=self.jobs, progress=self.progress)

    def subjects(self) -> list[Subject]:
        """The parts that are taken."""
        every = [one for source in self.sources for one in subjects(source)]
        return [one for one in every if self.choose is None or self.choose(one)]


def run_suite(name: str, suite: Suite) -> tuple[list[Row], str]:
    """Run a suite, keeping its rows and figures in its folder.

    Args:
        name: One of `SUITES`.
        suite: What it is run on.

    Returns:
        The rows, and the report in Markdown.

    Raises:
        KeyError: There is no such suite.
    """
    return SUITES[name](suite)


def _short(suite: Suite) -> tuple[list[Row], str]:
    seeds = suite.seeds or (1,)
    todo = [
        case
        for source in suite.sources
        for case in [*table_cases(source, seeds, suite.choose), *_promises(source, seeds, suite)]
    ]
    rows = suite.rows(todo)
    rows += _special(suite)
    shown = [row for row in rows if row["scenario"] == SPHERE.label and row["method"] in _SHOWN]
    save_figures(shown, suite.out)
    parts = [
        _what(suite, seeds),
        "## Promises",
        checks_table(check_pose(rows)),
        "## The paper's tables",
        paper_tables(rows),
        "![Recall](recall.png)",
        "![Point errors](points.png)",
        "## By scenario",
        report([row for row in rows if row["method"] == "default" and row["scenario"] in _PROMISED]),
    ]
    return rows, "\n\n".join(parts)


def _pose(suite: Suite) -> tuple[list[Row], str]:
    seeds = suite.seeds or (1, 2, 3)
    rows = suite.rows([case for source in suite.sources for case in _promises(source, seeds, suite)])
    rows += _special(suite)
    scans = _scans(rows)
    save_figures([row for row in scans if row["scenario"] == SPHERE.label], suite.out)
    return rows, "\n\n".join([_what(suite, seeds), checks_table(check_pose(rows)), report(scans)])


def _exact(suite: Suite) -> tuple[list[Row], str]:
    seeds = suite.seeds or (1, 2, 3)
    repeats = suite.seeds or range(1, 11)
    rows = suite.rows(
        [case for source in suite.sources for case in exact_cases(source, seeds, repeats, suite.choose)]
    )
    taught = taught_rows(Store(suite.out / "taught.jsonl"), suite.subjects(), seeds, suite.progress)
    save_figures([row for row in rows if row["scenario"] == SPHERE.label], suite.out)
    text = [
        _what(suite, seeds),
        f"The order is left open unless said. Yaw: over {len(repeats)} scans of each part.",
        "## Promises",
        checks_table(check_exact(rows + taught)),
        "## Covariance",
        covariance_table(rows),
        "## By scenario",
        report(rows),
    ]
    return rows + taught, "\n\n".join(text)


SUITES = {"short": _short, "pose": _pose, "exact": _exact}
"""Name of a suite, and what runs it."""


def _what(suite: Suite, seeds: Sequence[int]) -> str:
    sources = [Path(source).name for source in suite.sources]
    return f"Seeds {', '.join(map(str, seeds))}; {len(suite.subjects())} parts ({', '.join(sources)})."


def _scans(rows: Sequence[Row]) -> list[Row]:
    """Without what is no scan with a method."""
    return [row for row in rows if row["method"] not in ("invariance", "performance")]


def _promises(source: str, seeds: Sequence[int], suite: Suite) -> list[Case]:
    return [
        *cases(source, [SPHERE], seeds, _SPHERE_METHODS, choose=suite.choose),
        *cases(source, [ONE_VIEW, TABLE, ALONE], seeds, ("default",), choose=suite.choose),
    ]


def _merged(todo: Sequence[Case]) -> list[Case]:
    """One case for each scan, so that no scan is made twice."""
    merged: dict[tuple[object, ...], Case] = {}
    for case in todo:
        key = (case.source, case.part, case.scenario, case.seed)
        known = merged[key].methods if key in merged else ()
        names = tuple(dict.fromkeys([*known, *case.methods]))
        merged[key] = Case(case.source, case.place, case.part, case.scenario, case.seed, names)
    return list(merged.values())


def _special(suite: Suite) -> list[Row]:
    """What is no scan with a method: invariance of the pose, time and memory."""
    store, chosen = Store(suite.out / "special.jsonl"), suite.subjects()
    keys = [f"{one.source} | {one.part.name} | {SPHERE.label} | 1 | invariance" for one in chosen]
    for done, (subject, key) in enumerate(zip(chosen, keys, strict=True), 1):
        if not store.has(key):
            store.add(measure_invariance(subject, SPHERE, 1))
        if suite.progress is not None:
            suite.progress(done, len(chosen) + 1, key)
    if "performance" not in store.rows:
        store.add(measure_performance())
    if suite.progress is not None:
        suite.progress(len(chosen) + 1, len(chosen) + 1, "performance")
    return [store.rows[key] for key in (*keys, "performance")]
