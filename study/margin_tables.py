"""From the loops of a study to its table and its picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from quadid_logs.maths.normal import NORMAL_95
from study.summary import flights_interval

#: Of the intervals of phase and gain margin, this fraction holds the truth.
PROMISE: Final = (0.92, 0.98)
#: What is told of each figure: words, and unit of its errors.
WORDS: Final = {
    "phase_margin_deg": ("phase margin", "deg"),
    "gain_margin_db": ("gain margin", "dB"),
    "crossover_hz": ("crossover", "Hz"),
    "delay_margin_s": ("delay margin", "s"),
    "disk_margin": ("disk margin", ""),
}
_SHOWN: Final = ("phase_margin_deg", "gain_margin_db")
_GROUPS: Final = ("extrapolated", "axis", "loop", "autopilot", "rate_hz", "manoeuvre", "verdict")


def loops_of(flights: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row per figure of every loop, with the flight's settings beside it.

    Parameters
    ----------
    flights : iterable of mapping
        As of `study.margins.measure_loops`.

    Returns
    -------
    DataFrame
        With ``told`` (the analysis gives the figure, and the true loop has one), ``inside`` (its interval
        holds the truth), ``error``, ``half_width`` and ``z`` (the error in standard deviations as the
        interval states them).
    """
    rows = []
    for flight in flights:
        settings = {key: value for key, value in flight.items() if not isinstance(value, dict | list)}
        for loop in flight["loops"]:
            shared = {key: value for key, value in loop.items() if not isinstance(value, dict)}
            rows += [{**settings, **shared, "figure": name, **loop[name]} for name in WORDS]
    table = pd.DataFrame(rows)
    numbers = ["truth", "value", "low", "high"]
    table[numbers] = table[numbers].astype(np.float64)
    table["told"] = table["value"].notna() & table["truth"].notna()
    table["inside"] = (table["low"] <= table["truth"]) & (table["truth"] <= table["high"])
    table["error"] = table["value"] - table["truth"]
    side = np.where(table["error"] > 0.0, table["value"] - table["low"], table["high"] - table["value"])
    with np.errstate(divide="ignore", invalid="ignore"):
        table["z"] = np.where(table["error"] == 0.0, 0.0, table["error"] / side * NORMAL_95)
    table["half_width"] = 0.5 * (table["high"] - table["low"])
    return table


def margins_page(flights: list[dict[str, Any]], table: pd.DataFrame) -> str:
    """Return the tables as Markdown.

    Parameters
    ----------
    flights : list of dict
    table : DataFrame
        As of `loops_of`.

    Returns
    -------
    str
    """
    loops = table[table["figure"] == "phase_margin_deg"]
    # A refused axis, or a controller that does not reproduce the log, has no margins.
    untold = loops[~loops["told"] & (loops["verdict"] != "refused")]
    told = table[table["told"]]
    both = told[told["figure"].isin(_SHOWN)]
    lines = [
        f"{len(flights)} flights, seed {flights[0]['seed']}: {len(loops)} loops, "
        f"{int(loops['told'].sum())} of them with margins. On axes that are not refused, {len(untold)} loops "
        f"have none. True phase and gain margins in the interval: {_percent(both['inside'].mean())} "
        f"(target {_percent(PROMISE[0])} to {_percent(PROMISE[1])}).",
        "",
        *_figures_part(told),
        *_unstable_part(loops),
    ]
    for figure in _SHOWN:
        lines += _group_part(told[told["figure"] == figure], WORDS[figure][0])
    return "\n".join(lines) + "\n"


