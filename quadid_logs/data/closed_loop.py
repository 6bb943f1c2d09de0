"""What closing the loop hands on: margins with intervals, predictions, and the curves to draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.controller import FlownControllers, Replay
from quadid_logs.numerals import estimate

if TYPE_CHECKING:
    from quadid_logs.data.outer_loops import OuterLoops

#: Of responses that are worked out at once: arrays of a quarter of a megabyte stay in the processor's cache.
_POINTS_AT_ONCE: Final = 15_000


class Estimated(NamedTuple):
    """A figure with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


class Modes(NamedTuple):
    """Modes of frames between body and gyro: natural frequencies, damping ratios, what the gyro sees of them.

    Each of shape (n_plants,). The deflection d obeys d'' + 2 z w d' + w^2 d = -(rate)'.
    """

    natural_hz: FloatArray
    damping_ratio: FloatArray
    gain: FloatArray

    def at(self, numbers: slice | IntArray) -> Modes:
        """Return some of the modes."""
        return Modes(*(values[numbers] for values in self))

    def response(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the response of the gyro's rate to the body's.

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,) or (n_plants, n_frequencies)

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies)
        """
        frequency_hz = np.broadcast_to(frequency_hz, (self.gain.size, frequency_hz.shape[-1]))
        response = np.ones(frequency_hz.shape, dtype=np.complex128)
        # Many of the drawn vehicles have no mode at all.
        bends = np.flatnonzero(self.gain)
        natural_hz, damping_ratio, gain = (values[bends, np.newaxis] for values in self)
        x = frequency_hz[bends] / natural_hz
        response[bends] += gain * x**2 / (1.0 - x**2 + 2j * damping_ratio * x)
        return response


class Plant(NamedTuple):
    """Vehicles with their actuators, one axis: each of shape (n_plants,); one lead may be that of all.

    Torque to rate is B (1 + s lead) / (s - A) / (1 + s lag) exp(-s delay); ``damping`` A is negative where
    the air brakes. The delay does not contain the zero-order hold. The lead is that of rotors whose
    acceleration turns the vehicle, in yaw. The modes are those of the frame, None where none is looked for.
    """

    effectiveness: FloatArray
    damping: FloatArray
    lag_s: FloatArray
    delay_s: FloatArray
    lead_s: FloatArray | float = 0.0
    modes: Modes | None = None

    def at(self, numbers: slice) -> Plant:
        """Return some of the plants."""
        effectiveness, damping, lag_s, delay_s, lead_s = (values[numbers] for values in self._numbers())
        modes = None if self.modes is None else self.modes.at(numbers)
        return Plant(effectiveness, damping, lag_s, delay_s, lead_s, modes)

    def _numbers(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return all but the modes."""
        lead_s = np.broadcast_to(self.lead_s, self.effectiveness.shape)
        return self.effectiveness, self.damping, self.lag_s, self.delay_s, lead_s

    @property
    def reaction(self) -> FloatArray:
        """Return what accelerating rotors do; shape (n_plants,)."""
        return np.asarray(self.effectiveness * self.lead_s)

    def times(self, factor: float) -> Plant:
        """Return plants that are so many times as effective."""
        return self._replace(effectiveness=self.effectiveness * factor)

    def response(self, frequency_hz: FloatArray, hold_s: float) -> NDArray[np.complex128]:
        """Return the response of the rate to the controller's command, before the gyro's filters.

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,)
        hold_s : float
            For which a command is held [s].

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

    def over(self, others: Plant, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the response over that of other plants, with the same delays and modes.

        Parameters
        ----------
        others : Plant
        frequency_hz : ndarray, shape (n_frequencies,)

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies)
        """
        w = 2.0 * np.pi * frequency_hz
        ratio = self._by_rows(lambda some: some._without_delay(w), w.size)
        ratio /= others._by_rows(lambda some: some._without_delay(w), w.size)
        return ratio

    def _by_rows(
        self, response: Callable[[Plant], NDArray[np.complex128]], n_frequencies: int
    ) -> NDArray[np.complex128]:
        """Return the response of all, worked out for a few at once."""
        found = np.empty((self.effectiveness.size, n_frequencies), dtype=np.complex128)
        n_rows = max(_POINTS_AT_ONCE // max(n_frequencies, 1), 1)
        for row in range(0, len(found), n_rows):
            found[row : row + n_rows] = response(self.at(slice(row, row + n_rows)))
        return found

    def _without_delay(self, w: FloatArray) -> NDArray[np.complex128]:
        """Return the response at angular frequencies w [rad/s] but for delay, hold and modes."""
        B, A, lag_s, _, lead_s = (values[:, np.newaxis] for values in self._numbers())
        response = np.empty((B.size, w.size), dtype=np.complex128)
        # (s - A) (1 + s lag)
        response.real, response.imag = -A - lag_s * w**2, (1.0 - A * lag_s) * w
        return np.divide(B * (1.0 + 1j * w * lead_s) if np.any(lead_s) else B, response, out=response)


class ModeEvidence(NamedTuple):
    """By how much modes explain the spectrum of a flight better than none, as logarithms of likelihoods.

    ``natural_hz`` is (n_frequencies,), ``gained`` (n_frequencies, n_kinds): kinds are the same for all logs.
    """

    natural_hz: FloatArray
    gained: FloatArray

    def at(self, natural_hz: FloatArray) -> FloatArray:
        """Return what the nearest of the frequencies tell; beyond them nothing is told.

        Parameters
        ----------
        natural_hz : ndarray, shape (n,)

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
    """Modes of the frame that the flight allows about one axis, above the fitted band.

    Attributes
    ----------
    modes : Modes
        That of the estimate, then drawn ones; a gain of zero is none.
    seen : bool
        The spectrum of the rate shows one: the estimate has it, too.
    line_hz, line_height : float
        Where its line stands, and how many times the power of its surroundings it has; NaN for no line.
    absent : float
        Probability that there is no mode.
    visible_hz : float
        Up to where the log shows the spectrum of the rate, 0 nowhere.
    evidence : ModeEvidence or None
        Of each mode that was looked for, to be added to that of other flights.
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
    """How far a loop is from instability; None for a figure that the loop does not have.

    Attributes
    ----------
    stable : bool
        Of the estimate itself; an unstable loop has no figures.
    stable_fraction : float
        Of the vehicles that the flight allows, those whose loop is stable.
    extrapolated : bool
        The figures rest on frequencies where nothing was measured; the intervals are wider for it.
    crossover_hz, phase_margin_deg, delay_margin_s : Estimated or None
        Where the gain falls through one with the least phase to spare, that phase, and the delay that uses
        it up.
    gain_margin_db, gain_margin_down_db : Estimated or None
        By how much the gain may grow, and fall, until the loop oscillates.
    oscillation_hz : Estimated or None
        At what frequency it would with a higher gain.
    disk_margin, peak_sensitivity : Estimated or None
        1 / max |S - 1/2| (gain and phase at once, skew 0), and max |S|.
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
    """Margins with the loop cut at the mixer: the rate loop alone, and with the angle loop around it."""

    rate: Margins
    full: Margins | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopCurve:
    """The open loop against frequency, all of shape (n_frequencies,).

    ``low`` and ``high`` hold the 95 % bands of gain and phase [rad, unwrapped].
    """

    frequency_hz: FloatArray
    response: NDArray[np.complex128]
    gain_low: FloatArray
    gain_high: FloatArray
    phase_low: FloatArray
    phase_high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredLoop:
    """The open loop as the log shows it, each of shape (n_frequencies,).

    ``error`` is the relative standard error of ``response``; ``direct`` where an excitation at the mixer
    shows the broken loop itself; otherwise the measured vehicle is multiplied by the known controller.
    """

    frequency_hz: FloatArray
    response: NDArray[np.complex128]
    error: FloatArray
    direct: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """The rate's answer to a step of its set-point: figures with intervals, curve (n,) with its 95 % band.

    ``measured`` is the answer with the response of the closed loop as the log shows it, where it does.
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
    """Set-point, rate [rad/s] and torque of one axis with what is predicted, each (n_samples,), NaN in gaps.

    Torque and its prediction are high-passed at the lower edge of the fitted band.
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
    """What model and controller make of the set-points alone, judged on parts that the fit never saw.

    Attributes
    ----------
    rate_fit_percent, torque_fit_percent : float
        100 (1 - |error| / |measured|), both high-passed.
    attainable_percent : float
        The torque fit of the best linear system: what the set-points do not move, none predicts.
    held_out_s : float
    effectiveness : Estimated
        The on-axis effectiveness whose predicted torque is nearest to the measured one.
    at_limits : bool
        Motors were at their limits during most of what the set-points drive: the loop was open then, and its
        effectiveness is that of a torque that was not given.
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
    """The closed loop of one axis; what a failed replay or a refused axis forbids to say is None.

    ``contradicted``: the measured response does not fit the model around the crossover;
    ``known_hz``: up to where measurement supports the model; ``plants``: the estimate, then vehicles drawn
    around it, whose loops the intervals span. ``by_earlier``: the flight tells too little of the axis, and
    nothing in it contradicts the plants, which are those of earlier flights alone.
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoop:
    """The loops around the recommended model, by axis.

    Attributes
    ----------
    controllers : FlownControllers
        Rate and angle controllers with the parameters that flew.
    axes : mapping of str to AxisLoop
    outer : OuterLoops or None
        The loops around these; None where nobody looked, or the controllers are not known.

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
        """By axis, those that can be told: of axes whose controller replays and whose model is trusted."""
        return {axis: loop.margins for axis, loop in self.axes.items() if loop.margins is not None}

    def __repr__(self) -> str:
        lines = [f"<{type(self).__name__}"]
        lines += [f"  {axis:<5}  {loop.rate}" for axis, loop in self.margins.items()]
        return "\n".join(lines) + ">"
