"""One clock for a MAVLink log: seconds since the autopilot booted.

Messages carry `time_boot_ms` (since boot), `time_usec` (since boot or since
1970, sometimes only 32 bits wide) or no time at all; the host's stamps can run
wrong by factors and are used only where nothing else is there.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.containers.content import time_before

BOOT_MS: Final = "time_boot_ms"
USEC: Final = "time_usec"
_EPOCH_S: Final = 1e9
"""Later than any autopilot's uptime (31 years), earlier than any flight's date (2001)."""
_WRAP_S: Final = 2.0**32 * 1e-6
_RESET_S: Final = 1.0
"""The clock falls by more than messages can be out of order: the autopilot booted again."""


class BootClock(NamedTuple):
    """The boot clock as the messages with own time show it: byte offset and time, in file order."""

    position: IntArray
    time_s: FloatArray

    def at(self, position: IntArray) -> FloatArray:
        """Return the time at places in the file: that of the last message with own time before them [s]."""
        return time_before(position, self.position, self.time_s)


def merge_clocks(clocks: list[BootClock]) -> BootClock:
    """Put the clocks of several messages in file order."""
    if not clocks:
        return BootClock(np.zeros(0, np.int64), np.zeros(0))
    position = np.concatenate([clock.position for clock in clocks])
    time_s = np.concatenate([clock.time_s for clock in clocks])
    order = np.argsort(position, kind="stable")
    return BootClock(position[order], time_s[order])


def boot_ms_s(boot_ms: AnyArray) -> FloatArray:
    """Return milliseconds since boot in seconds; zero means not filled in and becomes NaN.

    Parameters
    ----------
    boot_ms : ndarray of unsigned integers, shape (n_rows,)

    Returns
    -------
    ndarray, shape (n_rows,)
        [s].
    """
    return np.where(boot_ms > 0, boot_ms / 1e3, np.nan)


def usec_to_boot_s(usec: AnyArray, position: IntArray, clock: BootClock) -> FloatArray:
    """Bring a message's microseconds to the boot clock.

    A 32-bit counter is continued over its wraps (every 71.6 min). Times since
    1970 are shifted by the median of their distance to the boot clock, between
    two boots each; the messages' own spacing stays.

    Parameters
    ----------
    usec : ndarray of unsigned integers, shape (n_rows,)
        Zero means not filled in.
    position : ndarray of int64, shape (n_rows,)
        Byte offsets, rising.

    Returns
    -------
    ndarray, shape (n_rows,)
        Seconds since boot; NaN where not filled in.
    """
    time_s = np.where(usec > 0, usec.astype(np.float64) / 1e6, np.nan)
    near_s = clock.at(position)
    if usec.dtype.itemsize == 4:
        wraps = np.round((near_s - time_s) / _WRAP_S)
        return time_s + np.where(np.isfinite(wraps), wraps, 0.0) * _WRAP_S
    since_epoch = time_s > _EPOCH_S
    if not since_epoch.any() or not len(clock.position):
        return time_s
    boot = np.cumsum(np.append(False, np.diff(near_s) < -_RESET_S))
    for k in np.unique(boot[since_epoch]):
        chosen = since_epoch & (boot == k)
        time_s[chosen] -= np.median(time_s[chosen] - near_s[chosen])
    return time_s
