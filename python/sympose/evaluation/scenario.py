"""What is measured: a scenario with its options, and the parts."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from sympose.datasets import Scan, load_mesh_folder, names, part, scan
from sympose.datasets.parts import Part
from sympose.datasets.view_poses import SCENARIOS
from sympose.errors import InvalidInputError

__all__ = ["SIGMA", "STRESS", "Scenario", "Subject", "subject_of", "subjects"]

SIGMA = 0.001  # standard deviation of the depth noise, as a share of the mean depth

STRESS: dict[str, dict[str, Any]] = {
    "outliers": {"outliers": 0.3},
    "wedge": {"wedge_deg": 90.0},
    "falloff": {"falloff": 3.0},
    "low_resolution": {"low_resolution": True},
    "flying_pixels": {"flying_pixels": 0.5},
    "dropout": {"dropout": 0.3},
    "warp": {"warp": 0.005},
    "misplaced_views": {"view_shift": 0.002, "view_turn_deg": 0.15},
}


@dataclass(frozen=True)
class Scenario:
    """How a part is scanned; the options are those of `sympose.datasets.scan`.

    Attributes:
        place: "sphere", "edge", "upper", "table" or "alone".
        views: Number of views.
        sigma: Depth noise in multiples of 0.001 of the mean depth.

    Example:
        >>> Scenario("upper", 3, outliers=0.3).label
        'upper views=3 sigma=1 outliers=0.3'
    """

    place: str = "sphere"
    views: int = 5
    sigma: float = 1.0
    clutter: int = 0
    low_resolution: bool = False
    flying_pixels: float = 0.0
    dropout: float = 0.0
    wedge_deg: float = 0.0
    falloff: float = 0.0
    warp: float = 0.0
    outliers: float = 0.0
    view_shift: float = 0.0
    view_turn_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.place not in SCENARIOS:
            raise InvalidInputError(f"scenario must be one of {', '.join(SCENARIOS)}, got {self.place!r}")
        for name, least in (("views", 1), ("sigma", 0), ("clutter", 0)):
            if not least <= getattr(self, name) < math.inf:
                raise InvalidInputError(f"{name} = {getattr(self, name)}: expected at least {least}")

    @property
    def label(self) -> str:
        """The scenario in words, with the options that are set."""
        options = [f"{f.name}={getattr(self, f.name):g}" for f in fields(self)[3:] if getattr(self, f.name)]
        return " ".join([self.place, f"views={self.views}", f"sigma={self.sigma:g}", *options])

    @property
    def segmented(self) -> bool:
        """Whether the views are handed over, so that the foreground is segmented first."""
        return self.place in ("table", "alone")

    def scan(self, part: Part, seed: int) -> Scan:
        """Scan `part`."""
        options = asdict(self)
        options["sigma"] *= SIGMA
        return scan(part, options.pop("place"), seed=seed, **options)


@dataclass(frozen=True, eq=False)
class Subject:
    """A part, and what counts as its order.

    Attributes:
        source: "own", or the name of the folder.
        part: The part.
        orders: Right answers; None among them where refusing is right.
    """

    source: str
    part: Part
    orders: tuple[int | str | None, ...]


@lru_cache(maxsize=4)
def subjects(source: str = "own", *, every: bool = False) -> tuple[Subject, ...]:
    """The parts of a source.

    Args:
        source: "own" for those of this package, or a folder of meshes with a manifest. Its
            `order_exact`, the order that holds at a closer look, is accepted as well.
        every: Also those that are continuous or without symmetry, not only those of a discrete order.

    Raises:
        FileNotFoundError: The folder has no manifest.
        InvalidInputError: The manifest is wrong.
    """
    if source == "own":
        found = [subject_of(source, name) for name in names(None if every else "cyclic")]
    else:
        parts = load_mesh_folder(source)
        entries = json.loads((Path(source) / "manifest.json").read_text(encoding="utf-8"))
        place = Path(source).resolve().name
        found = [Subject(place, one, _orders(one, entry)) for one, entry in zip(parts, entries, strict=True)]
    return tuple(one for one in found if every or isinstance(one.part.order, int))


def subject_of(source: str, name: str) -> Subject:
    """One part of a source, as in `subjects`.

    Raises:
        InvalidInputError: There is none of that name.
    """
    if source == "own":
        return Subject(source, part(name), (part(name).order,))
    for one in subjects(source, every=True):
        if one.part.name == name:
            return one
    raise InvalidInputError(f"there is no part {name!r} in {source}")


def _orders(part: Part, entry: dict[str, Any]) -> tuple[int | str | None, ...]:
    exact = entry.get("order_exact", entry["order"])
    if not isinstance(exact, int) or isinstance(exact, bool):
        raise InvalidInputError(f"order_exact of {part.name!r} must be a whole number, got {exact!r}")
    return tuple(dict.fromkeys([part.order, {0: "continuous", 1: None}.get(exact, exact)]))
