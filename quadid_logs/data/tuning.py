"""Results of `recommend`: the next gains to fly, or the reasons for refusing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from quadid_logs.data.autotune import Procedure
from quadid_logs.data.closed_loop import LoopMargins, Step
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.off_nominal import OFF_NOMINAL, ConditionMargins, Ranges

TuningVerdict = Literal["change", "keep", "refused"]
#: Direction of the gains: all up, all down, some up and some down, unchanged; "refuse" gives none.
Direction = Literal["raise", "lower", "reshape", "keep", "refuse"]

#: A whole number with a rounding error remains that whole number.
_LAST_DIGIT: Final = 1e-9


class Limits(NamedTuple):
    """Smallest margins of a loop: gain margin [dB], phase margin [deg] and disk margin [1].

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.Limits(gain_db=8.0, phase_deg=50.0, disk=0.8).gain_db
    8.0
    """

    gain_db: float
    phase_deg: float
    disk: float


#: Limits of a good loop (6 dB and 45 degrees: MIL-F-9490D, ADS-33E practice). A disk margin of 0.67 is both
#: at once.
GOOD: Final = Limits(6.0, 45.0, 0.67)
#: Small changes of the vehicle make a loop below these limits unstable: such a loop is close to instability.
POOR: Final = Limits(4.0, 30.0, 0.0)


def four_digits(value: float) -> float:
    """Return a gain rounded to four significant digits.

    Parameters
    ----------
    value : float

    Returns
    -------
    float

    Examples
    --------
    >>> four_digits(0.0703999)
    0.0704
    """
    return float(f"{value:.4g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class GainNames:
    """The tunable parameters of one axis' controller.

    Attributes
    ----------
    scaled : tuple of str
        Parameters that together scale P, I and D of the rate loop by one common factor.
    proportional, integral, derivative, angle : str
        Parameters of P, I and D of the rate loop, and of the angle loop around it.
    filters : tuple of str
        Cut-offs that users usually change: D-term filter and gyro filter [Hz].
    low_passes : tuple of str
        Cut-offs of all low-pass filters in this loop, which all cost phase [Hz].
    ranges : mapping of str to (float, float)
        Lowest and highest value in the documentation of this firmware version; infinite if not documented.
    whole : bool
        Whether the firmware stores whole numbers: values are rounded down, to a lower gain.
    """

    scaled: tuple[str, ...]
    proportional: str
    integral: str
    derivative: str
    angle: str
    ranges: Mapping[str, tuple[float, float]]
    filters: tuple[str, ...] = ()
    low_passes: tuple[str, ...] = ()
    whole: bool = False

    @property
    def every(self) -> tuple[str, ...]:
        """All gains of the axis. If the firmware scales gains by P itself, P occurs twice."""
        return *self.scaled, self.proportional, self.integral, self.derivative, self.angle

    @property
    def common(self) -> tuple[str, ...]:
        """Parameters that multiply P, I and D and can take them beyond their ranges; often empty."""
        own = (self.proportional, self.integral, self.derivative)
        # Where D is scaled by itself, another name is the other end of its range.
        return () if self.derivative in self.scaled else tuple(one for one in self.scaled if one not in own)

    def factors(self, name: str, flown: float) -> tuple[float, float]:
        """Return the smallest and largest factor that keeps a flown gain in its range.

        Parameters
        ----------
        name : str
            Name of the parameter.
        flown : float
            The flown value, above 0. A value outside of the range may stay, but does not move further out.

        Returns
        -------
        tuple of float
        """
        low, high = self.ranges.get(name, (0.0, math.inf))
        return min(low / flown, 1.0), max(high / flown, 1.0)

    def written(self, value: float) -> float:
        """Return a gain rounded as in the parameter file. The promise is computed from this value.

        Parameters
        ----------
        value : float

        Returns
        -------
        float
            Rounded to four significant digits, or down to a whole number.
        """
        return float(math.floor(value * (1.0 + _LAST_DIGIT))) if self.whole else four_digits(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tunable:
    """The tunable parameters of a vehicle.

    Attributes
    ----------
    axes : mapping of str to GainNames
        Parameters by axis.
    obstacle : str
        Property of the vehicle that rules out a recommendation; "" if there is none.
    procedures : mapping of str to tuple of Procedure
        Autotune procedures of the autopilot by axis, as far as they are known.
    """

    axes: Mapping[str, GainNames] = field(default_factory=dict)
    obstacle: str = ""
    procedures: Mapping[str, tuple[Procedure, ...]] = field(default_factory=dict)


#: Cut-offs that are changed by one common factor: range [Hz] by parameter.
Cutoffs = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterChoices:
    """The possible filter settings of this firmware version, for the spectral lines of the gyro.

    Attributes
    ----------
    shared : tuple of Cutoffs
        Cut-offs of low-pass filters that all axes share.
    own : mapping of str to tuple of Cutoffs
        Cut-offs of low-pass filters of a single axis, by axis.
    notches : tuple of mapping of str to float
        Complete notch settings for all axes, by parameter.
    defaults : mapping of str to float
        Cut-offs of these low-pass filters that the firmware comes with [Hz], as far as they are known.
    """

    shared: tuple[Cutoffs, ...] = ()
    own: Mapping[str, tuple[Cutoffs, ...]] = field(default_factory=dict)
    notches: tuple[Mapping[str, float], ...] = ()
    defaults: Mapping[str, float] = field(default_factory=dict)


def written_hz(value: float) -> float:
    """Return a cut-off rounded to a whole number, or to a tenth below 10 Hz.

    Parameters
    ----------
    value : float
        Cut-off [Hz].

    Returns
    -------
    float
        Rounded cut-off [Hz].

    Examples
    --------
    >>> written_hz(28.28), written_hz(3.54)
    (28.0, 3.5)
    """
    return float(round(value)) if value >= 10.0 else round(value, 1)


class GainChange(NamedTuple):
    """A parameter as flown (``now``), for the next flight (``next``), and its final value (``target``).

    The target is the expected value after further flights, if these confirm the model.
    """

    now: float
    next: float
    target: float


class FilterTrial(NamedTuple):
    """A filter setting with its best gains.

    Attributes
    ----------
    phase_deg : float
        Additional phase lag at the flown crossover frequency, compared with the flown filters [deg].
    noise : float
        Noise of the command, relative to the accepted noise.
    attitude_error : float
        Attitude error by gusts, relative to that with the flown gains and filters.
    """

    phase_deg: float
    noise: float
    attitude_error: float


#: What says that a step follows from a rule.
_BY_RULE: Final = ("QL648", "QL649")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AxisTuning:
    """The recommendation for one axis.

    Attributes
    ----------
    verdict : {"change", "keep", "refused"}
    reasons : tuple of Finding
        Reasons for the verdict, the decisive one first.
    gains : mapping of str to GainChange
        Gains by parameter; empty if the axis is refused.
    filters : mapping of str to GainChange
        Filter parameters that change with the gains. A parameter that all axes share occurs in each axis.
    filter_trials : tuple of FilterTrial
        Filter settings that were compared: the flown setting first, the selected setting last.
    now, next : LoopMargins or None
        Margins as flown, and promised margins of the next flight with the rounded gains.
    step_now, step_next : Step or None
        Rate step responses as flown and with the next gains.
    attitude_error : float
        Attitude error by gusts with the next gains, relative to the flown gains; NaN if not known.
    torque_noise : float
        Standard deviation of the flown command above the crossover frequency; NaN if the log is too slow.
    torque_noise_next : float
        The same with the next gains.
    more_flights, flights_to_limits : int
        Number of flights after the next until the gains reach their target, and until the margins meet the
        limits, if these flights confirm the model.
    off_nominal : tuple of ConditionMargins
        Margins under other conditions than flown; empty if not computed.
    """

    verdict: TuningVerdict
    reasons: tuple[Finding, ...]
    gains: Mapping[str, GainChange] = field(default_factory=dict)
    filters: Mapping[str, GainChange] = field(default_factory=dict)
    filter_trials: tuple[FilterTrial, ...] = ()
    now: LoopMargins | None = None
    next: LoopMargins | None = None
    step_now: Step | None = None
    step_next: Step | None = None
    attitude_error: float = float("nan")
    torque_noise: float = float("nan")
    torque_noise_next: float = float("nan")
    more_flights: int = 0
    flights_to_limits: int = 0
    off_nominal: tuple[ConditionMargins, ...] = ()

    @property
    def changed_gains(self) -> Mapping[str, GainChange]:
        """The gains with a new value."""
        return {name: change for name, change in self.gains.items() if change.next != change.now}

    @property
    def by_rule(self) -> bool:
        """Whether the recommendation follows from a rule and not from a model; it then has no promise."""
        return self.verdict == "change" and bool(self.reasons) and self.reasons[0].code in _BY_RULE

    @property
    def changes(self) -> Mapping[str, GainChange]:
        """The gains and filters with a new value."""
        return {**self.changed_gains, **self.filters}

    @property
    def direction(self) -> Direction:
        """Direction of the gains; every sentence about the direction is based on it."""
        if self.verdict != "change":
            return "keep" if self.verdict == "keep" else "refuse"
        ups = {change.next > change.now for change in self.changed_gains.values()}
        return "reshape" if self.filters or len(ups) > 1 else "raise" if True in ups else "lower"

    @property
    def summary(self) -> str:
        """One line: the verdict with the gains that change, or with the codes of the reasons."""
        changes = ", ".join(f"{name} {one.now:g} -> {one.next:g}" for name, one in self.changes.items())
        codes = " ".join(reason.code for reason in self.reasons) if self.verdict == "refused" else ""
        return f"{self.verdict:<7}  {changes or codes}".rstrip()

    def __repr__(self) -> str:
        return f"<AxisTuning: {' '.join(self.summary.split())}>"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Tuning:
    """The recommendation for a vehicle.

    Attributes
    ----------
    axes : mapping of str to AxisTuning
        Recommendation by axis.
    limits : Limits
        Limits of the promised margins. Each limit is met with 97.5 % confidence.
    ranges : Ranges
        Ranges of load, air density and propeller in which the limits are met too.
    """

    axes: Mapping[str, AxisTuning]
    limits: Limits
    ranges: Ranges = OFF_NOMINAL

    @property
    def refused(self) -> tuple[str, ...]:
        """The axes without a recommendation."""
        return tuple(axis for axis, found in self.axes.items() if found.verdict == "refused")

    @property
    def changes(self) -> Mapping[str, GainChange]:
        """All parameters with a new value."""
        return {name: change for found in self.axes.values() for name, change in found.changes.items()}

    def __repr__(self) -> str:
        lines = [
            f"<Tuning: gain margin {self.limits.gain_db:g} dB, phase margin {self.limits.phase_deg:g} deg"
        ]
        lines += [f"  {axis:<5}  {found.summary}" for axis, found in self.axes.items()]
        return "\n".join(lines) + ">"
