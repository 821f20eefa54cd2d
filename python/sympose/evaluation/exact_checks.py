"""The promises of the suite `exact`, and whether they are kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sympose.evaluation.check import (
    Check,
    check_mean,
    check_near,
    check_share,
    check_worst,
    pick,
    worst_first,
)
from sympose.evaluation.exact import EDGE, FIVE_SIGMA, MORE_VIEWS, STRESSED, THREE_SIGMA
from sympose.evaluation.measure import Row
from sympose.evaluation.pose_checks import ONE_VIEW, SPHERE
from sympose.evaluation.summary import figure, grouped, statistics

__all__ = ["check_exact", "yaw_spread_deg"]

_OPEN = "order_unknown"
_ADDS = {1: 0.015, 2: 0.007, 3: 0.006, 5: 0.005, 8: 0.004}


def check_exact(rows: Sequence[Row]) -> list[Check]:
    """Every promise for which there are rows; the parts of each source are judged apart."""
    found: list[Check] = []
    for (source,), mine in grouped(rows, "source").items():
        found += [
            *_orders(mine, source),
            *_noise(mine, source),
            *_views(mine, source),
            *_stress(mine, source),
            *_frame(mine, source),
        ]
    return [check for check in found if check.passed is not None]


def yaw_spread_deg(rows: Sequence[Row]) -> float:
    """Standard deviation [deg] of the yaw of scans of one part, modulo its period; infinite below two."""
    yaws = [row["yaw_deg"] for row in rows if row.get("yaw_deg") is not None]
    if len(yaws) < 2:
        return float("inf")
    turns = np.exp(np.radians(yaws) * 1j * rows[0]["order"])
    around = np.angle(turns * np.conj(turns.mean()))
    return float(np.degrees(np.sqrt((around**2).mean())) / rows[0]["order"])


def _right_order(row: Row) -> bool:
    return bool(row.get("order_right", False))


def _orders(rows: Sequence[Row], source: str) -> list[Check]:
    own = source == "own"
    five, one = pick(rows, SPHERE, _OPEN), pick(rows, ONE_VIEW, _OPEN)
    known = pick(rows, ONE_VIEW, "default")
    scenario = f"5 views, order unknown, {source}"
    single = f"1 view, order unknown, {source}"
    checks = [
        check_share(five, scenario, "order right", _right_order, 1.0 if own else 0.95),
        check_mean(five, scenario, "axis_deg", 0.006, "deg", may_refuse=True),
        check_mean(five, scenario, "offset", 0.00007, may_refuse=True),
        check_near(known, f"1 view, order known, {source}", 0.99),
        _median(known, f"1 view, order known, {source}", "axis_deg", 0.015, "deg"),
        check_near(one, single, 0.96),
        _median(one, single, "axis_deg", 0.015, "deg"),
        check_share(one, single, "order right", _right_order, 0.85),
        check_share(
            pick(rows, EDGE, _OPEN), f"edge, 1 view, {source}", "right, refused, or score < 0.5", _honest, 1.0
        ),
    ]
    for name, scene in (("5 views", SPHERE), ("1 view", ONE_VIEW)):
        for order, seen, prefix in (("known", "default", ""), ("unknown", _OPEN, "order_unknown_")):
            for lost, suffix in (("", ""), (", points shuffled", "_shuffled")):
                checks.append(
                    _ratio(
                        pick(rows, scene, f"{prefix}no_viewpoints{suffix}"),
                        pick(rows, scene, seen),
                        f"no viewpoints{lost}, {name}, order {order}, {source}",
                        "axis over that with viewpoints",
                        1.5,
                    )
                )
    return checks


def _honest(row: Row) -> bool:
    """Right, refused, or marked as not to be trusted."""
    if row["outcome"] != "ok":
        return bool(row["outcome"] == "refused")
    return (row["axis_deg"] <= 1.0 and _right_order(row)) or row["score"] < 0.5


def _noise(rows: Sequence[Row], source: str) -> list[Check]:
    five = pick(rows, FIVE_SIGMA, _OPEN)
    noisy = f"5 views, 5 sigma, {source}"
    checks = [
        check_mean(five, noisy, "axis_deg", 0.08, "deg"),
        check_worst(five, noisy, "axis_deg", 1.0, "deg"),
        _median(pick(rows, SPHERE, _OPEN), f"5 views, {source}", "axis_over_bound", 3.0),
    ]
    for scene, limit in ((SPHERE, 1.0), (FIVE_SIGMA, 0.75)):
        icp = pick(rows, scene, "cad_icp")
        title = f"5 views, {scene.sigma:g} sigma, {source}"
        checks.append(
            _ratio(pick(rows, scene, _OPEN), icp, title, "axis over that of ICP with the CAD model", limit)
        )
    for scene, limit in ((SPHERE, 0.4), (THREE_SIGMA, 0.65)):
        checks.append(_joint(pick(rows, scene, _OPEN), f"5 views, {scene.sigma:g} sigma, {source}", limit))
    return checks


def _views(rows: Sequence[Row], source: str) -> list[Check]:
    checks = []
    for scene in sorted((ONE_VIEW, SPHERE, *MORE_VIEWS), key=lambda one: one.views):
        mine, title = pick(rows, scene, _OPEN), f"views: {scene.views}, {source}"
        checks.append(check_mean(mine, title, "adds_aligned", _ADDS[scene.views], may_refuse=True))
    return checks


def _stress(rows: Sequence[Row], source: str) -> list[Check]:
    def scans(name: str) -> list[Row]:
        return pick(rows, STRESSED[name], _OPEN)

    checks = [
        check_mean(scans("outliers"), f"30 % outliers, {source}", "axis_deg", 0.05, "deg"),
        check_worst(scans("wedge"), f"wedge of 90 deg, {source}", "axis_deg", 0.3, "deg"),
    ]
    for name in ("low_resolution", "flying_pixels", "falloff", "dropout"):
        title = f"{name.replace('_', ' ')}, {source}"
        checks += [
            check_mean(scans(name), title, "axis_deg", 0.05, "deg"),
            check_near(scans(name), title, 1.0),
        ]
    hubs = scans("warp")
    title = f"wheel hubs, warp of 0.5 %, {source}"
    nearer = [row for row in hubs if "refined_error" in row]
    return [
        *checks,
        check_worst(hubs, title, "axis_deg", 0.5, "deg"),
        check_share(
            nearer,
            title,
            "refined nearer to the surface than raw",
            lambda row: row["refined_error"] < row["raw_error"],
            1.0,
        ),
    ]


def _frame(rows: Sequence[Row], source: str) -> list[Check]:
    parts = grouped((row for row in pick(rows, SPHERE, _OPEN) if _right_order(row)), "part")
    spreads = {part: yaw_spread_deg(mine) for (part,), mine in parts.items() if len(mine) > 1}
    worst = max(spreads.values(), default=0.0)
    taught = [row for row in rows if row["method"] == "taught"]
    return [
        Check(
            f"5 views, {source}",
            f"standard deviation of the yaw, worst of {len(spreads)} parts",
            "every <= 0.15 deg",
            f"{figure(worst)} (median {figure(float(np.median(list(spreads.values()) or [0.0])))})",
            worst <= 0.15 if spreads else None,
            worst_first(spreads, lambda spread: spread > 0.15, "{:.3g}"),
        ),
        check_mean(taught, f"taught from 5 views, found in 5 others, {source}", "taught_mssd", 0.001),
    ]


def _median(rows: Sequence[Row], scenario: str, column: str, limit: float, unit: str = "") -> Check:
    s = statistics(rows, column)
    return Check(
        scenario,
        f"{column}, median of {s.count}",
        f"<= {limit:g} {unit}".strip(),
        f"{figure(s.median)} (mean {figure(s.mean)})",
        s.median <= limit if s.count else None,
    )


def _ratio(ours: Sequence[Row], theirs: Sequence[Row], scenario: str, what: str, limit: float) -> Check:
    """Mean angle of the axis over that of another method, on the scans that both answer."""
    angle, other = _angles(ours), _angles(theirs)
    pairs = [(angle[scan], other[scan]) for scan in angle if scan in other]
    mine, its = np.array(pairs).reshape(-1, 2).T
    ratio = float(mine.mean() / its.mean()) if pairs else float("nan")
    return Check(
        scenario,
        f"{what}, {len(pairs)} of {len(ours)} scans",
        f"<= {limit:g}",
        f"{figure(ratio)} (medians {figure(float(np.median(mine / its)))})" if pairs else "-",
        ratio <= limit if pairs else None,
    )


def _angles(rows: Sequence[Row]) -> dict[tuple[str, int], float]:
    return {(row["part"], row["seed"]): row["axis_deg"] for row in rows if "axis_deg" in row}


def _joint(rows: Sequence[Row], scenario: str, limit: float) -> Check:
    ratios = {row["key"]: row["refined_error"] / row["raw_error"] for row in rows if "refined_error" in row}
    mean = float(np.mean(list(ratios.values()))) if ratios else float("nan")
    return Check(
        scenario,
        f"refined over raw distance to the surface, mean of {len(ratios)}",
        f"<= {limit:g}",
        f"{figure(mean)} (worst {figure(max(ratios.values(), default=0.0))})",
        mean <= limit if ratios else None,
        worst_first(ratios, lambda ratio: ratio > limit, "{:.2f}"),
    )
