"""Hold the body rates of the flights against the attitude of the same flights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.align.series import GAP_PERIODS, CleanSeries, Interval
from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import GyroCheck
from quadid_logs.maths.gyro_attitude import fit_gyro_to_attitude
from quadid_logs.maths.rotations import unwrapped

#: Long enough for the noise of an angle to be small against its change, short enough for a manoeuvre
#: to change within a block.
_INTERVAL_S = 0.3
#: Over four of them what compass, GPS and accelerometer correct, which no gyro shows, is a constant drift.
_PER_BLOCK = 4
#: Blocks differ in length by these factors: in even ones a periodic motion always has the same phase.
_SHORTEST, _LONGEST = 0.6, 1.4
#: The multiples of the golden ratio, modulo one, repeat no pattern.
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
#: Five minutes of flight say all that the check can say; it stays as quick on an hour.
_MOST_BLOCKS = 250
#: A clock that jumped far ahead must not cost memory: no battery lasts a day.
_LONGEST_S = 86_400.0
_LONGEST_BLOCK_S = _PER_BLOCK * _LONGEST * _INTERVAL_S
#: Nine equations each, for ten unknowns, and still enough to tell a habit from an accident.
_FEWEST_BLOCKS = 15


def check_gyro(
    rate: CleanSeries | None,
    attitude: CleanSeries | None,
    flights: Sequence[Interval],
) -> GyroCheck | None:
    """Fit the body rates to the change of attitude over intervals of some tenths of a second.

    Parameters
    ----------
    rate, attitude : CleanSeries or None
    flights : sequence of (start_s, end_s)

    Returns
    -------
    GyroCheck or None
        None where a signal is missing, or too little of both was logged.
    """
    if rate is None or attitude is None or min(rate.time_s.size, attitude.time_s.size) < 4:
        return None
    # First and last attitude sample (n, 2) of the intervals without a pause, and their block (n,).
    edges = np.concatenate(
        [np.zeros((0, _PER_BLOCK + 1), dtype=np.intp), *(_edges(attitude, each) for each in flights)]
    )
    edges = edges[:: -(-edges.shape[0] // _MOST_BLOCKS) or 1]
    pairs = np.stack([edges[:, :-1], edges[:, 1:]], axis=-1).reshape(-1, 2)
    block = np.repeat(np.arange(edges.shape[0]), _PER_BLOCK)
    start_s, end_s = attitude.time_s[pairs.T]
    longest_s = GAP_PERIODS * max(rate.period_s, attitude.period_s) + 1e-6
    good = (end_s > start_s) & (end_s - start_s < _LONGEST_BLOCK_S)
    good &= (start_s >= rate.time_s[0]) & (end_s <= rate.time_s[-1])
    for series in (rate, attitude):
        pauses = np.concatenate([[0], np.cumsum(np.diff(series.time_s) > longest_s)])
        last = series.time_s.size - 1
        before = np.maximum(np.searchsorted(series.time_s, start_s, side="right") - 1, 0)
        after = np.minimum(np.searchsorted(series.time_s, end_s), last)
        good &= pauses[before] == pauses[after]
    pairs, block = pairs[good], block[good]
    if np.unique(block).size < _FEWEST_BLOCKS:
        return None
    # Only what lies around the intervals: hours of flight or on the ground cost nothing.
    spans_s = attitude.time_s[pairs] + (-_LONGEST_BLOCK_S, _LONGEST_BLOCK_S)
    rates, attitudes = _rows_within(rate, spans_s), _rows_within(attitude, spans_s)
    fit = fit_gyro_to_attitude(
        rate.time_s[rates],
        rate.of_rows(rates),
        attitude.time_s[attitudes],
        unwrapped(attitude.of_rows(attitudes)),
        np.searchsorted(attitudes, pairs),
        block,
    )
    if fit is None or fit.start_s.size < _FEWEST_BLOCKS * _PER_BLOCK:
        return None
    return GyroCheck(length_s=_INTERVAL_S, **fit._asdict())


def _rows_within(series: CleanSeries, spans_s: FloatArray) -> IntArray:
    """Return the samples that lie in any of the spans (n_spans, 2), in order."""
    first, after = np.searchsorted(series.time_s, spans_s.T)
    change = np.bincount(first, minlength=series.time_s.size + 1)
    change -= np.bincount(after, minlength=series.time_s.size + 1)
    return np.flatnonzero(np.cumsum(change)[:-1] > 0)


def _edges(attitude: CleanSeries, flight: Interval) -> IntArray:
    """Return the attitude samples at the edges of the intervals of each block; shape (n_blocks, 5)."""
    end_s = min(flight[1], flight[0] + _LONGEST_S)
    count = np.arange(int((end_s - flight[0]) / (_PER_BLOCK * _SHORTEST * _INTERVAL_S)) + 1)
    length_s = _INTERVAL_S * (_SHORTEST + (_LONGEST - _SHORTEST) * np.modf(count * _GOLDEN)[0])
    start_s = flight[0] + _PER_BLOCK * (np.cumsum(length_s) - length_s)
    edges_s = start_s[:, None] + length_s[:, None] * np.arange(_PER_BLOCK + 1)
    found = np.searchsorted(attitude.time_s, edges_s[edges_s[:, -1] <= end_s])
    return np.asarray(found[found[:, -1] < attitude.time_s.size], dtype=np.intp)
