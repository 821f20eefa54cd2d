"""A process of its own for `growth.py`: one estimate for each line that comes in.

Arguments: a folder with points.npy and viewpoints.npy, threads, order.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

import sympose


def _peak() -> int:
    """Largest memory of this process so far [bytes]."""
    status = Path("/proc/self/status")
    if status.exists():
        # What getrusage says on Linux includes the process that started this one.
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return 1024 * int(line.split()[1])
    # macOS counts in bytes.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    folder, threads, order = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    points, viewpoints = np.load(folder / "points.npy"), np.load(folder / "viewpoints.npy")
    for _ in sys.stdin:
        start = time.perf_counter()
        sympose.estimate(points, order=order, viewpoints=viewpoints, threads=threads)
        seconds = time.perf_counter() - start
        sys.stdout.write(json.dumps({"seconds": seconds, "peak": _peak()}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
