"""The rate and angle controllers that flew, as linear filters, and how well they replay the log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.errors import ShapeError

#: How sure it is that the law below is that of the log's firmware.
VersionRead = Literal["read", "nearest", "unknown"]
Term = Literal["P", "I", "D", "FF", "output"]
#: The slowest filter of default parameters, 2.5 Hz, has forgotten its start to 1e-7 by then [s].
SETTLING_S: Final = 1.0
#: Sets of frequencies of which a filter that moved remembers its response: a search uses some four.
_MOST_KNOWN: Final = 8
TERMS: Final[tuple[Term, ...]] = ("P", "I", "D", "FF", "output")


@dataclass(frozen=True, slots=True, eq=False)
class DiscreteFilter:
    """A filter sum_k b_k z^-k / sum_k a_k z^-k.

    Attributes
    ----------
    numerator, denominator : ndarray, shape (n,)
        Coefficients b and a of z^0, z^-1, ...; the lengths may differ, and a_0 is not 0.
    period_s : float
        Of one step [s].
    """

    numerator: FloatArray
    denominator: FloatArray
    period_s: float

    def __post_init__(self) -> None:
        if not self.period_s > 0.0:
            raise ShapeError(f"A filter's period of {self.period_s} s is not positive.")
        for name in ("numerator", "denominator"):
            coefficients = np.array(getattr(self, name), dtype=np.float64, ndmin=1)
            coefficients.flags.writeable = False
            object.__setattr__(self, name, coefficients)
        if self.numerator.ndim != 1 or self.denominator.ndim != 1 or self.denominator[0] == 0.0:
            raise ShapeError("A filter needs two rows of coefficients, and the first of the denominator.")

    def response(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the frequency response.

        Parameters
        ----------
        frequency_hz : ndarray, any shape
            [Hz].

        Returns
        -------
        ndarray of complex, same shape
        """
        return self.at(self.step(np.asarray(frequency_hz)))

    def step(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return z^-1: the response of a delay of one step, for `at`; shape of ``frequency_hz``."""
        return np.asarray(np.exp(-2j * np.pi * frequency_hz * self.period_s), dtype=np.complex128)

    def at(self, step: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the frequency response by z^-1, which filters of one period share; same shape."""
        above, below = (_polynomial(step, each) for each in (self.numerator, self.denominator))
        above /= below
        return above

    def __mul__(self, other: DiscreteFilter) -> DiscreteFilter:
        """Return the two in series."""
        period_s = self._common_period_s(other)
        return DiscreteFilter(
            np.convolve(self.numerator, other.numerator),
            np.convolve(self.denominator, other.denominator),
            period_s,
        )

    def __add__(self, other: DiscreteFilter) -> DiscreteFilter:
        """Return the two in parallel."""
        period_s = self._common_period_s(other)
        first = np.convolve(self.numerator, other.denominator)
        second = np.convolve(other.numerator, self.denominator)
        total = np.zeros(max(first.size, second.size))
        total[: first.size] += first
        total[: second.size] += second
        return DiscreteFilter(total, np.convolve(self.denominator, other.denominator), period_s)

    def scaled(self, gain: float) -> DiscreteFilter:
        """Return the filter times a number."""
        return DiscreteFilter(gain * self.numerator, self.denominator, self.period_s)

    def _common_period_s(self, other: DiscreteFilter) -> float:
        if self.period_s != other.period_s:
            raise ShapeError(f"Filters of {self.period_s} s and {other.period_s} s do not combine.")
        return self.period_s


def _polynomial(x: NDArray[np.complex128], coefficients: FloatArray) -> NDArray[np.complex128]:
    """Return the sum of coefficients times x^0, x^1, ... (Horner)."""
    value = np.full(x.shape, coefficients[-1], dtype=np.complex128)
    for each in coefficients[-2::-1]:
        value *= x
        value += each
    return value


@dataclass(frozen=True, slots=True, eq=False)
class MeanFilter:
    """Filters that moved in flight, by their mean response: none moves far within its own memory.

    Attributes
    ----------
    instants : tuple of tuple of DiscreteFilter
        Those in series at each instant, of which each counts alike.
    """

    instants: tuple[tuple[DiscreteFilter, ...], ...]
    _known: dict[bytes, NDArray[np.complex128]] = field(default_factory=dict, init=False, repr=False)

    def response(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the mean of the frequency responses; see `DiscreteFilter.response`."""
        # A search for gains asks hundreds of times at the same frequencies, of hundreds of notches.
        asked = np.asarray(frequency_hz, dtype=np.float64)
        key = bytes(str(asked.shape), "ascii") + asked.tobytes()
        if key not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            found = np.array(np.mean([in_series(each, asked) for each in self.instants], axis=0))
            found.flags.writeable = False
            self._known[key] = found
        return self._known[key]


#: What answers a frequency.
Filter: TypeAlias = DiscreteFilter | MeanFilter


def in_series(filters: Iterable[Filter], frequency_hz: FloatArray) -> NDArray[np.complex128]:
    """Return the response of filters one behind the other.

    Parameters
    ----------
    filters : iterable of DiscreteFilter or MeanFilter
    frequency_hz : ndarray, any shape

    Returns
    -------
    ndarray of complex, same shape
    """
    response = np.ones(np.shape(frequency_hz), dtype=np.complex128)
    for each in filters:
        response = response * each.response(frequency_hz)
    return response


class FilterPlace(Enum):
    """Where a filter stands in the rate loop."""

    GYRO = "gyro"
    ERROR = "rate error"
    PART = "part of the controller"
    """It filters P or D alone."""
    COMMAND = "command"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFilter:
    """One filter of the rate loop, by the vendor's parameters.

    Attributes
    ----------
    name : str
        Parameter, or how the names of its parameters begin.
    place : FilterPlace
    filter : DiscreteFilter or MeanFilter
    part : DiscreteFilter or None
        Of a filter on P or D alone: what that part would be without this filter.
    speed : tuple of float
        Of a filter that moved: where it stood at each instant, over the median.
    centre_hz : tuple of float
        Of notches: lowest, median and highest centre of the lowest; empty for other filters.
    """

    name: str
    place: FilterPlace
    filter: Filter
    part: DiscreteFilter | None = None
    speed: tuple[float, ...] = ()
    centre_hz: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisController:
    """The linear part of one axis' controller: what acts while nothing saturates.

    With target r, measured rate w behind the ``gyro`` filters and T = ``target`` r, the torque command is
    ``command`` (``error`` (T - w) - ``rate`` w + ``feed_forward`` T).

    Attributes
    ----------
    period_s : float
        Of the control loop [s].
    error : DiscreteFilter
        From rate error [rad/s] to command [1]: P, I, D where it acts on the error, the error's filter.
    target : DiscreteFilter
        Of the rate set-point.
    rate : DiscreteFilter or None
        Acts on the measured rate alone, and is subtracted; its period may be that of the gyro.
    feed_forward : DiscreteFilter or None
        From the filtered target to the command.
    gyro : tuple of DiscreteFilter or MeanFilter
        Between gyro and controller, at the gyro's period.
    command : DiscreteFilter or None
        Behind the sum.
    angle_gain_per_s : float or None
        From angle error [rad] to rate set-point [rad/s] for small errors; None where it is not known.
    angle_delay_steps : int
        Loops from the angle's measurement to the use of the set-point made of it.
    gains : mapping of str to float
        The vendor's parameters that made all this.
    filters : tuple of NamedFilter
        Each filter that acts on the measured rate, for people: they are part of the above.
    predictable : bool
        Set-points alone tell what the controller does; not where moving sticks change it.
    """

    period_s: float
    error: DiscreteFilter
    target: DiscreteFilter
    rate: DiscreteFilter | None = None
    feed_forward: DiscreteFilter | None = None
    gyro: tuple[Filter, ...] = ()
    command: DiscreteFilter | None = None
    angle_gain_per_s: float | None = None
    angle_delay_steps: int = 1
    gains: Mapping[str, float] = field(default_factory=dict)
    filters: tuple[NamedFilter, ...] = ()
    predictable: bool = True


class RemarkKind(Enum):
    """What has to be said of the controllers beside their gains."""

    NOT_MODELLED = "not modelled"
    """A parameter switches on what is not modelled: the axis has no controller here."""
    MISSING_PARAMETER = "missing parameter"
    NOTCH_UNKNOWN = "notch unknown"
    """A notch follows something that the parameters do not hold: its phase is left out."""
    SLEW_LIMIT = "slew limit"
    """P and D are scaled down while the command moves fast."""
    PD_LIMIT = "P+D limit"
    VARIABLE_GAIN = "variable gain"
    """Gains depend on throttle, landing or battery."""
    PERIOD_ASSUMED = "period assumed"
    """The loop's period is that of the parameters, not of the log's rows."""
    VARIABLE_FILTER = "variable filter"
    """Cut-offs follow the throttle: they are taken as at its mean."""
    ANGLE_LOOP_UNKNOWN = "angle loop unknown"
    """An angle loop may have flown around the rate loop, which is not modelled."""
    GYRO_RATE_ASSUMED = "gyro rate assumed"
    """The log does not say how often the gyro is sampled and its filters run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerRemark:
    """A remark on one axis ("" for all), with the parameters and values that it stands on."""

    kind: RemarkKind
    axis: str = ""
    values: Mapping[str, float] = field(default_factory=dict)


class CommandUnit(NamedTuple):
    """The unit in which an autopilot's own figures count a command: so many of it are a command of 1."""

    name: str
    per_command: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownControllers:
    """The controllers of a log's parameters.

    Attributes
    ----------
    name : str
        Of the control law, for people.
    firmware : str
        As the log states it; untrusted text.
    version_read : str
        "read": the source of this firmware version was read; "nearest": that of ``version_note`` stands
        in; "unknown": the log does not tell its version.
    version_note : str
        The version whose source was read, for people.
    axes : mapping of str to AxisController
        By axis; one whose parameters are missing or not modelled is not in it.
    remarks : tuple of ControllerRemark
    command_unit : CommandUnit or None
        None where the autopilot counts commands as they stand here.
    """

    name: str
    firmware: str
    version_read: VersionRead
    version_note: str
    axes: Mapping[str, AxisController]
    remarks: tuple[ControllerRemark, ...] = ()
    command_unit: CommandUnit | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisRows:
    """What one axis' rate controller was given and gave, loop by loop without a gap.

    Attributes
    ----------
    start_s : float
        Of the first row, on the log's own clock [s].
    positions : ndarray of int64, shape (n_rows,)
        In the file.
    step_s : ndarray, shape (n_rows,)
        From the row before [s], by the stamps.
    target, rate : ndarray, shape (n_rows,)
        Set-point that the row used, and measured rate [rad/s].
    output : ndarray, shape (n_rows,)
        Torque command [1].
    added : ndarray, shape (n_rows,)
        What was added to the controller's output before it was logged.
    logged : mapping of str to ndarray, shape (n_rows,)
        Terms of the output, as far as the log holds them.
    limited : ndarray of bool, shape (n_rows,), or None
        The integrator was stopped; None where the log does not say.
    scale : ndarray, shape (n_rows,), or None
        Factor of a slew limiter on P and D.
    gain_scale : ndarray, shape (n_rows,), or None
        Factor on P and D by throttle or landing; None where the log tells of none.
    derivative : ndarray, shape (n_rows,), or None
        Logged angular acceleration that D acts on [rad/s^2].
    throttle : ndarray, shape (n_rows,), or None
        From 0 to 1; None where the law does not depend on it.
    known : ndarray of bool, shape (n_rows,)
        The set-point of the row was logged, not interpolated.
    setpoints_per_row : float
        Below 1 where set-points are missing, or come slower than the loop.
    """

    start_s: float
    positions: IntArray
    step_s: FloatArray
    target: FloatArray
    rate: FloatArray
    output: FloatArray
    added: FloatArray
    known: BoolArray
    logged: Mapping[Term, FloatArray] = field(default_factory=dict)
    limited: BoolArray | None = None
    scale: FloatArray | None = None
    gain_scale: FloatArray | None = None
    derivative: FloatArray | None = None
    throttle: FloatArray | None = None
    setpoints_per_row: float = 1.0

    @property
    def n_rows(self) -> int:
        """Number of loops."""
        return int(self.step_s.shape[0])

    def settled(self) -> int:
        """Return the first row at which filters that began at the first one no longer remember that."""
        return int(np.searchsorted(np.cumsum(self.step_s), SETTLING_S))

    def part(self, rows: slice) -> AxisRows:
        """Return some of the rows."""
        arrays = ("positions", "step_s", "target", "rate", "output", "added", "known")
        maybe = (name for name in _MAYBE if getattr(self, name) is not None)
        cut: dict[str, Any] = {name: getattr(self, name)[rows] for name in (*arrays, *maybe)}
        start_s = self.start_s + float(self.step_s[1 : (rows.start or 0) + 1].sum())
        logged = {term: values[rows] for term, values in self.logged.items()}
        return replace(self, start_s=start_s, logged=logged, **cut)


#: Fields of `AxisRows` that may be None.
_MAYBE: Final = ("limited", "scale", "gain_scale", "derivative", "throttle")


class ReplayedTerms(NamedTuple):
    """Terms of a replayed controller, each of shape (n_rows,), and where its integrator was stopped."""

    values: Mapping[Term, FloatArray]
    limited: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayInput:
    """All that is needed to replay one axis' controller.

    Attributes
    ----------
    rows : AxisRows
    law : callable
        From rows and parameters to `ReplayedTerms`.
    parameters : mapping of str to float
        The vendor's, as they were at the first row.
    gains : mapping of str to str
        By term the parameter that scales it.
    cutoffs : tuple of str
        Parameters of filters [Hz].
    tolerance : float
        By how much a right replay may differ, relative to the logged output's rms; NaN where rounding alone
        would hide a wrong one.
    loop_period_s : float
        That the parameters promise [s]; NaN where they do not.
    shortest_period_s : float
        That the loop may have where its rows' period is taken for its own [s]: where nothing else explains a
        difference, the rows may be some of its steps only. NaN where the parameters do not say.
    slew_limits : tuple of str
        Parameters that switch on a limiter whose factor on P and D these rows do not hold.
    filters : tuple of str
        How the names of further parameters begin that shape the loop, as those of the gyro's filters.
    as_logged : tuple of str
        Terms that are not made anew: what they follow is not in the rows.
    coarse : bool
        Rounding is so much of what is made anew that a difference which no cause explains tells nothing.
    thinned : bool
        The rows are some of the loops only, each with its own set-point: neither the stamps' clock nor the
        place of set-points needs to be searched.
    """

    rows: AxisRows
    law: Callable[[AxisRows, Mapping[str, float]], ReplayedTerms]
    parameters: Mapping[str, float]
    gains: Mapping[Term, str]
    cutoffs: tuple[str, ...]
    tolerance: float
    loop_period_s: float = float("nan")
    shortest_period_s: float = float("nan")
    slew_limits: tuple[str, ...] = ()
    filters: tuple[str, ...] = ()
    as_logged: tuple[Term, ...] = ()
    coarse: bool = False
    thinned: bool = False


class ReplayReason(Enum):
    """What differs between the controller of the parameters and the logged one."""

    NO_ROWS = "no rows"
    """The log lacks set-points, rates or the controller's output at the loop's rate."""
    ROUNDED = "rounding hides it"
    """The terms hardly rise above the rounding of what the log holds."""
    GAINS_CHANGED = "gains changed in flight"
    GAIN_DIFFERS = "gain differs"
    FILTER_DIFFERS = "filter differs"
    SLEW_LIMITED = "slew limited"
    GAINS_SCALED = "gains scaled in flight"
    """By throttle or for landing, as the log shows."""
    LIMIT_FLAGS_MISSING = "limit flags missing"
    SETPOINT_SHIFTED = "set-point shifted"
    SETPOINT_MISSING = "set-points missing"
    LOOP_RATE_DIFFERS = "loop rate differs"
    AXES_SWAPPED = "axes swapped"
    INTEGRATOR_RESET = "integrator reset"
    """All agrees but the integral's value: it was set in between, as on the ground."""
    HIDDEN_NOTCH = "hidden notch"
    NOT_EXPLAINED = "not explained"

    @property
    def tells_nothing(self) -> bool:
        """Whether the log speaks neither for nor against the controller of the parameters."""
        return self in (ReplayReason.NO_ROWS, ReplayReason.ROUNDED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """How the replayed controller of one axis compares with what the log holds.

    Attributes
    ----------
    relative_rms : mapping of str to (float or None)
        By term: rms of the difference over that of the logged one; None where the log has none.
    agrees : bool
    reason : ReplayReason or None
        What differs; None where it agrees.
    parameter : str
        The vendor's parameter that the reason speaks of, "" for none.
    numbers : mapping of str to float
        Evidence of the reason: values in the file and as flown, times, rows.
    n_rows : int
        That were compared.
    as_logged : tuple of str
        Terms that were taken from the log, so that nothing was checked of them.
    """

    relative_rms: Mapping[Term, float | None]
    agrees: bool
    reason: ReplayReason | None = None
    parameter: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    n_rows: int = 0
    as_logged: tuple[Term, ...] = ()
