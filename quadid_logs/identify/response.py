"""The response of angular acceleration to torque against frequency, and the band where it is the vehicle's.

A rigid body behind a lag and a delay has one gain at all frequencies. Where air or noise moves a
vehicle more than its pilot does, the torque is the controller's answer, and the response is that of
the inverse controller, -1/C: it grows with frequency while its phase lags.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Response
from quadid_logs.maths.band import ComplexArray, angular_frequency, gyro_response
from quadid_logs.maths.instrument_response import gain_by_instrument, tapered_spectra
from quadid_logs.maths.spectra import WINDOW_S

#: Two octaves tell a gain from a lag and a delay.
NARROWEST_BAND: Final = 4.0
#: At least eight samples per cycle at the cut-off, or the torque between samples is a guess.
SAMPLES_PER_CYCLE: Final = 8.0
#: Of a long flight there are hundreds, and of their lines one in ten counts.
_WINDOWS_AT_ONCE = 32
#: Third octaves from half a hertz, the resolution of a window, to 32 Hz, beyond any motion of a vehicle.
_EDGES_HZ: Final = 0.5 * 2.0 ** (np.arange(19) / 3.0)
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
#: So many known third octaves in a row, more than an octave, have a slope.
_SLOPE_BANDS = 4
#: A response of minimum phase that grows with the n-th power of frequency leads by n right angles (Bode
#: 1945); lag and delay make it fall. -1/C, whose sign is the other one, is two right angles from that: half
#: a right angle is left to the filters and the delay inside the controller's loop.
_LEAST_SLOPE = 0.5
_OFF_INVERSE_DEG = 45.0
#: With so much of the torque's power a fit is on the side of the controller; a run that begins with the last
#: third octave of a manoeuvre may hold half.
_MOST = 2.0 / 3.0
_TINY = float(np.finfo(float).tiny)


class Band(NamedTuple):
    """Frequencies [Hz] that are fitted: slower ones are taken out, above ``high_hz`` the filter cuts off."""

    low_hz: float
    high_hz: float


#: Nothing in the response speaks against any frequency.
EVERYWHERE: Final = Band(0.0, np.inf)


def fitted_band(
    found: Sequence[Response], default: Band, sample_period_s: float, *, from_known: bool = False
) -> Band:
    """Return the band to fit some axes in: where the response of all of them is a vehicle's.

    Parameters
    ----------
    found : sequence of Response
        Of the axes that count.
    default : Band
        What is fitted where nothing speaks against it. The upper edge goes above its own only
        where a raised lower edge would leave less than two octaves.
    sample_period_s : float
    from_known : bool
        Leave out what is slower than the first third octave that is known of all axes, too.

    Returns
    -------
    Band
        The default where the axes have no two octaves in common, or the samples do not hold them.
    """
    bands = [vehicle_band(each) for each in found]
    low_hz = max([default.low_hz, *(band.low_hz for band in bands)])
    if from_known:
        low_hz = max([low_hz, *(known_from(each) for each in found)])
    highest_hz = min([1.0 / (SAMPLES_PER_CYCLE * sample_period_s), *(band.high_hz for band in bands)])
    if NARROWEST_BAND * low_hz > highest_hz:
        return default
    return Band(low_hz, min(max(default.high_hz, NARROWEST_BAND * low_hz), highest_hz))


def known_from(response: Response) -> float:
    """Return the lower edge of the first third octave of which enough is known.

    Parameters
    ----------
    response : Response

    Returns
    -------
    float
        [Hz]; 0 where no slower one holds a line of the spectrum, and where nothing is known at all.
    """
    known = _known(response)
    unknown_below = known.size and np.isfinite(response.gain[: known[0]]).any()
    return float(_EDGES_HZ[known[0]]) if unknown_below else 0.0


def vehicle_band(response: Response) -> Band:
    """Return where one gain, lag, delay and damping explain the response.

    Parameters
    ----------
    response : Response

    Returns
    -------
    Band
        The widest of which all known third octaves agree, to the tolerance and twice their
        error: from 0 where none below disagrees, to infinity where none above does. `EVERYWHERE`
        if the widest is narrower than two octaves: then no part of the response is a vehicle's.
    """
    known = _known(response)
    gain, error = response.gain[known], response.error[known]
    grid = np.meshgrid(_LAGS_S, _DELAYS_S, _DAMPINGS_1_S)
    lag_s, delay_s, damping = (each.ravel()[:, np.newaxis] for each in grid)
    s = 2j * np.pi * response.frequency_hz[known]
    flat = gain * (1.0 + s * lag_s) * np.exp(s * delay_s) * (s - damping) / s
    for width in range(known.size, _FEWEST_BANDS - 1, -1):
        for first in range(known.size - width + 1):
            bands = slice(first, first + width)
            # One of the trials gives all bands the same real, positive gain.
            allowed = _TOLERANCE + error[bands]
            one = flat[:, bands].real @ allowed**-2.0 / np.sum(allowed**-2.0)
            possible = one > 0.0
            off = np.abs(flat[possible, bands] / one[possible, np.newaxis] - 1.0)
            if (off <= allowed + error[bands]).all(axis=1).any():
                low_hz = float(_EDGES_HZ[known[first]]) if first else 0.0
                to_the_end = bands.stop == known.size
                return Band(low_hz, np.inf if to_the_end else float(_EDGES_HZ[known[bands.stop - 1] + 1]))
    return EVERYWHERE


def inverse_controller(response: Response) -> BoolArray:
    """Say where the response is that of the inverse controller: torque follows rate, not rate torque.

    Parameters
    ----------
    response : Response

    Returns
    -------
    ndarray of bool, shape (n_bands,)
        Third octaves of runs in which the response grows with frequency while its phase is that
        of a growing response with the sign reversed.
    """
    known = _known(response)
    marked = np.zeros(response.error.shape, dtype=np.bool_)
    for first in range(known.size - _SLOPE_BANDS + 1):
        run = known[first : first + _SLOPE_BANDS]
        slope, _ = slope_and_phase(response, run)
        # Beside a strong line of the manoeuvre what leaks from it grows, too, often behind a hole: here all
        # third octaves that hold a line of the spectrum must be known, and each take part.
        if slope < _LEAST_SLOPE or np.isfinite(response.gain[run[0] : run[-1] + 1]).sum() > _SLOPE_BANDS:
            continue
        law = response.frequency_hz[run] ** slope * np.exp(1j * np.radians(90.0 * slope - 180.0))
        off = np.log(response.gain[run] / law)
        straight = np.abs(off.real - off.real.mean()) <= _TOLERANCE + 2.0 * response.error[run]
        marked[run] |= bool((straight & (np.abs(np.degrees(off.imag)) <= _OFF_INVERSE_DEG)).all())
    return marked


def slope_and_phase(response: Response, run: IntArray) -> tuple[float, float]:
    """Return the power of frequency that the size of the response grows with, and its mean phase.

    Parameters
    ----------
    response : Response
    run : ndarray of int, shape (n,)
        Of its third octaves, two or more.

    Returns
    -------
    slope : float
    phase_deg : float
    """
    gain, frequency_hz = response.gain[run], response.frequency_hz[run]
    slope = float(np.polyfit(np.log(frequency_hz), np.log(np.abs(gain)), 1)[0])
    return slope, float(np.degrees(np.angle(np.mean(gain / np.abs(gain)))))


class InverseController(NamedTuple):
    """Third octaves where torque follows rate, and their ``fraction`` of the torque's power in a band."""

    run: IntArray
    fraction: float


