"""What a flight promises of the next one with the recommended gains, and what became of it."""

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
    """A parameter of a controller: as it flew, and as the promise takes it to fly next."""

    back: float
    next: float


class QuantityKind(StrEnum):
    """What a number of the vehicle is."""

    EFFECTIVENESS = "control effectiveness"
    COUPLING = "coupling"
    LAG = "lag"
    DELAY = "delay"


class VehicleQuantity(NamedTuple):
    """One number of the vehicle by which another propeller, motor or load is recognised.

    ``axis`` turns about which the command about ``command`` accelerates, [rad/s^2] per command of 1; of
    lag and delay [s] both are "".
    """

    kind: QuantityKind
    axis: str
    command: str
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisPromise:
    """What is promised of one axis.

    Attributes
    ----------
    verdict : {"change", "keep", "refused"}
        Of the recommendation; nothing is promised of a refused axis.
    gains : mapping of str to Gain
        Every parameter that shapes the loop: the promise belongs to ``next``.
    margins : LoopMargins or None
        Of the next flight, whose vehicle may differ a little from this one; None where nothing is promised.
    """

    verdict: TuningVerdict
    gains: Mapping[str, Gain] = field(default_factory=dict)
    margins: LoopMargins | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """What a flight promises of the next one.

    Attributes
    ----------
    log, log_sha256 : str
        The flight that it was made from: the file's name, and its SHA-256 ("" where unknown). Untrusted.
    autopilot, frame, hardware_id : str
        Which vehicle; "" where the log does not tell. Untrusted.
    n_cells : int
        Of the battery, 0 where its voltage does not tell.
    throttle : float
        Mean of the flight, 0 where it is not known: yaw is more effective with more throttle.
    throttle_powers : mapping of str to float
        By axis, with which power of the throttle the effectiveness may grow.
    structure : str
        Of the model that the quantities are from.
    quantities : tuple of VehicleQuantity
    axes : mapping of str to AxisPromise
    limits : Limits
    ranges : Ranges
        With which the gains were recommended.
    balance : RotorBalance or None
        Of the rotors, by which one that weakens is recognised; None where the log does not tell it.
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
    """Which gains of an axis the next flight flew with."""

    NEXT = "next"
    BACK = "back"
    OTHER = "other"


class Held(StrEnum):
    """Where the figures of an axis are, held against what was promised."""

    INSIDE = "inside"
    BETTER = "better"
    WORSE = "worse"
    NOT_COMPARABLE = "not comparable"


class Outcome(StrEnum):
    """What became of a promise."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_COMPARABLE = "not comparable"


class Decision(StrEnum):
    """What to do now."""

    KEEP = "keep"
    GO_ON = "go on"
    BACK = "back"
    NO_ADVICE = "no advice"


class Obstacle(StrEnum):
    """Why a promise, or that of an axis, cannot be held against a flight."""

    SAME_LOG = "same log"
    OTHER_AUTOPILOT = "other autopilot"
    OTHER_FRAME = "other frame"
    OTHER_HARDWARE = "other hardware"
    NO_PROMISE = "no promise"
    OTHER_GAINS = "other gains"
    NO_MARGINS = "no margins"


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureCheck:
    """A promised figure beside the measured one.

    Attributes
    ----------
    name : str
        A field of `Margins`.
    promised, measured : Estimated
    p_value : float
        Of a difference like this one by chance, two-sided, with the intervals of both.
    differs : bool
        It is more than chance, with all tests of the vehicle in mind.
    gain : int
        +1 where the measured figure is the better one, -1 where it is the worse one.
    """

    name: str
    promised: Estimated
    measured: Estimated
    p_value: float
    differs: bool
    gain: int


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleCheck:
    """A number of the vehicle in both flights; ``p_value`` and ``differs`` as of `FigureCheck`."""

    kind: QuantityKind
    axis: str
    command: str
    promised: Estimated
    measured: Estimated
    p_value: float
    differs: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisCheck:
    """What became of the promise of one axis.

    Attributes
    ----------
    held : Held
    obstacle : Obstacle or None
        Why it is not comparable.
    flown : Flown
    other_gains : mapping of str to tuple of float
        By parameter that flew with another value than promised: promised, flown (NaN: not in the log).
    figures : tuple of FigureCheck
    stable : bool
        The measured loop is.
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
    """A rotor, its number from 0, its name, and the part of its thrust that it lost between two flights."""

    rotor: int
    name: str
    loss: Quantity


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Check:
    """A promise held against the next flight.

    Attributes
    ----------
    outcome : Outcome
    decision : Decision
    obstacle : Obstacle or None
        Why nothing of it can be compared.
    axes : mapping of str to AxisCheck
    vehicle : tuple of VehicleCheck
    n_cells : tuple of int
        Of the batteries of both flights, 0 where not known.
    rotor : WeakRotor or None
        That gives less thrust for the same command than in the flight of the promise.
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
        """The numbers of the vehicle that are not those of the flight of the promise."""
        return tuple(one for one in self.vehicle if one.differs)

    @property
    def is_other_vehicle(self) -> bool:
        """Whether a number of the vehicle or one of its rotors is not what it was."""
        return self.rotor is not None or bool(self.vehicle_changes)

    def __repr__(self) -> str:
        lines = [f"<Check: {self.outcome.value}, {self.decision.value}"]
        lines += [
            f"  {axis:<5}  {one.held.value}, {one.decision.value}"
            + ("" if one.obstacle is None else f" ({one.obstacle.value})")
            for axis, one in self.axes.items()
        ]
        return "\n".join(lines) + ">"
