"""What any log shows of its flight, whether or not a model comes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, Literal, NamedTuple

from quadid_logs.arrays import FloatArray
from quadid_logs.untrusted import printable

#: One half: 1 / (2 sin 15 deg) is 1.9, the peak of a closed loop with 30 degrees of phase margin.
_FOLLOWS: Final = 0.5
_MORE_THAN_ALL_ELSE: Final = 0.5
#: "normal", "high" and "severe" judge against a published range; "fact" is a number without one.
Level = Literal["normal", "high", "severe", "fact"]


class Quantity(NamedTuple):
    """A number with its unit, its 95 % interval and what is normal; None where that is not known."""

    value: float
    unit: str
    ci95: tuple[float, float] | None = None
    normal: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One chart's judgement.

    Attributes
    ----------
    sentence : str
        For people; no branch reads it.
    level : {"normal", "high", "severe", "fact"}
    findings : tuple of str
        Codes of the catalogue.
    judged : bool
        The sentence says what is normal, though nobody published a level.
    """

    sentence: str
    level: Level = "fact"
    findings: tuple[str, ...] = ()
    judged: bool = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.level}: {printable(self.sentence, 800)}>"

    @property
    def says_what_is_normal(self) -> bool:
        """Whether a pilot learns what the number should be."""
        return self.judged or self.level != "fact"


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisTracking:
    """How one axis follows its set-point.

    Attributes
    ----------
    error_rms, setpoint_rms : Quantity
        Of the difference, and of the set-point about its mean.
    lag : Quantity or None
        How late the axis follows [s]; None where the flight does not tell.
    """

    error_rms: Quantity
    setpoint_rms: Quantity
    lag: Quantity | None = None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Tracking(Topic):
    """Set-points against what was flown, by axis; of the rates or of the attitude.

    Attributes
    ----------
    axes : mapping of str to AxisTracking
    off : Quantity or None
        Of angles: fraction of the flight in which roll or pitch stays away from all that was asked lately.
    """

    axes: Mapping[str, AxisTracking]
    off: Quantity | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepCurve:
    """A measured response to a step of 1 in the set-point.

    Attributes
    ----------
    size : {"all", "small", "large"}
    n_windows : int
    response, low, high : ndarray, shape (n_times,)
        With the 95 % interval.
    """

    size: Literal["all", "small", "large"]
    n_windows: int
    response: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisSteps:
    """The step responses of one axis.

    Attributes
    ----------
    time_s : ndarray, shape (n_times,)
    ideal : ndarray, shape (n_times,)
        What a loop that follows at once would show: set-points hold no sharper step.
    split_rad_s : float
        Largest set-point of a window that parts small from large.
    overshoot : Quantity
        Highest value above 1, as a fraction of the step; of small set-points where large ones overshoot
        differently.
    half_time : Quantity
        When half of the step is reached, by the same set-points [s].
    overshoot_large : Quantity or None
        Of large set-points, where their interval and that of the small ones do not overlap.
    """

    time_s: FloatArray
    ideal: FloatArray
    curves: tuple[StepCurve, ...]
    split_rad_s: float
    overshoot: Quantity
    half_time: Quantity
    overshoot_large: Quantity | None = None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Steps(Topic):
    """Measured responses of the rates to steps of their set-points, of the axes whose set-points tell."""

    axes: Mapping[str, AxisSteps]


