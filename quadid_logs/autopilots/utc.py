"""What the time of day was: the difference between UTC and the log's clock."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray

#: No flight log is from before 2001, none yet from after 2100; receivers without a fix send 1980 or 1970.
_EARLIEST_S, _LATEST_S = 978_307_200.0, 4_102_444_800.0
#: 1980-01-06, the beginning of GPS time, as seconds since 1970.
_GPS_EPOCH_S: Final = 315_964_800.0
_WEEK_S: Final = 604_800.0
#: GPS time is ahead of UTC by the leap seconds since 1980: 18 since 2017, 15 to 17 in older logs.
_LEAP_S: Final = 18.0


def utc_offset_s(utc_s: FloatArray, log_s: FloatArray) -> float:
    """Return UTC minus the log's clock [s], NaN where no row tells the date.

    Parameters
    ----------
    utc_s : ndarray, shape (n_rows,)
        Seconds since 1970 as the receiver sent them, implausible ones included.
    log_s : ndarray, shape (n_rows,)
        The same rows on the log's clock [s].

    Returns
    -------
    float
        The median, which neither late messages nor damaged ones move.

    Examples
    --------
    >>> import numpy as np
    >>> utc_offset_s(np.array([0.0, 1.6e9, 1.6e9 + 1.0]), np.array([4.0, 10.0, 11.0]))
    1599999990.0
    """
    told = (utc_s > _EARLIEST_S) & (utc_s < _LATEST_S) & np.isfinite(log_s)
    return float(np.median(utc_s[told] - log_s[told])) if told.any() else float("nan")


def gps_utc_s(week: FloatArray, time_of_week_s: FloatArray) -> FloatArray:
    """Return seconds since 1970 of GPS time, which counts weeks since 1980 and seconds in the week.

    >>> float(gps_utc_s(np.array([2200.0]), np.array([0.0]))[0])
    1646524782.0
    """
    return np.asarray(_GPS_EPOCH_S + _WEEK_S * week + time_of_week_s - _LEAP_S, dtype=np.float64)