def feedback_in(response: Response, band: Band) -> InverseController | None:
    """Return the inverse controller if most of what a fit in a band sees is that.

    Parameters
    ----------
    response : Response
    band : Band

    Returns
    -------
    InverseController or None
        Its run may go on beyond the band.

    Notes
    -----
    Least squares weighs frequencies by the power of the torque, and so does this. Of a band of
    which nothing is known, what is around it is all that the log shows.
    """
    known = _known(response)
    marked = inverse_controller(response)
    seen = known[(_EDGES_HZ[known] >= band.low_hz) & (_EDGES_HZ[known] < band.high_hz)]
    if not seen.size:
        seen = known
    total = float(response.torque_power[seen].sum())
    fraction = float(response.torque_power[seen][marked[seen]].sum()) / total if total else 0.0
    return InverseController(np.flatnonzero(marked), fraction) if fraction > _MOST else None


def _known(response: Response) -> IntArray:
    """Return the third octaves of which enough is known."""
    return np.flatnonzero(response.error < _LARGEST_ERROR)


def responses(data: FlightData, *, by_setpoints: Collection[int]) -> tuple[Response, ...]:
    """Return the response of each axis to its own torque.

    Parameters
    ----------
    data : FlightData
    by_setpoints : collection of int
        Axes whose rate set-points drive their torque: from the cross spectra with the set-point, which no
        disturbance moves. Of the others from those with the torque itself.

    Returns
    -------
    tuple of Response
        Roll, pitch, yaw; empty where no segment is as long as a window.

    Notes
    -----
    J. S. Bendat and A. G. Piersol, *Random Data*, section 9: the variance of a
    response is that of what it leaves over that of its input, per independent line.
    """
    # Lines beyond the last third octave that the samples resolve stay out of every one.
    n_edges = int(np.searchsorted(_EDGES_HZ, _MOST_OF_RATE / data.sample_period_s, side="right"))
    lines = _Lines.of(data, below_hz=float(_EDGES_HZ[n_edges - 1]) if n_edges else 0.0)
    if lines is None:
        return ()
    reference = lines.reference
    n_bands, found = _EDGES_HZ.size - 1, []
    for axis in range(3):
        driven_by = reference if reference is not None and axis in by_setpoints else lines.torque
        where, gain = np.sqrt(_EDGES_HZ[:-1] * _EDGES_HZ[1:]), np.full(n_bands, np.nan + 0j)
        error = np.full(n_bands, np.inf)
        coherence, torque_power = np.zeros(n_bands), np.zeros(n_bands)
        for band, (low, high) in enumerate(pairwise(_EDGES_HZ)):
            inside = (lines.frequency_hz >= low) & (lines.frequency_hz < high)
            of_axis = (each[:, :, axis] for each in (driven_by, lines.torque, lines.acceleration))
            z, u, y = (each[:, inside] for each in of_axis)
            power = np.vdot(z, u)
            if power == 0.0:
                continue
            where[band] = np.sum(np.abs(u) ** 2 * lines.frequency_hz[inside]) / np.sum(np.abs(u) ** 2)
            gain[band], error[band] = gain_by_instrument(z, u, y)
            driving = max(float(np.vdot(z, z).real), _TINY)
            torque_power[band] = abs(power) ** 2 / driving
            coherence[band] = abs(np.vdot(z, y)) ** 2 / max(driving * float(np.vdot(y, y).real), _TINY)
        found.append(
            Response(
                frequency_hz=where, gain=gain, error=error, coherence=coherence, torque_power=torque_power
            )
        )
    return tuple(found)


