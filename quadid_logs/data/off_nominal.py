"""Off-nominal conditions: changes of load, air, propeller and battery, and the margins under them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Estimated, LoopMargins
from quadid_logs.errors import SettingsError


class Ranges(NamedTuple):
    """Ranges of off-nominal conditions: lowest and highest factor relative to the flight.

    Attributes
    ----------
    mass : tuple of float
        Factors on mass and inertia.
    density : tuple of float
        Factors on air density.
    propeller : tuple of float
        Factors on propeller diameter.

    Examples
    --------
    >>> from quadid_logs.data.off_nominal import Ranges
    >>> Ranges(mass=(1.0, 1.5)).density
    (0.82, 1.1)
    """

    mass: tuple[float, float] = (0.8, 1.2)
    density: tuple[float, float] = (0.82, 1.1)
    propeller: tuple[float, float] = (1.0, 1.07)


#: Mass and inertia change by a fifth. Air density (ISO 2533) goes from 2000 m altitude (0.82) to sea level at
#: -10 degC (1.10). The propeller may be one standard size larger (14, 15, 16, 17, 18 inches: 7, 7, 6, 6 %).
OFF_NOMINAL: Final = Ranges()
#: The flown condition only.
AS_FLOWN: Final = Ranges((1.0, 1.0), (1.0, 1.0), (1.0, 1.0))


#: Bounds within which it is still the same kind of vehicle.
_SENSIBLE: Final = {"mass": (0.2, 5.0), "density": (0.3, 1.5), "propeller": (0.7, 1.5)}


def checked(ranges: Ranges) -> Ranges:
    """Return ranges after a check of their values.

    Parameters
    ----------
    ranges : Ranges

    Returns
    -------
    Ranges

    Raises
    ------
    SettingsError
        If a range does not contain 1 (the flown condition), or exceeds the bounds for one vehicle.
    """
    for name, (low, high) in ranges._asdict().items():
        least, most = _SENSIBLE[name]
        if not least <= low <= 1.0 <= high <= most:
            hint = f"Give two factors: the first from {least:g} to 1, the second from 1 to {most:g}."
            raise SettingsError(f"{low:g} to {high:g} is not a possible range of {name}.", hint=hint)
    return ranges


class ThrustLaw(NamedTuple):
    """The firmware's conversion of a thrust command (0 to 1) to a motor output.

    Attributes
    ----------
    output : callable
        Function from command to output, both from 0 to 1, without the corrections below.
    before, behind : callable
        Factors on command and output, as functions of battery voltage [V] and number of cells. They are 1 if
        the firmware does not compensate the voltage.
    for_density : bool
        Whether the firmware divides the command by the air density.
    """

    output: Callable[[FloatArray], FloatArray]
    before: Callable[[float, int], float]
    behind: Callable[[float, int], float]
    for_density: bool = False


def _unchanged(voltage_v: float, n_cells: int) -> float:  # noqa: ARG001
    return 1.0


#: A firmware that passes commands on unchanged.
AS_COMMANDED: Final = ThrustLaw(lambda command: command, _unchanged, _unchanged)


class ConditionKind(StrEnum):
    """The property that differs from the flight."""

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
    """One off-nominal condition, as factors relative to the flight; ``voltage_v`` is the battery's [V]."""

    kind: ConditionKind
    mass: float = 1.0
    inertia: float = 1.0
    density: float = 1.0
    propeller: float = 1.0
    voltage: float = 1.0
    voltage_v: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConditionMargins:
    """Margins of one axis under one off-nominal condition.

    Attributes
    ----------
    condition : Condition
    effectiveness, lag : Estimated
        Control effectiveness and lag, relative to the flight.
    now : LoopMargins
        Margins with the flown gains.
    next : LoopMargins or None
        Margins with the next gains, None if there are none.
    spare : float
        Fraction of the limits that the worst plant samples meet with the next gains, else the flown gains.
    worst : bool
        Whether this condition has the smallest ``spare``.
    """

    condition: Condition
    effectiveness: Estimated
    lag: Estimated
    now: LoopMargins
    next: LoopMargins | None
    spare: float
    worst: bool = False
