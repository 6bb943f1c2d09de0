"""What lies between torque and angular acceleration: rotors and filters, or nothing.

A torque goes through rotors, and the motion through the filter of a gyro: acceleration comes later than the
torque, and fast torque has less of an effect. A torque that was computed from the rates has neither, at any
rate of the log: phase and gain are looked at in hertz, where rotors matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import Segment
from quadid_logs.data.model import TorquePath
from quadid_logs.maths.band import ComplexArray, angular_frequency
from quadid_logs.maths.normal import NORMAL_95

#: Windows tell half a hertz apart; they overlap by half.
_WINDOW_S: Final = 2.0
#: Standard errors come from so many windows, or there are none; Student's distribution knows how few. Of
#: seven seconds of 140 flights none looks computed, and with a derivative of the rates as torque all do.
_FEWEST_WINDOWS: Final = 4
#: The variance of a sum over windows that overlap by half, over that of independent ones: spectra of
#: neighbours correlate by 1/36 (P. D. Welch, IEEE Trans. Audio Electroacoust., vol. 15, 1967).
_OVERLAP: Final = 1.0 + 2.0 / 36.0
#: Below, air and tilt move a vehicle; above, frames bend [Hz]. A lag of 10 ms turns the phase by 7 degrees at
#: the lower edge, and by 51 degrees at the upper one.
_BAND_HZ: Final = (2.0, 20.0)
#: Up to this fraction of the sample rate, linear interpolation keeps at least 0.7 of the gain.
_MOST_OF_RATE: Final = 0.25
#: Two octaves tell a lag from a constant phase.
_NARROWEST_BAND: Final = 4.0
#: Half a step of a loop of 400 Hz and the filter of a gyro at 250 Hz: even the speeds of rotors are
#: followed by what the gyro shows no sooner (by 3 to 7 ms on flown vehicles) [s].
_LEAST_LAG_S: Final = 2e-3
#: Judged, no source: a rotor is taken to lag by 10 ms at least. Its lag takes half of its square from the
#: gain; half of that roll-off is between such a rotor and none [s^2].
_LEAST_ROLL_OFF_S2: Final = 0.25 * 0.01**2
#: The lags of rotors lie within so much, one as likely as another [s].
_LAGS_S: Final = 0.03
_TINY: Final = float(np.finfo(np.float64).tiny)
#: Advances of the torque that are tried, before Newton's steps from the best [s].
_ADVANCES_S: Final = np.linspace(-0.12, 0.12, 121)
_NEWTON_STEPS: Final = 8


def torque_path(segments: Sequence[Segment], axis: int, period_s: float) -> TorquePath | None:
    """Measure lag and roll-off from one torque to its acceleration.

    Parameters
    ----------
    segments : sequence of Segment
    axis : int
    period_s : float
        Between samples [s].

    Returns
    -------
    TorquePath or None
        None where the log is too short or too slow for it, or holds nothing in the band.

    Notes
    -----
    With the torque u advanced by the lag, acceleration is b (u + c u''), by least squares over the lines of
    the band, each divided by its power of acceleration; the lag is where u' explains nothing more. Standard
    errors are those of the jackknife over windows. The null hypothesis is a torque that acts through
    something: a lag of `_LEAST_LAG_S` or more, or a roll-off of `_LEAST_ROLL_OFF_S2` or more. The
    p-value is the larger one of the two, by Student's distribution. The difference to the next sample comes
    half a sample before the acceleration: a lag of just that is no rotor's where so near a lag, and so little
    left of the motion (gusts, noise), would come together by chance.
    """
    lines = _Lines.of(segments, axis, period_s)
    if lines is None:
        return None
    advance_s = lines.best_of(_ADVANCES_S)
    for _ in range(_NEWTON_STEPS):
        theta, error, explained = lines.polynomial(advance_s)
        advance_s += theta[1]
    if not (np.isfinite([*theta, *error, advance_s]).all() and (error[1:] > 0.0).all()):
        return None
    # Rates that are interpolated half-way between samples lose cos(omega T / 2) of their gain.
    allowed_s2 = _LEAST_ROLL_OFF_S2 + period_s**2 / 8.0
    freedom = len(lines.torque) - 1
    # That a rotor's lag is so near to half a sample, with so little left of the motion. Of two independent
    # p-values, by Fisher's method: their product k is below k (1 - ln k) of the cases.
    distance_s = float(abs(advance_s + 0.5 * period_s) + NORMAL_95 * error[1])
    both = min(2.0 * distance_s / _LAGS_S, 1.0) * min(max(1.0 - explained, _TINY), 1.0)
    no_lag = min(_tail(float((_LEAST_LAG_S + advance_s) / error[1]), freedom), both * (1.0 - math.log(both)))
    no_roll_off = _tail(float((allowed_s2 - theta[2]) / error[2]), freedom)
    # Where the steps do not settle, no lag describes the phase: it is no path, and not none either.
    settled = abs(theta[1]) < error[1]
    return TorquePath(
        lag_s=-float(advance_s),
        lag_error_s=float(error[1]),
        roll_off_s2=float(theta[2]),
        roll_off_error_s2=float(error[2]),
        explained=explained,
        p_value=max(no_lag, no_roll_off) if settled else 1.0,
    )


def _tail(deviation: float, freedom: int) -> float:
    """Return the probability that Student's t exceeds a deviation."""
    from scipy.special import stdtr

    return float(stdtr(freedom, -deviation))


