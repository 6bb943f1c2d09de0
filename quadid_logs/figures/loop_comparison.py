"""The figures of loops over each other: of two flights, and of a flight and the next one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import AxisLoop, LoopCurve, Step
from quadid_logs.data.result import Result
from quadid_logs.figures.closed_loop import STEP_S, decibels, phase_of
from quadid_logs.figures.spec import FREQUENCY, Axis, Curve, Figure, LeftOut, Level, Panel, Ribbon
from quadid_logs.vocabulary import AXES

_KEY: Final = "compare-loop"
_TITLE: Final = "The loops before and after"
_GAIN: Final = Axis(label="gain", unit="dB", low=-60.0, high=40.0)
_PHASE: Final = Axis(label="phase", unit="deg", low=-360.0, high=0.0)
_SECONDS: Final = Axis(label="time after the step", unit="s")


class _Style(NamedTuple):
    """How the lines of one loop are drawn."""

    label: str
    role: str

    def curve(self, x: FloatArray, y: FloatArray) -> Curve:
        return Curve(label=self.label, x=x, y=y, role=self.role)

    def ribbon(self, x: FloatArray, low: FloatArray, high: FloatArray) -> Ribbon:
        return Ribbon(label=f"{self.label}, 95 %", x=x, low=low, high=high, role=self.role)


_FLIGHTS: Final = (_Style("before", "series-1"), _Style("after", "series-2"))
_AS_FLOWN: Final = _Style("as flown", "muted")
_NEXT: Final = _Style("next gains", "series-1")
_Drawn = Sequence[tuple[LoopCurve, _Style]]


def loop_comparison_figure(before: Result, after: Result) -> Figure | LeftOut:
    """Draw open loops and step responses of two flights over each other, by axis.

    Left out where no axis has a loop in both flights.
    """
    pairs = {axis: (_loop(before, axis), _loop(after, axis)) for axis in AXES}
    shown = {
        name: [(loop, style) for loop, style in zip(pair, _FLIGHTS, strict=True) if loop is not None]
        for name, pair in pairs.items()
        if None not in pair
    }
    if not shown:
        return LeftOut(key=_KEY, title=_TITLE, reason="No axis has a known loop in both flights.")
    curves = {
        axis: [(loop.curve, style) for loop, style in both if loop.curve is not None]
        for axis, both in shown.items()
    }
    steps = [
        _step(axis, [(loop.step, style) for loop, style in both if loop.step is not None])
        for axis, both in shown.items()
    ]
    return Figure(
        key=_KEY,
        title=_TITLE,
        caption=(
            "Gain and phase around the loop, cut at the mixer, and the rate step response. Shaded: 95 % "
            "intervals. The phase margin is the phase above -180 degrees at the frequency where the gain "
            "passes 0 dB."
        ),
        panels=(*_gains_and_phases(curves), *steps),
        columns=len(shown),
    )


def next_loop_figure(
    result: Result, following: Mapping[str, LoopCurve], axes: Sequence[str] = AXES
) -> Figure | None:
    """Draw the open loops that flew, and those with the next gains over them.

    Parameters
    ----------
    result : Result
    following : mapping of str to LoopCurve
        By axis, with the next gains; an axis without one shows what flew.
    axes : sequence of str
        To draw, as far as their loops are known.

    Returns
    -------
    Figure or None
        None where no loop is known.
    """
    drawn = {}
    for axis in axes:
        loop = _loop(result, axis)
        both = ((None if loop is None else loop.curve, _AS_FLOWN), (following.get(axis), _NEXT))
        if known := [(curve, style) for curve, style in both if curve is not None]:
            drawn[axis] = known
    if not drawn:
        return None
    return Figure(
        key="next-loop",
        title="The open loop, cut at the mixer",
        caption="Where the gain passes 0 dB, the phase above -180 degrees is the phase margin. Where the "
        "phase passes -180 degrees, the gain below 0 dB is the gain margin. Shaded: 95 % intervals; that of "
        "the next gains holds what flights of one vehicle differ by.",
        panels=_gains_and_phases(drawn),
        columns=len(drawn),
    )


def _loop(result: Result, axis: str) -> AxisLoop | None:
    """Return the loop of an axis; None where it has none to draw."""
    found = result.loop_of(axis)
    return None if found is None or found.curve is None else found


def _gains_and_phases(drawn: Mapping[str, _Drawn]) -> tuple[Panel, ...]:
    """Return a row of gains and one of phases, an axis beside the other."""
    gains = (
        Panel(
            title=f"{axis.capitalize()}: gain",
            x=FREQUENCY,
            y=_GAIN,
            curves=tuple(
                style.curve(one.frequency_hz, decibels(np.abs(one.response))) for one, style in known
            ),
            ribbons=tuple(
                style.ribbon(one.frequency_hz, decibels(one.gain_low), decibels(one.gain_high))
                for one, style in known
            ),
            levels=(Level(value=0.0, role="muted"),),
        )
        for axis, known in drawn.items()
    )
    phases = (
        Panel(
            title=f"{axis.capitalize()}: phase",
            x=FREQUENCY,
            y=_PHASE,
            curves=tuple(style.curve(one.frequency_hz, np.degrees(phase_of(one))) for one, style in known),
            ribbons=tuple(
                style.ribbon(one.frequency_hz, np.degrees(one.phase_low), np.degrees(one.phase_high))
                for one, style in known
            ),
            levels=(Level(value=-180.0, role="muted"),),
        )
        for axis, known in drawn.items()
    )
    return (*gains, *phases)


def _step(axis: str, steps: Sequence[tuple[Step, _Style]]) -> Panel:
    curves, ribbons = [], []
    for one, style in steps:
        shown = one.time_s <= STEP_S
        x = one.time_s[shown]
        curves.append(style.curve(x, one.response[shown]))
        ribbons.append(style.ribbon(x, one.low[shown], one.high[shown]))
    return Panel(
        title=f"{axis.capitalize()}: step",
        x=_SECONDS,
        y=Axis(label="rate divided by set-point", low=-0.1),
        curves=tuple(curves),
        ribbons=tuple(ribbons),
        levels=(Level(value=1.0, role="muted"),),
    )
