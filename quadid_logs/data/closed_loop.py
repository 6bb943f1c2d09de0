"""Results of closing the loop: margins with intervals, predictions and curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.controller import AxisController, FlownControllers, Replay
from quadid_logs.numerals import estimate

if TYPE_CHECKING:
    from quadid_logs.data.outer_loops import OuterLoops

#: Responses computed at once: arrays of a quarter of a megabyte stay in the processor's cache.
_POINTS_AT_ONCE: Final = 15_000


class Estimated(NamedTuple):
    """A value with its 95 % interval ``ci95`` (lower and upper end), in the same unit."""

    value: float
    ci95: tuple[float, float]


class Modes(NamedTuple):
    """Structural modes between body and gyro: natural frequency [Hz], damping ratio, gain at the gyro.

    All arrays have shape (n_plants,). The deflection d obeys d'' + 2 z w d' + w^2 d = -(rate)', with the
    damping ratio z and the natural frequency w [rad/s].
    """

    natural_hz: FloatArray
    damping_ratio: FloatArray
    gain: FloatArray

    def at(self, numbers: slice | IntArray) -> Modes:
        """Return a subset of the modes."""
        return Modes(*(values[numbers] for values in self))

    def response(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the frequency response from the rate of the body to the rate at the gyro.

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,) or (n_plants, n_frequencies)
            Frequencies [Hz].

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies)
        """
        frequency_hz = np.broadcast_to(frequency_hz, (self.gain.size, frequency_hz.shape[-1]))
        response = np.ones(frequency_hz.shape, dtype=np.complex128)
        # Many of the plant samples have no mode.
        bends = np.flatnonzero(self.gain)
        natural_hz, damping_ratio, gain = (values[bends, np.newaxis] for values in self)
        x = frequency_hz[bends] / natural_hz
        response[bends] += gain * x**2 / (1.0 - x**2 + 2j * damping_ratio * x)
        return response


