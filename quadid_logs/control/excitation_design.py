"""Excitation that fits a vehicle: band, amplitude and length of a sweep for a wanted interval in its air.

A sweep d that is added at the mixer's input makes the torque S d, S = 1 / (1 + L), whatever the air does,
and the
rate that follows from it. Around that the equation of motion, d(rate)/dt = B h torque + A rate + v, is
disturbed
by air and by the gyro's noise: with their spectrum the variance of the estimate of B that `identify` makes,
with damping, lag and delay unknown, too, follows before anything is flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.loop import close, forward_filters
from quadid_logs.control.margins import grid_hz
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.identify.excitation import MIN_RATE_RMS_DEG_S
from quadid_logs.identify.spectral import LEAST_DEPARTURE, OCTAVE
from quadid_logs.identify.systematic import GYRO_SYSTEMATIC
from quadid_logs.maths.band import ComplexArray, gaussian_response
from quadid_logs.maths.normal import NORMAL_95

#: Around the crossover, a vehicle's response decides its margins: from where the loop holds the attitude up
#: to where it does nothing any more.
_BELOW, _ABOVE = 0.2, 2.5
#: The gain margin is read off where the phase of the loop crosses 180 degrees: the sweep goes on beyond it.
_BEYOND_PHASE_CROSSOVER: Final = 1.25
#: Slower than this a sweep is a drift of the trim, and its two first cycles last for ten seconds [Hz].
_SLOWEST_HZ: Final = 0.2
#: Of the loop's rate: above, what happens between two samples is a guess.
_OF_LOOP_RATE: Final = 0.3
#: Shortest and longest sweep [s]: half a minute is the least whose blocks tell the noise, two minutes a
#: third of a battery.
SHORTEST_S: Final = 30.0
LONGEST_S: Final = 90.0
#: The analysis calls no axis excited that turns less than a hovering vehicle over a flight: of three sweeps
#: in turn each has a quarter of it, with the pauses between them.
_LEAST_RATE_RAD_S: Final = math.radians(1.2 * MIN_RATE_RMS_DEG_S * math.sqrt(4.0))
#: A third of every flight is kept to judge the model by, and nothing is fitted to it.
TRAINED: Final = 2.0 / 3.0
#: Of an interval, what more excitation is not worth; the least part of the strongest sweep that is tried, and
#: how near to the gentlest the search ends: settings have two digits.
_NO_LESS: Final = 1e-3
_GENTLEST: Final = 1e-3
_NEAR: Final = 1.02


#: Where a sweep enters: at the mixer, as a fraction of its range with the loops closed; or as a rate
#: set-point in rad/s, with no angle loop around it.
Entry = Literal["mixer", "rate"]


class AxisLimits(NamedTuple):
    """What a sweep of one axis may do: torque in the mixer's range, rate and angle that follow from it."""

    torque: float
    rate_rad_s: float
    angle_rad: float


#: Half of what leaves the vehicle its full authority against a gust, and motions in which it stays linear:
#: lift falls by 1 - cos(8 degrees), 1 %. Yaw turns at the same height, whatever its angle is.
LIMITS: Final = (
    AxisLimits(0.15, math.radians(60.0), math.radians(8.0)),
    AxisLimits(0.15, math.radians(60.0), math.radians(8.0)),
    AxisLimits(0.25, math.radians(45.0), math.radians(20.0)),
)


