"""One clock for a log that may have rebooted, jumped, or logged rows out of order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import Signal

#: Logged rows are out of order by at most some 100 ms; time falling by more is a reboot [s].
RESET_S = 1.0
#: A longer pause than any battery lasts is a clock that was set, not a flight [s].
JUMP_S = 3600.0
#: A single stamp this far from both its neighbours in the file is damaged [s].
OUTLIER_S = 5.0
#: Neighbours on each side that a stamp is compared with. Four outvote a burst
#: of three damaged rows, and a reboot still has a clean edge.
_NEIGHBOURS = 4
#: Stamps that are looked at together: less than a second of a log that is worth the effort.
_STAMPS = 1024
#: Rows that are compared with the clock at once.
_ROWS = 1 << 14
#: Logged when they change, not periodically: too few rows to vote on the clock.
EVENTS = frozenset({"armed", "landed"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clock:
    """The epochs of a log: parts of the file over which its clock ran on.

    Attributes
    ----------
    start_position : ndarray of int64, shape (n_epochs,)
        Where in the file each epoch begins; the first is minimal.
    first_s, last_s : ndarray, shape (n_epochs,)
        Earliest and latest logged time of each epoch [s].
    shift_s : ndarray, shape (n_epochs,)
        To be added to logged times, so that every epoch follows the one before.
    position, time_s : ndarray, shape (n_rows,)
        Every believable row of the log: what the clock showed where in the file.
    """

    start_position: IntArray
    first_s: FloatArray
    last_s: FloatArray
    shift_s: FloatArray
    position: IntArray
    time_s: FloatArray

    @property
    def n_resets(self) -> int:
        """How often the clock fell or jumped."""
        return len(self.start_position) - 1

    def epoch_of(self, position: IntArray) -> IntArray:
        """Return the epoch that each file position lies in.

        Parameters
        ----------
        position : ndarray of int64, shape (n,)
            Byte offsets.

        Returns
        -------
        ndarray of int64, shape (n,)
            Numbers of epochs, from 0.
        """
        return np.clip(np.searchsorted(self.start_position, position, side="right") - 1, 0, None)

    def common_time(self, time_s: FloatArray, position: IntArray) -> FloatArray:
        """Bring logged times onto the common clock.

        Parameters
        ----------
        time_s, position : ndarray, shape (n,)
            As of `Rows`.

        Returns
        -------
        ndarray, shape (n,)
            [s]; the same array where the clock was never reset.
        """
        return time_s + self.shift_s[self.epoch_of(position)] if self.n_resets else time_s

    def is_outlier(self, time_s: FloatArray, position: IntArray, tolerance_s: float) -> BoolArray:
        """Mark stamps that are not finite or far from what the clock showed at that place in the file.

        Parameters
        ----------
        time_s, position : ndarray, shape (n,)
            As of `Rows`.
        tolerance_s : float

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        if self.time_s.size == 0:
            return ~np.isfinite(time_s)
        bad = np.empty(time_s.shape, dtype=bool)
        # In parts, which stay in the processor's cache.
        for first in range(0, time_s.size, _ROWS):
            part = slice(first, first + _ROWS)
            # Looked up in the part of the rows that holds all these places.
            places = position[part]
            low, high = np.searchsorted(self.position, [places.min(), places.max()])
            row = np.searchsorted(self.position[low : high + 1], places) + low
            nearest = np.minimum(row, self.position.size - 1)
            with np.errstate(invalid="ignore"):  # damage makes signalling NaN
                off = np.abs(time_s[part] - self.time_s[nearest])
                before = np.abs(time_s[part] - self.time_s[np.maximum(nearest - 1, 0)])
            # At a reset the rows on either side disagree: being near one of them is enough.
            bad[part] = ~(np.minimum(off, before) <= tolerance_s)
        return bad

    def time_at(self, time_s: float, position: int) -> float:
        """Bring one logged time onto the common clock."""
        return float(self.common_time(np.array([time_s]), np.array([position]))[0])


