"""Gains that rise until the vehicle oscillates, and are then cut: D first, P with I after it.

The procedure sees an oscillation by the slew rate of P and D, which gyro noise and gusts make as well: here
it begins where the linear loop becomes unstable, so that noise ends it no later than is told.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.control.loop import close
from quadid_logs.control.margins import fine_grid_hz, is_stable
from quadid_logs.control.separate_gains import Rebuild
from quadid_logs.data.autotune import Doubling
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import GainNames

#: A gain of none begins here.
_FIRST_GAIN: Final = 1e-4
#: By so much at a time gains rise; the limit of stability is found to a hundredth by halvings.
_STEP: Final = 2.0**0.25
_HALVINGS: Final = 4
#: More steps than from the first gain to any that a vehicle bears.
_MOST_STEPS: Final = 100
#: P falls with D by no more than this.
_LEAST_P_RATIO: Final = 0.5


class DoubledGains(NamedTuple):
    """Gains at the end, each of shape (n_plants,); NaN where no gain makes the vehicle oscillate."""

    proportional: FloatArray
    integral: FloatArray
    derivative: FloatArray


def double(
    procedure: Doubling, controller: AxisController, plants: Plant, names: GainNames, rebuild: Rebuild
) -> DoubledGains | None:
    """Run the procedure on vehicles.

    Parameters
    ----------
    procedure : Doubling
    controller : AxisController
        With the gains from which it starts.
    plants : Plant
    names : GainNames
    rebuild : callable

    Returns
    -------
    DoubledGains or None
        None where the controller's parts are not known apart.
    """
    stable = _stability(procedure, plants, names, rebuild)
    if stable is None:
        return None
    n = plants.effectiveness.size
    flown = [
        np.full(n, controller.gains[name]) for name in (names.proportional, names.integral, names.derivative)
    ]
    old_p, old_i, old_d = flown

    def with_d(rows: IntArray, d: FloatArray) -> BoolArray:
        return stable(rows, old_p[rows], old_i[rows], d)

    d = _raised(with_d, old_d, procedure.highest_derivative)
    cut_d = _cut(d, procedure, procedure.highest_derivative)
    p = old_p
    if procedure.lowers_p:
        # Lowered D lowers P with it.
        falls = np.maximum(cut_d / np.maximum(old_d, cut_d), _LEAST_P_RATIO)
        p = _no_less(falls * old_p, old_p, procedure)
    end_d = _no_less(cut_d, old_d, procedure)

    def integral(rows: IntArray, p: FloatArray) -> FloatArray:
        return old_i[rows] if procedure.integral_ratio is None else p * procedure.integral_ratio

    def with_p(rows: IntArray, p: FloatArray) -> BoolArray:
        return stable(rows, p, integral(rows, p), end_d[rows])

    risen = _raised(with_p, p, procedure.highest_proportional)
    end_p = _no_less(_cut(risen, procedure, procedure.highest_proportional), old_p, procedure)
    return DoubledGains(end_p, integral(np.arange(n), end_p), end_d)


class _Raised(NamedTuple):
    """Where gains stop to rise, and whether because the vehicle oscillates; each (n_plants,)."""

    gain: FloatArray
    oscillates: BoolArray


def _raised(
    stable: Callable[[IntArray, FloatArray], BoolArray], start: FloatArray, highest: float
) -> _Raised:
    """Raise gains until the loop is unstable, or to the highest; NaN where neither comes.

    ``stable`` takes the numbers of some plants and a gain for each.
    """
    first = np.maximum(start, _FIRST_GAIN)
    below = first.copy()
    above = np.full(below.shape, np.nan)
    rising = np.arange(below.size)
    for _ in range(_MOST_STEPS):
        holds = stable(rising, below[rising])
        above[rising[~holds]] = below[rising[~holds]]
        rising = rising[holds & (below[rising] < highest)]
        if not rising.size:
            break
        below[rising] *= _STEP
    # The first step that oscillates, and the last that does not; who oscillates at once stays there.
    low = np.where(above > first, above / _STEP, above)
    high = above.copy()
    between = np.flatnonzero(np.isfinite(high))
    for _ in range(_HALVINGS if between.size else 0):
        middle = np.sqrt(low[between] * high[between])
        holds = stable(between, middle)
        low[between[holds]], high[between[~holds]] = middle[holds], middle[~holds]
    oscillates = np.isfinite(high) & ((high < highest) | (high <= first))
    limited = np.where(below >= highest, np.maximum(highest, start), np.nan)
    return _Raised(np.where(oscillates, high, limited), oscillates)


def _cut(raised: _Raised, procedure: Doubling, highest: float) -> FloatArray:
    """Return what is left of gains at which the vehicle oscillates, and of others at most the highest."""
    kept = np.where(raised.oscillates, procedure.kept, 1.0)
    return np.asarray(np.minimum(kept * raised.gain, highest))


def _no_less(gain: FloatArray, flown: FloatArray, procedure: Doubling) -> FloatArray:
    return np.asarray(np.maximum(gain, procedure.least_of_flown * flown))


def _stability(
    procedure: Doubling, plants: Plant, names: GainNames, rebuild: Rebuild
) -> Callable[[IntArray, FloatArray, FloatArray, FloatArray], BoolArray] | None:
    """Return what tells of the numbers of some plants and their P, I and D whether their loops are stable."""
    gains = (names.proportional, names.integral, names.derivative)
    made = [
        rebuild({name: float(name == one) for name in gains} | dict(procedure.filters))
        for one in ("", *gains)
    ]
    if any(one is None for one in made):
        return None
    nothing, *single = [one for one in made if one is not None]
    frequency_hz = fine_grid_hz(nothing.period_s)
    closes_angle = nothing.angle_gain_per_s is not None

    def open_loop(one: AxisController) -> np.ndarray:
        loop = close(one, plants, frequency_hz)
        return loop.rate if loop.full is None else loop.full

    rest = open_loop(nothing)
    each = [open_loop(one) - rest for one in single]
    runs_away = plants.damping > 0.0

    def stable(rows: IntArray, p: FloatArray, i: FloatArray, d: FloatArray) -> BoolArray:
        gains = zip((p, i, d), each, strict=True)
        loop = rest[rows] + sum(gain[:, np.newaxis] * one[rows] for gain, one in gains)
        n_integrators = int(bool(np.any(i > 0.0))) + int(closes_angle)
        return is_stable(np.asarray(loop, dtype=np.complex128), n_integrators, runs_away[rows])

    return stable
