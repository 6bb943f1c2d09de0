"""Which of the filters that an autopilot's parameters tell change the logged body rates."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from quadid_logs.data.log import GyroFilter, Notch, Places

#: A notch below is no vibration's, and one above moves nothing that is fitted.
_RANGE_HZ: Final = (5.0, 2000.0)
#: One narrower than this fraction of its frequency delays what is slower by less than a microsecond.
_LEAST_INVERSE_Q: Final = 1e-6


def gyro_filter(low_pass_hz: float, notches: Iterable[Notch], tracked: Iterable[Places] = ()) -> GyroFilter:
    """Return the filters that change anything.

    Parameters
    ----------
    low_pass_hz : float
        Cut-off of a low-pass of second order; what is not positive and finite counts as none.
    notches : iterable of Notch
        Of any numbers: parameters hold NaN, infinities and negative widths.
    tracked : iterable of Places
        Groups of notches that moved, of any numbers too.
    """
    groups = (tuple(_felt(each) for each in instants) for instants in tracked)
    return GyroFilter(
        float(low_pass_hz) if 0.0 < low_pass_hz < math.inf else math.nan,
        _felt(notches),
        tuple(instants for instants in groups if any(instants)),
    )


def _felt(notches: Iterable[Notch]) -> tuple[Notch, ...]:
    return tuple(
        notch
        for notch in notches
        if _RANGE_HZ[0] <= notch.frequency_hz <= _RANGE_HZ[1]
        and _LEAST_INVERSE_Q <= notch.inverse_q < math.inf
        and notch.depth < 1.0
    )
