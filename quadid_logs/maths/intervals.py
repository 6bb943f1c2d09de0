"""Which times lie in intervals, however many there are, and which follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, runs

#: A longer step than so many typical ones is a gap.
_GAP: Final = 3.0


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


def following_rows(time_s: FloatArray, usable: BoolArray) -> tuple[slice, float]:
    """Return the longest run of usable rows without a gap or a repeated stamp.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        In file order [s].
    usable : ndarray of bool, shape (n,)

    Returns
    -------
    rows : slice
        Empty where no two usable rows follow each other.
    typical_s : float
        The median step between usable rows [s], 0 where there is none.

    Examples
    --------
    >>> following_rows(np.array([0.0, 1.0, 2.0, 9.0, 10.0]), np.ones(5, dtype=bool))
    (slice(0, 3, None), 1.0)
    """
    step_s = np.diff(time_s)
    both = usable[1:] & usable[:-1]
    forward = step_s[(step_s > 0.0) & both]
    typical_s = float(np.median(forward)) if forward.size else 0.0
    joined = (step_s > 0.0) & (step_s < _GAP * typical_s) & both
    first, end = max(runs(joined), key=lambda run: run[1] - run[0], default=(0, -1))
    return slice(first, end + 1), typical_s
