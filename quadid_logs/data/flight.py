"""What `align` hands on: one clock, one period, segments without gaps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.counting import counted
from quadid_logs.data.log import NO_GYRO_FILTER, GyroFilter, LogText, ModeChange
from quadid_logs.data.torque import AssumedExpo, Calibration

#: Twenty fits of half a second: below, held-out validation says nothing [s].
LEAST_FLIGHT_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceChoice:
    """Which source of a signal was taken, and how it was really sampled.

    Attributes
    ----------
    signal, source, reason : str
        Canonical name, vendor's fields, and why this one.
    rate_hz : float
        Median rate inside the flight segments (whole log where there is none).
    mean_rate_hz : float
        Samples over time covered: below `rate_hz` where samples are missing.
    longest_gap_s : float
        Longest pause between samples inside the flight segments.
    n_gaps : int
        Pauses of more than three periods.
    n_duplicate, n_out_of_order, n_outliers, n_not_finite : int
        Rows with a repeated stamp, put back in order, thrown away for an
        impossible stamp, or for NaN, infinite or absurd values or a spike of one sample.
    others : tuple of (source, rate_hz)
        The sources that were not taken.
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
        Uniform, on the log's clock [s].
    body_rate_rad_s, torque : ndarray, shape (n_samples, 3)
        Torque is in the unit that `InputDescription` names.
    attitude_rad : ndarray, shape (n_samples, 3), or None
        Euler angles, yaw unwrapped; None where the log has none.
    throttle : ndarray, shape (n_samples,), or None
    rotor_thrust : ndarray, shape (n_samples, n_rotors), or None
        Thrust of each rotor in the unit for which `InputDescription.torque_per_thrust` gives the
        torque; None where the rotors are not known.
    thrust_by_expo : ndarray, shape (n_samples, n_rotors), or None
        Its derivative by the expo of the thrust curve; None where no expo was assumed.
    reference : ndarray, shape (n_samples, 3 or 4), or None
        What was commanded, from outside the rate loop: rate setpoints [rad/s], and the excitation
        of a system-ID mode where there is one; None where the log has no setpoints.
    command : ndarray, shape (n_samples, 3 or 4), or None
        The reference without what the vehicle's own motion makes of it: where an angle controller flew, its
        gain times the angle is put back, which leaves that gain times the commanded angle [rad/s]. NaN in
        flight modes whose set-points answer the motion in ways that the log does not tell; None without
        set-points, or where no flight mode is known. Of a planned trajectory the rates that follow from it.
        Where sticks that ask for angles are logged, those of roll and pitch, as rates. Of flights that repeat
        one trajectory the mean torque of the others, in its standard deviations.
    law : ndarray of int, shape (n_samples,), or None
        How the flight mode made set-points of commands, a number for each kind; None where one kind flew.
    velocity_m_s : ndarray, shape (n_samples, 3), or None
        Over ground, along the body axes; None where no velocity or no attitude is logged.
    planned : bool
        The command is a planned trajectory's: few and gentle, and below a hertz it goes with the speed
        through the air.
    repeated : bool
        The planned trajectory is known by other flights that repeat it.
    saturated : ndarray of bool, shape (n_samples,)
        The torque could not be achieved, or was clipped.
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
    """Whether the body rates integrate to the change of the attitude.

    Attributes
    ----------
    start_s : ndarray, shape (n_intervals,)
        Of intervals of `length_s` in flight [s].
    attitude_change, integrated_change : ndarray, shape (n_intervals, 3)
        Change of roll, pitch and yaw by the attitude, and by the body rates as they were
        logged, but for the bias and the lag [rad].
    matrix, half_width, explained : ndarray, shape (3, 3)
        Body rates that the attitude shows over those logged: the identity if they agree. Half
        of the 95 % interval, and the fraction of that part of the motion that it explains.
    bias_rad_s : ndarray, shape (3,)
    lag_s, lag_half_width_s : float
        How long the rates come after the attitude: the filter of the gyro.
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
        """Lowest and highest value that the data allow each element of `matrix`; each (3, 3).

        Noise in the rates draws least squares towards zero. The true value lies between that
        estimate and the one with rates and attitude exchanged, which noise in the attitude draws
        the other way: the estimate over the explained fraction (R. Frisch, *Statistical Confluence
        Analysis*, 1934; S. Klepper and E. Leamer, Econometrica, vol. 52, 1984).
        """
        far = np.copysign(np.inf, self.matrix)
        np.divide(self.matrix, self.explained, out=far, where=self.explained > 0.0)
        low, high = np.minimum(self.matrix, far), np.maximum(self.matrix, far)
        return low - self.half_width, high + self.half_width


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputDescription:
    """What L, M, N are in this log: kind is "torque_n_m" or "torque_command".

    ``achieved`` torque contains saturation, so that saturated samples may be
    used; ``saturated_fraction`` counts samples in which any axis got less than was commanded,
    ``limited_fraction`` those of each axis; ``calibration`` is that of the log, for inertia and intervals;
    ``torque_per_thrust`` (3, n_rotors) is L, M, N per unit of
    `Segment.rotor_thrust`, None where the rotors are not known.
    ``expo``: that of the thrust curve by which the torque was rebuilt, None where none was assumed.
    ``every_step``: each step of the control loop was logged, so that the
    torque is known between the samples as well.
    ``grid``: step of the values that L, M and N take in the log, 0 where they take any.
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
    """A cleaned series of the whole log, not resampled, for figures of the flight.

    ``time_s`` has shape (n_samples,), ``stored`` (n_samples, n_columns): in single precision what was logged
    as whole numbers of few digits.
    """

    signal: str
    columns: tuple[str, ...]
    time_s: FloatArray
    stored: AnyArray

    @property
    def values(self) -> FloatArray:
        """In double precision; shape (n_samples, n_columns)."""
        return np.asarray(self.stored, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightData:
    """The aligned log.

    Attributes
    ----------
    sample_period_s : float
        Of every segment; NaN where there is nothing to resample.
    segments : tuple of Segment
        Gap-free parts that can be identified from, in order of time.
    flights : tuple of (start_s, end_s)
        Take-off to landing, whether or not signals suffice for a segment.
    sources : mapping of str to SourceChoice
        By canonical name.
    gyro_filter : GyroFilter
        What the logged body rates have passed, as far as the parameters tell.
    clock_resets : int
        Reboots and clock jumps; later epochs are shifted to follow the earlier ones.
    start_s, duration_s : float
        Of the whole log on that clock; of pooled logs together, without the pauses between.
    on_ground_reason : str
        Why no flight was found, "" where there is one.
    gyro_check : GyroCheck or None
        None where rates or attitude are missing or too sparse to hold against each other.
    modes, texts
        Of the log, on this clock.

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
        """First and last time [s] of the usable samples of each flight, whatever gaps lie between."""
        spans: dict[int, tuple[float, float]] = {}
        for segment in self.segments:
            start_s, _ = spans.get(segment.flight, (segment.start_s, 0.0))
            spans[segment.flight] = (start_s, segment.end_s)
        return tuple(spans.values())

    @property
    def used_s(self) -> float:
        """Length of all segments together [s]."""
        return sum(segment.end_s - segment.start_s for segment in self.segments)

    @property
    def n_samples(self) -> int:
        """Number of grid points."""
        return sum(segment.n_samples for segment in self.segments)

    @property
    def mean_throttle(self) -> float:
        """Mean throttle as a fraction of full throttle, 0 where it was not logged throughout [1]."""
        throttle = [segment.throttle for segment in self.segments if segment.throttle is not None]
        if not self.segments or len(throttle) < len(self.segments):
            return 0.0
        return sum(float(values.sum()) for values in throttle) / sum(values.size for values in throttle)

    def __repr__(self) -> str:
        rate = f" at {1.0 / self.sample_period_s:.4g} Hz" if self.segments else ""
        n_segments = len(self.segments)
        return f"<{type(self).__name__}: {self.n_samples} samples{rate} in {counted(n_segments, 'segment')}>"
