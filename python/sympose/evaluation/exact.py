"""What the suite `exact` measures: mostly with the order left open, and scans of every kind of trouble."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sympose.evaluation.covariance import is_inside
from sympose.evaluation.measure import Row
from sympose.evaluation.pose_checks import ONE_VIEW, SPHERE
from sympose.evaluation.runner import Case, Store, cases
from sympose.evaluation.scenario import STRESS, Scenario, Subject
from sympose.evaluation.summary import figure, grouped, markdown_table, share
from sympose.evaluation.taught import measure_taught, taught_key

__all__ = [
    "EDGE",
    "FIVE_SIGMA",
    "MORE_VIEWS",
    "STRESSED",
    "THREE_SIGMA",
    "covariance_table",
    "exact_cases",
    "taught_rows",
]

THREE_SIGMA = Scenario("sphere", 5, 3.0)
FIVE_SIGMA = Scenario("sphere", 5, 5.0)
MORE_VIEWS = tuple(Scenario("sphere", views) for views in (2, 3, 8))
EDGE = Scenario("edge", 1)
STRESSED = {name: Scenario("sphere", 5, **options) for name, options in STRESS.items()}

Choose = Callable[[Subject], bool]


def exact_cases(
    source: str, seeds: Sequence[int], repeats: Sequence[int], choose: Choose | None = None
) -> list[Case]:
    """What has to be run.

    Args:
        source: As for `cases`.
        seeds: Of all scenarios.
        repeats: Of the scans over which the yaw must repeat.
        choose: Whether to take a part.
    """
    open_order = ("order_unknown",)
    unseen = ("no_viewpoints", "no_viewpoints_shuffled")
    both = ("order_unknown", "default", *unseen, *(f"order_unknown_{name}" for name in unseen))
    others = [one for name, one in STRESSED.items() if name != "warp"]

    def is_hub(subject: Subject) -> bool:
        return subject.part.family == "wheel_hub" and (choose is None or choose(subject))

    return [
        *cases(source, [SPHERE, ONE_VIEW], seeds, both, choose=choose),
        *cases(source, [SPHERE, FIVE_SIGMA], seeds, ("cad_icp",), choose=choose),
        *cases(source, [THREE_SIGMA, FIVE_SIGMA, *MORE_VIEWS, EDGE], seeds, open_order, choose=choose),
        *cases(source, others, seeds, open_order, choose=choose),
        *cases(source, [SPHERE], repeats, open_order, choose=choose),
        *cases(source, [STRESSED["warp"]], seeds, open_order, choose=is_hub),
    ]


def taught_rows(
    store: Store,
    chosen: Sequence[Subject],
    seeds: Sequence[int],
    progress: Callable[[int, int, str], object] | None,
) -> list[Row]:
    """A row for each part and seed: taught from one scan, found in the next."""
    pairs = [(subject, seed) for subject in chosen for seed in seeds]
    keys = [taught_key(subject, SPHERE, seed) for subject, seed in pairs]
    for done, ((subject, seed), key) in enumerate(zip(pairs, keys, strict=True), 1):
        if not store.has(key):
            store.add(measure_taught(subject, SPHERE, seed))
        if progress is not None:
            progress(done, len(pairs), key)
    return [store.rows[key] for key in keys]


def covariance_table(rows: Sequence[Row]) -> str:
    """By class: share of the true axes inside the 95 % region, and errors over stated standard deviations.

    The root mean square of error over stated, scan by scan, is 1 where the uncertainty is right. One scan
    with a large stated deviation, maybe rightly so, does not hide the others in it, as it does in a mean.

    Only of answers within 1 deg to scans with no other trouble than noise and views off their places: the
    covariance is that of a solution, not of a wrong one.
    """
    misplaced = STRESSED["misplaced_views"]
    noisy = {one.label for one in (SPHERE, ONE_VIEW, THREE_SIGMA, FIVE_SIGMA, *MORE_VIEWS, misplaced)}
    known = [
        row
        for row in rows
        if row["scenario"] in noisy and row["method"] == "order_unknown"
        if "axis_chi_sq" in row and row["axis_deg"] <= 1.0
    ]
    head = ["scenario, class", "scans", "inside 95 %"]
    head += ["axis, error over stated", "stated [deg]", "empirical"]
    head += ["shift, error over stated", "stated [diameters]", "empirical"]
    body = []
    for (source, scenario, family), mine in grouped(known, "source", "scenario", "family").items():
        inside = share(mine, is_inside)
        spread: list[str] = []
        for stated, error in (("stated_deg", "axis_deg"), ("stated_shift", "shift")):
            over = [row[error] / row[stated] for row in mine]
            spread.append(f"{_root_mean_square(over):.2f}")
            spread += [figure(_root_mean_square([row[column] for row in mine])) for column in (stated, error)]
        body.append([f"{scenario}, {source}, {family}", len(mine), f"{100 * inside:.0f} %", *spread])
    return markdown_table(head, body)


def _root_mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
