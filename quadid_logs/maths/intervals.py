"""Which times lie in intervals, however many there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray


def inside(time_s: FloatArray, intervals: Sequence[tuple[float, float]]) -> BoolArray:
    """Mark the times that lie in one of the intervals, ends included.

    A time lies in as many intervals as have begun by then and not ended before. Counted so, memory and time
    go with the times and not with times by intervals: a log may hold thousands of flights.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        [s].
    intervals : sequence of (start_s, end_s)

    Returns
    -------
    ndarray of bool, shape (n,)

    Examples
    --------
    >>> inside(np.array([0.0, 1.0, 2.0, 3.0]), [(1.0, 2.0), (5.0, 6.0)]).tolist()
    [False, True, True, False]
    """
    if not intervals:
        return np.zeros(time_s.shape, dtype=np.bool_)
    starts, ends = (np.sort(bound) for bound in np.transpose(intervals))
    begun = np.searchsorted(starts, time_s, side="right")
    ended = np.searchsorted(ends, time_s, side="left")
    return np.asarray(np.isfinite(time_s) & (begun > ended), dtype=np.bool_)
