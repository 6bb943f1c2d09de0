"""The excitation of Betaflight's chirp mode, from the fields of its debug mode.

Source: ``common/chirp.c``, ``pid.c``. From f0 on the frequency rises by the same factor every second,
x = cos(phase), times the frequency where that is below 1 Hz. Since 2026.6 the log holds phase, axis,
frequency and x; 2025.12 holds the phase alone, modulo 2 pi, and 0 outside of a run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray

#: From which frequency to which, in tenths of a hertz, and for how long.
SWEEP_SETTINGS: Final = (
    "chirp_frequency_start_deci_hz",
    "chirp_frequency_end_deci_hz",
    "chirp_time_seconds",
)
_EXCITATION_ONE, _PHASE_ONE = 1000.0, 5000.0
#: The logged excitation and the cosine of the logged phase agree to the rounding of both.
_ROUNDING: Final = 2e-3
#: Below, the excitation shrinks with the frequency [Hz].
_FULL_HZ: Final = 1.0
#: Slopes of the phase over the frequencies that follow from it: 1 in a chirp, but for rounding and the clock.
_OFF: Final = 0.1
#: A phase of 0 inside of a run is one that was rounded, for a row or two.
_ROUNDED_ROWS: Final = 2
#: Fewer rows tell no chirp from noise.
_FEWEST_ROWS: Final = 100


class Sweep(NamedTuple):
    """From which to which frequency [Hz] a run goes, and for how long [s]."""

    begin_hz: float
    end_hz: float
    duration_s: float

    @property
    def growth_hz_per_rad(self) -> float:
        """By how much the frequency rises with the phase: the law is linear in it."""
        return math.log(self.end_hz / self.begin_hz) / (2.0 * math.pi * self.duration_s)


def sweep_of(texts: Mapping[str, str]) -> Sweep | None:
    """Return the sweep that a header's settings make, None in a build without the mode."""
    cells = [texts.get(name, "").strip() for name in SWEEP_SETTINGS]
    if not all(cell.isdecimal() and len(cell) < 7 for cell in cells):
        return None
    begin, end, duration = map(int, cells)
    return Sweep(begin / 10.0, end / 10.0, float(duration)) if 0 < begin < end and duration > 0 else None


def excitation(debug: FloatArray, time_s: FloatArray, sweep: Sweep) -> FloatArray | None:
    """Return the chirp before the lead-lag that shapes it [1], 0 outside of a run; None if it is none.

    Parameters
    ----------
    debug : ndarray, shape (n_rows, 4)
        The first fields of the debug mode, whichever it is.
    time_s : ndarray, shape (n_rows,)

    Returns
    -------
    ndarray, shape (n_rows,), or None
        The number of the debug mode changes from version to version, so the fields themselves have to tell.
    """
    return _of_phase(debug[:, 0], time_s, sweep) if not debug[:, 1:].any() else _as_logged(debug)


def _as_logged(debug: FloatArray) -> FloatArray | None:
    """Take the logged excitation where it is the cosine of the logged phase."""
    phase, axis, _, logged = debug.T
    runs = axis >= 0.0
    if not runs.any() or not np.isin(axis, (-1.0, 0.0, 1.0, 2.0)).all():
        return None
    off = np.abs(np.cos(phase / _PHASE_ONE) - logged / _EXCITATION_ONE)[runs]
    if np.median(off) > _ROUNDING:
        return None
    return np.asarray(np.where(runs, logged / _EXCITATION_ONE, 0.0))


def _of_phase(phase: FloatArray, time_s: FloatArray, sweep: Sweep) -> FloatArray | None:
    """Make the excitation from the phase of each run."""
    found, rows = np.zeros(len(phase)), np.flatnonzero(phase)
    if not rows.size:
        return None
    if phase.min(initial=0.0) < 0.0 or phase.max(initial=0.0) > 2.0 * math.pi * _PHASE_ONE + 1.0:
        return None
    cuts = np.flatnonzero(np.diff(rows) > _ROUNDED_ROWS + 1)
    for begin, end in zip(rows[np.append(0, cuts + 1)], rows[np.append(cuts, -1)], strict=True):
        if end - begin < _FEWEST_ROWS:
            continue
        run = slice(begin, end + 1)
        made = _run(phase[run].astype(np.float64) / _PHASE_ONE, time_s[run], sweep)
        if made is None:
            return None
        found[run] = made
    return found if found.any() else None


def _run(phase: FloatArray, time_s: FloatArray, sweep: Sweep) -> FloatArray | None:
    """Return cos(phase), less below 1 Hz; None where the phase does not run as that of the sweep does."""
    period_s = float(np.median(np.diff(time_s)))
    whole = np.unwrap(phase)
    # Faster than half the rows' rate the phase cannot be counted any more: what was reached stays.
    frequency_hz = np.maximum.accumulate(sweep.begin_hz + sweep.growth_hz_per_rad * whole)
    slope_hz = np.gradient(whole, time_s) / (2.0 * math.pi)
    slow = frequency_hz * period_s < 0.25
    if not slow.any() or not abs(float(np.median(slope_hz[slow] / frequency_hz[slow])) - 1.0) < _OFF:
        return None
    return np.asarray(np.cos(phase) * np.minimum(frequency_hz / _FULL_HZ, 1.0))
