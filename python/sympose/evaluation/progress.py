"""A progress bar on standard error; without a terminal, a line now and then."""

from __future__ import annotations

import sys
import time
from typing import TextIO

__all__ = ["ProgressBar"]

_WIDTH = 30
_EVERY = 0.05  # of the whole, between two lines of a log


class ProgressBar:
    """Called with the count done, the count in all and what was done last.

    Args:
        stream: Standard error where it is not given.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._start = time.monotonic()
        self._first: int | None = None
        self._shown = -1.0

    def __call__(self, done: int, total: int, name: str) -> None:
        """Show how far it is."""
        if self._first is None:
            self._first = done
        share = done / total if total else 1.0
        elapsed = time.monotonic() - self._start
        fresh = done - self._first
        left = (
            f"{_clock(elapsed * (total - done) / fresh)} left"
            if fresh
            else "resuming"
            if done
            else "starting"
        )
        if self._stream.isatty():
            bar = "#" * int(_WIDTH * share)
            end = "\n" if done == total else ""
            self._stream.write(f"\r\x1b[K[{bar:<{_WIDTH}}] {done}/{total} {left} {name[:60]}{end}")
        elif share - self._shown >= _EVERY or done == total:
            self._shown = share
            self._stream.write(f"{done}/{total} after {_clock(elapsed)}, {left} {name}\n")
        self._stream.flush()


def _clock(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
