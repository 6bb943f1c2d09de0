"""How fast and how well damped the attitude follows, and how much a disturbance of it is raised at most."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.band import ComplexArray

#: Slower, only pilots and wind are [Hz].
_LOWEST_HZ: Final = 0.05
#: The bandwidth ends where 45 degrees are left to -180, or 3 dB are lost (ADS-33E-PRF 3.3.2.1, the lower).
_PHASE_DEG: Final = -135.0
_GAIN: Final = 0.5**0.5


class Attitude(NamedTuple):
    """Bandwidths of answers to the set-point [Hz]; highest gain from a disturbance to what is left of it.

    All of shape (n_loops,). ``peak_db`` is the disturbance rejection peak; minus infinity where no angle loop
    is known. ``resonance_db`` is the highest gain of the rate's and of the attitude's answer to set-points.
    """

    bandwidth_hz: FloatArray
    peak_db: FloatArray
    resonance_db: FloatArray


def attitude_of(
    frequency_hz: FloatArray, rate: ComplexArray, full: ComplexArray | None, to_rate: ComplexArray
) -> Attitude:
    """Return bandwidth and disturbance rejection peak of attitudes.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Rising.
    rate, full : ndarray of complex, shape (n_loops, n_frequencies)
        Open loops, see `quadid_logs.control.loop.Loop`; full is None where no angle loop is known.
    to_rate : ndarray of complex, shape (n_loops, n_frequencies)
        The open answer of the rate to its set-point.

    Returns
    -------
    Attitude
        Of the rate's answer to its set-point where no angle loop is known.

    Notes
    -----
    The attitude's answer to its set-point is A / (1 + L), A being what the angle loop adds to the whole loop
    L: what a disturbance of the attitude leaves is (1 + L - A) / (1 + L) (Blanken et al., "Test Guide for
    ADS-33E-PRF", disturbance rejection).
    """
    turns = to_rate / (1.0 + rate)
    follows, peak_db = turns, np.full(len(rate), -np.inf)
    if full is not None:
        whole = 1.0 + full
        follows = (full - rate) / whole
        peak_db = _highest_db((1.0 + rate) / whole)
    resonance_db = np.maximum(_highest_db(turns), _highest_db(follows))
    return Attitude(bandwidth_hz(frequency_hz, follows), peak_db, resonance_db)


def resonance_db(damping_ratio: float) -> float:
    """Return the highest gain of a second-order answer of unit gain at rest.

    Parameters
    ----------
    damping_ratio : float
        Below the root of one half.

    Returns
    -------
    float
        1 / (2 z sqrt(1 - z^2)) [dB].
    """
    return -20.0 * math.log10(2.0 * damping_ratio * math.sqrt(1.0 - damping_ratio**2))


def _highest_db(answers: ComplexArray) -> FloatArray:
    """Return the highest gain of answers (n_loops, n_frequencies) [dB]."""
    return np.asarray(20.0 * np.log10(np.max(np.abs(answers), axis=1)), dtype=np.float64)


def bandwidth_hz(frequency_hz: FloatArray, follows: ComplexArray) -> FloatArray:
    """Return up to where answers follow their set-points.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Rising.
    follows : ndarray of complex, shape (n_loops, n_frequencies)

    Returns
    -------
    ndarray, shape (n_loops,)
        Where 45 degrees are left to -180, or 3 dB are lost [Hz].
    """
    looked_at = frequency_hz >= _LOWEST_HZ
    some, follows = frequency_hz[looked_at], follows[:, looked_at]
    late_hz = _first_below(some, np.degrees(np.unwrap(np.angle(follows))), _PHASE_DEG)
    weak_hz = _first_below(some, np.log(np.abs(follows)), np.log(_GAIN))
    return np.minimum(late_hz, weak_hz)


def _first_below(frequency_hz: FloatArray, values: FloatArray, level: float) -> FloatArray:
    """Return where values first fall below a level, between two frequencies; the last one for nowhere.

    Values are of shape (n_loops, n_frequencies).
    """
    below = values < level
    after = np.maximum(np.argmax(below, axis=1), 1)
    row = np.arange(len(values))
    above, under = values[row, after - 1] - level, values[row, after] - level
    place = np.clip(above / (above - under), 0.0, 1.0)
    found_hz = frequency_hz[after - 1] * (frequency_hz[after] / frequency_hz[after - 1]) ** place
    return np.asarray(np.where(below.any(axis=1), found_hz, frequency_hz[-1]))
