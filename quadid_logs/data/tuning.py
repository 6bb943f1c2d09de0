"""The next gains to fly, or why none: what `recommend` hands on."""

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
#: Where the gains go: all up, all down, some up and some down, nowhere; "refuse" says nothing of them.
Direction = Literal["raise", "lower", "reshape", "keep", "refuse"]

#: What is a whole number but for rounding stays that.
_LAST_DIGIT: Final = 1e-9


class Limits(NamedTuple):
    """What a loop keeps at least: gain [dB], phase [deg], and both at once as disk margin.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.Limits(gain_db=8.0, phase_deg=50.0, disk=0.8).gain_db
    8.0
    """

    gain_db: float
    phase_deg: float
    disk: float


#: Of loops that pilots and the handling-quality standards call good (6 dB and 45 degrees: MIL-F-9490D,
#: ADS-33E practice). A disk margin of 0.67 is both at once.
GOOD: Final = Limits(6.0, 45.0, 0.67)
#: Small changes of the vehicle bring loops below these to the limit: they are called close to instability.
POOR: Final = Limits(4.0, 30.0, 0.0)


def four_digits(value: float) -> float:
    """Return a gain as people read it.

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
    """The parameters of one axis' controller that may be changed.

    Attributes
    ----------
    scaled : tuple of str
        Those that scale P, I and D of the rate loop together, each by the same factor.
    proportional, integral, derivative, angle : str
        Of the rate loop, and of the angle loop around it.
    filters : tuple of str
        Cut-offs [Hz] that people try out: of D, of the gyro.
    low_passes : tuple of str
        Cut-offs [Hz] of all low-passes in this axis' loop, each of which may take its phase.
    ranges : mapping of str to (float, float)
        Lowest and highest value that this version of the firmware documents; infinite where it names none.
    whole : bool
        The firmware holds whole numbers: a value is rounded down, to less gain.
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
        """All gains of the axis; some firmwares scale P itself, which then stands twice."""
        return *self.scaled, self.proportional, self.integral, self.derivative, self.angle

    @property
    def common(self) -> tuple[str, ...]:
        """Those that multiply P, I and D and so take each of them beyond its own range; often none."""
        own = (self.proportional, self.integral, self.derivative)
        # Where D is scaled by itself, another name is the other end of its range.
        return () if self.derivative in self.scaled else tuple(one for one in self.scaled if one not in own)

    def factors(self, name: str, flown: float) -> tuple[float, float]:
        """Return least and largest factor on a flown gain within its range.

        Parameters
        ----------
        name : str
        flown : float
            Above 0. What flew outside of the range may stay there, and comes no further out.

        Returns
        -------
        tuple of float
        """
        low, high = self.ranges.get(name, (0.0, math.inf))
        return min(low / flown, 1.0), max(high / flown, 1.0)

    def written(self, value: float) -> float:
        """Return a gain as it is written: people read it, and the promise is computed from it.

        Parameters
        ----------
        value : float

        Returns
        -------
        float
            To four digits, or the next whole number below.
        """
        return float(math.floor(value * (1.0 + _LAST_DIGIT))) if self.whole else four_digits(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tunable:
    """What of a vehicle may be tuned.

    Attributes
    ----------
    axes : mapping of str to GainNames
    obstacle : str
        What this vehicle is that no gains are given for, "" for nothing.
    procedures : mapping of str to tuple of Procedure
        By axis, how the autopilot tunes itself, as far as that is known.
    """

    axes: Mapping[str, GainNames] = field(default_factory=dict)
    obstacle: str = ""
    procedures: Mapping[str, tuple[Procedure, ...]] = field(default_factory=dict)


#: Cut-offs that are changed by one factor: by parameter its range [Hz].
Cutoffs = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterChoices:
    """What of the filters of this firmware version may be set, for the lines that the gyro shows.

    Attributes
    ----------
    shared : tuple of Cutoffs
        Of low-passes that all axes share.
    own : mapping of str to tuple of Cutoffs
        By axis, of its own low-passes.
    notches : tuple of mapping of str to float
        Each a whole setting of notches by parameter, for all axes.
    """

    shared: tuple[Cutoffs, ...] = ()
    own: Mapping[str, tuple[Cutoffs, ...]] = field(default_factory=dict)
    notches: tuple[Mapping[str, float], ...] = ()


def written_hz(value: float) -> float:
    """Return a cut-off as it is written: whole, below 10 Hz to a tenth.

    Parameters
    ----------
    value : float

    Returns
    -------
    float

    Examples
    --------
    >>> written_hz(28.28), written_hz(3.54)
    (28.0, 3.5)
    """
    return float(round(value)) if value >= 10.0 else round(value, 1)


class GainChange(NamedTuple):
    """A parameter as it flew, for the next flight, and where it leads to if nothing else turns up."""

    now: float
    next: float
    target: float


class FilterTrial(NamedTuple):
    """A setting of the filters with the best gains behind it.

    Attributes
    ----------
    phase_deg : float
        That its filters lose at the flown crossover, less what those lose that flew [deg].
    noise : float
        Of the command, over what is accepted.
    attitude_error : float
        Of gusts, over that of the flown gains and filters.
    """

    phase_deg: float
    noise: float
    attitude_error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AxisTuning:
    """What is recommended for one axis.

    Attributes
    ----------
    verdict : {"change", "keep", "refused"}
    reasons : tuple of Finding
        Why, the decisive one first.
    gains : mapping of str to GainChange
        By parameter; empty where the axis is refused.
    filters : mapping of str to GainChange
        Parameters of filters that change with the gains; those that all axes share stand in each of them.
    filter_trials : tuple of FilterTrial
        Settings that were looked at where filters change: the flown one first, the chosen one last.
    now, next : LoopMargins or None
        As flown, and as promised for the next flight, from the values in the file.
    step_now, step_next : Step or None
        The rate's answers to a step of its set-point.
    attitude_error : float
        Of gusts, with the next gains over that of the flown ones; NaN where it is not known.
    torque_noise : float
        Standard deviation of the command above the crossover, as flown; NaN where the log is too slow.
    torque_noise_next : float
        With the next gains.
    more_flights, flights_to_limits : int
        After the next one until the gains are at their target, and until the limits are kept, if none of
        them finds anything else.
    off_nominal : tuple of ConditionMargins
        The margins of the vehicle otherwise than it flew; empty where none are told.
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
        """The gains that get another value."""
        return {name: change for name, change in self.gains.items() if change.next != change.now}

    @property
    def by_rule(self) -> bool:
        """Whether a rule says so, not a model: nothing is promised then."""
        return self.verdict == "change" and bool(self.reasons) and self.reasons[0].code == "QL648"

    @property
    def changes(self) -> Mapping[str, GainChange]:
        """The gains and filters that get another value."""
        return {**self.changed_gains, **self.filters}

    @property
    def direction(self) -> Direction:
        """Where the gains go: the one source of every sentence that says so."""
        if self.verdict != "change":
            return "keep" if self.verdict == "keep" else "refuse"
        ups = {change.next > change.now for change in self.changed_gains.values()}
        return "reshape" if self.filters or len(ups) > 1 else "raise" if True in ups else "lower"

    @property
    def summary(self) -> str:
        """Verdict and, in one line, the gains that change, or the codes that say why none does."""
        changes = ", ".join(f"{name} {one.now:g} -> {one.next:g}" for name, one in self.changes.items())
        codes = " ".join(reason.code for reason in self.reasons) if self.verdict == "refused" else ""
        return f"{self.verdict:<7}  {changes or codes}".rstrip()

    def __repr__(self) -> str:
        return f"<AxisTuning: {' '.join(self.summary.split())}>"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Tuning:
    """What is recommended for a vehicle.

    Attributes
    ----------
    axes : mapping of str to AxisTuning
    limits : Limits
        That the promised margins keep in 97.5 % of the vehicles that the flight allows.
    ranges : Ranges
        Of load, air and propeller, over which the limits are kept as well.
    """

    axes: Mapping[str, AxisTuning]
    limits: Limits
    ranges: Ranges = OFF_NOMINAL

    @property
    def refused(self) -> tuple[str, ...]:
        """The axes that nothing is recommended for."""
        return tuple(axis for axis, found in self.axes.items() if found.verdict == "refused")

    @property
    def changes(self) -> Mapping[str, GainChange]:
        """Every parameter that gets another value."""
        return {name: change for found in self.axes.values() for name, change in found.changes.items()}

    def __repr__(self) -> str:
        lines = [
            f"<Tuning: gain margin {self.limits.gain_db:g} dB, phase margin {self.limits.phase_deg:g} deg"
        ]
        lines += [f"  {axis:<5}  {found.summary}" for axis, found in self.axes.items()]
        return "\n".join(lines) + ">"
