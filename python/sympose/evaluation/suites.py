"""Ready-made runs: `short` for the report that is kept in the repository, `issue2` for all promises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from sympose.evaluation.checks import ALONE, ONE_VIEW, SPHERE, TABLE, check_all, checks_table
from sympose.evaluation.invariance import measure_invariance
from sympose.evaluation.measure import Row
from sympose.evaluation.performance import measure_performance
from sympose.evaluation.plots import save_figures
from sympose.evaluation.runner import Case, Store, cases, run
from sympose.evaluation.scenario import subjects
from sympose.evaluation.summary import report
from sympose.evaluation.tables import paper_tables, table_cases

__all__ = ["SUITES", "run_suite"]

Progress = Callable[[int, int, str], object]

_SPHERE_METHODS = ("default", "no_viewpoints", "paper", "paper_no_joint")


def run_suite(
    name: str,
    out: Path,
    *,
    sources: Sequence[str] = ("own",),
    seeds: Sequence[int] | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[list[Row], str]:
    """Run a suite, keeping its rows and figures in `out`.

    Args:
        name: One of `SUITES`.
        out: Folder; a run that was interrupted goes on.
        sources: "own" or folders of meshes.
        seeds: Those of the suite where they are not given.
        jobs: Processes.
        progress: As for `run`.

    Returns:
        The rows, and the report in Markdown.

    Raises:
        KeyError: There is no such suite.
    """
    return SUITES[name](out, sources, seeds, jobs, progress)


def _short(
    out: Path, sources: Sequence[str], seeds: Sequence[int] | None, jobs: int, progress: Progress | None
) -> tuple[list[Row], str]:
    del sources  # the repository has no other parts than its own
    chosen = seeds or (1,)
    todo = table_cases("own", chosen) + _promises("own", chosen)
    rows = run(_merged(todo), Store(out / "rows.jsonl"), jobs=jobs, progress=progress)
    rows += _special(Store(out / "special.jsonl"), ("own",), progress)
    save_figures([row for row in rows if row["scenario"] == SPHERE.label and row["method"] in _SHOWN], out)
    parts = [
        f"Seeds {', '.join(map(str, chosen))}; 14 procedural parts.",
        "## Promises",
        checks_table(check_all(rows)),
        "## The paper's tables",
        paper_tables(rows),
        "![Recall](recall.png)",
        "![Point errors](points.png)",
        "## By scenario",
        report([row for row in rows if "source" in row and row["method"] != "invariance"]),
    ]
    return rows, "\n\n".join(parts)


def _issue2(
    out: Path, sources: Sequence[str], seeds: Sequence[int] | None, jobs: int, progress: Progress | None
) -> tuple[list[Row], str]:
    chosen = seeds or (1, 2, 3)
    todo = [case for source in sources for case in _promises(source, chosen)]
    rows = run(todo, Store(out / "rows.jsonl"), jobs=jobs, progress=progress)
    rows += _special(Store(out / "special.jsonl"), sources, progress)
    save_figures(
        [row for row in rows if row["scenario"] == SPHERE.label and row["method"] != "invariance"], out
    )
    text = [
        f"Seeds {', '.join(map(str, chosen))}; parts: {', '.join(sources)}.",
        checks_table(check_all(rows)),
        report([row for row in rows if "source" in row and row["method"] != "invariance"]),
    ]
    return rows, "\n\n".join(text)


SUITES = {"short": _short, "issue2": _issue2}
"""Name of a suite, and what runs it."""

_SHOWN = ("default", "paper", "cad_icp", "cad_icp_far", "pca")


def _promises(source: str, seeds: Sequence[int]) -> list[Case]:
    return [
        *cases(source, [SPHERE], seeds, _SPHERE_METHODS),
        *cases(source, [ONE_VIEW, TABLE, ALONE], seeds, ("default",)),
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


def _special(store: Store, sources: Sequence[str], progress: Progress | None) -> list[Row]:
    """What is no scan with a method: invariance of the pose, time and memory."""
    chosen = [subject for source in sources for subject in subjects(source)]
    keys = [f"{one.source} | {one.part.name} | {SPHERE.label} | 1 | invariance" for one in chosen]
    for done, (subject, key) in enumerate(zip(chosen, keys, strict=True), 1):
        if key not in store.rows:
            store.add(measure_invariance(subject, SPHERE, 1))
        if progress is not None:
            progress(done, len(chosen) + 1, key)
    if "performance" not in store.rows:
        store.add(measure_performance())
    if progress is not None:
        progress(len(chosen) + 1, len(chosen) + 1, "performance")
    return [store.rows[key] for key in (*keys, "performance")]
