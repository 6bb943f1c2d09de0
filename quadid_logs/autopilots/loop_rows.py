"""Rows of a log that follow each other loop by loop: what a controller can be replayed on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.maths.intervals import following_rows, inside

Interval = tuple[float, float]

#: Shorter than this [s] there is little to compare once the filters have settled.
_SHORTEST_S: Final = 4.0
#: Five minutes at 400 Hz: more rows say nothing new, and cost time.
_MOST_ROWS: Final = 120_000


def longest_run(time_s: FloatArray, usable: BoolArray) -> slice | None:
    """Return the longest run of usable rows without a gap or a repeated stamp.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        In file order [s].
    usable : ndarray of bool, shape (n,)

    Returns
    -------
    slice or None
        None where no run is long enough.
    """
    run, _ = following_rows(time_s, usable)
    if run.stop == run.start:
        return None
    after = min(run.stop, run.start + _MOST_ROWS)
    return slice(run.start, after) if time_s[after - 1] - time_s[run.start] >= _SHORTEST_S else None


def possible(*values: FloatArray) -> BoolArray:
    """Mark the rows in which all columns of all arrays are numbers that a controller can have met."""
    found = [(np.abs(one) < _IMPOSSIBLE).all(axis=1) for one in values]
    return np.asarray(np.logical_and.reduce(found), dtype=np.bool_)


def within(time_s: FloatArray, intervals: Sequence[Interval]) -> BoolArray:
    """Mark the times that lie in one of the intervals, ends included; all where there is none."""
    return inside(time_s, intervals) if intervals else np.asarray(np.isfinite(time_s), dtype=np.bool_)


def in_step(log: FlightLog, name: str, with_: Signal) -> Signal | None:
    """Return the source of a signal that was logged in the same message as another signal.

    Parameters
    ----------
    name : str
        A key of `vocabulary.SIGNALS`.
    """
    return next((one for one in log.candidates(name) if one.rows is with_.rows), None)


def matched(time_s: FloatArray, values: FloatArray, wanted_s: FloatArray) -> FloatArray:
    """Return the values at the same stamps, NaN where there is none.

    Parameters
    ----------
    time_s, values : ndarray, shape (n,)
        In file order; of a stamp that repeats the last counts.
    wanted_s : ndarray, shape (m,)

    Returns
    -------
    ndarray, shape (m,)
    """
    if not time_s.size:
        return np.full(wanted_s.shape, np.nan)
    order = np.argsort(time_s, kind="stable")
    place = np.searchsorted(time_s[order], wanted_s + _SAME_TIME_S, side="right") - 1
    row = order[np.maximum(place, 0)]
    same = (place >= 0) & (np.abs(time_s[row] - wanted_s) <= _SAME_TIME_S)
    return np.where(same, values[row], np.nan)


def last_before(time_s: FloatArray, wanted_s: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the last row at or before each of other times.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        In file order, n at least 1.
    wanted_s : ndarray, shape (m,)

    Returns
    -------
    place, row : ndarray of int64, shape (m,)
        Its number in order of time, -1 for none, and in the file; the first row where there is none.
    """
    order = np.argsort(time_s, kind="stable")
    place = np.searchsorted(time_s[order], wanted_s, side="right") - 1
    return place, order[np.maximum(place, 0)]


def stood_still(integral: FloatArray, increments: FloatArray) -> BoolArray:
    """Mark the steps at which an integral stood still rather than moved by its increment.

    Parameters
    ----------
    integral, increments : ndarray, shape (n,)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    steps = np.diff(integral, prepend=integral[0])
    return np.asarray(np.abs(steps) < _STOOD * np.abs(increments), dtype=np.bool_)


#: A step is all of the increment or nothing of it, but for rounding; in between, something else differs.
_STOOD: Final = 0.25
#: In SI units and commands nothing comes near: such a number is damage, and its square may overflow.
_IMPOSSIBLE: Final = 1e6
#: Stamps are whole microseconds.
_SAME_TIME_S: Final = 0.4e-6