class _Lines(NamedTuple):
    """Spectral lines of tapered windows, (n_windows, n_lines, 3) each; no reference without setpoints."""

    frequency_hz: FloatArray
    torque: ComplexArray
    acceleration: ComplexArray
    reference: ComplexArray | None

    @classmethod
    def of(cls, data: FlightData, below_hz: float) -> _Lines | None:
        """Return the lines of all segments below a frequency; None where none is as long as a window."""
        n_samples = round(WINDOW_S / data.sample_period_s)
        windows = [
            segment.rows(slice(first, first + n_samples))
            for segment in data.segments
            for first in range(0, segment.n_samples - n_samples + 1, n_samples // 2)
        ]
        if not windows:
            return None
        s = angular_frequency(n_samples, data.sample_period_s)
        s = s[s.imag / (2.0 * np.pi) < below_hz]
        gyro = gyro_response(s, *data.gyro_filter)[:, np.newaxis]
        references = [each.reference[:, :3] for each in windows if each.reference is not None]
        return cls(
            frequency_hz=s.imag / (2.0 * np.pi),
            torque=_first_lines([each.torque for each in windows], s.size) * gyro,
            acceleration=_first_lines([each.body_rate_rad_s for each in windows], s.size) * s[:, np.newaxis],
            reference=_first_lines(references, s.size) if len(references) == len(windows) else None,
        )


def _first_lines(windows: Sequence[FloatArray], n_lines: int) -> ComplexArray:
    """Return the first spectral lines of windows, so many windows at once as memory stays flat with."""
    parts = (windows[first : first + _WINDOWS_AT_ONCE] for first in range(0, len(windows), _WINDOWS_AT_ONCE))
    return np.concatenate([tapered_spectra(np.stack(part))[:, :n_lines] for part in parts])
