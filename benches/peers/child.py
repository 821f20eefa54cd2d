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


def main() -> None:
    folder, threads, order = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    points, viewpoints = np.load(folder / "points.npy"), np.load(folder / "viewpoints.npy")
    for _ in sys.stdin:
        start = time.perf_counter()
        sympose.estimate(points, order=order, viewpoints=viewpoints, threads=threads)
        seconds = time.perf_counter() - start
        # Linux counts in kB, macOS in bytes.
        unit = 1 if sys.platform == "darwin" else 1024
        peak = unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        sys.stdout.write(json.dumps({"seconds": seconds, "peak": peak}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
