"""From the flights of a study to its tables."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from quadid_logs.arrays import BoolArray
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import AXES

#: In the order of the tables.
KINDS: Final = (
    "on-axis effectiveness",
    "off-axis effectiveness",
    "on-axis damping",
    "off-axis damping",
    "gyroscopic",
    "product of inertia",
    "lag",
    "delay",
)
#: What the flights differ in, cut into groups for the tables and plots: column, limits.
GROUPS: Final[Mapping[str, tuple[float, ...]]] = {
    "manoeuvre": (),
    "autopilot": (),
    "structure": (),
    "verdict": (),
    "wind_m_s": (-1.0, 0.0, 2.0, 4.0, 6.0),
    "lag_s": (0.0, 0.02, 0.04, 0.1),
    "rate_hz": (0.0, 110.0, 130.0, 210.0, 260.0, 410.0),
    "gyro_noise_rad_s_per_rthz": (0.0, 6e-5, 1.5e-4, 1.0),
    "duration_s": (0.0, 40.0, 50.0, 60.0),
    "gyro_filter_hz": (0.0, 35.0, 55.0, 100.0),
    "amplitude": (0.0, 0.6, 0.9, 2.0),
    "drag_height_m": (-1.0, 0.01, 0.025, 1.0),
    "lag_ratio": (0.0, 1.05, 2.0),
    "mixer_limited": (-1.0, 0.001, 0.05, 1.0),
    "askew_deg": (-1.0, 0.01, 90.0),
    "drop_fraction": (-1.0, 0.0, 0.02),
    "disturbance_rad_s2": (-1.0, 0.0, 1.3, 2.0),
}
#: An interval promises this fraction, and a study of many hundred values may miss it by so much.
PROMISE: Final = (0.93, 0.97)
#: A gain is wrong where the truth lies outside this many half-widths and this fraction of the truth: beyond
#: what an interval of 95 % may miss, and beyond what matters to anyone.
WRONG_HALF_WIDTHS: Final = 2.0
WRONG_FRACTION: Final = 0.03
#: At most this fraction of all axes may be usable and wrong.
MOST_WRONG: Final = 0.005


def read_flights(path: Path) -> list[dict[str, Any]]:
    """Return the flights in the order of their numbers."""
    flights = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return sorted(flights, key=lambda flight: flight["number"])


def parameters_of(flights: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row per parameter of every flight, with the flight's settings beside it.

    Columns beyond those of `measure`: ``verdict`` of the parameter's axis,
    ``claimed`` (identifiable, and the axis not refused), ``inside`` (the
    interval holds the truth), ``z`` (error in standard deviations as the
    interval states them), ``error`` and ``half_width`` relative to ``scale``,
    ``wrong`` (the truth lies far outside the interval, and the error matters).
    """
    rows = []
    for flight in flights:
        settings = {key: value for key, value in flight.items() if not isinstance(value, dict | list)}
        for parameter in flight["parameters"]:
            verdict = _verdict(flight["verdicts"], parameter["axis"])
            rows.append({**settings, **parameter, "verdict": verdict})
    table = pd.DataFrame(rows)
    table["claimed"] = table["identifiable"] & (table["verdict"] != "refused")
    table["inside"] = (table["low"] <= table["truth"]) & (table["truth"] <= table["high"])
    error = table["value"] - table["truth"]
    # An interval need not be symmetric: the half that points to the truth counts.
    side = np.where(error > 0.0, table["value"] - table["low"], table["high"] - table["value"])
    with np.errstate(divide="ignore", invalid="ignore"):
        table["z"] = np.where(error == 0.0, 0.0, error / side * NORMAL_95)
        table["error"] = error / table["scale"]
        table["half_width"] = 0.5 * (table["high"] - table["low"]) / table["scale"]
    far = table["z"].abs() > WRONG_HALF_WIDTHS * NORMAL_95
    table["wrong"] = far & (table["error"].abs() > WRONG_FRACTION)
    return table


def _verdict(verdicts: Mapping[str, str], axis: str) -> str:
    """Return the verdict of the axis of p, q or r; of the best axis for what is common to all."""
    if axis:
        return verdicts[AXES["pqr".index(axis)]]
    return min(verdicts.values(), key=("usable", "caution", "refused").index)


