"""The small pictures of tune's page, drawn as SVG: no script, readable in print and by a screen reader."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.closed_loop import Step
from quadid_logs.data.tuning import AxisTuning
from quadid_logs.report.numbers import number

WIDTH: Final = 320
#: Of a picture of steps, and of one of filters: its height, and the room around what is drawn.
_STEP_HEIGHT, _STEP_LEFT, _STEP_RIGHT, _STEP_TOP, _STEP_BOTTOM = 180, 34, 8, 10, 26
_FILTER_HEIGHT, _FILTER_LEFT, _FILTER_RIGHT, _FILTER_TOP, _FILTER_BOTTOM = 200, 46, 12, 12, 36
_MOST_POINTS: Final = 160
#: A rate loop that is worth flying has done most of its step by then; shown are so many settling times.
_SHOWN: Final = 1.5
#: Within a twentieth of the set-point, as `control.step` takes an answer for settled.
_ARRIVED: Final = 0.05
#: Room beside the outermost points, as a part of the picture.
_ROOM: Final = 0.06

#: A tick: its place in the picture, and its text.
Tick = tuple[float, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One axis: ticks across and up, and what it shows in words; ``left`` and ``right`` end what is drawn."""

    axis: str
    across: tuple[Tick, ...]
    up: tuple[Tick, ...]
    words: str
    height: int
    left: int
    right: int
    width: int = WIDTH


class Scale(NamedTuple):
    """From a value between ``low`` and ``high`` to a place between ``begin`` and ``end`` in the picture."""

    low: float
    high: float
    begin: float
    end: float

    def at(self, value: float) -> float:
        """Return the place of a value; the middle where all are alike."""
        part = (value - self.low) / (self.high - self.low) if self.high > self.low else 0.5
        return round(self.begin + (self.end - self.begin) * part, 1)


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
    x = Scale(0.0, end_s, _STEP_LEFT, WIDTH - _STEP_RIGHT)
    y = Scale(bottom, max(top, 1.2), _STEP_HEIGHT - _STEP_BOTTOM, _STEP_TOP)
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
        height=_STEP_HEIGHT,
        left=_STEP_LEFT,
        right=WIDTH - _STEP_RIGHT,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterPicture(Picture):
    """Settings as points: (class, x, y, radius)."""

    points: tuple[tuple[str, float, float, float], ...]


def filter_picture(axis: str, found: AxisTuning) -> FilterPicture | None:
    """Return the picture of one axis, None where its filters stay."""
    trials = found.filter_trials
    if not found.filters or len(trials) < 2:
        return None
    phase = [one.phase_deg for one in trials]
    noise = [100.0 * MOST_NOISE * one.noise for one in trials]
    x = _scale(phase, _FILTER_LEFT, WIDTH - _FILTER_RIGHT)
    y = _scale([_log(one) for one in noise], _FILTER_HEIGHT - _FILTER_BOTTOM, _FILTER_TOP)
    names = ["flown", *["other"] * (len(trials) - 2), "chosen"]
    sizes = {"flown": 5.0, "other": 2.0, "chosen": 5.0}
    chosen = trials[-1]
    less = -chosen.phase_deg
    phase_words = (
        f"{number(abs(less), 2)} degrees {'less' if less > 0.0 else 'more'} phase lost at the crossover"
    )
    percent = [number(100.0 * MOST_NOISE * one.noise, 2) for one in (trials[0], chosen)]
    return FilterPicture(
        axis=axis,
        points=tuple(
            (name, x.at(lost), y.at(_log(loud)), sizes[name])
            for name, lost, loud in zip(names, phase, noise, strict=True)
        ),
        across=tuple((x.at(end), f"{number(end, 2)}°") for end in (min(phase), max(phase))),
        up=tuple((y.at(_log(end)), f"{number(end, 2)} %") for end in (min(noise), max(noise))),
        words=(
            f"{axis.capitalize()}: the chosen filters have {phase_words}. With their gains, the noise on "
            f"the motors is {percent[1]} %. The best gains with the flown filters would give {percent[0]} %."
        ),
        height=_FILTER_HEIGHT,
        left=_FILTER_LEFT,
        right=WIDTH - _FILTER_RIGHT,
    )


def _log(percent: float) -> float:
    return math.log(max(percent, 1e-4))


def _scale(values: list[float], begin: float, end: float) -> Scale:
    room = _ROOM * (end - begin)
    return Scale(min(values), max(values), begin + room, end - room)
