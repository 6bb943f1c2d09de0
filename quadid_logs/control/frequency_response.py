"""What the log itself shows of the loop around its crossover: responses by instruments, with their errors.

The excitation of a system-ID mode answers no gust and no noise, and rate set-points hardly do above the angle
loop's band. By such instruments the vehicle's response follows at frequencies far above those that the model
was fitted to, wherever they have enough power.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.model import Actuator
from quadid_logs.identify.rotors import Rotors, equivalent_torque
from quadid_logs.maths.band import ComplexArray, angular_frequency
from quadid_logs.maths.instrument_response import gain_by_instrument, tapered_spectra
from quadid_logs.maths.spectra import WINDOW_S

#: From half a hertz, the resolution of a window, eight octaves to 128 Hz, above any crossover; in thirds.
_LOWEST_HZ: Final = 0.5
_OCTAVES: Final = 8
BAND_WIDTH: Final = 2.0 ** (1.0 / 3.0)
THIRDS: Final = 3
#: Above this fraction of the sample rate, the response is that of what happens between the samples.
MOST_OF_RATE = 0.35
#: A response known worse than this (6 degrees, 0.9 dB) cannot tell a good margin from a poor one.
_LARGEST_ERROR = 0.1
#: Gain and phase (3 degrees) that a lag and a delay leave of rotors, frame and sampling, in one standard
#: deviation.
TOLERANCE: Final = 0.05
#: A Hann window's side lobes leak up to a 1400th of a neighbour's density (-31 dB); where an instrument
#: falls by nearly as much within an octave, what is left is leakage, and knows nothing of this frequency.
_LEAKAGE = 1.0 / 200.0
#: So many third octaves around the crossover make half an octave or more on either side of it.
_FEWEST_BANDS = 3
#: Of responses that the model fits, one in a hundred is called contradicted.
_CONFIDENCE = 0.99


class Response(NamedTuple):
    """A response in bands, each (n_bands,): complex gain, and its relative standard error."""

    frequency_hz: FloatArray
    gain: ComplexArray
    error: FloatArray

    def known(self) -> Response:
        """Return the bands that are known well enough to judge a margin by."""
        return self.of(self.error <= _LARGEST_ERROR)

    def up_to(self, highest_hz: float) -> Response:
        """Return the bands up to a frequency."""
        return self.of(self.frequency_hz <= highest_hz)

    def of(self, bands: BoolArray) -> Response:
        """Return some of the bands, which are marked (n_bands,)."""
        return Response(self.frequency_hz[bands], self.gain[bands], self.error[bands])


class Lines(NamedTuple):
    """Spectral lines of one axis over tapered windows, (n_windows, n_lines) each.

    ``acting`` is the torque that, behind a linear lag, acts as the rotors do; without a lag of theirs the
    logged one. ``chirp`` is what a system-ID mode injects, as late as it acts; None where the log has none.
    """

    frequency_hz: FloatArray
    setpoint: ComplexArray
    torque: ComplexArray
    acting: ComplexArray
    rate: ComplexArray
    chirp: ComplexArray | None


def acting_torque(segment: Segment, data: FlightData, actuator: Actuator | None) -> FloatArray:
    """Return the torque that, behind the actuator's linear lag, acts as the rotors of a segment do.

    Thrust goes with the square of a speed that lags: a doublet that brings the motors to their limits acts a
    tenth more strongly than a linear lag would have it.

    Parameters
    ----------
    segment : Segment
        Of `data`.
    data : FlightData
    actuator : Actuator or None

    Returns
    -------
    ndarray, shape (n_samples, 3)
        The logged torque where the lag was not found to be that of the rotors.
    """
    if actuator is None or data.input is None or not np.isfinite(actuator.lag_up_s + actuator.lag_down_s):
        return segment.torque
    rotors = Rotors(actuator.lag_up_s, actuator.lag_down_s)
    return equivalent_torque(segment, data.input, data.sample_period_s, rotors)[:, :3]


def lines_of(
    data: FlightData, axis: int, chirp_delay_s: float, actuator: Actuator | None = None
) -> Lines | None:
    """Return the spectral lines of an axis.

    Parameters
    ----------
    data : FlightData
    axis : int
    chirp_delay_s : float
        From the stamp of an excitation to the torque that it is part of [s].
    actuator : Actuator, optional
        As of `acting_torque`.

    Returns
    -------
    Lines or None
        None where no segment with set-points is as long as a window.
    """
    n_samples = round(WINDOW_S / data.sample_period_s)
    windows: list[FloatArray] = []
    for segment in data.segments:
        if segment.reference is None:
            continue
        chirp = segment.reference[:, 3] if segment.reference.shape[1] > 3 else np.zeros(segment.n_samples)
        acting = acting_torque(segment, data, actuator)[:, axis]
        rate = segment.body_rate_rad_s[:, axis]
        columns = np.column_stack([segment.reference[:, axis], segment.torque[:, axis], acting, rate, chirp])
        begins = range(0, segment.n_samples - n_samples + 1, n_samples // 2)
        windows += [columns[first : first + n_samples] for first in begins]
    if not windows:
        return None
    s = angular_frequency(n_samples, data.sample_period_s)
    spectra = tapered_spectra(np.stack(windows))
    injected = spectra[..., 4] * np.exp(-s * chirp_delay_s)
    return Lines(
        frequency_hz=above_zero(s.imag / (2.0 * np.pi)),
        setpoint=spectra[..., 0],
        torque=spectra[..., 1],
        acting=spectra[..., 2],
        rate=spectra[..., 3],
        chirp=injected if np.abs(injected).any() else None,
    )


def above_zero(frequency_hz: NDArray[np.floating]) -> FloatArray:
    """Return the frequencies of a transform with a small one for zero, where integrators are infinite.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_lines,)

    Returns
    -------
    ndarray, shape (n_lines,)
    """
    return np.asarray(np.concatenate([frequency_hz[1:2] * 1e-3, frequency_hz[1:]]), dtype=np.float64)


def response(
    frequency_hz: FloatArray,
    driven_by: ComplexArray,
    cause: ComplexArray,
    effect: ComplexArray,
    *,
    per_octave: int = THIRDS,
) -> Response:
    """Return effect over cause in bands, both as far as an instrument drives them.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_lines,)
    driven_by, cause, effect : ndarray of complex, shape (n_windows, n_lines)
    per_octave : int
        So many bands begin in each octave; with more than three they overlap.

    Returns
    -------
    Response
        The error is infinite where the instrument has no power.

    Notes
    -----
    J. S. Bendat and A. G. Piersol, *Random Data*, section 9: the variance of a response is that of what it
    leaves over that of its input, per independent line.
    """
    lowest_hz = _LOWEST_HZ * 2.0 ** (np.arange(_OCTAVES * per_octave) / per_octave)
    where = lowest_hz * np.sqrt(BAND_WIDTH)
    highest_hz = MOST_OF_RATE * 2.0 * frequency_hz[-1]
    kept_density: list[float] = []
    gain, error = np.full(where.size, np.nan + 0j), np.full(where.size, np.inf)
    for band, low in enumerate(lowest_hz):
        lines = (frequency_hz >= low) & (frequency_hz < min(low * BAND_WIDTH, highest_hz))
        z, u, y = (each[:, lines] for each in (driven_by, cause, effect))
        density, power = float(np.mean(np.abs(z) ** 2)) if z.size else 0.0, np.vdot(z, u)
        if abs(power) <= np.finfo(float).tiny or density < _LEAKAGE * max(
            kept_density[-per_octave:], default=0.0
        ):
            continue
        kept_density.append(density)
        weight = np.abs(np.sum(np.conj(z) * u, axis=0))
        where[band] = np.sum(weight * frequency_hz[lines]) / np.sum(weight)
        gain[band], error[band] = gain_by_instrument(z, u, y)
    return Response(where, gain, error)


def better(first: Response, second: Response) -> Response:
    """Return of each band the response that is known better."""
    take = first.error <= second.error
    return Response(*(np.where(take, a, b) for a, b in zip(first, second, strict=True)))


class Confirmation(NamedTuple):
    """Up to where measurement supports the model [Hz], 0 nowhere; and whether it contradicts it."""

    known_hz: float
    contradicted: bool


def confirm(
    ratio: Response, crossover_hz: float, fitted_hz: float, drawn: ComplexArray | None = None
) -> Confirmation:
    """Hold the measured vehicle against the model around the crossover.

    Parameters
    ----------
    ratio : Response
        Measured over modelled, the known bands only.
    crossover_hz : float
        Of the rate loop.
    fitted_hz : float
        Up to where the model was fitted.
    drawn : ndarray of complex, shape (n_plants, n_bands), optional
        Vehicles that the fit allows, over the model: what it leaves open is no contradiction.

    Returns
    -------
    Confirmation
        Contradicted where the distance from the model is beyond what both leave open, with a probability of
        1 % by chance.
    """
    from scipy.special import chdtri

    near = (ratio.frequency_hz >= 0.5 * crossover_hz) & (ratio.frequency_hz <= 2.0 * crossover_hz)
    n_near = int(np.count_nonzero(near))
    if n_near >= _FEWEST_BANDS and _distance(ratio, drawn, near) > chdtri(2 * n_near, 1.0 - _CONFIDENCE):
        return Confirmation(0.0, contradicted=True)
    bands = np.eye(ratio.frequency_hz.size, dtype=np.bool_)
    off = np.array([_distance(ratio, drawn, band) for band in bands])
    agrees = np.asarray(off <= chdtri(2, 1.0 - _CONFIDENCE), dtype=np.bool_)
    # Up to where bands agree, no more than two thirds of an octave apart from each other.
    known_hz = 0.0
    for each_hz in ratio.frequency_hz[agrees]:
        if known_hz and each_hz > known_hz * 2.0 ** (2.0 / 3.0):
            break
        known_hz = float(each_hz)
    return Confirmation(max(fitted_hz, known_hz), contradicted=False)


def _distance(ratio: Response, drawn: ComplexArray | None, bands: BoolArray) -> float:
    """Return the squared distance of some bands from the model."""
    some, n_bands = None if drawn is None else drawn[:, bands], np.count_nonzero(bands)
    return float(distances(ratio.of(bands), some, np.ones((1, n_bands), dtype=np.complex128))[0])


def distances(ratio: Response, drawn: ComplexArray | None, expected: ComplexArray) -> FloatArray:
    """Return the squared distance of a measured response from others, over what is known of it.

    Parameters
    ----------
    ratio : Response
        Measured over modelled.
    drawn : ndarray of complex, shape (n_plants, n_bands), optional
        Vehicles that the fit allows, over the model.
    expected : ndarray of complex, shape (n, n_bands)
        Over the model, too.

    Returns
    -------
    ndarray, shape (n,)
        Each band has two degrees of freedom. What the model leaves open is alike in neighbouring bands: its
        covariance is that of the drawn vehicles.
    """
    off = ratio.gain - expected
    covariance = np.diag(np.tile(0.5 * ratio.error**2 + TOLERANCE**2, 2))
    if drawn is not None and len(drawn) > 1:
        covariance = covariance + np.cov(np.hstack([drawn.real, drawn.imag]), rowvar=False)
    both = np.hstack([off.real, off.imag])
    return np.asarray(np.sum(both * np.linalg.solve(covariance, both.T).T, axis=1))
