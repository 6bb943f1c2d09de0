"""The loops around the rate loop (attitude, velocity and position), and what was found of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, Literal

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Estimated, Margins

#: Rows that tell something of a controller.
FEWEST_ROWS: Final = 50
#: Directions of `PositionRows`.
Direction = Literal["north", "east", "down"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeRows:
    """What the attitude controller was given and gave, each of shape (n_rows, 3): roll, pitch, yaw.

    Attributes
    ----------
    time_s : ndarray, shape (n_rows,)
        On the log's own clock; rows need not follow each other loop by loop.
    from_error : ndarray
        Rate that the law makes of the attitude error [rad/s].
    forward : ndarray
        Rate that it adds whatever the error [rad/s].
    logged : ndarray
        The rate set-point that the log holds [rad/s].
    lags_s : tuple of float or None
        Those of `AttitudeCommand`, where parameters leave them open and the rows tell.
    not_judged : tuple of str
        Axes whose law is not known.
    """

    time_s: FloatArray
    from_error: FloatArray
    forward: FloatArray
    logged: FloatArray
    lags_s: tuple[float, ...] | None = None
    not_judged: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShaperRows:
    """The angle that was wanted, and the target that the input shaper made of it.

    Attributes
    ----------
    wanted, shaped, logged : ndarray, shape (n_rows, 2)
        Roll and pitch [rad]: as wanted, what the law makes of it, and the target that the log holds.
    """

    wanted: FloatArray
    shaped: FloatArray
    logged: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeCommand:
    """What stands between a wanted attitude and the angle loop of `AxisController`.

    Attributes
    ----------
    lags_s : tuple of float
        First-order lags from the wanted attitude to the target, for small changes.
    forward : bool
        The target's own rate is added to the rate set-point.
    not_modelled : tuple of str
        Parameters that switch on what is not replayed.
    gains : mapping of str to float
        The vendor's parameters.
    """

    lags_s: tuple[float, ...] = ()
    forward: bool = False
    not_modelled: tuple[str, ...] = ()
    gains: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CascadeController:
    """Position and velocity controller of some directions: what acts while nothing saturates.

    With positions x and velocities v, the velocity target is V = forward + ``position_per_s`` (X - x), and
    the acceleration target forward + P (V - v) + I times its integral + D times its slope, or less D times
    the slope of v alone.

    Attributes
    ----------
    position_per_s : float
        [1/s]; 0 where positions are not controlled.
    linear_m_s : float
        Velocities up to which the position controller is linear in any case.
    proportional_per_s, integral_per_s2, derivative : float
        P [1/s], I [1/s^2], D [1].
    error_hz, derivative_hz : float
        Cut-offs of the first-order low-passes on the velocity error and behind the slope, 0 for none [Hz].
    slope_of_error : bool
        D acts on the filtered error; else on the measured velocity.
    period_s : float
        Of the controller [s].
    gains : mapping of str to float
        The vendor's parameters that made all this.
    """

    position_per_s: float
    proportional_per_s: float
    integral_per_s2: float
    derivative: float
    error_hz: float
    derivative_hz: float
    slope_of_error: bool
    period_s: float
    gains: Mapping[str, float]
    linear_m_s: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OuterControllers:
    """The controllers around the rate loop by the log's parameters; None where these do not tell."""

    attitude: AttitudeCommand
    horizontal: CascadeController | None = None
    vertical: CascadeController | None = None


class Shown(Enum):
    """What the log says of a controller that was replayed."""

    AGREES = "agrees"
    DIFFERS = "differs"
    NOT_SHOWN = "not shown"
    """The flight moved it too little, or the rows are too few."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeReplay:
    """How well the attitude controller of one axis makes the logged rate set-points.

    Attributes
    ----------
    shown : Shown
    relative_rms : float
        Of the difference, over that of the logged set-point, without the rows that differ most.
    gain : Estimated or None
        The angle gain with which it would fit best, over that of the parameters.
    n_rows : int
    """

    shown: Shown
    relative_rms: float
    gain: Estimated | None
    n_rows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaperReplay:
    """How well the input shaper of one axis makes the logged target of the wanted angle.

    ``unshaped_rms`` is what the wanted angle itself is off by. Both over the rms of the logged target.
    """

    relative_rms: float
    unshaped_rms: float
    n_rows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CascadeReplay:
    """How well the position and velocity controllers of one direction make the logged targets.

    Attributes
    ----------
    position, velocity, integral : Estimated or None
        Gains of the position controller, of P and of I of the velocity controller with which the logged
        targets fit best, over those of the parameters; None where the log does not hold them or they are
        zero.
    position_rms, velocity_rms : float
        Of the differences to the logged targets over the rms of what the controllers gave; NaN for none.
    velocity_error_m_s, velocity_moved_m_s : float
        Rms of target less velocity, and of the target's own movement.
    position_error_m : float
        Rms of target less position, NaN where it is not controlled.
    n_rows : int
    row_s : float
        Typical step of the rows [s].
    """

    position: Estimated | None
    velocity: Estimated | None
    integral: Estimated | None
    position_rms: float
    velocity_rms: float
    velocity_error_m_s: float
    velocity_moved_m_s: float
    position_error_m: float
    n_rows: int
    row_s: float

    @property
    def shown(self) -> Shown:
        """What the log says of both controllers: one that differs is enough."""
        told = [shown_by(each) for each in (self.position, self.velocity) if each is not None]
        if Shown.DIFFERS in told:
            return Shown.DIFFERS
        return Shown.AGREES if told and told[-1] is Shown.AGREES else Shown.NOT_SHOWN


#: A gain that is off by a tenth takes 0.8 dB of a margin, less than the intervals of most.
TOLERANCE = 0.1


def shown_by(gain: Estimated) -> Shown:
    """Say what an estimated gain, over that of the parameters, says of these.

    Parameters
    ----------
    gain : Estimated

    Returns
    -------
    Shown
        Differs where the whole interval lies more than a tenth away from one.
    """
    low, high = gain.ci95
    if low > 1.0 + TOLERANCE or high < 1.0 - TOLERANCE:
        return Shown.DIFFERS
    return Shown.AGREES if high - low < 0.5 and abs(gain.value - 1.0) <= 2.0 * TOLERANCE else Shown.NOT_SHOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class OuterLoop:
    """The velocity and position loops that tilt about one axis closes, cut at the acceleration set-point.

    Attributes
    ----------
    attitude_hz : Estimated
        Bandwidth of the attitude's answer to a wanted attitude: 45 degrees late, or 3 dB less (ADS-33).
    velocity : Margins
        Of the velocity loop alone.
    whole : Margins or None
        With the position loop around it; None where positions are not controlled.
    """

    attitude_hz: Estimated
    velocity: Margins
    whole: Margins | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OuterLoops:
    """What was found of the loops around the rate loop.

    Attributes
    ----------
    controllers : OuterControllers
    attitude : mapping of str to AttitudeReplay
        By axis.
    shaper : mapping of str to ShaperReplay
        By axis, where the log holds the wanted angles.
    cascades : mapping of str to CascadeReplay
        By direction.
    loops : mapping of str to OuterLoop
        By the axis that tilts: "pitch" flies forward, "roll" sideways.
    """

    controllers: OuterControllers
    attitude: Mapping[str, AttitudeReplay] = field(default_factory=dict)
    shaper: Mapping[str, ShaperReplay] = field(default_factory=dict)
    cascades: Mapping[str, CascadeReplay] = field(default_factory=dict)
    loops: Mapping[str, OuterLoop] = field(default_factory=dict)
