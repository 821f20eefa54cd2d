"""Time Sympose beside Open3D, SciPy, scikit-learn and small_gicp: same clouds, same two threads, one process.

    python benches/compare_peers.py [--only PART] [--out FOLDER] [--repeats N]

Every row times all libraries in turn, round by round, so that what else the machine does falls on all of them
alike, and takes medians; short calls are made twice and timed the second time, as in a loop. It also compares
what they return. A peer's own container is filled before the clock starts; Sympose is timed with its copy of
the array. A library that is not installed is left out, and the table says so. The status is 1 when results
disagree; a missed goal is only marked.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

THREADS = 2

# Before anything is imported that starts threads. Not every pool obeys a variable, but all obey the cores.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[_name] = str(THREADS)
# Threads of OpenMP that spin on after a call would slow whoever is timed next.
os.environ["OMP_WAIT_POLICY"], os.environ["KMP_BLOCKTIME"] = "passive", "0"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:THREADS])

from peers import growth, kernels, report, trees, whole  # noqa: E402
from peers.report import Row  # noqa: E402

PARTS: dict[str, Callable[[int], Iterator[Row]]] = {
    "voxel": kernels.voxel,
    "radius": kernels.radius,
    "statistical": kernels.statistical,
    "normals": kernels.normals,
    "plane": kernels.plane,
    "tree": trees.rows,
    "estimate": whole.estimate,
    "threads": growth.second_thread,
    "growth": growth.growth,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", choices=sorted(PARTS), nargs="+", help="these parts (default: all)")
    parser.add_argument("--repeats", type=int, default=7, help="rounds of each row (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="folder for compare_peers.json and compare_peers.md")
    options = parser.parse_args()

    rows: list[Row] = []
    sys.stdout.write(report.header() + "\n" + report.HEAD + "\n")
    for part in options.only or PARTS:
        for row in PARTS[part](options.repeats):
            rows.append(row)
            sys.stdout.write(report.line(row) + "\n")
            sys.stdout.flush()
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        report.write(rows, options.out)
    return 0 if all(row.agrees for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
