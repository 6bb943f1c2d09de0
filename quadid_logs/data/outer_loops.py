"""Loops around the rate loop (attitude, velocity, position): their controllers, replays and margins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, Literal

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Estimated, Margins

#: Number of rows that suffices to judge a controller.
FEWEST_ROWS: Final = 50
#: Directions of `PositionRows`.
Direction = Literal["north", "east", "down"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeRows:
    """Inputs and output of the attitude controller; arrays have shape (n_rows, 3): roll, pitch, yaw.

    Attributes
    ----------
    time_s : ndarray, shape (n_rows,)
        Time on the log's own clock [s]; rows need not be consecutive control steps.
    from_error : ndarray
        Rate set-point computed from the attitude error [rad/s].
    forward : ndarray
        Feed-forward rate, independent of the error [rad/s].
    logged : ndarray
        Logged rate set-point [rad/s].
    lags_s : tuple of float or None
        First-order lags from wanted attitude to target [s], if they follow from the rows and not from
        parameters.
    not_judged : tuple of str
        Axes with an unknown control law.
    """

    time_s: FloatArray
    from_error: FloatArray
    forward: FloatArray
    logged: FloatArray
    lags_s: tuple[float, ...] | None = None
    not_judged: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShaperRows:
    """Input and output of the input shaper for attitude commands.

    Attributes
    ----------
    wanted, shaped, logged : ndarray, shape (n_rows, 2)
        Roll and pitch [rad]: commanded angle, target computed from it, and logged target.
    """

    wanted: FloatArray
    shaped: FloatArray
    logged: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeCommand:
    """The path from a commanded attitude to the angle loop of `AxisController`.

    Attributes
    ----------
    lags_s : tuple of float
        First-order lags from the commanded attitude to the target, for small changes [s].
    forward : bool
        Whether the rate of the target is added to the rate set-point.
    not_modelled : tuple of str
        Parameters that enable functions which are not replayed.
    gains : mapping of str to float
        The vendor's parameters.
    """

    lags_s: tuple[float, ...] = ()
    forward: bool = False
    not_modelled: tuple[str, ...] = ()
    gains: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CascadeController:
    """Position and velocity controller of one or two directions, without saturation.

    For position x and velocity v, the velocity target is V = forward + ``position_per_s`` (X - x). The
    acceleration target is forward + P (V - v) + I times the integral of V - v + D times its derivative.
    Some firmwares subtract D times the derivative of v instead.

    Attributes
    ----------
    position_per_s : float
        Gain of the position controller [1/s]; 0 if positions are not controlled.
    linear_m_s : float
        Velocity up to which the position controller is certainly linear [m/s].
    proportional_per_s, integral_per_s2, derivative : float
        P [1/s], I [1/s^2], D [1].
    error_hz, derivative_hz : float
        Cut-offs of the first-order low-pass filters on the velocity error and on the derivative; 0 for none
        [Hz].
    slope_of_error : bool
        Whether D acts on the filtered error; otherwise it acts on the measured velocity.
    period_s : float
        Sample period of the controller [s].
    gains : mapping of str to float
        The vendor's parameters that these values were computed from.
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
    """The controllers around the rate loop from the log's parameters; None if not known."""

    attitude: AttitudeCommand
    horizontal: CascadeController | None = None
    vertical: CascadeController | None = None


class Shown(Enum):
    """Result of the comparison of a replayed controller with the log."""

    AGREES = "agrees"
    DIFFERS = "differs"
    NOT_SHOWN = "not shown"
    """The flight moved it too little, or the rows are too few."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeReplay:
    """Agreement of the replayed attitude controller of one axis with the logged rate set-points.

    Attributes
    ----------
    shown : Shown
    relative_rms : float
        Rms of the difference over rms of the logged set-point, without the rows that differ most.
    gain : Estimated or None
        Angle gain of the best fit, relative to that of the parameters.
    n_rows : int
        Number of rows compared.
    """

    shown: Shown
    relative_rms: float
    gain: Estimated | None
    n_rows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaperReplay:
    """Agreement of the replayed input shaper of one axis with the logged target.

    ``relative_rms`` is the rms error of the shaped angle, ``unshaped_rms`` that of the commanded angle. Both
    are relative to the rms of the logged target.
    """

    relative_rms: float
    unshaped_rms: float
    n_rows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CascadeReplay:
    """Agreement of the replayed position and velocity controllers of one direction with the logged targets.

    Attributes
    ----------
    position, velocity, integral : Estimated or None
        Best-fit gains of the position controller, and of P and I of the velocity controller, relative to
        those of the parameters. None if not logged, or zero.
    position_rms, velocity_rms : float
        Rms differences to the logged targets, over the rms of the controllers' outputs; NaN for none.
    velocity_error_m_s, velocity_moved_m_s : float
        Rms of target minus velocity, and of the changes of the target [m/s].
    position_error_m : float
        Rms of target minus position [m]; NaN if positions are not controlled.
    n_rows : int
        Number of rows compared.
    row_s : float
        Typical time between rows [s].
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
        """Result for both controllers together; they differ if at least one of them differs."""
        told = [shown_by(each) for each in (self.position, self.velocity) if each is not None]
        if Shown.DIFFERS in told:
            return Shown.DIFFERS
        return Shown.AGREES if told and told[-1] is Shown.AGREES else Shown.NOT_SHOWN


#: A gain error of a tenth changes a margin by 0.8 dB, less than the width of most intervals.
TOLERANCE = 0.1


def shown_by(gain: Estimated) -> Shown:
    """Compare an estimated gain with that of the parameters.

    Parameters
    ----------
    gain : Estimated
        Estimated gain relative to that of the parameters.

    Returns
    -------
    Shown
        The gains differ if the whole interval is more than a tenth away from 1.
    """
    low, high = gain.ci95
    if low > 1.0 + TOLERANCE or high < 1.0 - TOLERANCE:
        return Shown.DIFFERS
    return Shown.AGREES if high - low < 0.5 and abs(gain.value - 1.0) <= 2.0 * TOLERANCE else Shown.NOT_SHOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class OuterLoop:
    """Velocity and position loops through the tilt about one axis, opened at the acceleration set-point.

    Attributes
    ----------
    attitude_hz : Estimated
        Bandwidth of the attitude response to a commanded attitude: 45 degrees of phase lag, or -3 dB (ADS-33)
        [Hz].
    velocity : Margins
        Margins of the velocity loop without the position loop.
    whole : Margins or None
        Margins with the position loop; None if positions are not controlled.
    """

    attitude_hz: Estimated
    velocity: Margins
    whole: Margins | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OuterLoops:
    """Controllers, replays and margins of the loops around the rate loop.

    Attributes
    ----------
    controllers : OuterControllers
        Controllers from the log's parameters.
    attitude : mapping of str to AttitudeReplay
        Replay of the attitude controller by axis.
    shaper : mapping of str to ShaperReplay
        Replay of the input shaper by axis, if the log holds the commanded angles.
    cascades : mapping of str to CascadeReplay
        Replay of the position and velocity controllers by direction.
    loops : mapping of str to OuterLoop
        Loops by tilt axis: "pitch" moves forward, "roll" sideways.
    """

    controllers: OuterControllers
    attitude: Mapping[str, AttitudeReplay] = field(default_factory=dict)
    shaper: Mapping[str, ShaperReplay] = field(default_factory=dict)
    cascades: Mapping[str, CascadeReplay] = field(default_factory=dict)
    loops: Mapping[str, OuterLoop] = field(default_factory=dict)
