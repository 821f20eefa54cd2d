"""Captured scenes: run each, compare the axis with what is known, draw it.

    python -m sympose.evaluation.real FOLDER --out out/real

FOLDER holds a `manifest.json` as `read_captures` expects it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import sympose
from sympose.errors import SymposeError
from sympose.evaluation.captures import Capture, read_captures
from sympose.evaluation.metrics import axis_angle_deg, axis_offset
from sympose.evaluation.pictures import draw_capture
from sympose.evaluation.summary import figure, markdown_table, write_json

__all__ = ["main", "run_capture"]

_HEAD = (
    "scene",
    "points given",
    "order told",
    "answer",
    "order",
    "axis [deg]",
    "offset / radius",
    "score",
    "explained",
    "points kept",
    "ground",
    "time [s]",
    "remarks",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 2 bad usage or input."""
    parser = argparse.ArgumentParser(
        prog="python -m sympose.evaluation.real", description=__doc__.splitlines()[0]
    )
    parser.add_argument("folder", help="captured scenes with a manifest.json")
    parser.add_argument("--out", default="out/real", help="folder of the results (default: out/real)")
    parser.add_argument("--only", default="", help="only scenes whose name holds this")
    options = parser.parse_args(argv)
    out = Path(options.out)
    rows: list[dict[str, Any]] = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        for capture in read_captures(options.folder):
            if options.only not in capture.name:
                continue
            for told in ("continuous", None):
                row, estimate = run_capture(capture, told)
                rows.append(row)
                sys.stderr.write(f"{row['name']}, {row['how']}, {row['told']}: {row['outcome']}\n")
                if told is not None:
                    draw_capture(capture, estimate, out / f"{_slug(capture)}.png", row["message"])
    except (SymposeError, OSError, ImportError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    text = captures_table(rows)
    (out / "report.md").write_text(text + "\n", encoding="utf-8")
    write_json(rows, out / "rows.json")
    sys.stdout.write(text + "\n")
    return 0


def run_capture(capture: Capture, told: str | None) -> tuple[dict[str, Any], Any]:
    """Estimate one captured object.

    Args:
        capture: The object.
        told: Order that is told: "continuous", or None to find it.

    Returns:
        A row of figures, and the estimate, None where there is none.
    """
    row: dict[str, Any] = {
        "name": capture.name,
        "how": capture.how,
        "told": told or "none",
        "symmetry": capture.order or "none",
        "points": len(capture.scene),
        "message": "",
    }
    start = time.perf_counter()
    try:
        estimate = sympose.estimate(capture.scene, order=told, roi=capture.roi)  # type: ignore[arg-type]
    except SymposeError as error:
        outcome = {"outcome": "refused", "message": f"{type(error).__name__}: {error}"}
        return {**row, **outcome, "seconds": time.perf_counter() - start}, None
    except Exception as error:  # a failure is a result, too
        outcome = {"outcome": "error", "message": f"{type(error).__name__}: {error}"}
        return {**row, **outcome, "seconds": time.perf_counter() - start}, None
    row |= {
        "outcome": "ok",
        "seconds": time.perf_counter() - start,
        "order": estimate.order,
        "score": float(estimate.score),
        "explained": float(estimate.explained),
        "kept": len(estimate.inliers),
        "ground": estimate.ground is not None,
        "message": "; ".join(estimate.warnings),
    }
    if capture.known is not None:
        axis, center = np.asarray(estimate.axis), np.asarray(estimate.center)
        row["axis_deg"] = axis_angle_deg(axis, capture.known.direction)
        row["offset_over_radius"] = axis_offset(capture.known.point, center, axis) / capture.known.radius
    return row, estimate


def captures_table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows in Markdown."""
    return markdown_table(
        _HEAD,
        (
            [
                row["name"],
                row["how"],
                row["told"],
                row["outcome"],
                row.get("order", "-"),
                figure(row.get("axis_deg")),
                figure(row.get("offset_over_radius")),
                figure(row.get("score")),
                figure(row.get("explained")),
                f"{row.get('kept', '-')} of {row['points']}",
                {True: "yes", False: "no"}.get(row.get("ground", ""), "-"),
                figure(row["seconds"]),
                row["message"].replace("\n", " ")[:160],
            ]
            for row in rows
        ),
    )


def _slug(capture: Capture) -> str:
    name = f"{capture.name} {capture.how}"
    return "".join(letter if letter.isalnum() else "_" for letter in name)


if __name__ == "__main__":
    sys.exit(main())
