"""Whether something held the vehicle while its rotors ran: a test rig, a tether, a hand, the ground.

In the air the rotors push along body z, and the air resists slowly: quick tilts leave the accelerometer's
lateral readings alone. What is held feels gravity instead, by the sine of its tilt. And what the ground
carries feels one g, whatever the throttle is.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import FloatArray
from quadid_logs.maths.band import ComplexArray
from quadid_logs.vocabulary import GRAVITY_M_S2

#: Below, the drag of a nano quadrotor, whose speed decays in half a second, carries a fifth of it and more as
#: a hand would: k^2 / (k^2 + w^2). Above, vibration and the accelerometer's place outweigh gravity [Hz].
_BAND_HZ: Final = (0.7, 2.5)
#: Windows of so long resolve six lines of the band; samples are averaged over one step, which takes at least
#: three for a period of the band.
_WINDOW_S, _STEP_S, _STEPS_PER_PERIOD = 6.0, 0.02, 3.0
#: Neighbours of a Hann window's lines, and windows that overlap by half, are one measurement in about three.
_ALIKE: Final = 3.0
#: Gravity is felt whole or not at all: the interval lies above a half, and it explains most of what is felt
#: (measured: docs/method.md).
_FELT, _EXPLAINED = 0.5, 0.9
#: Of the interval: a motion of one frequency tells gravity from the accelerometer's place by chance.
_SIGMAS: Final = 3.0


#: Averages over one second leave no vibration; in 20 flights they range over 8 % of g and more, on the
#: ground over 4 % at most. A battery that empties from 4.2 to 3.5 V a cell raises the throttle of a still
#: hover by the square of that; one that moves by more moves the vehicle, too.
_MEAN_S, _FEWEST, _STEADY, _MOVED = 1.0, 5, 0.05, 1.45
_MOST_OF_TIME: Final = (0.05, 0.95)


def stayed_on_the_ground(force: CleanSeries, throttle: CleanSeries, start_s: float, end_s: float) -> bool:
    """Say whether the throttle moved between two times and the vehicle did not.

    Parameters
    ----------
    force : CleanSeries
        Specific force, FRD, in m/s^2.
    throttle : CleanSeries
        Of the largest.
    start_s, end_s : float

    Returns
    -------
    bool
        False where the log does not tell.
    """
    n_means = int((end_s - start_s) / _MEAN_S)
    n_least = min(
        part.stop - part.start for part in (each.within(start_s, end_s) for each in (force, throttle))
    )
    if not _FEWEST <= n_means <= n_least:
        return False
    edges = np.linspace(start_s, start_s + _MEAN_S * n_means, n_means + 1)
    given = _averages(throttle, 0, edges)
    # Whichever way up: a tail-sitter hovers along its body x.
    felt = np.linalg.norm([_averages(force, column, edges) for column in range(3)], axis=0)
    low, high = np.quantile(given, _MOST_OF_TIME)
    return bool(np.ptp(felt) < _STEADY * GRAVITY_M_S2 and high > _MOVED * low)


def is_held(force: CleanSeries, rate: CleanSeries, start_s: float, end_s: float) -> bool:
    """Say whether the accelerometer tilts with gravity between two times.

    Of each lateral axis, in the band, as spectra: a = s g (sine of the tilt) + d (angular acceleration), with
    the tilt as the integral of the body rate, s = 1 where the vehicle is held and 0 in the air, and d by how
    far the accelerometer is from where it turns about.

    Parameters
    ----------
    force : CleanSeries
        Specific force, FRD, in m/s^2.
    rate : CleanSeries
        Body rates [rad/s].
    start_s, end_s : float

    Returns
    -------
    bool
        False where the log does not tell.
    """
    inside = [each.within(start_s, end_s) for each in (force, rate)]
    n_least = min(part.stop - part.start for part in inside)
    length_s = end_s - start_s
    step_s = max(_STEP_S, length_s / max(n_least, 1))
    n_window = int(_WINDOW_S / step_s)
    n_steps = int(length_s / step_s)
    if step_s * _BAND_HZ[1] * _STEPS_PER_PERIOD > 1.0 or n_steps < n_window:
        return False
    edges = start_s + step_s * np.arange(n_steps + 1)
    frequency_hz = np.fft.rfftfreq(n_window, step_s)
    lines = (frequency_hz >= _BAND_HZ[0]) & (frequency_hz <= _BAND_HZ[1])
    turning = 2j * np.pi * frequency_hz[lines]
    felt, columns = [], []
    # Roll to the right brings the sky's side of body y down: -g sine; nose up brings body x up: +g sine.
    for number, (lateral, axis, sign) in enumerate(((1, 0, -1.0), (0, 1, 1.0))):
        spectra = [
            _spectra(_averages(each, column, edges), n_window)[:, lines]
            for each, column in ((force, lateral), (rate, axis))
        ]
        moved = np.zeros((spectra[1].size, 3), dtype=np.complex128)
        moved[:, 0] = (sign * GRAVITY_M_S2 * spectra[1] / turning).ravel()
        moved[:, 1 + number] = (spectra[1] * turning).ravel()
        felt.append(spectra[0].ravel())
        columns.append(moved)
    return _feels_gravity(_both_parts(np.vstack(columns)), _both_parts(np.concatenate(felt)))


def _feels_gravity(columns: FloatArray, felt: FloatArray) -> bool:
    """Say whether the first column is in what is felt, in full, and there is little else."""
    # An axis that never turns tells nothing of where the accelerometer is.
    size = np.sqrt(np.sum(columns**2, axis=0))
    moved = size > 0.0
    if not (moved[0] and np.isfinite(felt).all() and np.isfinite(size).all()):
        return False
    columns = columns[:, moved] / size[moved]
    covariance = columns.T @ columns
    if np.linalg.matrix_rank(covariance) < len(covariance):
        return False
    slopes = np.linalg.solve(covariance, columns.T @ felt)
    left = float(np.sum((felt - columns @ slopes) ** 2))
    n_free = len(felt) / _ALIKE - len(slopes)
    if n_free < 1.0 or left > (1.0 - _EXPLAINED) * float(felt @ felt):
        return False
    sigma = float(np.sqrt(np.linalg.inv(covariance)[0, 0] * left / n_free))
    return bool(slopes[0] - _SIGMAS * sigma > _FELT * size[0])


def _averages(series: CleanSeries, column: int, edges: FloatArray) -> FloatArray:
    """Return the mean of a column between each two edges (n + 1,), by the integral of its broken line."""
    near = series.within(edges[0], edges[-1])
    time_s, values = series.time_s[near], series.of_rows(near)[:, column]
    known = np.isfinite(values)
    time_s, values = time_s[known], values[known]
    if time_s.size < 2:
        return np.full(edges.size - 1, np.nan)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))])
    return np.asarray(np.diff(np.interp(edges, time_s, area)) / np.diff(edges), dtype=np.float64)


def _spectra(values: FloatArray, n_window: int) -> ComplexArray:
    """Return the spectra of windows that overlap by half, (n_windows, n_lines)."""
    starts = np.arange(0, values.size - n_window + 1, n_window // 2)
    windows = values[starts[:, np.newaxis] + np.arange(n_window)]
    taper = np.hanning(n_window)
    return np.fft.rfft((windows - windows.mean(axis=1, keepdims=True)) * taper, axis=1)


def _both_parts(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])