class Plant(NamedTuple):
    """Samples of the plant of one axis with its actuator; shape (n_plants,).

    The transfer from torque to rate is B (1 + s lead) / (s - A) / (1 + s lag) exp(-s delay), with the
    ``effectiveness`` B [rad/s^2 per unit of torque] and the ``damping`` A [1/s], negative for a damped axis.
    Lag, delay and lead are in [s]. The delay excludes the zero-order hold. The lead is the reaction of
    accelerating rotors in yaw; one value may hold for all plants. ``modes`` are structural modes, None if
    they were not searched for.
    """

    effectiveness: FloatArray
    damping: FloatArray
    lag_s: FloatArray
    delay_s: FloatArray
    lead_s: FloatArray | float = 0.0
    modes: Modes | None = None

    def at(self, numbers: slice) -> Plant:
        """Return a subset of the plants."""
        effectiveness, damping, lag_s, delay_s, lead_s = (values[numbers] for values in self._numbers())
        modes = None if self.modes is None else self.modes.at(numbers)
        return Plant(effectiveness, damping, lag_s, delay_s, lead_s, modes)

    def _numbers(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return all numbers except the modes."""
        lead_s = np.broadcast_to(self.lead_s, self.effectiveness.shape)
        return self.effectiveness, self.damping, self.lag_s, self.delay_s, lead_s

    @property
    def reaction(self) -> FloatArray:
        """Reaction of accelerating rotors: effectiveness times lead; shape (n_plants,)."""
        return np.asarray(self.effectiveness * self.lead_s)

    def times(self, factor: float) -> Plant:
        """Return plants with the effectiveness multiplied by a factor."""
        return self._replace(effectiveness=self.effectiveness * factor)

    def response(self, frequency_hz: FloatArray, hold_s: float) -> NDArray[np.complex128]:
        """Return the frequency response from the controller's command to the rate, before the gyro filters.

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,)
            Frequencies [Hz].
        hold_s : float
            Duration of the zero-order hold of a command [s].

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies)
        """
        w, held = 2.0 * np.pi * frequency_hz, np.sinc(frequency_hz * hold_s)

        def rigid(some: Plant) -> NDArray[np.complex128]:
            # The delay's phase by cosine and sine, half as long as a complex exponential.
            late = w * (some.delay_s[:, np.newaxis] + 0.5 * hold_s)
            turned = np.empty(late.shape, dtype=np.complex128)
            turned.real, turned.imag = held * np.cos(late), -held * np.sin(late)
            turned *= some._without_delay(w)
            return turned

        response = self._by_rows(rigid, w.size)
        if self.modes is not None:
            response *= self.modes.response(frequency_hz)
        return response

    def undelayed(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the response without delay, hold and modes.

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,)
            Frequencies [Hz].

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies)
        """
        w = 2.0 * np.pi * frequency_hz
        return self._by_rows(lambda some: some._without_delay(w), w.size)

    def _by_rows(
        self, response: Callable[[Plant], NDArray[np.complex128]], n_frequencies: int
    ) -> NDArray[np.complex128]:
        """Return the response of all plants, computed in batches."""
        found = np.empty((self.effectiveness.size, n_frequencies), dtype=np.complex128)
        n_rows = max(_POINTS_AT_ONCE // max(n_frequencies, 1), 1)
        for row in range(0, len(found), n_rows):
            found[row : row + n_rows] = response(self.at(slice(row, row + n_rows)))
        return found

    def _without_delay(self, w: FloatArray) -> NDArray[np.complex128]:
        """Return the response at angular frequencies w [rad/s] without delay, hold and modes."""
        B, A, lag_s, _, lead_s = (values[:, np.newaxis] for values in self._numbers())
        response = np.empty((B.size, w.size), dtype=np.complex128)
        # (s - A) (1 + s lag)
        response.real, response.imag = -A - lag_s * w**2, (1.0 - A * lag_s) * w
        return np.divide(B * (1.0 + 1j * w * lead_s) if np.any(lead_s) else B, response, out=response)


class ModeEvidence(NamedTuple):
    """Log-likelihood ratios of structural modes against no mode, for the spectrum of a flight.

    ``natural_hz`` [Hz] has shape (n_frequencies,), ``gained`` (n_frequencies, n_kinds). The kinds are the
    same for all logs.
    """

    natural_hz: FloatArray
    gained: FloatArray

    def at(self, natural_hz: FloatArray) -> FloatArray:
        """Return the log-likelihood ratios at the nearest frequencies, zero outside their range.

        Parameters
        ----------
        natural_hz : ndarray, shape (n,)
            Natural frequencies [Hz].

        Returns
        -------
        ndarray, shape (n, n_kinds)
        """
        logs = np.log(self.natural_hz)
        nearest = np.rint(np.interp(np.log(natural_hz), logs, np.arange(logs.size))).astype(np.int64)
        known = (natural_hz >= self.natural_hz[0]) & (natural_hz <= self.natural_hz[-1])
        return np.where(known[:, np.newaxis], self.gained[nearest], 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameModes:
    """Possible structural modes of the frame about one axis, above the fitted band.

    Attributes
    ----------
    modes : Modes
        The mode of the estimate, then random samples; a gain of zero means no mode.
    seen : bool
        Whether a mode was detected in the spectrum of the rate; the estimate then includes it.
    line_hz, line_height : float
        Frequency of the spectral line [Hz], and its power relative to the surrounding spectrum; NaN if there
        is no line.
    absent : float
        Probability that there is no mode.
    visible_hz : float
        Highest frequency of the logged rate spectrum [Hz]; 0 if there is none.
    evidence : ModeEvidence or None
        Evidence for each tested mode, to be combined with that of other flights.
    """

    modes: Modes
    seen: bool
    line_hz: float
    line_height: float
    absent: float
    visible_hz: float
    evidence: ModeEvidence | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Stability margins of a loop; None for a margin that the loop does not have.

    Attributes
    ----------
    stable : bool
        Whether the loop of the estimate is stable. An unstable loop has no margins.
    stable_fraction : float
        Fraction of the plant samples with a stable loop.
    extrapolated : bool
        Whether the margins depend on frequencies without measurements. The intervals are then wider.
    crossover_hz : Estimated or None
        Crossover frequency [Hz]: the gain falls through 1. Of several, that with the smallest phase margin.
    phase_margin_deg : Estimated or None
        Phase margin at that frequency [deg].
    delay_margin_s : Estimated or None
        The additional delay that uses up the phase margin [s].
    gain_margin_db, gain_margin_down_db : Estimated or None
        Increase, and decrease, of the gain at which the loop becomes unstable [dB].
    oscillation_hz : Estimated or None
        Frequency of the oscillation at the upper gain margin [Hz].
    disk_margin, peak_sensitivity : Estimated or None
        1 / max |S - 1/2| (simultaneous gain and phase variation, skew 0), and max |S|.
    """

    stable: bool
    stable_fraction: float
    extrapolated: bool
    crossover_hz: Estimated | None = None
    phase_margin_deg: Estimated | None = None
    gain_margin_db: Estimated | None = None
    gain_margin_down_db: Estimated | None = None
    oscillation_hz: Estimated | None = None
    delay_margin_s: Estimated | None = None
    disk_margin: Estimated | None = None
    peak_sensitivity: Estimated | None = None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self}>"

    def __str__(self) -> str:
        if not self.stable:
            return "unstable"
        figures = ("phase margin", self.phase_margin_deg, "deg"), ("gain margin", self.gain_margin_db, "dB")
        told = [
            f"{name} {estimate(found.value, *found.ci95)} {unit}"
            for name, found, unit in figures
            if found is not None
        ]
        return ", ".join(told) or "stable"


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins:
    """Margins of the loop opened at the mixer: ``rate`` without, ``full`` with the angle loop around it."""

    rate: Margins
    full: Margins | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopCurve:
    """The open-loop transfer over frequency [Hz]; all arrays have shape (n_frequencies,).

    ``gain_low``, ``gain_high``, ``phase_low`` and ``phase_high`` are the 95 % bands of gain [1] and phase
    [rad, unwrapped].
    """

    frequency_hz: FloatArray
    response: NDArray[np.complex128]
    gain_low: FloatArray
    gain_high: FloatArray
    phase_low: FloatArray
    phase_high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredLoop:
    """The measured open-loop transfer; all arrays have shape (n_frequencies,).

    ``error`` is the relative standard error of ``response``. If ``direct``, the transfer was measured with an
    excitation at the mixer. Otherwise it is the measured vehicle times the known controller.
    """

    frequency_hz: FloatArray
    response: NDArray[np.complex128]
    error: FloatArray
    direct: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """Rate step response: characteristics with 95 % intervals, and curves of shape (n,).

    ``response`` is relative to the step of the set-point, ``low`` and ``high`` are its 95 % band.
    ``measured`` is the step response of the measured closed loop, None if the log does not show it.
    """

    rise_time_s: Estimated
    overshoot_percent: Estimated
    settling_time_s: Estimated
    time_s: FloatArray
    response: FloatArray
    low: FloatArray
    high: FloatArray
    measured: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedSeries:
    """Measured and predicted rate [rad/s] and torque of one axis; shape (n_samples,), NaN in gaps.

    Torque and predicted torque are high-passed at the lower edge of the fitted band. ``held_out`` marks
    validation data.
    """

    time_s: FloatArray
    setpoint: FloatArray
    rate: FloatArray
    predicted_rate: FloatArray
    torque: FloatArray
    predicted_torque: FloatArray
    held_out: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Prediction of rate and torque from the set-points only, with its scores on validation data.

    Attributes
    ----------
    rate_fit_percent, torque_fit_percent : float
        100 (1 - |error| / |measured|) [%]; both signals are high-passed.
    attainable_percent : float
        Torque fit of the best linear system [%]: no model can predict what does not follow from set-points.
    held_out_s : float
        Length of the validation data [s].
    effectiveness : Estimated
        The on-axis effectiveness [rad/s^2 per unit of torque] with the best prediction of the torque.
    at_limits : bool
        Whether the motors were at their limits during most of the motion by set-points. The loop was open
        then, so ``effectiveness`` refers to a torque that was not achieved.
    """

    rate_fit_percent: float
    torque_fit_percent: float
    attainable_percent: float
    held_out_s: float
    effectiveness: Estimated
    series: PredictedSeries
    at_limits: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisLoop:
    """The closed loop of one axis. Fields are None if the replay failed or the axis is refused.

    ``contradicted`` means that the measured response disagrees with the model around the crossover.
    ``known_hz`` is the highest frequency at which measurements support the model [Hz]. ``plants`` holds the
    estimate, then the plant samples that the intervals are computed from. ``by_earlier`` means that the
    flight does not identify the axis: the plants are those of earlier flights, which it does not contradict.
    ``began`` is the controller of the first of the earlier flights that tell of the axis.
    """

    replay: Replay | None = None
    prediction: Prediction | None = None
    margins: LoopMargins | None = None
    step: Step | None = None
    curve: LoopCurve | None = None
    measured: MeasuredLoop | None = None
    effectiveness: Estimated | None = None
    contradicted: bool = False
    known_hz: float = 0.0
    frame: FrameModes | None = None
    plants: Plant | None = None
    by_earlier: bool = False
    began: AxisController | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoop:
    """The closed loops of the recommended model and the controllers, by axis.

    Attributes
    ----------
    controllers : FlownControllers
        Rate and angle controllers with the flown parameters.
    axes : mapping of str to AxisLoop
        Loops by axis: "roll", "pitch", "yaw".
    outer : OuterLoops or None
        Attitude, velocity and position loops; None if not analyzed, or if their controllers are not known.

    Examples
    --------
    >>> import quadid_logs
    >>> loop = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").loop  # a ClosedLoop
    >>> margin = loop.margins["roll"].rate.phase_margin_deg
    >>> print(f"{margin.value:.0f} deg, 95 %: {margin.ci95[0]:.0f} to {margin.ci95[1]:.0f}")
    63 deg, 95 %: 63 to 63
    """

    controllers: FlownControllers
    axes: Mapping[str, AxisLoop] = field(default_factory=dict)
    outer: OuterLoops | None = None

    @property
    def margins(self) -> dict[str, LoopMargins]:
        """Margins by axis, for axes with a usable model and a controller that reproduces the log."""
        return {axis: loop.margins for axis, loop in self.axes.items() if loop.margins is not None}

    def __repr__(self) -> str:
        lines = [f"<{type(self).__name__}"]
        lines += [f"  {axis:<5}  {loop.rate}" for axis, loop in self.margins.items()]
        return "\n".join(lines) + ">"
