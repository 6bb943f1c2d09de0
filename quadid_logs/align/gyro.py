"""Hold the body rates of the flights against the attitude of the same flights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.align.series import GAP_PERIODS, CleanSeries, Interval
from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import GyroCheck
from quadid_logs.maths.gyro_attitude import fit_gyro_to_attitude
from quadid_logs.maths.rotations import unwrapped

#: Long enough for the noise of an angle to be small against its change, short enough for the
#: corrections by compass and GPS, which no gyro shows, to be small too.
_INTERVAL_S = 1.0
#: Five minutes of flight say all that the check can say; it stays as quick on an hour.
_MOST_INTERVALS = 300
#: A clock that jumped far ahead must not cost memory: no flight lasts a week.
_LONGEST_S = 7.0 * 86_400.0
#: Three equations each, for thirteen unknowns, and still enough to tell a habit from an accident.
_FEWEST_INTERVALS = 20


def check_gyro(
    rate: CleanSeries | None,
    attitude: CleanSeries | None,
    flights: Sequence[Interval],
) -> GyroCheck | None:
    """Fit the body rates to the change of attitude over intervals of a second.

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
    pairs = _intervals(rate, attitude, flights)
    if pairs.shape[0] < _FEWEST_INTERVALS:
        return None
    # Only what lies around the intervals: hours of flight or on the ground cost nothing.
    spans_s = attitude.time_s[pairs] + (-_INTERVAL_S, _INTERVAL_S)
    rates, attitudes = _rows_within(rate, spans_s), _rows_within(attitude, spans_s)
    fit = fit_gyro_to_attitude(
        rate.time_s[rates],
        rate.values[rates],
        attitude.time_s[attitudes],
        unwrapped(attitude.values[attitudes]),
        np.searchsorted(attitudes, pairs),
    )
    if fit is None or fit.start_s.size < _FEWEST_INTERVALS:
        return None
    return GyroCheck(length_s=_INTERVAL_S, **fit._asdict())


def _intervals(rate: CleanSeries, attitude: CleanSeries, flights: Sequence[Interval]) -> IntArray:
    """Return first and last attitude sample of intervals in the air that neither signal pauses in."""
    edges = [_edges(attitude, flight) for flight in flights]
    pairs = np.concatenate(
        [np.column_stack([each[:-1], each[1:]]) for each in edges if each.size > 1]
        or [np.zeros((0, 2), dtype=np.intp)]
    )
    start_s, end_s = attitude.time_s[pairs.T]
    longest_s = GAP_PERIODS * max(rate.period_s, attitude.period_s) + 1e-6
    good = (end_s - start_s < 1.5 * _INTERVAL_S) & (start_s >= rate.time_s[0]) & (end_s <= rate.time_s[-1])
    for series in (rate, attitude):
        pauses = np.concatenate([[0], np.cumsum(np.diff(series.time_s) > longest_s)])
        last = series.time_s.size - 1
        before = np.maximum(np.searchsorted(series.time_s, start_s, side="right") - 1, 0)
        after = np.minimum(np.searchsorted(series.time_s, end_s), last)
        good &= pauses[before] == pauses[after]
    kept = pairs[good]
    return np.asarray(kept[:: -(-kept.shape[0] // _MOST_INTERVALS) or 1], dtype=np.intp)


def _rows_within(series: CleanSeries, spans_s: FloatArray) -> IntArray:
    """Return the samples that lie in any of the spans (n_spans, 2), in order."""
    first, after = np.searchsorted(series.time_s, spans_s.T)
    change = np.bincount(first, minlength=series.time_s.size + 1)
    change -= np.bincount(after, minlength=series.time_s.size + 1)
    return np.flatnonzero(np.cumsum(change)[:-1] > 0)


def _edges(attitude: CleanSeries, flight: Interval) -> IntArray:
    """Return the attitude sample that comes first in each second of the flight."""
    end_s = min(flight[1], flight[0] + _LONGEST_S)
    found = np.searchsorted(attitude.time_s, np.arange(flight[0], end_s, _INTERVAL_S))
    return np.asarray(np.unique(found[found < attitude.time_s.size]), dtype=np.intp)
