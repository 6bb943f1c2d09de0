"""The summary picture: verdict and gain of each axis over the rates, measured and simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from quadid_logs.data.result import Result
from quadid_logs.figures.evidence import answer_to_commands, held_out_seconds
from quadid_logs.figures.spec import Curve, Figure, Panel
from quadid_logs.figures.thinning import break_at_gaps, thin_line
from quadid_logs.figures.time_series import RATE_AXIS, TIME
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES


def summary_figure(result: Result, headline: str, gains: Mapping[str, str]) -> Figure:
    """Return the summary: one panel per axis.

    Parameters
    ----------
    headline : str
        The verdict over all axes.
    gains : mapping of str to str
        By axis: its gain with the interval in words, "" where there is none.

    Returns
    -------
    Figure
        Where nothing was fitted, the rates of the whole log.
    """
    name = printable(result.name, 60)
    vehicle = ", ".join(filter(None, (printable(result.log.frame, 30), printable(result.log.firmware, 50))))
    held = dict(zip(AXES, held_out_seconds(result), strict=False))
    curves = {axis: each.curves() for axis, each in held.items()} or _measured(result)
    answers = {axis: answer_to_commands(result, axis) for axis in AXES}
    shown = (
        "Body rates on validation data: measured, and predicted from the torque alone."
        if held
        else "Body rates of the log. No model could be fitted, or no data were kept for validation."
    )
    if any(answers.values()):
        shown += " For an axis that air also moves: its acceleration per commanded torque, by frequency."
    return Figure(
        key="summary",
        title=f"{name}: {headline}",
        caption=f"{vehicle + '. ' if vehicle else ''}{shown} Gains with 95 % intervals. Made with "
        "quadid-logs.",
        panels=tuple(
            replace(
                answers[axis]
                or Panel(
                    title="",
                    x=TIME,
                    y=held[axis].axis() if axis in held else RATE_AXIS,
                    curves=curves.get(axis, ()),
                    ribbons=held[axis].ribbons() if axis in held else (),
                ),
                title=", ".join(
                    filter(None, (f"{axis.capitalize()}: {_verdict(result, axis)}", gains.get(axis, "")))
                ),
            )
            for axis in AXES
        ),
    )


def _verdict(result: Result, axis: str) -> str:
    found = result.diagnosis.axes.get(axis)
    return found.verdict if found else "not judged"


def _measured(result: Result) -> dict[str, tuple[Curve, ...]]:
    """Return the rate of each axis over the whole log."""
    overview = result.data.overview.get("body_rate")
    if overview is None or not overview.time_s.size:
        return {}
    time_s, values = break_at_gaps(overview.time_s, np.degrees(overview.values))
    curves: dict[str, tuple[Curve, ...]] = {}
    for column, axis in enumerate(AXES):
        x, y = thin_line(time_s, values[:, column])
        curves[axis] = (Curve(label="measured", x=x, y=y, role="measured"),)
    return curves
