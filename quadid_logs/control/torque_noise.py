"""What gusts and gyro noise do to a loop, from what the log shows of both with the gains that flew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, runs
from quadid_logs.control.loop import close
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import FitSeries
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.spectra import WINDOW_S, Spectra, averaged_spectra

#: Fewer averages than this make no spectrum.
_FEWEST: Final = 4
#: Above the crossover by this, and above what pilots and gusts do to a vehicle [Hz], noise is left.
_ABOVE: Final = 1.5
_ABOVE_FLIGHT_HZ: Final = 15.0
#: Gusts that are slower tilt a vehicle that its pilot holds anyway [Hz].
_SLOWEST_GUST_HZ: Final = 0.05
#: Power of the frequency that the density of what disturbs a hovering vehicle falls with: of two research
#: vehicles indoors, between 0.1 and 10 Hz.
_GUST_SLOPE: Final = -0.8
_N_GUSTS: Final = 120
#: Column of the excitation of a system-ID mode among commands.
_INJECTED: Final = 3
#: What a command makes of the torque is known to 3 dB.
_MOST_MADE: Final = 2.0
#: Rows that are faster than the data by this show noise that these do not.
_FASTER: Final = 1.2
#: Rows of one record are one step apart: a distance that rounds to no or to two steps ends it.
_IRREGULAR: Final = 0.5
#: Up to this part of the highest frequency of the data, most of what they hold is not folded.
_UNFOLDED: Final = 0.25


class Spectrum(NamedTuple):
    """A one-sided density over ``frequency_hz``, both (n_frequencies,): multiples of the first."""

    frequency_hz: FloatArray
    density: FloatArray

    def deviation(self, gain: FloatArray, band: BoolArray) -> float:
        """Return the standard deviation behind a squared gain, of what lies in a band."""
        return float(np.sqrt(np.sum((self.density * gain)[band]) * self.frequency_hz[0]))


def torque_spectrum(
    data: FlightData,
    number: int,
    controller: AxisController,
    plant: Plant | None,
    rows: Spectrum | None = None,
) -> Spectrum | None:
    """Return the density of one axis' command, without what pilot or system identification made of it.

    Parameters
    ----------
    data : FlightData
        With the torque in units of the command.
    number : int
        Of the axis.
    controller : AxisController
        That flew.
    plant : Plant or None
        The estimate alone. Without one nothing is left out.
    rows : Spectrum, optional
        Of the command in faster rows (`logged_spectrum`): the density is that of these.

    Returns
    -------
    Spectrum or None
        None where no segment is long enough.

    Notes
    -----
    What is coherent with set-points, or with torque that was injected, is no noise; but no more than the loop
    makes of them: an attitude that was put back leaves noise in set-points that hold nothing else.
    """
    records = list(_commanded(data, number))
    known = _spectrum([record[:, -1] for record in records], data.sample_period_s)
    if known is None or plant is None:
        return rows or _of_data(data, number)
    loop = close(controller, plant, known.frequency_hz)
    left = known.density
    for place, answer in enumerate((loop.target_to_torque[0], 1.0 / (1.0 + loop.rate[0]))):
        pairs = [(record[:, place], record[:, -1]) for record in records]
        found = _averaged(pairs, data.sample_period_s)
        most = _MOST_MADE * np.abs(answer) ** 2 * found.input_psd[1:]
        left = left - np.minimum((found.coherence * found.output_psd)[1:], most)
    left = np.maximum(left, 0.0)
    if rows is None:
        return known._replace(density=left)
    part = np.divide(left, known.density, out=np.ones_like(left), where=known.density > 0.0)
    part = np.interp(rows.frequency_hz, known.frequency_hz, part, right=1.0)
    return rows._replace(density=rows.density * part)


def logged_spectrum(log: FlightLog, data: FlightData, number: int) -> Spectrum | None:
    """Return the density of one axis' command in rows of the log that are faster than the data.

    Data fold faster noise down, where nobody can tell it from slower noise.

    Parameters
    ----------
    log : FlightLog
    data : FlightData
        In whose unit the density is.
    number : int
        Of the axis.

    Returns
    -------
    Spectrum or None
        None where no rows are faster, or they are not even for long enough.
    """
    signal = next(iter(log.signals.get("torque_command", ())), None)
    if signal is None or len(signal.values) < 2:
        return None
    time_s = np.asarray(signal.rows.time_s, dtype=np.float64)
    steps = np.diff(time_s)
    period_s = float(np.median(steps))
    if not 0.0 < period_s < data.sample_period_s / _FASTER:
        return None
    values = np.asarray(signal.values, dtype=np.float64)[:, number]
    columns = []
    for segment in data.segments:
        inside = (time_s >= segment.time_s[0]) & (time_s <= segment.time_s[-1]) & np.isfinite(values)
        even = inside & np.append(np.abs(steps / period_s - 1.0) < _IRREGULAR, False)
        columns += [values[first:after] for first, after in runs(even)]
    found, slow = _spectrum(columns, period_s), _of_data(data, number)
    if found is None or slow is None:
        return None
    # Slow commands are in both, and what is larger in the data by its unit.
    known = found.frequency_hz <= _UNFOLDED * slow.frequency_hz[-1]
    power = float(np.sum(found.density[known]))
    scale = float(np.sum(slow.density[: np.count_nonzero(known)])) / power if power > 0.0 else 0.0
    return found._replace(density=scale * found.density)


def _of_data(data: FlightData, number: int) -> Spectrum | None:
    return _spectrum([segment.torque[:, number] for segment in data.segments], data.sample_period_s)


def _commanded(data: FlightData, number: int) -> Iterator[FloatArray]:
    """Yield set-point, excitation and torque of an axis wherever it is known what was commanded, (n, 3)."""
    for segment in data.segments:
        if segment.command is None or segment.planned:
            continue
        injected = segment.command[:, _INJECTED:].sum(axis=1)
        record = np.column_stack([segment.command[:, number], injected, segment.torque[:, number]])
        yield from (record[first:after] for first, after in runs(np.isfinite(record).all(axis=1)))


def residual_spectrum(fit: FitSeries | None, number: int) -> Spectrum | None:
    """Return the density of the angular acceleration that the model leaves: what disturbs the vehicle.

    Parameters
    ----------
    fit : FitSeries or None
    number : int
        Of the axis.

    Returns
    -------
    Spectrum or None
        [(rad/s^2)^2 / Hz].
    """
    if fit is None or fit.time_s.size < 2:
        return None
    left = fit.acceleration[:, number] - fit.modelled_acceleration[:, number]
    period_s = float(np.nanmedian(np.diff(fit.time_s)))
    return _spectrum([left[first:after] for first, after in runs(np.isfinite(left))], period_s)


def _spectrum(columns: list[FloatArray], period_s: float) -> Spectrum | None:
    if not (np.isfinite(period_s) and period_s > 0.0):
        return None
    found = _averaged([(one, one) for one in columns], period_s)
    if found.n_averages < _FEWEST:
        return None
    return Spectrum(found.frequency_hz[1:], found.input_psd[1:])


def _averaged(pairs: Sequence[tuple[FloatArray, FloatArray]], period_s: float) -> Spectra:
    return averaged_spectra(pairs, period_s=period_s, n_per_segment=max(round(WINDOW_S / period_s), 2))


class Noise(NamedTuple):
    """Standard deviation of the command above the crossover, as flown and with other gains."""

    now: float
    next: float


def torque_noise(
    spectrum: Spectrum, controllers: tuple[AxisController, AxisController], plant: Plant, crossover_hz: float
) -> Noise | None:
    """Return what gyro noise makes of the command.

    Parameters
    ----------
    spectrum : Spectrum
        Of the command that flew.
    controllers : tuple of AxisController
        As flown, and another one.
    plant : Plant
        The estimate alone.
    crossover_hz : float
        Of the loop that flew.

    Returns
    -------
    Noise or None
        None where the log ends below the frequencies that noise is at.

    Notes
    -----
    Noise n of the gyro comes back as the command u = -C n / (1 + L): with other gains the measured spectrum
    is multiplied by what that changes by, and no spectrum of the gyro itself is needed.
    """
    band = noise_band(spectrum, crossover_hz)
    if band is None:
        return None
    # L / (1 + L) differs from C / (1 + L) by the vehicle alone.
    before, after = (
        (loop.rate / (1.0 + (loop.rate if loop.full is None else loop.full)))[0]
        for loop in (close(one, plant, spectrum.frequency_hz) for one in controllers)
    )
    ratio = np.abs(after / before) ** 2
    return Noise(spectrum.deviation(np.ones_like(ratio), band), spectrum.deviation(ratio, band))


def noise_band(spectrum: Spectrum, crossover_hz: float) -> BoolArray | None:
    """Return where a command shows the gyro's noise; None where the log ends below that.

    Parameters
    ----------
    spectrum : Spectrum
        Of the command that flew.
    crossover_hz : float
        Of the loop that flew.

    Returns
    -------
    ndarray of bool, shape (n_frequencies,) or None
    """
    band = spectrum.frequency_hz >= lowest_noise_hz(crossover_hz)
    return None if np.count_nonzero(band) < _FEWEST else band


def lowest_noise_hz(crossover_hz: float) -> float:
    """Return from where on a command shows noise, and not pilot and gusts [Hz].

    Parameters
    ----------
    crossover_hz : float
        NaN for none.
    """
    return _ABOVE_FLIGHT_HZ if np.isnan(crossover_hz) else max(_ABOVE * crossover_hz, _ABOVE_FLIGHT_HZ)


def attitude_error(
    spectrum: Spectrum,
    controllers: tuple[AxisController, AxisController],
    plant: Plant,
    band_hz: tuple[float, float],
) -> float:
    """Return the attitude error that gusts make, with another controller over that of the flown one.

    Parameters
    ----------
    spectrum : Spectrum
        Of the angular acceleration that disturbs the vehicle.
    controllers : tuple of AxisController
        As flown, and another one.
    plant : Plant
        The estimate alone.
    band_hz : tuple of float
        Where the spectrum is known; gusts go on below it.

    Returns
    -------
    float
        Ratio of standard deviations, below 1 where the other one rejects more; NaN where nothing is known.
    """
    _, high_hz = band_hz
    if not high_hz > _SLOWEST_GUST_HZ:
        return float("nan")
    gusts = gusts_of(spectrum, plant, band_hz, np.geomspace(_SLOWEST_GUST_HZ, high_hz, _N_GUSTS))
    if gusts is None:
        return float("nan")
    sizes = []
    for controller in controllers:
        loop = close(controller, plant, gusts.frequency_hz)
        sizes.append(float(gusts.attitude_rad((loop.rate if loop.full is None else loop.full)[:1])[0]))
    return sizes[1] / sizes[0] if sizes[0] > 0.0 else float("nan")


class Gusts(NamedTuple):
    """What gusts make of the attitude: power over ``frequency_hz`` without a loop, both (n_frequencies,)."""

    frequency_hz: FloatArray
    power: FloatArray

    def attitude_rad(self, whole: ComplexArray) -> FloatArray:
        """Return the standard deviations of the attitude around open loops (n_loops, n_frequencies)."""
        return np.asarray(np.sqrt(np.sum(self.power / np.abs(1.0 + whole) ** 2, axis=1)))


def gusts_of(
    spectrum: Spectrum, plant: Plant, band_hz: tuple[float, float], frequency_hz: FloatArray
) -> Gusts | None:
    """Return what gusts make of the attitude without a loop.

    Parameters
    ----------
    spectrum : Spectrum
        Of the angular acceleration that disturbs the vehicle.
    plant : Plant
        The estimate alone.
    band_hz : tuple of float
        Where the spectrum is known; gusts go on below it.
    frequency_hz : ndarray, shape (n_frequencies,)
        Rising.

    Returns
    -------
    Gusts or None
        None where nothing is known.
    """
    low_hz, high_hz = band_hz
    known = (spectrum.frequency_hz >= low_hz) & (spectrum.frequency_hz <= high_hz)
    if not known.any():
        return None
    known_hz, told = spectrum.frequency_hz[known], spectrum.density[known]
    density = np.interp(frequency_hz, known_hz, told)
    # Below what is known, stronger as those of flown vehicles are; a single line at the edge tells no level.
    edge, below = known_hz <= 2.0 * known_hz[0], frequency_hz < known_hz[0]
    level = float(np.mean(told[edge] * known_hz[edge] ** -_GUST_SLOPE))
    density[below] = level * frequency_hz[below] ** _GUST_SLOPE
    s = 2j * np.pi * frequency_hz
    inside = (frequency_hz >= _SLOWEST_GUST_HZ) & (frequency_hz <= high_hz)
    power = np.where(inside, density / np.abs(s * (s - plant.damping[0])) ** 2, 0.0)
    # The trapezoidal rule, as weights.
    width = np.diff(frequency_hz)
    weight = 0.5 * (np.append(width, 0.0) + np.insert(width, 0, 0.0))
    return Gusts(frequency_hz, power * weight)
