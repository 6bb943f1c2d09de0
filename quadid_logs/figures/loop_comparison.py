"""The figure of two flights' loops over each other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from quadid_logs.data.closed_loop import AxisLoop, LoopCurve, Step
from quadid_logs.data.result import Result
from quadid_logs.figures.closed_loop import decibels
from quadid_logs.figures.spec import Axis, Curve, Figure, LeftOut, Level, Panel
from quadid_logs.vocabulary import AXES

_KEY: Final = "compare-loop"
_TITLE: Final = "The loops before and after"
_FREQUENCY: Final = Axis(label="frequency", unit="Hz", log=True)
_SECONDS: Final = Axis(label="time after the step", unit="s")
#: A rate loop that is of use answers within this time [s].
_STEP_S: Final = 1.5
_FLIGHTS: Final = (("before", "series-1"), ("after", "series-2"))
_Pair = tuple[AxisLoop | None, AxisLoop | None]


def loop_comparison_figure(before: Result, after: Result) -> Figure | LeftOut:
    """Draw open loops and step responses of two flights over each other, by axis.

    Left out where no axis has a loop in both flights.
    """
    pairs = {axis: (_loop(before, axis), _loop(after, axis)) for axis in AXES}
    shown = {axis: pair for axis, pair in pairs.items() if None not in pair}
    if not shown:
        return LeftOut(key=_KEY, title=_TITLE, reason="No axis has a known loop in both flights.")
    return Figure(
        key=_KEY,
        title=_TITLE,
        caption="Gain and phase around the loop, cut at the mixer, and the rate step response. "
        "Dashed: 95 % intervals. Where the gain passes 0 dB, the phase above -180 degrees "
        "is the phase margin.",
        panels=tuple(
            draw(axis.capitalize(), pair) for draw in (_gain, _phase, _step) for axis, pair in shown.items()
        ),
        columns=len(shown),
    )


def _loop(result: Result, axis: str) -> AxisLoop | None:
    """Return the loop of an axis; None where it has none to draw."""
    found = None if result.closed_loop is None else result.closed_loop.axes.get(axis)
    return None if found is None or found.curve is None else found


def _gain(name: str, pair: _Pair) -> Panel:
    return Panel(
        title=f"{name}: gain",
        x=_FREQUENCY,
        y=Axis(label="gain", unit="dB", low=-60.0, high=40.0),
        curves=tuple(_of_curves(pair, _gain_curves)),
        levels=(Level(value=0.0, role="muted"),),
    )


def _phase(name: str, pair: _Pair) -> Panel:
    return Panel(
        title=f"{name}: phase",
        x=_FREQUENCY,
        y=Axis(label="phase", unit="deg", low=-360.0, high=0.0),
        curves=tuple(_of_curves(pair, _phase_curves)),
        levels=(Level(value=-180.0, role="muted"),),
    )


def _step(name: str, pair: _Pair) -> Panel:
    drawn = [
        curve
        for found, (label, role) in zip(pair, _FLIGHTS, strict=True)
        if found is not None and found.step is not None
        for curve in _step_curves(found.step, label, role)
    ]
    return Panel(
        title=f"{name}: step",
        x=_SECONDS,
        y=Axis(label="rate over set-point", low=-0.1),
        curves=tuple(drawn),
        levels=(Level(value=1.0, role="muted"),),
    )


def _of_curves(pair: _Pair, draw: Callable[[LoopCurve, str, str], tuple[Curve, ...]]) -> Iterator[Curve]:
    """Yield the curves of both flights."""
    for found, (label, role) in zip(pair, _FLIGHTS, strict=True):
        if found is not None and found.curve is not None:
            yield from draw(found.curve, label, role)


def _gain_curves(curve: LoopCurve, label: str, role: str) -> tuple[Curve, ...]:
    x = curve.frequency_hz
    return (
        Curve(label=f"{label}, 95 %", x=x, y=decibels(curve.gain_low), role=role, mark="dashed"),
        Curve(label=f"{label}, 95 %", x=x, y=decibels(curve.gain_high), role=role, mark="dashed"),
        Curve(label=label, x=x, y=decibels(np.abs(curve.response)), role=role),
    )


def _phase_curves(curve: LoopCurve, label: str, role: str) -> tuple[Curve, ...]:
    x, phase = curve.frequency_hz, np.unwrap(np.angle(curve.response))
    return (
        Curve(label=f"{label}, 95 %", x=x, y=np.degrees(curve.phase_low), role=role, mark="dashed"),
        Curve(label=f"{label}, 95 %", x=x, y=np.degrees(curve.phase_high), role=role, mark="dashed"),
        Curve(label=label, x=x, y=np.degrees(phase), role=role),
    )


def _step_curves(step: Step, label: str, role: str) -> tuple[Curve, ...]:
    shown = step.time_s <= _STEP_S
    x = step.time_s[shown]
    return (
        Curve(label=f"{label}, 95 %", x=x, y=step.low[shown], role=role, mark="dashed"),
        Curve(label=f"{label}, 95 %", x=x, y=step.high[shown], role=role, mark="dashed"),
        Curve(label=label, x=x, y=step.response[shown], role=role),
    )