def binomial_interval(successes: int, n: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a fraction (Clopper and Pearson, 1934)."""
    from scipy.stats import binomtest

    interval = binomtest(successes, n).proportion_ci(0.95, method="exact")
    return float(interval.low), float(interval.high)


def flights_interval(inside: BoolArray, flight: Any) -> tuple[float, float]:
    """Return the 95 % interval of a fraction whose values come several from each flight.

    Values of one flight have its disturbances and its gyro in common: they count as
    many values as the variance between flights says, not more than there are.
    """
    frame = (
        pd.DataFrame({"inside": inside, "flight": flight}).groupby("flight")["inside"].agg(["sum", "size"])
    )
    n, fraction = int(frame["size"].sum()), float(frame["sum"].sum() / frame["size"].sum())
    deviation = frame["sum"] - fraction * frame["size"]
    n_flights = len(frame)
    variance = float((deviation**2).sum()) / n**2 * n_flights / max(n_flights - 1, 1)
    independent = fraction * (1.0 - fraction) / n
    effective = max(1, round(n * min(1.0, independent / variance))) if variance > 0.0 else n_flights
    return binomial_interval(round(fraction * effective), effective)


def coverage_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per kind: how many are claimed, how many of them hold the truth, how wide."""
    rows = []
    for kind in KINDS:
        of_kind = table[table["kind"] == kind]
        claimed = of_kind[of_kind["claimed"]]
        if claimed.empty:
            continue
        inside = claimed["inside"].to_numpy()
        low, high = flights_interval(inside, claimed["number"])
        rows.append(
            {
                "kind": kind,
                "claimed": len(claimed),
                "of": len(of_kind),
                "coverage": float(inside.mean()),
                "low": low,
                "high": high,
                "z_median": float(claimed["z"].median()),
                "z_spread": float((claimed["z"].quantile(0.75) - claimed["z"].quantile(0.25)) / 1.349),
                "within_10": float((claimed["error"].abs() <= 0.1).mean()),
                "median_error": float(claimed["error"].abs().median()),
                "median_half_width": float(claimed["half_width"].median()),
            }
        )
    return pd.DataFrame(rows)


def verdict_table(flights: list[dict[str, Any]], table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per structural effect: what the axes of its flights were called, and how many wrongly.

    Columns ``usable``, ``caution``, ``refused`` and ``wrong`` (usable, but wrong) count axes.
    """
    gains = table[(table["kind"] == "on-axis effectiveness") & (table["verdict"] == "usable")]
    wrong = gains[gains["wrong"]].groupby("number").size()
    worst = gains["error"].abs().groupby(gains["number"]).max()
    rows = []
    for name, numbers in _by_effect(flights).items():
        verdicts = [v for one in flights if one["number"] in numbers for v in one["verdicts"].values()]
        rows.append(
            {
                "effect": name,
                "flights": len(numbers),
                "axes": len(verdicts),
                **{verdict: verdicts.count(verdict) for verdict in ("usable", "caution", "refused")},
                "wrong": int(wrong.reindex(sorted(numbers)).sum()),
                "worst": float(worst.reindex(sorted(numbers)).max()),
            }
        )
    return pd.DataFrame(rows)


def _by_effect(flights: list[dict[str, Any]]) -> dict[str, set[int]]:
    """Return the numbers of the flights with each structural effect; a flight with two counts for both."""
    groups: dict[str, set[int]] = {"none, calm air": set(), "none, air as rough as flown": set()}
    for flight in flights:
        rough = flight["disturbance_rad_s2"] > 0.0
        names = flight["structural"].split(" + ") if flight["structural"] else [list(groups)[rough]]
        for name in names:
            groups.setdefault(name, set()).add(flight["number"])
    clean = set().union(*list(groups.values())[:2])
    everything = {flight["number"] for flight in flights}
    ordered = dict(list(groups.items())[:2]) | {name: groups[name] for name in sorted(list(groups)[2:])}
    ordered |= {"any structural effect": everything - clean, "all": everything}
    return {name: numbers for name, numbers in ordered.items() if numbers}


def grouped(table: pd.DataFrame, column: str) -> pd.Series[Any]:
    """Return the group that each row falls into, an ordered category, by the limits of `GROUPS`."""
    limits = GROUPS[column]
    if not limits:
        return table[column].astype("category")
    names = [f"up to {high:g}" if low < 0.0 else f"{low:g} to {high:g}" for low, high in pairwise(limits)]
    return pd.cut(table[column], limits, labels=names)


def group_table(table: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Return coverage of one kind by everything that the flights differ in."""
    claimed = table[table["claimed"] & (table["kind"] == kind)]
    rows = []
    for column in GROUPS:
        for name, part in claimed.groupby(grouped(claimed, column), observed=True):
            rows.append(
                {
                    "by": column,
                    "group": name,
                    "n": len(part),
                    "coverage": float(part["inside"].mean()),
                    "z_median": float(part["z"].median()),
                    "within_10": float((part["error"].abs() <= 0.1).mean()),
                    "half_width": float(part["half_width"].median()),
                }
            )
    return pd.DataFrame(rows)


def page(flights: list[dict[str, Any]], table: pd.DataFrame) -> str:
    """Return the tables as Markdown: verdicts of all, coverage of flights without structural effects."""
    clean = without_structural(table)
    flown = [flight for flight in flights if not flight["structural"]]
    lines = [*_flights_part(flights), *_verdict_part(verdict_table(flights, table))]
    lines += [f"### Coverage without structural effects ({len(flown)} flights)", ""]
    lines += [*_coverage_part(coverage_table(clean)), *_axes_part(flown, clean)]
    for kind in ("on-axis effectiveness", "on-axis damping", "lag"):
        lines += _group_part(kind, group_table(clean, kind))
    return "\n".join(lines) + "\n"


def without_structural(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of flights that have no structural effect; rough air is none."""
    return table[table["structural"] == ""]


def _flights_part(flights: list[dict[str, Any]]) -> list[str]:
    """Say how many flights there were, and what was recommended for them."""
    counts = pd.Series([flight["structure"] or "no model" for flight in flights]).value_counts()
    recommended = ", ".join(f"{name} {count}" for name, count in counts.items())
    seconds = np.median([flight["analysis_s"] for flight in flights])
    return [
        f"{len(flights)} flights, seed {flights[0]['seed']}. Recommended: {recommended}. "
        f"Median time of one analysis: {seconds:.1f} s.",
        "",
    ]


def _verdict_part(verdicts: pd.DataFrame) -> list[str]:
    """Verdicts by structural effect, and what was called usable and was wrong."""
    lines = [
        "### Usable and wrong, by structural effect",
        "",
        f"Wrong: the error of the effectiveness is above {WRONG_HALF_WIDTHS:g} half-widths of its interval "
        f"and above {100.0 * WRONG_FRACTION:g} % of its value. The target is at most {_percent(MOST_WRONG)} "
        "of all axes.",
        "",
        "| effect | flights | usable | caution | refused | usable and wrong | of all axes "
        "| 95 % interval of it | largest error of a usable effectiveness |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in verdicts.itertuples():
        low, high = binomial_interval(row.wrong, row.axes)
        verdict = " | ".join(_percent(count / row.axes) for count in (row.usable, row.caution, row.refused))
        lines.append(
            f"| {row.effect} | {row.flights} | {verdict} | {row.wrong} | {_percent(row.wrong / row.axes)} "
            f"| {_percent(low)} to {_percent(high)} "
            f"| {'' if np.isnan(row.worst) else _percent(row.worst)} |"
        )
    return [*lines, ""]


def _coverage_part(summary: pd.DataFrame) -> list[str]:
    """Coverage by kind of parameter."""
    lines = [
        "| kind | claimed | coverage | 95 % interval of it | on target | median z | spread of z "
        "| within 10 % | median error | median half-width |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    rows = [
        f"| {row.kind} | {row.claimed} of {row.of} | {_percent(row.coverage)} "
        f"| {_percent(row.low)} to {_percent(row.high)} | {_kept(row.coverage)} "
        f"| {row.z_median:+.2f} | {row.z_spread:.2f} | {_percent(row.within_10)} "
        f"| {_percent(row.median_error)} | {_percent(row.median_half_width)} |"
        for row in summary.itertuples()
    ]
    return [*lines, *rows, ""]


def _axes_part(flights: list[dict[str, Any]], table: pd.DataFrame) -> list[str]:
    """On-axis effectiveness by axis: verdicts, coverage, error."""
    lines = [
        "| axis | usable | caution | refused | coverage | within 10 % | largest error |",
        "|---|---|---|---|---|---|---|",
    ]
    for axis, letter in zip(AXES, "pqr", strict=True):
        verdicts = [flight["verdicts"][axis] for flight in flights]
        fractions = " | ".join(
            _percent(verdicts.count(verdict) / len(verdicts)) for verdict in ("usable", "caution", "refused")
        )
        on_axis = table[
            table["claimed"] & (table["kind"] == "on-axis effectiveness") & (table["axis"] == letter)
        ]
        lines.append(
            f"| {axis} | {fractions} | {_percent(on_axis['inside'].mean())} "
            f"| {_percent((on_axis['error'].abs() <= 0.1).mean())} "
            f"| {_percent(on_axis['error'].abs().max())} |"
        )
    return [*lines, ""]


def _group_part(kind: str, groups: pd.DataFrame) -> list[str]:
    """Coverage of one kind by what the flights differ in."""
    lines = [
        f"### {kind.capitalize()} by group",
        "",
        "| by | group | number | coverage | median z | within 10 % | median half-width |",
        "|---|---|---|---|---|---|---|",
    ]
    rows = [
        f"| {row.by} | {row.group} | {row.n} | {_percent(row.coverage)} | {row.z_median:+.2f} "
        f"| {_percent(row.within_10)} | {_percent(row.half_width)} |"
        for row in groups.itertuples()
    ]
    return [*lines, *rows, ""]


def _kept(coverage: float) -> str:
    """Return whether a coverage is on target, or on which side of it."""
    if coverage < PROMISE[0]:
        return "no, too low"
    return "no, too high" if coverage > PROMISE[1] else "yes"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.1f} %"
