"""The response of angular acceleration to torque against frequency, and the band where it is the vehicle's.

A rigid body behind a lag and a delay has one gain at all frequencies. Where slow air moves a vehicle
more than its pilot does, the torque is the controller's answer, and the response is that of the
inverse controller, -1/C: its phase lags and its size falls towards low frequencies.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.maths.band import ComplexArray, angular_frequency, gyro_response

#: Two octaves tell a gain from a lag and a delay.
NARROWEST_BAND: Final = 4.0
#: Windows of the averaged spectra: long enough to tell half a hertz apart, short enough for many of them.
_WINDOW_S = 4.0
#: Third octaves from half a hertz, the resolution of a window, to 32 Hz, beyond any motion of a vehicle.
_EDGES_HZ: Final = 0.5 * 2.0 ** (np.arange(19) / 3.0)
#: Windows overlap by half and their taper leaks into neighbours: so many of their lines are independent.
_INDEPENDENT = 0.5
#: Above this fraction of the sample rate, the response is that of what happens between the samples.
_MOST_OF_RATE = 0.35
#: A mixer, a thrust curve and a rotor are one gain and one lag to about this fraction.
_TOLERANCE = 0.15
#: A response that is known worse than this says neither yes nor no.
_LARGEST_ERROR = 0.2
#: So many third octaves, too.
_FEWEST_BANDS = 6
#: What is tried for lag [s], delay [s] and damping [1/s]: the largest that are published, and finely enough
#: that a step is well inside the tolerance.
_LAGS_S = (0.0, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.11, 0.15, 0.2)
_DELAYS_S = (0.0, 0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06)
_DAMPINGS_1_S = (0.0, -0.5, -1.0, -2.0, -3.5, -6.0)


class Response(NamedTuple):
    """Angular acceleration over torque of one axis in third octaves; each (n_bands,).

    ``frequency_hz`` is where the torque of the band is; ``gain`` complex, NaN where nothing is known;
    ``error`` is its relative standard error.
    """

    frequency_hz: FloatArray
    gain: ComplexArray
    error: FloatArray


def lower_edge_hz(response: Response, sample_period_s: float) -> float:
    """Return from where one gain, lag, delay and damping explain the response; 0 where from its beginning.

    Parameters
    ----------
    response : Response
    sample_period_s : float

    Returns
    -------
    float
        Lower edge [Hz] of the widest band of which all known third octaves agree, to the
        tolerance and twice their error. 0 where none below disagrees, and where the widest
        band is narrower than two octaves: then no part of the response is a vehicle's.
    """
    known = np.flatnonzero(
        (response.error < _LARGEST_ERROR) & (_EDGES_HZ[1:] <= _MOST_OF_RATE / sample_period_s)
    )
    gain, error = response.gain[known], response.error[known]
    grid = np.meshgrid(_LAGS_S, _DELAYS_S, _DAMPINGS_1_S)
    lag_s, delay_s, damping = (each.ravel()[:, np.newaxis] for each in grid)
    s = 2j * np.pi * response.frequency_hz[known]
    flat = gain * (1.0 + s * lag_s) * np.exp(s * delay_s) * (s - damping) / s
    for width in range(known.size, _FEWEST_BANDS - 1, -1):
        for first in range(known.size - width + 1):
            bands = slice(first, first + width)
            if _is_one_gain(flat[:, bands], error[bands]):
                return float(_EDGES_HZ[known[first]]) if first else 0.0
    return 0.0


def _is_one_gain(flat: ComplexArray, error: FloatArray) -> bool:
    """Say whether, for one of the trials (n_trials, n_bands), all bands have the same real, positive gain."""
    allowed = _TOLERANCE + error
    gain = flat.real @ allowed**-2.0 / np.sum(allowed**-2.0)
    possible = gain > 0.0
    off = np.abs(flat[possible] / gain[possible, np.newaxis] - 1.0)
    return bool((off <= allowed + error).all(axis=1).any())


def responses(data: FlightData, *, instruments: bool) -> tuple[Response, ...]:
    """Return the response of each axis to its own torque.

    Parameters
    ----------
    data : FlightData
    instruments : bool
        From the cross spectra with the axis' rate setpoint, which no disturbance moves;
        otherwise from those with the torque itself.

    Returns
    -------
    tuple of Response
        Roll, pitch, yaw; empty where no segment is as long as a window.

    Notes
    -----
    J. S. Bendat and A. G. Piersol, *Random Data*, section 9: the variance of a
    response is that of what it leaves over that of its input, per independent line.
    """
    lines = _Lines.of(data)
    if lines is None:
        return ()
    driven_by = lines.torque if lines.reference is None or not instruments else lines.reference
    return tuple(
        _response(lines.frequency_hz, driven_by[..., k], lines.torque[..., k], lines.acceleration[..., k])
        for k in range(3)
    )


def _response(
    frequency_hz: FloatArray, driven_by: ComplexArray, torque: ComplexArray, acceleration: ComplexArray
) -> Response:
    """Return the response of one axis from its lines, each (n_windows, n_lines)."""
    n_bands = _EDGES_HZ.size - 1
    where, gain = np.sqrt(_EDGES_HZ[:-1] * _EDGES_HZ[1:]), np.full(n_bands, np.nan + 0j)
    error = np.full(n_bands, np.inf)
    for band, (low, high) in enumerate(pairwise(_EDGES_HZ)):
        lines = (frequency_hz >= low) & (frequency_hz < high)
        z, u, y = (each[:, lines] for each in (driven_by, torque, acceleration))
        power = np.vdot(z, u)
        if power == 0.0:
            continue
        where[band] = np.sum(np.abs(u) ** 2 * frequency_hz[lines]) / np.sum(np.abs(u) ** 2)
        gain[band] = np.vdot(z, y) / power
        left = np.linalg.norm(y - gain[band] * u) * np.linalg.norm(z) / np.sqrt(_INDEPENDENT * u.size)
        error[band] = left / max(abs(gain[band] * power), np.finfo(float).tiny)
    return Response(where, gain, error)


class _Lines(NamedTuple):
    """Spectral lines of tapered windows, (n_windows, n_lines, 3) each; no reference without setpoints."""

    frequency_hz: FloatArray
    torque: ComplexArray
    acceleration: ComplexArray
    reference: ComplexArray | None

    @classmethod
    def of(cls, data: FlightData) -> _Lines | None:
        """Return the lines of all segments; None where none is as long as a window."""
        n_samples = round(_WINDOW_S / data.sample_period_s)
        windows = [
            segment.rows(slice(first, first + n_samples))
            for segment in data.segments
            for first in range(0, segment.n_samples - n_samples + 1, n_samples // 2)
        ]
        if not windows:
            return None
        s = angular_frequency(n_samples, data.sample_period_s)
        gyro = gyro_response(s, *data.gyro_filter)[:, np.newaxis]
        reference = [each.reference[:, :3] for each in windows if each.reference is not None]
        return cls(
            frequency_hz=s.imag / (2.0 * np.pi),
            torque=_transformed([each.torque for each in windows]) * gyro,
            acceleration=_transformed([each.body_rate_rad_s for each in windows]) * s[:, np.newaxis],
            reference=_transformed(reference) if len(reference) == len(windows) else None,
        )


def _transformed(windows: list[FloatArray]) -> ComplexArray:
    """Return the spectra of windows without mean and trend, tapered; shape (n_windows, n_lines, 3)."""
    stacked = np.stack(windows)
    line = np.linspace(-1.0, 1.0, stacked.shape[1])[:, np.newaxis]
    level = stacked - stacked.mean(axis=1, keepdims=True)
    slope = (line * level).sum(axis=1, keepdims=True) / np.sum(line**2)
    taper = np.hanning(stacked.shape[1])[:, np.newaxis]
    return np.asarray(np.fft.rfft((level - slope * line) * taper, axis=1), dtype=np.complex128)