def _figures_part(told: pd.DataFrame) -> list[str]:
    """Coverage and errors of each figure."""
    lines = [
        "| margin | number | inside | 95 % interval of it | median z | spread of z | median error "
        "| 90 % quantile | median half-width |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for figure, (words, unit) in WORDS.items():
        part = told[told["figure"] == figure]
        if part.empty:
            continue
        low, high = flights_interval(part["inside"].to_numpy(), part["number"])
        error, z = part["error"].abs(), part["z"]
        lines.append(
            f"| {words} | {len(part)} | {_percent(part['inside'].mean())} "
            f"| {_percent(low)} to {_percent(high)} "
            f"| {z.median():+.2f} | {(z.quantile(0.75) - z.quantile(0.25)) / 1.349:.2f} "
            f"| {error.median():.2g} {unit} | {error.quantile(0.9):.2g} {unit} "
            f"| {part['half_width'].median():.2g} {unit} |"
        )
    return [*lines, ""]


def _unstable_part(loops: pd.DataFrame) -> list[str]:
    """Return how often stability itself was judged correctly."""
    known = loops[loops["stable"].notna()] if "stable" in loops else loops.iloc[:0]
    wrong = int((known["stable"].astype(bool) != known["true_stable"]).sum())
    return [f"Stability was judged for {len(known)} loops, and wrongly for {wrong}.", ""]


def _group_part(part: pd.DataFrame, words: str) -> list[str]:
    """Coverage of one figure by what the loops differ in."""
    lines = [
        f"### {words.capitalize()} by group",
        "",
        "| by | group | number | inside | median z | median error | median half-width |",
        "|---|---|---|---|---|---|---|",
    ]
    for column in _GROUPS:
        for name, group in part.groupby(column, observed=True):
            lines.append(
                f"| {column} | {name} | {len(group)} | {_percent(group['inside'].mean())} "
                f"| {group['z'].median():+.2f} | {group['error'].abs().median():.2g} "
                f"| {group['half_width'].median():.2g} |"
            )
    return [*lines, ""]


def draw_margins(table: pd.DataFrame, path: Path) -> None:
    """Draw found against true margins with their intervals, and the errors in standard deviations.

    Parameters
    ----------
    table : DataFrame
        As of `loops_of`.
    path : Path
        Of the PNG.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.4), layout="constrained")
    axes = figure.subplots(2, 2)
    told = table[table["told"]]
    for column, name in enumerate(_SHOWN):
        part, (words, unit) = told[told["figure"] == name], WORDS[name]
        _draw_against_truth(axes[0, column], part, f"{words} [{unit}]")
        _draw_scores(axes[1, column], part["z"].to_numpy(), words)
    figure.savefig(path, dpi=110)


def _draw_against_truth(axis: Any, part: pd.DataFrame, label: str) -> None:
    """Draw one point with its interval per loop; those that miss the truth are red."""
    for inside, colour in ((True, "#1f5fa8"), (False, "#b2182b")):
        some = part[part["inside"] == inside]
        half = np.maximum([some["value"] - some["low"], some["high"] - some["value"]], 0.0)
        share = f"{'holds' if inside else 'misses'} the truth ({len(some)})"
        axis.errorbar(some["truth"], some["value"], yerr=half, fmt=".", color=colour, alpha=0.5, label=share)
    ends = [part["truth"].min(), part["truth"].max()] if len(part) else [0.0, 1.0]
    axis.plot(ends, ends, color="#333333", linewidth=0.8)
    axis.set_xlabel(f"true {label}")
    axis.set_ylabel(f"found {label}")
    axis.legend(fontsize=8)


def _draw_scores(axis: Any, z: Any, words: str) -> None:
    """Draw the errors in standard deviations of the interval against the normal distribution."""
    edges, centre = np.linspace(-5.0, 5.0, 41), np.linspace(-5.0, 5.0, 201)
    # What lies beyond is counted in the outermost bins, not hidden.
    counts, _ = np.histogram(np.clip(z, -4.99, 4.99), edges)
    axis.stairs(counts / max(z.size * (edges[1] - edges[0]), 1e-9), edges, fill=True, color="#7aa6d1")
    axis.plot(centre, np.exp(-0.5 * centre**2) / np.sqrt(2.0 * np.pi), color="#333333", linewidth=1.2)
    axis.axvspan(-NORMAL_95, NORMAL_95, color="#333333", alpha=0.06)
    axis.set_xlabel(f"error of the {words} in standard deviations of its interval")


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.1f} %"
