"""Slow signals at the rows of a fast one, by their place in the file.

Places never fall or jump, whatever the clock does.
"""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import FlightLog, Signal


def at_rows(signal: Signal | None, position: IntArray, *, missing: float) -> FloatArray:
    """Interpolate the first column of a signal to rows of the file; shape of `position`.

    ``missing`` stands where the signal has no finite value at all.
    """
    if signal is None:
        return np.full(position.shape, missing)
    known = np.isfinite(signal.values[:, 0])
    if not known.any():
        return np.full(position.shape, missing)
    place = signal.position[known].astype(np.float64)
    order = np.argsort(place, kind="stable")
    values = np.interp(position.astype(np.float64), place[order], signal.values[known, 0][order])
    return np.asarray(values, dtype=np.float64)


def held_at_rows(signal: Signal | None, position: IntArray, *, before: float) -> FloatArray:
    """Return the last value of the first column at rows of the file, `before` ahead of the first one."""
    if signal is None or not signal.n_samples:
        return np.full(position.shape, before)
    order = np.argsort(signal.position, kind="stable")
    row = np.searchsorted(signal.position[order], position, side="right")
    return np.concatenate([[before], signal.values[order, 0]])[row]


def first(log: FlightLog, name: str) -> Signal | None:
    """Return the preferred source of a signal, None where there is none."""
    return next(iter(log.candidates(name)), None)


def flown(log: FlightLog, position: IntArray, throttle: FloatArray) -> BoolArray:
    """Mark the rows at which the vehicle was certainly off the ground; shape (n_samples,).

    Armed, not landed, and at more than half of the throttle that is usual while armed.
    """
    landed, armed = first(log, "landed"), first(log, "armed")
    # The opposite of the first event was the state before it.
    on_ground = held_at_rows(landed, position, before=1.0 - _first_value(landed)) > 0.5
    is_armed = held_at_rows(armed, position, before=1.0 - _first_value(armed)) > 0.5
    up = ~on_ground if landed is not None else np.ones(position.shape, np.bool_)
    if armed is not None:
        up &= is_armed
    up &= np.isfinite(throttle)
    if up.any():
        up &= throttle > 0.5 * float(np.median(throttle[up]))
    return up


def _first_value(signal: Signal | None) -> float:
    return float(signal.values[0, 0]) if signal is not None and signal.n_samples else 0.0