class Air(NamedTuple):
    """What disturbs an axis: one-sided densities over ``frequency_hz``, each (n_frequencies,).

    ``acceleration`` is that of the angular acceleration which no torque explains, in (rad/s^2)^2 / Hz, and
    ``fitted_hz`` the upper edge of the band that the model of such a flight is fitted in.
    """

    frequency_hz: FloatArray
    acceleration: FloatArray
    fitted_hz: float = 5.0

    def at(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the density at frequencies; outside of what is known, as strong as at its edge."""
        return np.interp(frequency_hz, self.frequency_hz, self.acceleration)


class Chirp(NamedTuple):
    """A logarithmic sweep: its band [Hz], amplitude [1] and length [s]."""

    start_hz: float
    stop_hz: float
    magnitude: float
    record_s: float

    def energy(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the one-sided energy density [1 s / Hz]: time in a band times half the squared amplitude."""
        inside = (frequency_hz >= self.start_hz) & (frequency_hz <= self.stop_hz)
        octave = self.strength / math.log(self.stop_hz / self.start_hz)
        return np.where(inside, 0.5 * octave / frequency_hz, 0.0)

    @property
    def strength(self) -> float:
        """What its energy is in proportion to: the squared amplitude times how long it rises [s]."""
        return self.magnitude**2 * (self.record_s - 2.0 / self.start_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisExcitation:
    """A sweep that fits one axis, and what it promises.

    Attributes
    ----------
    start_hz, stop_hz, magnitude, record_s : float
        Of the sweep; the magnitude in the unit of its `Entry`.
    crossover_hz, phase_crossover_hz : float
        Of the whole loop as it flies: where its gain is one, and where its phase is 180 degrees. NaN where it
        has none.
    half_width : float
        Of the 95 % interval of the control effectiveness, over the effectiveness.
    most_magnitude : float
        Largest magnitude that keeps the vehicle within `LIMITS`.
    peak_torque, peak_rate_rad_s, peak_angle_rad : float
        What the sweep does to the vehicle at most.
    """

    start_hz: float
    stop_hz: float
    magnitude: float
    record_s: float
    crossover_hz: float
    phase_crossover_hz: float
    half_width: float
    most_magnitude: float
    peak_torque: float
    peak_rate_rad_s: float
    peak_angle_rad: float


class _Answers(NamedTuple):
    """What one unit of the sweep does over frequency, each (n_frequencies,): torque, rate, and angle."""

    frequency_hz: FloatArray
    loop: ComplexArray
    torque: ComplexArray
    rate: ComplexArray


def design(
    controller: AxisController,
    plant: Plant,
    air: Air,
    number: int,
    wanted: float,
    *,
    entry: Entry = "mixer",
    most_hz: float = math.inf,
    lead_lag_hz: tuple[float, float] | None = None,
) -> AxisExcitation | None:
    """Choose the sweep of one axis.

    Parameters
    ----------
    controller : AxisController
        As it flies.
    plant : Plant
        The estimate alone, per unit of the controller's command.
    air : Air
        Where the flight is to be.
    number : int
        Of the axis: 0 roll, 1 pitch, 2 yaw.
    wanted : float
        Half the 95 % interval of the control effectiveness, over the effectiveness.
    entry : Entry
    most_hz : float
        Above which nothing can be commanded.
    lead_lag_hz : (float, float), optional
        Pole and zero of what the autopilot shapes its sweep with.

    Returns
    -------
    AxisExcitation or None
        The gentlest of the shortest sweeps that reach what is wanted; where none does, the strongest of the
        longest, which promises less. None where the loop has no crossover, or the sweep would not reach it.
    """
    frequency_hz = grid_hz(controller.period_s)
    closed = close(controller, plant, frequency_hz)
    loop = (closed.rate if closed.full is None else closed.full)[0]
    if entry == "mixer":
        torque = 1.0 / (1.0 + loop)
    else:
        torque = forward_filters(controller, frequency_hz) / (1.0 + closed.rate[0])
    rate = torque * plant.response(frequency_hz, controller.period_s)[0]
    answers = _Answers(frequency_hz, loop, torque, rate)
    if lead_lag_hz is not None:
        pole, zero = (1.0 + 1j * answers.frequency_hz / corner for corner in lead_lag_hz)
        answers = answers._replace(torque=answers.torque * zero / pole, rate=answers.rate * zero / pole)
    crossover_hz, phase_crossover_hz = crossovers(answers.frequency_hz, answers.loop)
    if not math.isfinite(crossover_hz):
        return None
    start_hz, stop_hz = band(crossover_hz, phase_crossover_hz, controller.period_s)
    stop_hz = min(stop_hz, most_hz)
    if stop_hz < 2.0 * start_hz:
        return None
    inside = (frequency_hz >= start_hz) & (frequency_hz <= stop_hz)
    turned = answers.rate / (2j * np.pi * frequency_hz)
    peaks = [float(np.abs(each[inside]).max()) for each in (answers.torque, answers.rate, turned)]
    if entry == "mixer":
        # What is added at the mixer is the mixer's, too, where the loop takes from it.
        peaks[0] = max(peaks[0], 1.0)
    most = min(limit / peak for limit, peak in zip(LIMITS[number], peaks, strict=True))

    promise = _Promise(plant, answers, air, Chirp(start_hz, stop_hz, 1.0, LONGEST_S))

    def promised(magnitude: float, record_s: float) -> float:
        return promise.half_width(Chirp(start_hz, stop_hz, magnitude, record_s))

    magnitude, record_s = _least(promised, _rounded_down(most), wanted)
    # The rate during a sweep of one unit, as far as it is fitted.
    energy = Chirp(start_hz, stop_hz, 1.0, record_s).energy(frequency_hz)
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    power = energy * np.abs(answers.rate) ** 2 * gaussian_response(s, air.fitted_hz) ** 2
    moving = _LEAST_RATE_RAD_S / math.sqrt(float(np.trapezoid(power, frequency_hz)) / record_s)
    magnitude = min(max(magnitude, _rounded_up(moving)), _rounded_down(most))
    torque, rate, angle = (magnitude * peak for peak in peaks)
    return AxisExcitation(
        start_hz=start_hz,
        stop_hz=stop_hz,
        magnitude=magnitude,
        record_s=record_s,
        crossover_hz=crossover_hz,
        phase_crossover_hz=phase_crossover_hz,
        half_width=promised(magnitude, record_s),
        most_magnitude=_rounded_down(most),
        peak_torque=torque,
        peak_rate_rad_s=rate,
        peak_angle_rad=angle,
    )


def band(crossover_hz: float, phase_crossover_hz: float, period_s: float) -> tuple[float, float]:
    """Return the band of a sweep [Hz], both crossovers within it.

    Parameters
    ----------
    crossover_hz, phase_crossover_hz : float
        The latter NaN where the phase never gets there.
    period_s : float
        Of the control loop.

    Returns
    -------
    (float, float)
    """
    beyond = np.nan_to_num(_BEYOND_PHASE_CROSSOVER * phase_crossover_hz)
    high_hz = min(max(_ABOVE * crossover_hz, float(beyond)), _OF_LOOP_RATE / period_s)
    return float(f"{max(_BELOW * crossover_hz, _SLOWEST_HZ):.2g}"), float(f"{high_hz:.3g}")


def crossovers(frequency_hz: FloatArray, loop: ComplexArray) -> tuple[float, float]:
    """Return where a loop's gain last falls through one, and where its phase then reaches 180 degrees.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Rising.
    loop : ndarray of complex, shape (n_frequencies,)

    Returns
    -------
    (float, float)
        NaN for none.
    """
    gain, phase = np.abs(loop), np.unwrap(np.angle(loop))
    falling = np.flatnonzero((gain[:-1] >= 1.0) & (gain[1:] < 1.0))
    if not falling.size:
        return math.nan, math.nan
    last = int(falling[-1])
    # A loop that is stable has less than 180 degrees of lag at its crossover.
    phase = phase - 2.0 * math.pi * math.ceil((phase[last] - 0.5 * math.pi) / (2.0 * math.pi))
    beyond = np.flatnonzero((phase[:-1] > -math.pi) & (phase[1:] <= -math.pi))
    later = beyond[beyond >= last]
    return float(frequency_hz[last]), float(frequency_hz[later[0]]) if later.size else math.nan


class _Promise:
    """What sweeps of one band promise: all integrals over the band are in proportion to a sweep's energy.

    Notes
    -----
    Instruments leave the part of torque and rate that follows from the sweep. Least squares on that in the
    band W that is fitted have the information M = 2 int g g* E W df and the variance M^-1 N M^-1, N = 2 int g
    g* E P W^2 df, with the slopes g, the sweep's energy E and the noise's density P, one-sided (L. Ljung,
    System Identification, 1999, sec. 7.4, 9.4 and 13.3). The departure is that of `identify.spectral`.
    """

    def __init__(self, plant: Plant, answers: _Answers, air: Air, chirp: Chirp) -> None:
        f, s = answers.frequency_hz, np.asarray(2j * np.pi * answers.frequency_hz, dtype=np.complex128)
        self._strength = chirp.strength
        noise, energy = air.at(f), 2.0 * TRAINED * chirp.energy(f)
        driven = answers.rate * (s - plant.damping[0])
        # By relative changes of effectiveness, and by changes of damping, lag and delay.
        slopes = np.stack([driven, answers.rate, -s / (1.0 + s * plant.lag_s[0]) * driven, -s * driven])
        fitted = gaussian_response(s, air.fitted_hz) ** 2
        self._information, self._scatter = (
            np.real((slopes * weight) @ _to_integrate(slopes.conj().T, f))
            for weight in (energy * fitted, energy * fitted**2 * noise)
        )
        typical = np.trapezoid(noise * fitted, f) / np.trapezoid(fitted, f)
        # How well damping, lag and delay are known before a flight, in standard deviations.
        before = (max(2.0, abs(float(plant.damping[0]))), 0.7 * max(float(plant.lag_s[0]), 0.01), 0.01)
        self._known_before = np.diag([0.0, *(typical / spread**2 for spread in before)])
        self._typical = float(typical)
        moved = _to_integrate((slopes * energy * fitted * driven.conj()).T, f)
        alike = np.exp(-np.abs(np.subtract.outer(np.log(f), np.log(f))) / OCTAVE)
        self._departure = sum(each.T @ alike @ each for each in (moved.real, moved.imag))

    def half_width(self, chirp: Chirp) -> float:
        """Return half the 95 % interval of the effectiveness that a sweep promises, over the effectiveness.

        Returns
        -------
        float
            The gyro's scale included, and the smooth departure that no lag and delay describe.
        """
        times, known_before = chirp.strength / self._strength, self._known_before
        inverse = np.linalg.pinv(times * self._information + known_before, hermitian=True)
        # What is known before has its own part in the variance, as a measurement would.
        scatter = times * self._scatter + self._typical * known_before
        variance = (inverse @ scatter @ inverse)[0, 0]
        variance += (LEAST_DEPARTURE * times) ** 2 * (inverse[0] @ self._departure @ inverse[0])
        return float(np.hypot(NORMAL_95 * math.sqrt(max(variance, 0.0)), GYRO_SYSTEMATIC))


def _to_integrate(columns: ComplexArray, frequency_hz: FloatArray) -> ComplexArray:
    """Return rows weighted by the trapezoidal rule."""
    width = np.diff(frequency_hz)
    weight = 0.5 * (np.append(width, 0.0) + np.insert(width, 0, 0.0))
    return columns * weight[:, np.newaxis]


def _least(promised: Callable[[float, float], float], most: float, wanted: float) -> tuple[float, float]:
    """Return magnitude and length: the least of the shortest, then the shortest of the strongest."""
    # What no sweep makes smaller, however strong: what a stronger one tells may even be a little less.
    least = min(promised(1e6 * most, LONGEST_S), promised(most, LONGEST_S))
    enough = max(wanted, math.hypot(least, _NO_LESS))
    for record_s in np.arange(SHORTEST_S, LONGEST_S + 1.0, 10.0):
        if promised(most, float(record_s)) <= enough:
            break
    else:
        return most, LONGEST_S
    low, high = _GENTLEST * most, most
    while high > _NEAR * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if promised(middle, float(record_s)) <= enough else (middle, high)
    return min(_rounded_up(high), most), float(record_s)


def _rounded_down(value: float) -> float:
    """Return a setting of two digits that is no larger."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / step + 1e-9) * step:.2g}")


def _rounded_up(value: float) -> float:
    """Return a setting of two digits that is no smaller."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.2g}")
