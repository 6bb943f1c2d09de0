"""The pictures of a study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from quadid_logs.maths.normal import NORMAL_95
from study.summary import PROMISE, binomial_interval, grouped, without_structural

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN: Final = (
    "on-axis effectiveness",
    "off-axis effectiveness",
    "on-axis damping",
    "gyroscopic",
    "lag",
    "delay",
)
_BY: Final = {
    "manoeuvre": "manoeuvre",
    "wind_m_s": "wind [m/s]",
    "lag_s": "motor lag [s]",
    "rate_hz": "log rate [Hz]",
    "disturbance_rad_s2": "disturbances [rad/s²]",
}


def draw_plots(table: pd.DataFrame, verdicts: pd.DataFrame, folder: Path) -> None:
    """Draw the histogram of z, coverage by what the flights differ in, and the verdicts by structural effect.

    Parameters
    ----------
    table : DataFrame
        As of `study.summary.parameters_of`.
    verdicts : DataFrame
        As of `study.summary.verdict_table`.
    folder : Path
    """
    clean = without_structural(table)
    claimed = clean[clean["claimed"]]
    figures = {"z": _histograms(claimed), "groups": _groups(claimed), "effects": _verdicts(verdicts)}
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=110)


def _verdicts(verdicts: pd.DataFrame) -> Figure:
    """Draw what the axes were called, by structural effect; red is usable and wrong."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 0.9 + 0.32 * len(verdicts)), layout="constrained")
    axis = figure.subplots()
    names = [f"{row.effect} ({row.flights} flights)" for row in verdicts.itertuples()]
    left = np.zeros(len(verdicts))
    for label, counts, colour in (
        ("usable and wrong", verdicts["wrong"], "#b2182b"),
        ("usable", verdicts["usable"] - verdicts["wrong"], "#4c9f70"),
        ("caution", verdicts["caution"], "#e0b050"),
        ("refused", verdicts["refused"], "#b0b0b0"),
    ):
        width = (100.0 * counts / verdicts["axes"]).to_numpy()
        axis.barh(names, width, left=left, color=colour, label=label)
        left = left + width
    axis.invert_yaxis()
    axis.set_xlim(0.0, 100.0)
    axis.set_xlabel("axes [%]")
    figure.legend(loc="outside upper center", ncols=4, fontsize=9)
    return figure


def _histograms(claimed: pd.DataFrame) -> Figure:
    """Error in standard deviations against the normal distribution that the intervals claim."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 5.6), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True)
    edges = np.linspace(-5.0, 5.0, 41)
    centre = np.linspace(-5.0, 5.0, 201)
    normal = np.exp(-0.5 * centre**2) / np.sqrt(2.0 * np.pi)
    for axis, kind in zip(axes.flat, _SHOWN, strict=True):
        z = claimed.loc[claimed["kind"] == kind, "z"].to_numpy()
        # What lies beyond is counted in the outermost bins, not hidden.
        counts, _ = np.histogram(np.clip(z, -4.99, 4.99), edges)
        axis.stairs(counts / max(z.size * (edges[1] - edges[0]), 1e-9), edges, fill=True, color="#7aa6d1")
        axis.plot(centre, normal, color="#333333", linewidth=1.2)
        axis.axvspan(-NORMAL_95, NORMAL_95, color="#333333", alpha=0.06)
        axis.set_title(f"{kind} (n = {z.size})", fontsize=10)
    figure.supxlabel("error in standard deviations of the stated interval; outermost bins hold all beyond")
    return figure


def _groups(claimed: pd.DataFrame) -> Figure:
    """Coverage of on-axis effectiveness and damping by what flights differ in, with binomial intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 3.8), layout="constrained")
    axes = figure.subplots(1, len(_BY), sharey=True)
    for axis, (column, label) in zip(axes, _BY.items(), strict=True):
        axis.axhspan(*PROMISE, color="#4c9f70", alpha=0.25, linewidth=0.0)
        names = list(grouped(claimed, column).cat.categories)
        for offset, kind, colour in (
            (-0.12, "on-axis effectiveness", "#1f5fa8"),
            (0.12, "on-axis damping", "#c8553d"),
        ):
            part = claimed[claimed["kind"] == kind]
            for name, group in part.groupby(grouped(part, column), observed=True):
                low, high = binomial_interval(int(group["inside"].sum()), len(group))
                place, fraction = names.index(name) + offset, group["inside"].mean()
                axis.errorbar(
                    place, fraction, yerr=[[fraction - low], [high - fraction]], fmt="o", color=colour
                )
            axis.plot([], [], "o", color=colour, label=kind)
        axis.set_xticks(range(len(names)), names, rotation=35, ha="right", fontsize=8)
        axis.set_xlabel(label)
    axes[0].set_ylabel("fraction of truths inside the interval")
    # The second panel is empty below: bars of few flights reach down in the first.
    axes[1].legend(fontsize=8, loc="lower left")
    return figure