def find_clock(signals: Iterable[Signal]) -> Clock:
    """Split a log where its clock fell (a reboot) or jumped ahead.

    All signals vote together in file order: one late row is out of order, but
    when every row from here on is earlier than every row before, the clock
    was reset.

    Parameters
    ----------
    signals : iterable of Signal
        Those of one message have the same rows, which vote once.

    Returns
    -------
    Clock
    """
    # Positions and times of all signals in file order, each message counted once.
    periodic = (signal.rows for signal in signals if signal.name not in EVENTS)
    distinct = dict.fromkeys(rows for rows in periodic if rows.n_samples)
    if not distinct:
        position, time_s = np.zeros(0, np.int64), np.zeros(0)
    else:
        position = np.concatenate([rows.position for rows in distinct])
        time_s = np.concatenate([rows.time_s for rows in distinct])
        order = np.argsort(position, kind="stable")
        position, time_s = position[order], time_s[order]
    bad = is_outlier(time_s, OUTLIER_S)
    position, time_s = position[~bad], time_s[~bad]
    if time_s.size == 0:
        zero = np.zeros(1)
        nowhere = np.zeros(0, np.int64)
        return Clock(
            start_position=np.zeros(1, np.int64),
            first_s=zero,
            last_s=zero,
            shift_s=zero,
            position=nowhere,
            time_s=np.zeros(0),
        )
    starts = np.concatenate([[0], _breaks(time_s)])
    first_s = np.minimum.reduceat(time_s, starts)
    last_s = np.maximum.reduceat(time_s, starts)
    shift_s = np.zeros(len(starts))
    for epoch in range(1, len(starts)):
        # One second apart: enough to be a gap at every rate that can be used.
        shift_s[epoch] = last_s[epoch - 1] + shift_s[epoch - 1] + 1.0 - first_s[epoch]
    return Clock(
        start_position=position[starts],
        first_s=first_s,
        last_s=last_s,
        shift_s=shift_s,
        position=position,
        time_s=time_s,
    )


def is_outlier(time_s: FloatArray, tolerance_s: float) -> BoolArray:
    """Mark stamps that are not finite or far from the median of their neighbours in the file.

    At a pause or a reset a good stamp has its neighbours of one side within
    reach, so it stays.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        In the order of the file.
    tolerance_s : float

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    finite = np.isfinite(time_s)
    if np.count_nonzero(finite) <= 2 * _NEIGHBOURS:
        return ~finite
    bad = ~finite
    known = time_s if finite.all() else time_s[finite]
    found = []
    for first in range(0, known.size, _STAMPS):
        after = min(first + _STAMPS, known.size)
        near = known[np.clip(np.arange(first - _NEIGHBOURS, after + _NEIGHBOURS), 0, known.size - 1)]
        far = np.zeros(after - first, bool)
        # Almost always all are near, and a median takes long.
        if np.ptp(near) > tolerance_s:
            around = np.lib.stride_tricks.sliding_window_view(near, 2 * _NEIGHBOURS + 1)
            far = np.abs(known[first:after] - np.median(around, axis=1)) > tolerance_s
        found.append(far)
    bad[finite] = np.concatenate(found)
    return bad


def _breaks(time_s: FloatArray) -> IntArray:
    """Return the indices at which a new epoch begins."""
    n = 2 * _NEIGHBOURS
    if time_s.size < 2:
        return np.zeros(0, np.int64)
    # Almost all rows are in order: look closely only where the clock moved a lot.
    step = np.diff(time_s)
    candidate = np.flatnonzero((step < -RESET_S) | (step > JUMP_S))
    before = time_s[np.clip(candidate[:, np.newaxis] - np.arange(n), 0, None)]
    after = time_s[np.clip(candidate[:, np.newaxis] + 1 + np.arange(n), None, time_s.size - 1)]
    fell = after.max(axis=1) < before.min(axis=1) - RESET_S
    jumped = after.min(axis=1) > before.max(axis=1) + JUMP_S
    return np.asarray(candidate[fell | jumped] + 1, dtype=np.int64)