class LineSource(Enum):
    """What a line in the spectrum comes from."""

    ROTOR = "rotor"
    FOLLOWS_THROTTLE = "follows throttle"
    FIXED = "fixed frequency"
    LOOP = "control loop"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A line in a spectrum.

    Attributes
    ----------
    frequency_hz, height_db : float
        Height above the floor around it.
    p_value : float
        That a spectrum without lines shows one as high anywhere in what was searched.
    share : float
        Of the flight's windows in which it stands.
    rms : float
        Of the oscillation [rad/s], without the floor.
    source : LineSource
    harmonic : int
        Of the rotors' speed, or of the loop's oscillation; 0 where it is neither.
    notch_hz : float
        Centre of a notch of the parameters that stands on it, NaN without.
    """

    frequency_hz: float
    height_db: float
    p_value: float
    share: float
    rms: float
    source: LineSource = LineSource.UNKNOWN
    harmonic: int = 0
    notch_hz: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """A spectrum over something: ``level_db`` (n_frequencies, n_x) over cells' centres; NaN is unknown."""

    x: FloatArray
    frequency_hz: FloatArray
    level_db: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GyroSpectrum:
    """The density of one gyro source.

    Attributes
    ----------
    source : str
    rate_hz : float
        Of its samples.
    frequency_hz : ndarray, shape (n_frequencies,)
    density : ndarray, shape (n_frequencies, 3)
        [(rad/s)^2/Hz]
    """

    source: str
    rate_hz: float
    frequency_hz: FloatArray
    density: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Noise(Topic):
    """Spectra of the gyro, and the lines in them.

    Attributes
    ----------
    after, before : GyroSpectrum or None
        Behind the autopilot's filters and before them, as logged.
    lines : mapping of str to tuple of Line
        By axis, the highest first.
    over_time, over_throttle : Map or None
        Of all axes together.
    rotor_hz : ndarray, shape (n_times,)
        Mean speed of the rotors at the times of ``over_time``; empty where it is not logged.
    may_be_folded : bool
        Faster vibration than half the log's rate may stand below it.
    """

    after: GyroSpectrum | None
    before: GyroSpectrum | None
    lines: Mapping[str, tuple[Line, ...]]
    over_time: Map | None
    over_throttle: Map | None
    rotor_hz: FloatArray
    may_be_folded: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisCommandNoise:
    """How much of one axis' command is too fast for its loop.

    Attributes
    ----------
    rms : Quantity
        Of the output above ``CommandNoise.above_hz``, as a fraction of its range.
    terms : mapping of str to Quantity
        The same of its terms "P", "D" and "FF", as far as they are logged.
    density : ndarray, shape (n_frequencies,)
        Of the output [1/Hz].
    term_densities : mapping of str to ndarray, shape (n_frequencies,)
        [1/Hz]
    """

    rms: Quantity
    terms: Mapping[str, Quantity]
    density: FloatArray
    term_densities: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class CommandNoise(Topic):
    """Spectra of the rate controllers' output.

    Attributes
    ----------
    axes : mapping of str to AxisCommandNoise
    above_hz : float
        No loop of a multirotor corrects anything that is faster.
    frequency_hz : ndarray, shape (n_frequencies,)
    """

    axes: Mapping[str, AxisCommandNoise]
    above_hz: float
    frequency_hz: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Motors(Topic):
    """What the motors were sent in flight.

    Attributes
    ----------
    names : tuple of str
        Number and place of each motor.
    unit : {"1", "us"}
        Fraction of the range in which the motors are driven, or the pulse's length where that is not known.
    mean, low, high : ndarray, shape (n_motors,)
        Mean, and the 5th and 95th percentile.
    spread : Quantity
        Highest mean less the lowest, in microseconds of outputs that are pulses.
    hardest : int
        Which motor has the highest mean.
    headroom : Quantity or None
        What is left above the highest motor in 99 % of the flight; None where the range is not known.
    at_high, at_low : Quantity or None
        Fraction of the flight in which any motor is at an end of its range.
    time_s, output : ndarray, shape (n_times,) and (n_times, n_motors)
        Averages over short times.
    """

    names: tuple[str, ...]
    unit: Literal["1", "us"]
    mean: FloatArray
    low: FloatArray
    high: FloatArray
    spread: Quantity
    hardest: int
    headroom: Quantity | None
    at_high: Quantity | None
    at_low: Quantity | None
    time_s: FloatArray
    output: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Vibration(Topic):
    """How much the vehicle shakes.

    Attributes
    ----------
    measure : {"vibration", "vibration_level", "specific_force"}
        The signal that it was taken from.
    columns : tuple of str
    figure : Quantity
        What 99 % of the flight stay below, of the worst column.
    limits : tuple of float
        Where "high" and "severe" begin; empty where nothing published says so.
    clips : Quantity or None
        Samples at the end of the accelerometer's range, in flight.
    time_s, values : ndarray, shape (n_times,) and (n_times, n_columns)
    """

    measure: Literal["vibration", "vibration_level", "specific_force"]
    columns: tuple[str, ...]
    figure: Quantity
    limits: tuple[float, ...]
    clips: Quantity | None
    time_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Battery(Topic):
    """The battery under load.

    Attributes
    ----------
    start_v, lowest_v : Quantity
        First and lowest mean over a second in flight.
    n_cells : int
        0 where the voltage does not tell.
    sag_v : Quantity or None
        Drop for each tenth of the throttle [V].
    time_s, voltage : ndarray, shape (n_times,)
    """

    start_v: Quantity
    lowest_v: Quantity
    n_cells: int
    sag_v: Quantity | None
    time_s: FloatArray
    voltage: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Course(Topic):
    """One quantity over the flight, in the unit that people read.

    Attributes
    ----------
    label, unit : str
        Of the chart's axis.
    columns : tuple of str
    figures : mapping of str to Quantity
        What the sentence rests on, by name, in SI units.
    limits : tuple of (float, str)
        Levels of the chart and their words.
    time_s, values : ndarray, shape (n_times,) and (n_times, n_columns)
    """

    label: str
    unit: str
    columns: tuple[str, ...]
    figures: Mapping[str, Quantity]
    limits: tuple[tuple[float, str], ...]
    time_s: FloatArray
    values: FloatArray


