"""Results of the stage `align`: segments without gaps, on one clock and one sample period."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.counting import counted
from quadid_logs.data.log import NO_GYRO_FILTER, FlightLog, GyroFilter, LogText, ModeChange
from quadid_logs.data.torque import AssumedExpo, Calibration

#: Twenty fits of half a second; on less flight, scores on validation data mean nothing [s].
LEAST_FLIGHT_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceChoice:
    """The selected source of a signal, and its actual sampling.

    Attributes
    ----------
    signal, source, reason : str
        Canonical name, the vendor's fields, and the reason for the selection.
    rate_hz : float
        Median sample rate inside the flight segments, or of the whole log if there are none [Hz].
    mean_rate_hz : float
        Number of samples over time covered; lower than `rate_hz` if samples are missing [Hz].
    longest_gap_s : float
        Longest time between samples inside the flight segments [s].
    n_gaps : int
        Number of gaps longer than three periods.
    n_duplicate, n_out_of_order, n_outliers, n_not_finite : int
        Rows with a repeated time stamp; rows that were sorted into order; rows removed for an impossible time
        stamp; rows removed for NaN, infinite or absurd values, or a spike of one sample.
    others : tuple of (source, rate_hz)
        The sources that were not selected.
    """

    signal: str
    source: str
    reason: str
    n_samples: int
    rate_hz: float
    mean_rate_hz: float
    longest_gap_s: float
    n_gaps: int = 0
    n_duplicate: int = 0
    n_out_of_order: int = 0
    n_outliers: int = 0
    n_not_finite: int = 0
    others: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """A part of a flight on a uniform time grid, without gaps.

    Attributes
    ----------
    time_s : ndarray, shape (n_samples,)
        Uniform times on the log's clock [s].
    body_rate_rad_s : ndarray, shape (n_samples, 3)
        p, q, r in the body frame (forward, right, down) [rad/s].
    torque : ndarray, shape (n_samples, 3)
        L, M, N about the body axes, in the unit that `InputDescription` names.
    attitude_rad : ndarray, shape (n_samples, 3), or None
        Euler angles roll, pitch, yaw with yaw unwrapped [rad]; None if not logged.
    throttle : ndarray, shape (n_samples,), or None
        Throttle as a fraction of full throttle; None if not logged.
    rotor_thrust : ndarray, shape (n_samples, n_rotors), or None
        Thrust of each rotor, in the unit that `InputDescription.torque_per_thrust` refers to; None if the
        rotors are not known.
    thrust_by_expo : ndarray, shape (n_samples, n_rotors), or None
        Derivative of the thrust by the expo of the thrust curve; None if no expo was assumed.
    reference : ndarray, shape (n_samples, 3 or 4), or None
        Commands from outside the rate loop: rate set-points [rad/s], and the excitation of a system-ID mode
        if there is one. None if the log has no set-points.
    command : ndarray, shape (n_samples, 3 or 4), or None
        The reference without the feedback of the vehicle's motion. For an angle controller, this is its gain
        times the commanded angle [rad/s]. For a planned trajectory, it holds the rates along the trajectory
        [rad/s]. If the log holds stick commands for angles, roll and pitch are these, as rates [rad/s]. For
        flights that repeat one trajectory, it is the mean torque of the other flights, in standard
        deviations. NaN in flight modes whose set-points depend on the motion in ways that are not logged.
        None without set-points or flight modes.
    law : ndarray of int, shape (n_samples,), or None
        Number of the law by which the flight mode computed set-points from commands; None if there was only
        one.
    velocity_m_s : ndarray, shape (n_samples, 3), or None
        Velocity over ground along the body axes [m/s]; None if velocity or attitude is not logged.
    planned : bool
        Whether the command is a planned trajectory. Such commands are few and gentle. Below 1 Hz they are
        correlated with the airspeed.
    repeated : bool
        Whether the planned trajectory was obtained from other flights that repeat it.
    saturated : ndarray of bool, shape (n_samples,)
        Whether the torque could not be achieved, or was clipped.
    flight : int
        Number of the flight (from take-off to landing), from 0.
    """

    time_s: FloatArray
    body_rate_rad_s: FloatArray
    torque: FloatArray
    attitude_rad: FloatArray | None
    throttle: FloatArray | None
    saturated: BoolArray
    reference: FloatArray | None = None
    command: FloatArray | None = None
    law: IntArray | None = None
    velocity_m_s: FloatArray | None = None
    planned: bool = False
    repeated: bool = False
    rotor_thrust: FloatArray | None = None
    thrust_by_expo: FloatArray | None = None
    flight: int = 0

    @property
    def n_samples(self) -> int:
        """Number of grid points."""
        return int(self.time_s.shape[0])

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__}: {self.n_samples} samples from {self.start_s:.4g} to {self.end_s:.4g} s>"
        )

    def parts(self, n_parts: int) -> Iterator[Segment]:
        """Yield the segment in so many parts of about equal length, in order."""
        for first, after in pairwise(np.linspace(0, self.n_samples, n_parts + 1).astype(int).tolist()):
            yield self.rows(slice(first, after))

    def rows(self, rows: slice) -> Segment:
        """Return a part of the segment."""
        return replace(
            self,
            time_s=self.time_s[rows],
            body_rate_rad_s=self.body_rate_rad_s[rows],
            torque=self.torque[rows],
            attitude_rad=None if self.attitude_rad is None else self.attitude_rad[rows],
            throttle=None if self.throttle is None else self.throttle[rows],
            saturated=self.saturated[rows],
            reference=None if self.reference is None else self.reference[rows],
            command=None if self.command is None else self.command[rows],
            law=None if self.law is None else self.law[rows],
            velocity_m_s=None if self.velocity_m_s is None else self.velocity_m_s[rows],
            rotor_thrust=None if self.rotor_thrust is None else self.rotor_thrust[rows],
            thrust_by_expo=None if self.thrust_by_expo is None else self.thrust_by_expo[rows],
        )

    @property
    def start_s(self) -> float:
        """Time of the first sample [s]."""
        return float(self.time_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.time_s[-1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GyroCheck:
    """Comparison of the integrated body rates with the change of the attitude.

    Attributes
    ----------
    length_s : float
        Length of each interval [s].
    start_s : ndarray, shape (n_intervals,)
        Start of each interval of flight [s].
    attitude_change, integrated_change : ndarray, shape (n_intervals, 3)
        Change of roll, pitch and yaw from the attitude, and from the logged body rates after correction of
        bias and lag [rad].
    matrix : ndarray, shape (3, 3)
        Body rates by the attitude over logged body rates; the identity matrix if they agree.
    half_width : ndarray, shape (3, 3)
        Half of the 95 % interval of each element of `matrix`.
    explained : ndarray, shape (3, 3)
        Fraction of the motion that each element explains.
    bias_rad_s : ndarray, shape (3,)
        Bias of the gyro [rad/s].
    lag_s, lag_half_width_s : float
        Lag of the rates behind the attitude, which is that of the gyro filter, and half of its 95 % interval
        [s].
    """

    length_s: float
    start_s: FloatArray
    attitude_change: FloatArray
    integrated_change: FloatArray
    matrix: FloatArray
    half_width: FloatArray
    explained: FloatArray
    bias_rad_s: FloatArray
    lag_s: float
    lag_half_width_s: float

    @property
    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest possible value of each element of `matrix`; both of shape (3, 3).

        Noise in the rates biases the least-squares estimate towards zero. With rates and attitude exchanged,
        noise in the attitude biases it the other way: that estimate is the first over the explained fraction.
        The true value lies between the two (R. Frisch, *Statistical Confluence Analysis*, 1934; S. Klepper
        and E. Leamer, Econometrica, vol. 52, 1984).
        """
        far = np.copysign(np.inf, self.matrix)
        np.divide(self.matrix, self.explained, out=far, where=self.explained > 0.0)
        low, high = np.minimum(self.matrix, far), np.maximum(self.matrix, far)
        return low - self.half_width, high + self.half_width


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputDescription:
    """The quantity behind L, M, N in this log; ``kind`` is "torque_n_m" or "torque_command".

    If the torque is ``achieved``, it includes saturation, and saturated samples may be used.
    ``saturated_fraction`` is the fraction of samples in which any axis got less torque than commanded;
    ``limited_fraction`` holds that fraction for each axis. ``calibration`` is that of the log, for inertia
    and intervals. ``torque_per_thrust`` (3, n_rotors) is L, M, N per unit of `Segment.rotor_thrust`, None if
    the rotors are not known. ``expo`` belongs to the thrust curve that the torque was rebuilt with, None if
    none was assumed. ``every_step`` means that each step of the control loop was logged: the torque is then
    known between the samples too. ``grid`` is the quantization step of L, M and N in the log, 0 if there is
    none.
    """

    kind: str
    unit: str
    source: str
    saturated_fraction: float = 0.0
    limited_fraction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    achieved: bool = False
    calibration: Calibration = field(default_factory=Calibration)
    torque_per_thrust: FloatArray | None = None
    expo: AssumedExpo | None = None
    every_step: bool = False
    grid: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Overview:
    """A cleaned signal over the whole log at its own sample times, for figures of the flight.

    ``time_s`` [s] has shape (n_samples,), ``stored`` (n_samples, n_columns). Whole numbers of few digits are
    stored in single precision.
    """

    signal: str
    columns: tuple[str, ...]
    time_s: FloatArray
    stored: AnyArray

    @property
    def values(self) -> FloatArray:
        """Values in double precision; shape (n_samples, n_columns)."""
        return np.asarray(self.stored, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightData:
    """The aligned log.

    Attributes
    ----------
    sample_period_s : float
        Sample period of every segment [s]; NaN if there is nothing to resample.
    segments : tuple of Segment
        Parts of flight without gaps, usable for identification, in order of time.
    flights : tuple of (start_s, end_s)
        Take-off and landing of each flight [s], with or without a usable segment.
    sources : mapping of str to SourceChoice
        Selected sources by canonical name.
    input : InputDescription or None
        The quantity behind L, M, N; None without torque.
    gyro_filter : GyroFilter
        Filters of the logged body rates, as far as the parameters define them.
    clock_resets : int
        Number of reboots and clock jumps. Data after them are shifted to follow the earlier data.
    start_s, duration_s : float
        Start and length of the whole log on this clock [s]. For pooled logs: of all together, without the
        time between them.
    on_ground_reason : str
        Why no flight was found; "" if there is one.
    overview : mapping of str to Overview
        Signals of the whole log for figures, by canonical name.
    gyro_check : GyroCheck or None
        None if rates or attitude are missing or too sparse to compare.
    modes : tuple of ModeChange
        Flight modes of the log on this clock.
    texts : tuple of LogText
        Text messages of the log on this clock. Untrusted: escape before showing.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.analyze("sample_logs/sysid-quad-x.bin").data
    <FlightData: 2360 samples at 100 Hz in 1 segment>
    """

    sample_period_s: float
    segments: tuple[Segment, ...]
    flights: tuple[tuple[float, float], ...]
    sources: Mapping[str, SourceChoice]
    input: InputDescription | None
    start_s: float
    duration_s: float
    gyro_filter: GyroFilter = NO_GYRO_FILTER
    clock_resets: int = 0
    on_ground_reason: str = ""
    overview: Mapping[str, Overview] = field(default_factory=dict)
    gyro_check: GyroCheck | None = None
    modes: tuple[ModeChange, ...] = ()
    texts: tuple[LogText, ...] = ()

    @property
    def flight_segments(self) -> tuple[tuple[float, float], ...]:
        """First and last time of the usable samples of each flight, including gaps between them [s]."""
        spans: dict[int, tuple[float, float]] = {}
        for segment in self.segments:
            start_s, _ = spans.get(segment.flight, (segment.start_s, 0.0))
            spans[segment.flight] = (start_s, segment.end_s)
        return tuple(spans.values())

    @property
    def used_s(self) -> float:
        """Total length of all segments [s]."""
        return sum(segment.end_s - segment.start_s for segment in self.segments)

    @property
    def n_samples(self) -> int:
        """Number of grid points."""
        return sum(segment.n_samples for segment in self.segments)

    @property
    def mean_throttle(self) -> float:
        """Mean throttle as a fraction of full throttle [1]; 0 if it was not logged throughout."""
        throttle = [segment.throttle for segment in self.segments if segment.throttle is not None]
        if not self.segments or len(throttle) < len(self.segments):
            return 0.0
        return sum(float(values.sum()) for values in throttle) / sum(values.size for values in throttle)

    def __repr__(self) -> str:
        rate = f" at {1.0 / self.sample_period_s:.4g} Hz" if self.segments else ""
        n_segments = len(self.segments)
        return f"<{type(self).__name__}: {self.n_samples} samples{rate} in {counted(n_segments, 'segment')}>"


def flown_parameters(log: FlightLog, data: FlightData) -> Mapping[str, float]:
    """Return the parameters as they were when the part of the flight that is used began.

    Parameters
    ----------
    log : FlightLog
    data : FlightData

    Returns
    -------
    Mapping of str to float
    """
    rates = log.candidates("body_rate")
    if not rates or not data.segments or data.clock_resets:
        return log.parameters
    first = int(np.argmax(rates[0].time_s >= data.segments[0].start_s))
    return log.parameters_at(int(rates[0].position[first]))
