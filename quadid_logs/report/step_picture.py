"""The step before and after, drawn as SVG: no script, readable in print and by a screen reader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Step
from quadid_logs.data.tuning import AxisTuning
from quadid_logs.report.numbers import number

WIDTH: Final = 320
HEIGHT: Final = 180
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 8, 10, 26
_MOST_POINTS: Final = 160
#: A rate loop that is worth flying has done most of its step by then; shown are so many settling times.
_SHOWN: Final = 1.5
#: Within a twentieth of the set-point, as `control.step` takes an answer for settled.
_ARRIVED: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A line and its band as points of SVG; ``name`` is a class of the page's style."""

    name: str
    line: str
    band: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StepPicture:
    """One axis: curves, ticks as (place, text), and what it shows in words."""

    axis: str
    curves: tuple[Curve, ...]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]
    words: str
    width: int = WIDTH
    height: int = HEIGHT
    left: int = _LEFT
    right: int = WIDTH - _RIGHT
    top: int = _TOP
    bottom: int = HEIGHT - _BOTTOM


def step_picture(axis: str, found: AxisTuning) -> StepPicture | None:
    """Return the picture of one axis, None where nothing changes.

    Parameters
    ----------
    axis : str
    found : AxisTuning

    Returns
    -------
    StepPicture or None
    """
    before, after = found.step_now, found.step_next
    if found.verdict != "change" or after is None:
        return None
    steps = {"after": after} if before is None else {"before": before, "after": after}
    settled = [one.settling_time_s.value for one in steps.values() if np.isfinite(one.settling_time_s.value)]
    end_s = min(max([*settled, 0.2]) * _SHOWN, float(after.time_s[-1]))
    top = 1.05 * max(float(one.high[one.time_s <= end_s].max()) for one in steps.values())
    bottom = min(0.0, *(float(one.low[one.time_s <= end_s].min()) for one in steps.values()))
    place = _Place(end_s, bottom, max(top, 1.2))
    return StepPicture(
        axis=axis,
        curves=tuple(place.curve(name, one) for name, one in steps.items()),
        across=tuple((place.x(value), f"{number(value, 2)} s") for value in (0.0, 0.5 * end_s, end_s)),
        up=tuple((place.y(value), number(value)) for value in (0.0, 0.5, 1.0)),
        words=_words(axis, steps),
    )


def _words(axis: str, steps: dict[str, Step]) -> str:
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
    return f"{axis.capitalize()} rate after a step of its set-point: {'; '.join(told)}."


def rise_words(rise_s: float, overshoot_percent: float, end: float, end_s: float) -> str:
    """Say how the rate comes to its set-point.

    Parameters
    ----------
    rise_s, overshoot_percent : float
        By where the answer ends.
    end : float
        That, as a fraction of the step.
    end_s : float
        When [s].

    Returns
    -------
    str

    Examples
    --------
    >>> rise_words(0.015, 12.0, 1.0, 4.0), rise_words(1.64, 1.0, 0.84, 4.0)
    ('rises in 15 ms and overshoots by 12 %', 'has come to 84 % after 4 s')
    """
    # An integrator that is slow goes on for long: rise and overshoot would be those of less than the step.
    if abs(end - 1.0) > _ARRIVED:
        return f"has come to {100.0 * end:.0f} % after {number(end_s, 2)} s"
    return f"rises in {number(1e3 * rise_s, 2)} ms and overshoots by {overshoot_percent:.0f} %"


class _Place:
    """From seconds and rates to places in the picture."""

    def __init__(self, end_s: float, low: float, high: float) -> None:
        self._end_s, self._low, self._high = end_s, low, high

    def x(self, time_s: float) -> float:
        return round(_LEFT + (WIDTH - _LEFT - _RIGHT) * time_s / self._end_s, 1)

    def y(self, value: float) -> float:
        part = (value - self._low) / (self._high - self._low)
        return round(HEIGHT - _BOTTOM - (HEIGHT - _TOP - _BOTTOM) * part, 1)

    def curve(self, name: str, step: Step) -> Curve:
        shown = int(np.count_nonzero(step.time_s <= self._end_s))
        rows = np.unique(np.linspace(0, max(shown - 1, 0), _MOST_POINTS).astype(np.int64))
        there = self._points(step.time_s[rows], step.high[rows])
        back = self._points(step.time_s[rows][::-1], step.low[rows][::-1])
        line = self._points(step.time_s[rows], step.response[rows])
        return Curve(name=name, line=line, band=f"{there} {back}")

    def _points(self, time_s: FloatArray, values: FloatArray) -> str:
        return " ".join(f"{self.x(float(t))},{self.y(float(v))}" for t, v in zip(time_s, values, strict=True))