class OscillatingLoop(Enum):
    """Which loop makes an oscillation."""

    RATE = "rate"
    """The rate swings more than twice its set-point: the rate loop has no margin there."""
    OUTER = "outer"
    """The rate follows its set-point, which swings: the angle loop, or one around it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisOscillation:
    """A line in rate and output of one axis, where the loop can take part.

    Attributes
    ----------
    axis : str
    line : Line
    setpoint_share : float
        Size of the set-point over that of the rate at this frequency.
    power_share, output_share : float
        Of all that the rate and the output do, by their squares.
    overtone : bool
        It is a multiple of a stronger oscillation of another axis, which makes it.
    rate_loop : bool
        A rate loop follows the set-point. A law that holds attitude and rates at once has none.
    """

    axis: str
    line: Line
    setpoint_share: float = 0.0
    power_share: float = 0.0
    output_share: float = 0.0
    overtone: bool = False
    rate_loop: bool = True

    @property
    def dominates(self) -> bool:
        """Whether the axis does more of this than of all else: nothing but its own loop does that."""
        return self.power_share > _MORE_THAN_ALL_ELSE and not self.overtone

    @property
    def drives_outputs(self) -> bool:
        """Whether the rate loop's output does more of this than of all else, or the rate does."""
        of_output = self.output_share > _MORE_THAN_ALL_ELSE and self.loop is OscillatingLoop.RATE
        return self.dominates or (of_output and not self.overtone)

    @property
    def loop(self) -> OscillatingLoop:
        """A loop with 30 degrees of phase margin makes at most twice its set-point of a rate."""
        follows = self.setpoint_share > _FOLLOWS
        return OscillatingLoop.OUTER if follows or not self.rate_loop else OscillatingLoop.RATE

    @property
    def certain(self) -> bool:
        """Whether nothing but a loop makes it; otherwise something may shake the vehicle there."""
        of_outer = self.loop is OscillatingLoop.OUTER
        return self.overtone or (self.rate_loop and (of_outer or self.dominates))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Oscillation(Topic):
    """Oscillations that last, by axis; none where the log was searched and shows none."""

    axes: tuple[AxisOscillation, ...]
    highest_hz: float
    may_be_folded: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorFault:
    """What one test found.

    Attributes
    ----------
    code : str
        Of the catalogue.
    rotor : int
        Which one, from 0; -1 where it is none.
    time_s : float
        When it began, NaN where it was there all the time.
    size : Quantity
        What was lost of the rotor's thrust, how far off the centre of mass is, or how strong it shakes.
    p_value : float
        That a flight without the fault shows it as clearly.
    sentence : str
    """

    code: str
    rotor: int
    time_s: float
    size: Quantity
    p_value: float
    sentence: str


