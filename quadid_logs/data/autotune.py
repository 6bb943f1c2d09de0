"""What an autopilot's own tuning procedure does, and where it would end on this vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple


class PolePlacement(NamedTuple):
    """A procedure that fits a discrete model of second order and places the poles of the closed loop.

    Attributes
    ----------
    title : str
        For people.
    rise_time_s : float
        Of the closed loop, as wanted [s].
    model_period_s : float
        Of the discrete model [s].
    excitation_per_s : float
        Corner of the steps' spectrum [rad/s]: they are steps less their own low-pass.
    detuning : float
        Weight of the command.
    angle_error_rad : float
        That makes the full command, by which the angle gain is set.
    angle_gains : tuple of float
        Lowest and highest angle gain.
    highest : tuple of float
        P, I over P [1/s] and D over P [s] below which the gains are accepted.
    common : str
        Parameter of a common factor on P, I and D, which the procedure sets to 1; "" for none.
    """

    title: str
    rise_time_s: float
    model_period_s: float
    excitation_per_s: float
    detuning: float
    angle_error_rad: float
    angle_gains: tuple[float, float]
    highest: tuple[float, float, float]
    common: str


class Twitching(NamedTuple):
    """A procedure that twitches the vehicle and changes one gain at a time by what it sees.

    Attributes
    ----------
    title : str
        For people.
    aggressiveness : float
        Bounce back and overshoot that it looks for, of the highest rate.
    filter_hz : float
        Of the low-pass through which it sees the rate; 0 for none.
    derivative, proportional, angle : tuple of float
        Lowest and highest value of each gain.
    integral_ratio : float
        I over P at the end.
    angle_back_off : float
        Factor on the angle gain at the end.
    """

    title: str
    aggressiveness: float
    filter_hz: float
    derivative: tuple[float, float]
    proportional: tuple[float, float]
    angle: tuple[float, float]
    integral_ratio: float
    angle_back_off: float


class Doubling(NamedTuple):
    """A procedure that raises D, and then P, until the vehicle oscillates, and cuts them.

    Attributes
    ----------
    title : str
        For people.
    filters : mapping of str to float
        What it sets first, by parameter [Hz].
    kept : float
        Of a gain at which the vehicle oscillates.
    least_of_flown : float
        Part of a flown gain below which it does not go.
    integral_ratio : float or None
        I over P; None where it leaves I as it is.
    highest_proportional, highest_derivative : float
        Where it stops, infinite for nowhere.
    lowers_p : bool
        P falls with D where that ends below the flown one.
    """

    title: str
    filters: Mapping[str, float]
    kept: float
    least_of_flown: float
    integral_ratio: float | None
    highest_proportional: float
    highest_derivative: float
    lowers_p: bool


#: A procedure that is known.
Procedure = PolePlacement | Twitching | Doubling


class ProcedureKind(StrEnum):
    """Which of an autopilot's procedures it is: the one in the firmware, or that of rising gains."""

    AUTOTUNE = "autotune"
    QUIKTUNE = "quiktune"


@dataclass(frozen=True, slots=True, kw_only=True)
class AutotuneForecast:
    """Where a procedure would end, each interval from the 2.5 to the 97.5 % quantile of the vehicles.

    Attributes
    ----------
    kind : ProcedureKind
    title : str
        Of the procedure.
    gains : mapping of str to tuple of float
        By parameter.
    gain_margin_db, phase_margin_deg : tuple of float or None
        Of the whole loop; 0 of an unstable one; None where a loop has no such margin.
    unstable_fraction : float
        Of the vehicles, those whose loop would be unstable.
    ended_fraction : float
        Of the vehicles, those on which the procedure would end with gains.
    """

    kind: ProcedureKind
    title: str
    gains: Mapping[str, tuple[float, float]]
    gain_margin_db: tuple[float, float] | None
    phase_margin_deg: tuple[float, float] | None
    unstable_fraction: float
    ended_fraction: float
