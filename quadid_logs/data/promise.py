"""The promise of a recommendation for the next flight, and the check of that flight against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from quadid_logs.data.closed_loop import Estimated, LoopMargins
from quadid_logs.data.health import Quantity, RotorBalance
from quadid_logs.data.off_nominal import OFF_NOMINAL, Ranges
from quadid_logs.data.tuning import Limits, TuningVerdict


class Gain(NamedTuple):
    """A controller parameter: as flown before (``back``), and as the promise requires it (``next``)."""

    back: float
    next: float


class QuantityKind(StrEnum):
    """The kind of a property of the vehicle."""

    EFFECTIVENESS = "control effectiveness"
    COUPLING = "coupling"
    LAG = "lag"
    DELAY = "delay"


class VehicleQuantity(NamedTuple):
    """One property of the vehicle that reveals another propeller, motor or load.

    For effectiveness, the command about the axis ``command`` accelerates the vehicle about ``axis``
    [rad/s^2 per unit of command]. For lag and delay [s], both are "".
    """

    kind: QuantityKind
    axis: str
    command: str
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisPromise:
    """The promise for one axis.

    Attributes
    ----------
    verdict : {"change", "keep", "refused"}
        Verdict of the recommendation. A refused axis has no promise.
    gains : mapping of str to Gain
        All parameters of the loop. The promise holds for their ``next`` values.
    margins : LoopMargins or None
        Margins of the next flight, allowing for small changes of the vehicle; None without a promise.
    """

    verdict: TuningVerdict
    gains: Mapping[str, Gain] = field(default_factory=dict)
    margins: LoopMargins | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """The promise of one flight for the next.

    Attributes
    ----------
    log, log_sha256 : str
        File name and SHA-256 of the flight that the promise is based on ("" if unknown). Untrusted.
    autopilot, frame, hardware_id : str
        Identity of the vehicle; "" if not logged. Untrusted.
    n_cells : int
        Number of battery cells; 0 if not known from the voltage.
    throttle : float
        Mean throttle of the flight, 0 if not known. Yaw effectiveness increases with throttle.
    throttle_powers : mapping of str to float
        By axis, the largest power of the throttle that the effectiveness may grow with.
    structure : str
        Structure of the model that the quantities come from.
    quantities : tuple of VehicleQuantity
        Properties of the vehicle.
    axes : mapping of str to AxisPromise
        Promise by axis.
    limits : Limits
        Limits of the recommendation.
    ranges : Ranges
        Off-nominal ranges of the recommendation.
    balance : RotorBalance or None
        Balance of the rotors, which reveals a rotor that weakens; None if not known from the log.
    """

    log: str
    log_sha256: str
    autopilot: str
    frame: str
    hardware_id: str
    n_cells: int
    throttle: float
    throttle_powers: Mapping[str, float]
    structure: str
    quantities: tuple[VehicleQuantity, ...]
    axes: Mapping[str, AxisPromise]
    limits: Limits
    ranges: Ranges = OFF_NOMINAL
    balance: RotorBalance | None = None


class Flown(StrEnum):
    """The gains of an axis in the next flight: recommended, previous or other."""

    NEXT = "next"
    BACK = "back"
    OTHER = "other"


class Held(StrEnum):
    """The margins of an axis, compared with the promise."""

    INSIDE = "inside"
    BETTER = "better"
    WORSE = "worse"
    NOT_COMPARABLE = "not comparable"


class Outcome(StrEnum):
    """The outcome of a promise."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_COMPARABLE = "not comparable"


class Decision(StrEnum):
    """The decision about the gains."""

    KEEP = "keep"
    GO_ON = "go on"
    BACK = "back"
    NO_ADVICE = "no advice"


class Obstacle(StrEnum):
    """The reason why a flight, or one of its axes, cannot be compared with the promise."""

    SAME_LOG = "same log"
    OTHER_AUTOPILOT = "other autopilot"
    OTHER_FRAME = "other frame"
    OTHER_HARDWARE = "other hardware"
    NO_PROMISE = "no promise"
    OTHER_GAINS = "other gains"
    NO_MARGINS = "no margins"


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureCheck:
    """A promised margin and its measured value.

    Attributes
    ----------
    name : str
        A field of `Margins`.
    promised, measured : Estimated
    p_value : float
        Two-sided p-value of the difference, from the intervals of both values.
    differs : bool
        Whether the difference is significant, corrected for all tests of the vehicle.
    gain : int
        +1 if the measured value is better, -1 if it is worse.
    """

    name: str
    promised: Estimated
    measured: Estimated
    p_value: float
    differs: bool
    gain: int


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleCheck:
    """A property of the vehicle in both flights.

    ``p_value`` is the two-sided p-value of the difference. ``differs`` means that it is significant,
    corrected for all tests of the vehicle.
    """

    kind: QuantityKind
    axis: str
    command: str
    promised: Estimated
    measured: Estimated
    p_value: float
    differs: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisCheck:
    """The check of the promise for one axis.

    Attributes
    ----------
    held : Held
        Result of the comparison.
    obstacle : Obstacle or None
        Why the axis is not comparable.
    flown : Flown
        Which gains flew.
    other_gains : mapping of str to tuple of float
        Promised and flown value of each parameter that differs (NaN: not in the log).
    figures : tuple of FigureCheck
        Margins in comparison.
    stable : bool
        Whether the measured loop is stable.
    decision : Decision
        What to do with the gains of this axis.
    """

    held: Held
    obstacle: Obstacle | None
    flown: Flown
    other_gains: Mapping[str, tuple[float, float]]
    figures: tuple[FigureCheck, ...] = ()
    stable: bool = True
    decision: Decision = Decision.NO_ADVICE


class WeakRotor(NamedTuple):
    """A rotor that lost thrust between two flights: its number from 0, its name, and the fraction lost."""

    rotor: int
    name: str
    loss: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Check:
    """The check of a flight against a promise.

    Attributes
    ----------
    outcome : Outcome
        Whether the promise was kept.
    decision : Decision
        What to do with the gains.
    obstacle : Obstacle or None
        Why the flight cannot be compared with the promise.
    axes : mapping of str to AxisCheck
        Check by axis.
    vehicle : tuple of VehicleCheck
        Properties of the vehicle in both flights.
    n_cells : tuple of int
        Number of battery cells in both flights, 0 if not known.
    rotor : WeakRotor or None
        A rotor with less thrust per command than in the flight of the promise.
    """

    outcome: Outcome
    decision: Decision
    obstacle: Obstacle | None
    axes: Mapping[str, AxisCheck]
    vehicle: tuple[VehicleCheck, ...]
    n_cells: tuple[int, int]
    rotor: WeakRotor | None = None

    @property
    def vehicle_changes(self) -> tuple[VehicleCheck, ...]:
        """The properties of the vehicle that differ significantly from the flight of the promise."""
        return tuple(one for one in self.vehicle if one.differs)

    @property
    def is_other_vehicle(self) -> bool:
        """Whether a property of the vehicle or one of its rotors changed."""
        return self.rotor is not None or bool(self.vehicle_changes)

    def __repr__(self) -> str:
        lines = [f"<Check: {self.outcome.value}, {self.decision.value}"]
        lines += [
            f"  {axis:<5}  {one.held.value}, {one.decision.value}"
            + ("" if one.obstacle is None else f" ({one.obstacle.value})")
            for axis, one in self.axes.items()
        ]
        return "\n".join(lines) + ">"