class _Lines(NamedTuple):
    """Spectral lines in the band: torque and acceleration (n_windows, n_lines), ``weight`` and ``s``."""

    s: ComplexArray
    torque: ComplexArray
    acceleration: ComplexArray
    weight: FloatArray

    @classmethod
    def of(cls, segments: Sequence[Segment], axis: int, period_s: float) -> _Lines | None:
        """Return the lines of all windows; None where there are too few, or no power in one of them."""
        n_samples = round(_WINDOW_S / period_s)
        highest_hz = min(_BAND_HZ[1], _MOST_OF_RATE / period_s)
        windows = [
            each.rows(slice(first, first + n_samples))
            for each in segments
            for first in range(0, each.n_samples - n_samples + 1, n_samples // 2)
        ]
        if len(windows) < _FEWEST_WINDOWS or highest_hz < _NARROWEST_BAND * _BAND_HZ[0]:
            return None
        s = angular_frequency(n_samples, period_s)
        inside = (s.imag >= 2.0 * np.pi * _BAND_HZ[0]) & (s.imag <= 2.0 * np.pi * highest_hz)
        s = s[inside]
        torque = np.stack([each.torque[:, axis] for each in windows])
        rate = np.stack([each.body_rate_rad_s[:, axis] for each in windows])
        phase = np.pi * np.arange(n_samples) / n_samples
        taper, slope = np.sin(phase) ** 2, np.pi / _WINDOW_S * np.sin(2.0 * phase)
        # By partial integration: what leaks from a strong line leaks from torque and acceleration alike.
        acceleration = s * _spectra(rate, taper)[:, inside] - _spectra(rate, slope)[:, inside]
        # No window is louder than most.
        rms = np.sqrt(np.sum(np.abs(acceleration) ** 2, axis=1, keepdims=True))
        scale = np.minimum(np.median(rms) / np.where(rms > 0.0, rms, np.inf), 1.0)
        acceleration = acceleration * scale
        power = np.sum(np.abs(acceleration) ** 2, axis=0)
        if not (power > 0.0).all() or not torque.any():
            return None
        given = _spectra(torque, taper)[:, inside] * scale
        return cls(s, given, acceleration, 1.0 / (power * s.size))

    def best_of(self, advances_s: FloatArray) -> float:
        """Return the advance of the torque at which it is most in phase with the acceleration [s]."""
        cross = np.sum(self.torque.conj() * self.acceleration, axis=0) * self.weight
        in_phase = (np.exp(-np.outer(advances_s, self.s)) @ cross).real
        return float(advances_s[np.argmax(in_phase)])

    def polynomial(self, advance_s: float) -> tuple[FloatArray, FloatArray, float]:
        """Fit the acceleration by the advanced torque and its two derivatives.

        Returns the coefficients over the first and their standard errors, each (3,), and the fraction of
        the acceleration that they explain.
        """
        powers = self.s[:, np.newaxis] ** np.arange(3) * np.exp(self.s * advance_s)[:, np.newaxis]
        columns = self.torque[:, :, np.newaxis] * powers
        weighted = columns.conj() * self.weight[:, np.newaxis]
        normal = np.einsum("wlk,wlm->wkm", weighted, columns).real
        right = np.einsum("wlk,wl->wk", weighted, self.acceleration).real
        theta = np.linalg.pinv(normal.sum(axis=0), hermitian=True) @ right.sum(axis=0)
        without = np.linalg.pinv(normal.sum(axis=0) - normal, hermitian=True)
        each = np.einsum("wkm,wm->wk", without, right.sum(axis=0) - right)
        explained = float(theta @ right.sum(axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            theta, each = theta / theta[0], each / each[:, :1]
        spread = np.sum((each - each.mean(axis=0)) ** 2, axis=0) * (len(each) - 1) / len(each)
        return theta, np.sqrt(_OVERLAP * spread), explained


def _spectra(values: FloatArray, taper: FloatArray) -> ComplexArray:
    """Return the spectra of windows (n_windows, n_samples), each about its mean."""
    about_mean = values - values.mean(axis=1, keepdims=True)
    return np.asarray(np.fft.rfft(about_mean * taper, axis=1), dtype=np.complex128)
