"""The vehicle otherwise than as it flew: what may change from flight to flight, and the margins then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Estimated, LoopMargins
from quadid_logs.errors import SettingsError


class Ranges(NamedTuple):
    """How far a vehicle may leave what it flew with: lowest and highest factor on each.

    Attributes
    ----------
    mass : tuple of float
        Of mass and, with it, inertia.
    density : tuple of float
        Of the air.
    propeller : tuple of float
        Of the diameter.

    Examples
    --------
    >>> from quadid_logs.data.off_nominal import Ranges
    >>> Ranges(mass=(1.0, 1.5)).density
    (0.82, 1.1)
    """

    mass: tuple[float, float] = (0.8, 1.2)
    density: tuple[float, float] = (0.82, 1.1)
    propeller: tuple[float, float] = (1.0, 1.07)


#: A fifth of mass and inertia; air from 2000 m above the sea (0.82 of its density there) to frost at the sea
#: (-10 degC: 1.10), both of ISO 2533; and one size of propeller more, as they are sold (14, 15, 16, 17, 18
#: inches: 7, 7, 6 and 6 %).
OFF_NOMINAL: Final = Ranges()
#: Nothing but what flew.
AS_FLOWN: Final = Ranges((1.0, 1.0), (1.0, 1.0), (1.0, 1.0))


#: What a vehicle may be and still be the one that flew.
_SENSIBLE: Final = {"mass": (0.2, 5.0), "density": (0.3, 1.5), "propeller": (0.7, 1.5)}


def checked(ranges: Ranges) -> Ranges:
    """Return ranges that can be meant.

    Parameters
    ----------
    ranges : Ranges

    Returns
    -------
    Ranges

    Raises
    ------
    SettingsError
        If a range does not hold what flew, which is 1, or goes beyond what is a vehicle of this kind.
    """
    for name, (low, high) in ranges._asdict().items():
        least, most = _SENSIBLE[name]
        if not least <= low <= 1.0 <= high <= most:
            hint = f"Give two factors: the first from {least:g} to 1, the second from 1 to {most:g}."
            raise SettingsError(f"{low:g} to {high:g} is not a possible range of {name}.", hint=hint)
    return ranges


class ThrustLaw(NamedTuple):
    """What a firmware makes of a command of thrust, between 0 and 1, before the motors.

    Attributes
    ----------
    output : callable
        Command to output, both from 0 to 1, without what follows.
    before, behind : callable
        Factors on command and output at a voltage of the battery [V] and its number of cells: 1 where
        nothing makes up for an emptier battery.
    for_density : bool
        The command is divided by the density of the air.
    """

    output: Callable[[FloatArray], FloatArray]
    before: Callable[[float, int], float]
    behind: Callable[[float, int], float]
    for_density: bool = False


def _unchanged(voltage_v: float, n_cells: int) -> float:  # noqa: ARG001
    return 1.0


#: A firmware that hands commands on.
AS_COMMANDED: Final = ThrustLaw(lambda command: command, _unchanged, _unchanged)


class ConditionKind(StrEnum):
    """What is otherwise than it flew."""

    BATTERY_FULL = "battery_full"
    BATTERY_EMPTY = "battery_empty"
    LIGHTER = "lighter"
    HEAVIER = "heavier"
    PAYLOAD = "payload"
    """Heavier by a load at the centre, which adds no inertia."""
    THIN_AIR = "thin_air"
    DENSE_AIR = "dense_air"
    SMALLER_PROPELLER = "smaller_propeller"
    LARGER_PROPELLER = "larger_propeller"


class Condition(NamedTuple):
    """One thing that is otherwise, as factors on what flew; the battery by its voltage [V]."""

    kind: ConditionKind
    mass: float = 1.0
    inertia: float = 1.0
    density: float = 1.0
    propeller: float = 1.0
    voltage: float = 1.0
    voltage_v: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConditionMargins:
    """The loop of one axis in one condition.

    Attributes
    ----------
    condition : Condition
    effectiveness, lag : Estimated
        Over those that flew.
    now : LoopMargins
        With the flown gains.
    next : LoopMargins or None
        With the next gains, None where there are none.
    spare : float
        Part of the limits that the worst vehicles keep with the next gains, or with those that flew.
    worst : bool
        No other condition keeps less.
    """

    condition: Condition
    effectiveness: Estimated
    lag: Estimated
    now: LoopMargins
    next: LoopMargins | None
    spare: float
    worst: bool = False