class RotorBalance(NamedTuple):
    """Where the thrust that the rotors are sent is on the whole, and where each rotor is.

    ``centre`` is that of thrust, forward and to the right in lengths of the longest arm, and the balance of
    yaw: thrusts weighted by spin, of the whole. ``place`` is, for each rotor, forward, right and spin.
    """

    centre: tuple[Quantity, Quantity, Quantity]
    place: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Rotors(Topic):
    """How much each rotor gives of what it is sent, and what is wrong with them.

    Attributes
    ----------
    names : tuple of str
        Number and place.
    effectiveness : tuple of Quantity or None
        Of each rotor, over the mean of all [1]; None where they did not move independently enough.
    change : tuple of Quantity or None
        Of each rotor, what it gave at the end of the flight over what it gave at the beginning, if it
        alone had changed; None where the flight is too short.
    mass_offset : tuple of two Quantity or None
        How far forward and to the right of the rotors' middle the centre of mass is, in lengths of the arm.
    thrust_change : Quantity or None
        Thrust for a unit of command at the end of the flight over that at the beginning.
    axes_change : tuple of Quantity
        Of roll, pitch and yaw, effectiveness at the end of the flight over that at the beginning, where the
        centre of thrust moved and a rotor that lost thrust would explain it: QL431, if yaw says so, too.
        Empty where it did not move.
    shaking : tuple of Quantity or None
        What the gyro sees of each propeller's turning [rad/s].
    faults : tuple of RotorFault
        The surest first.
    searched : tuple of str
        Codes of the tests that this log allows.
    balance : RotorBalance or None
        Of the part of the flight without a sudden loss; None where it is too short.
    """

    names: tuple[str, ...]
    effectiveness: tuple[Quantity | None, ...]
    change: tuple[Quantity | None, ...]
    mass_offset: tuple[Quantity, Quantity] | None
    thrust_change: Quantity | None
    shaking: tuple[Quantity | None, ...]
    faults: tuple[RotorFault, ...]
    searched: tuple[str, ...]
    axes_change: tuple[Quantity, ...] = ()
    balance: RotorBalance | None = None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Standstill(Topic):
    """A rotor that hardly turned although it was sent more than the others: looked for in the air or not.

    Attributes
    ----------
    rotor : int
        Which one, from 0.
    time_s : float
        When it began.
    length : Quantity
    """

    rotor: int
    time_s: float
    length: Quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """What a log shows of its flight; ``missing`` says of a topic that is None which signal it lacks.

    ``rates`` stands in for ``tracking`` where set-points are not logged, ``torque`` for ``motors``: without
    them nothing is missing. ``standstill`` is there where one was found.
    """

    standstill: Standstill | None = None

    tracking: Tracking | None = None
    rates: Course | None = None
    attitude: Tracking | None = None
    tilt: Course | None = None
    steps: Steps | None = None
    noise: Noise | None = None
    command_noise: CommandNoise | None = None
    motors: Motors | None = None
    torque: Course | None = None
    throttle: Course | None = None
    thrust: Course | None = None
    vibration: Vibration | None = None
    battery: Battery | None = None
    oscillation: Oscillation | None = None
    rotors: Rotors | None = None
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def topics(self) -> Mapping[str, Topic]:
        """Those that the log tells of, by name, the most urgent first."""
        found: dict[str, Topic | None] = {
            "standstill": self.standstill,
            "oscillation": self.oscillation,
            "rotors": self.rotors,
            "tracking": self.tracking,
            "rates": self.rates,
            "attitude": self.attitude,
            "tilt": self.tilt,
            "steps": self.steps,
            "noise": self.noise,
            "command_noise": self.command_noise,
            "motors": self.motors,
            "torque": self.torque,
            "throttle": self.throttle,
            "thrust": self.thrust,
            "vibration": self.vibration,
            "battery": self.battery,
        }
        return {name: topic for name, topic in found.items() if topic is not None}

    def __repr__(self) -> str:
        told = [f"{name} {topic.level}" for name, topic in self.topics.items()]
        return f"<{type(self).__name__}: {', '.join(told) or 'nothing is shown'}>"
