"""The step before and after, drawn as SVG: no script, readable in print and by a screen reader."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Step
from quadid_logs.data.tuning import AxisTuning
from quadid_logs.report.numbers import number
from quadid_logs.report.picture import WIDTH, Picture, Scale

_HEIGHT: Final = 180
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 8, 10, 26
_MOST_POINTS: Final = 160
#: A rate loop that is worth flying has done most of its step by then; shown are so many settling times.
_SHOWN: Final = 1.5
#: Within a twentieth of the set-point, as `control.step` takes an answer for settled.
_ARRIVED: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A line and its band, "" for none, as points of SVG; ``name`` is a class of the page's style."""

    name: str
    line: str
    band: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StepPicture(Picture):
    """Steps as curves."""

    curves: tuple[Curve, ...]


def step_picture(axis: str, found: AxisTuning, flown: Step | None = None) -> StepPicture | None:
    """Return the picture of one axis, None where nothing changes.

    ``flown`` is the step of the flight; what the log shows of it is drawn, too.
    """
    before, after = found.step_now, found.step_next
    if found.verdict != "change" or after is None:
        return None
    steps = {"after": after} if before is None else {"before": before, "after": after}
    settled = [one.settling_time_s.value for one in steps.values() if np.isfinite(one.settling_time_s.value)]
    end_s = min(max([*settled, 0.2]) * _SHOWN, float(after.time_s[-1]))
    measured = None
    if flown is not None and flown.measured is not None and np.isfinite(flown.measured).all():
        measured = replace(flown, response=flown.measured, high=flown.measured)
    drawn = [*steps.values(), *([measured] if measured else [])]
    top = 1.05 * max(float(one.high[one.time_s <= end_s].max()) for one in drawn)
    bottom = min(0.0, *(float(one.low[one.time_s <= end_s].min()) for one in steps.values()))
    x = Scale(0.0, end_s, _LEFT, WIDTH - _RIGHT)
    y = Scale(bottom, max(top, 1.2), _HEIGHT - _BOTTOM, _TOP)
    told = [
        f"{'as flown' if name == 'before' else 'with the next gains'} it "
        + rise_words(
            one.rise_time_s.value,
            one.overshoot_percent.value,
            float(one.response[-1]),
            float(one.time_s[-1]),
        )
        for name, one in steps.items()
    ]
    curves = tuple(_curve(name, one, x, y) for name, one in steps.items())
    if measured is not None:
        curves = (replace(_curve("measured", measured, x, y), band=""), *curves)
    return StepPicture(
        axis=axis,
        curves=curves,
        across=tuple((x.at(value), f"{number(value, 2)} s") for value in (0.0, 0.5 * end_s, end_s)),
        up=tuple((y.at(value), number(value)) for value in (0.0, 0.5, 1.0)),
        words=f"{axis.capitalize()} rate after a step of its set-point: {'; '.join(told)}.",
        height=_HEIGHT,
        left=_LEFT,
        right=WIDTH - _RIGHT,
    )


def _curve(name: str, step: Step, x: Scale, y: Scale) -> Curve:
    shown = int(np.count_nonzero(step.time_s <= x.high))
    rows = np.unique(np.linspace(0, max(shown - 1, 0), _MOST_POINTS).astype(np.int64))

    def points(values: FloatArray, order: int = 1) -> str:
        pairs = zip(step.time_s[rows][::order], values[rows][::order], strict=True)
        return " ".join(f"{x.at(float(time_s))},{y.at(float(value))}" for time_s, value in pairs)

    band = f"{points(step.high)} {points(step.low, -1)}"
    return Curve(name=name, line=points(step.response), band=band)


def rise_words(rise_s: float, overshoot_percent: float, end: float, end_s: float) -> str:
    """Say how the rate comes to its set-point.

    Parameters
    ----------
    rise_s, overshoot_percent : float
        Rise time [s] and overshoot [%], relative to the final value of the response.
    end : float
        The final value as a fraction of the step.
    end_s : float
        Time of the final value [s].

    Examples
    --------
    >>> rise_words(0.015, 12.0, 1.0, 4.0), rise_words(1.64, 1.0, 0.84, 4.0)
    ('rises in 15 ms and overshoots by 12 %', 'reaches 84 % after 4 s')
    """
    # An integrator that is slow goes on for long: rise and overshoot would be those of less than the step.
    if abs(end - 1.0) > _ARRIVED:
        return f"reaches {100.0 * end:.0f} % after {number(end_s, 2)} s"
    return f"rises in {number(1e3 * rise_s, 2)} ms and overshoots by {overshoot_percent:.0f} %"
