"""Time and memory of one estimate, and the size of the compiled module."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import sympose
from sympose import _core
from sympose.datasets import part, scan
from sympose.evaluation.measure import Row

__all__ = ["measure_performance"]

_PART, _VIEWS, _POINTS = "wheel_hub_5", 5, 150_000
_REPEATS = 7

# Runs on its own, so that the peak is that of the estimate alone. VmHWM is the peak resident size in kB.
_PEAK = """
import re, sys
import numpy as np, sympose
def peak():
    return int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024
before = peak()
data = np.load(sys.argv[1])
sympose.estimate(data["points"], order=int(sys.argv[2]), viewpoints=data["viewpoints"], threads=2)
print(peak() - before)
"""


def measure_performance() -> Row:
    """One row: median time [s] on two threads, peak memory above the interpreter [MB], sizes [MB].

    The time is taken by the clock and, since other work may share the machine, of the processors.
    """
    one = scan(part(_PART), "sphere", views=_VIEWS, seed=1)
    order = one.order
    points, viewpoints = one.scene.points[:_POINTS], one.scene.viewpoints
    assert viewpoints is not None
    viewpoints = viewpoints[:_POINTS]
    times, busy = [], []
    for _ in range(_REPEATS + 1):
        start, used = time.perf_counter(), time.process_time()
        sympose.estimate(points, order=order, viewpoints=viewpoints, threads=2)
        times.append(time.perf_counter() - start)
        busy.append(time.process_time() - used)
    library = Path(str(_core.__file__))
    content = library.read_bytes()
    return {
        "key": "performance",
        "method": "performance",
        "scenario": f"{_PART}, {len(points):,} points",
        "outcome": "ok",
        "seconds": statistics.median(times[1:]),  # the first warms the caches
        "cpu_seconds": statistics.median(busy[1:]),
        "memory_mb": _peak_mb(points, viewpoints, str(order)),
        "module": library.name,
        "module_mb": len(content) / 1e6,
        "module_compressed_mb": len(zlib.compress(content, 9)) / 1e6,
    }


def _peak_mb(points: NDArray[np.float64], viewpoints: NDArray[np.float64], order: str) -> float | None:
    """Peak of a process of its own; None where the system does not tell (it is read from /proc)."""
    if not Path("/proc/self/status").exists():
        return None
    with tempfile.TemporaryDirectory() as folder:
        cloud = Path(folder) / "cloud.npz"
        np.savez(cloud, points=points, viewpoints=viewpoints)
        command = [sys.executable, "-c", _PEAK, str(cloud), order]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(json.loads(done.stdout))
