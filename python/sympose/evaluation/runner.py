"""Runs cases: one row for each scan and method, kept in a file, so that an interrupted run goes on."""

from __future__ import annotations

import json
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

from sympose import _core
from sympose.errors import InvalidInputError
from sympose.evaluation.measure import Row, failed, key_of, measure
from sympose.evaluation.methods import applies, method
from sympose.evaluation.scenario import Scenario, Subject, subject_of, subjects

__all__ = ["Case", "Store", "cases", "run"]


@dataclass(frozen=True)
class Case:
    """A scan and the methods to run on it; small, since it travels to other processes.

    Attributes:
        source: "own" or a folder, as for `subjects`.
        place, part: Name of the source and of the part, as in the rows.
        scenario, seed: The scan.
        methods: Names of the columns.
    """

    source: str
    place: str
    part: str
    scenario: Scenario
    seed: int
    methods: tuple[str, ...]

    def row_keys(self) -> list[str]:
        """Names of the rows that it gives."""
        return [key_of(self.place, self.part, self.scenario.label, self.seed, name) for name in self.methods]


def cases(
    source: str,
    scenarios: Iterable[Scenario],
    seeds: Iterable[int],
    methods: Sequence[str],
    *,
    every: bool = False,
    choose: Callable[[Subject], bool] | None = None,
) -> list[Case]:
    """All combinations that make sense; the scans of one part lie together.

    Raises:
        InvalidInputError: There is no such method.
        FileNotFoundError: The folder has no manifest.
    """
    for name in methods:
        method(name)
    scenarios, seeds = list(scenarios), list(seeds)
    return [
        Case(source, one.source, one.part.name, scenario, seed, names)
        for one in subjects(source, every=every)
        if (names := tuple(name for name in methods if applies(name, one)))
        and (choose is None or choose(one))
        for scenario in scenarios
        for seed in seeds
    ]


class Store:
    """Rows in a file of JSON lines; what an interrupted run left half written is dropped.

    Beside it stands a file that names the build and the parts that were measured, since figures of two builds
    or of two folders must not mix.

    Args:
        path: Made when it is missing.

    Raises:
        InvalidInputError: The file is of another build, or a line but the last is no row.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, Row] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        stamp, build = path.with_suffix(".build"), _build()
        if not path.exists():
            stamp.write_text(build + "\n", encoding="utf-8")
            return
        known = stamp.read_text(encoding="utf-8").split("\n")[0] if stamp.exists() else "an unknown build"
        if known != build:
            raise InvalidInputError(
                f"{path} was measured with {known}, this is {build}: choose another folder"
            )
        whole = ""
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        for number, line in enumerate(lines, 1):
            try:
                row = json.loads(line)
                self.rows[row["key"]] = row
            except (json.JSONDecodeError, KeyError, TypeError) as error:
                if number < len(lines):
                    raise InvalidInputError(f"{path}: line {number} is no row of an evaluation") from error
                break
            whole += line if line.endswith("\n") else line + "\n"
        if whole != "".join(lines):
            path.write_text(whole, encoding="utf-8")

    def has(self, key: str) -> bool:
        """Whether the row is there; one that failed for another reason than the scan is worth another try."""
        return key in self.rows and self.rows[key].get("outcome") != "error"

    def claim(self, place: str, content: str) -> None:
        """Say which parts the rows of a source are of, since those of two folders of one name must not mix.

        Raises:
            InvalidInputError: Rows of other parts are here under that name.
        """
        stamp = self.path.with_suffix(".build")
        build, *claims = stamp.read_text(encoding="utf-8").splitlines()
        known = dict(claim.rsplit(" ", 1) for claim in claims)
        if known.setdefault(place, content) != content:
            raise InvalidInputError(
                f"{self.path} has rows of other parts of a folder {place!r}: rename one of the folders, or "
                "choose another folder for the results"
            )
        lines = [build, *(f"{name} {of}" for name, of in known.items())]
        stamp.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def add(self, row: Row) -> None:
        """Keep a row; it is on disk when this returns."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        self.rows[row["key"]] = row


def run(
    todo: Sequence[Case],
    store: Store,
    *,
    jobs: int = 1,
    progress: Callable[[int, int, str], object] | None = None,
) -> list[Row]:
    """Measure what `store` does not have yet.

    Args:
        todo: The cases.
        store: Where rows are kept.
        jobs: Processes; with 1 all is done in this one.
        progress: Called with the rows done, the rows in all and the name of the last.

    Returns:
        The rows of all cases in their order, whether measured now or before.

    Raises:
        InvalidInputError: `store` has rows of other parts of a folder of that name.
    """
    for source, place in dict.fromkeys((case.source, case.place) for case in todo):
        store.claim(place, _content(source))
    wanted = [key for case in todo for key in case.row_keys()]
    missing = [left for case in todo if (left := _left(case, store))]
    done = len(wanted) - sum(len(case.methods) for case in missing)
    if progress is not None:
        progress(done, len(wanted), "")
    for row in _in_this_process(missing) if jobs == 1 else _in_processes(missing, jobs):
        store.add(row)
        done += 1
        if progress is not None:
            progress(done, len(wanted), row["key"])
    return [store.rows[key] for key in dict.fromkeys(wanted)]


def _build() -> str:
    """The version, and a checksum of the compiled module."""
    return f"{_core.__version__} {crc32(Path(str(_core.__file__)).read_bytes()):08x}"


def _content(source: str) -> str:
    """A checksum of what a source says of its parts; those of this package belong to the build."""
    if source == "own":
        return source
    return f"{crc32((Path(source) / 'manifest.json').read_bytes()):08x}"


def _left(case: Case, store: Store) -> Case | None:
    names = tuple(name for name, key in zip(case.methods, case.row_keys(), strict=True) if not store.has(key))
    return replace(case, methods=names) if names else None


def _in_this_process(todo: Sequence[Case]) -> Iterator[Row]:
    for case in todo:
        yield from _rows(case)


def _in_processes(todo: Sequence[Case], jobs: int) -> Iterator[Row]:
    """Rows as they come. A process that dies takes the pool with it; the rest is then tried one by one."""
    left = dict(enumerate(todo))
    pool = _pool(jobs)
    try:
        futures: dict[Future[list[Row]], int] = {pool.submit(_all_rows, case): k for k, case in left.items()}
        for future in as_completed(futures):
            rows = future.result()
            del left[futures[future]]
            yield from rows
    except BrokenProcessPool:
        for case in left.values():
            for name in case.methods:
                single = replace(case, methods=(name,))
                try:
                    with _pool(1) as alone:
                        rows = alone.submit(_all_rows, single).result()
                except BrokenProcessPool as error:
                    rows = [failed(subject_of(case.source, case.part), case.scenario, case.seed, name, error)]
                yield from rows
    finally:
        pool.shutdown(cancel_futures=True)


def _pool(jobs: int) -> ProcessPoolExecutor:
    # Spawned, not forked: thread pools and ray tracers do not survive a fork. Ctrl-C reaches the children as
    # well: they end at once, without a traceback each, and the parent says so.
    spawn = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(
        jobs, mp_context=spawn, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_DFL)
    )


def _all_rows(case: Case) -> list[Row]:
    return list(_rows(case))


def _rows(case: Case) -> Iterator[Row]:
    subject = subject_of(case.source, case.part)
    try:
        scan = case.scenario.scan(subject.part, case.seed)
    except Exception as error:  # recorded for each method that now has nothing to work on
        for name in case.methods:
            yield failed(subject, case.scenario, case.seed, name, error)
        return
    for name in case.methods:
        yield measure(subject, case.scenario, scan, case.seed, name)
