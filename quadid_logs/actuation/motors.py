"""Thrust of every motor over time, whatever it was rebuilt from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.align.series import CleanLog, CleanSeries, TorqueSeries
from quadid_logs.arrays import AnyArray, BoolArray, FloatArray
from quadid_logs.data.log import FlightLog
from quadid_logs.data.torque import AssumedExpo, MixerCheck
from quadid_logs.maths.thrust_curve import slope_at


def any_motor(limited: BoolArray) -> BoolArray:
    """Return whether any motor of a row is marked; (n_samples, n_rotors) to (n_samples,).

    Parameters
    ----------
    limited : ndarray of bool, shape (n_samples, n_rotors)

    Returns
    -------
    ndarray of bool, shape (n_samples,)
    """
    return np.asarray(np.any(limited, axis=1), dtype=np.bool_)


def on_all_axes(limited: BoolArray) -> BoolArray:
    """Return a mark per row as a mark per row and axis, shape (n_samples, 3).

    Parameters
    ----------
    limited : ndarray of bool, shape (n_samples,)

    Returns
    -------
    ndarray of bool, shape (n_samples, 3)
    """
    return np.repeat(limited[:, None], 3, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorSeries:
    """What the motors did, or were commanded to do.

    Attributes
    ----------
    base : CleanSeries
        What it was rebuilt from; tells the times.
    thrust : ndarray, shape (n_samples, n_rotors)
        Fraction of one rotor's thrust at full command and full battery in air of sea level [1].
    command_thrust : ndarray, shape (n_samples, n_rotors)
        The same before any compensation of battery and air: what the mixing gives for the command [1].
    actuator : ndarray, shape (n_samples, n_rotors)
        Motor command, 0 to 1 over the range that makes thrust.
    command : ndarray, shape (n_samples, 3)
        Torque on the scale of the autopilot's own command [1].
    saturated : ndarray of bool, shape (n_samples, 3), or None
        Axes that got less than was commanded; None where that is not known.
    flown : ndarray of bool, shape (n_samples,)
        Certainly off the ground.
    source, reason : str
    achieved : bool
        Saturation is contained.
    by_expo : ndarray, shape (n_samples, n_rotors), or None
        Derivative of the thrust by the expo of its curve, over the thrust; None where no expo was assumed.
    per_thrust : ndarray, shape (3, n_rotors), or None
        ``command`` per unit of ``command_thrust``, where that is not the inverse of the mixing.
    """

    base: CleanSeries
    thrust: FloatArray
    command_thrust: FloatArray
    actuator: FloatArray
    command: FloatArray
    saturated: BoolArray | None
    flown: BoolArray
    source: str
    reason: str
    achieved: bool
    by_expo: FloatArray | None = None
    per_thrust: FloatArray | None = None

    @property
    def time_s(self) -> FloatArray:
        """On the common clock [s]; shape (n_samples,)."""
        return self.base.time_s

    @property
    def marks(self) -> CleanSeries | None:
        """Where the axes got less than was commanded, as a series ``torque_saturation``."""
        if self.saturated is None:
            return None
        return self.series("torque_saturation", self.saturated)

    def series(self, name: str, values: AnyArray, reason: str = "") -> CleanSeries:
        """Return values at these times as a source of a signal.

        Parameters
        ----------
        name : str
            A key of `vocabulary.SIGNALS`.
        values : ndarray, shape (n_samples, n_columns)
            Of any type; they are worked with in double precision.
        reason : str
            Instead of that of the motors.
        """
        return replace(
            self.base,
            name=name,
            stored=values,
            source=self.source,
            reason=reason or self.reason,
            achieved=self.achieved,
        )

    def as_command(self, airframe: Airframe, expo: AssumedExpo | None = None) -> TorqueSeries:
        """Return the normalised torque, with the thrust that makes it.

        Parameters
        ----------
        expo : AssumedExpo, optional
            That of the thrust.

        Returns
        -------
        TorqueSeries
            ``torque_command`` [1].
        """
        command = self.command
        if airframe.yaw_with_command:
            yaw = self._yaw_with_command(airframe.command_per_thrust[2])
            command = np.column_stack([command[:, :2], yaw])
        series = self.series("torque_command", command)
        if not airframe.inverts:
            return TorqueSeries(series=series, saturated=self.marks)
        thrust = self.command_thrust
        thrust = thrust if thrust.size and thrust.min() >= 0.0 else np.clip(thrust, 0.0, None)
        return TorqueSeries(
            series=series,
            saturated=self.marks,
            rotor_thrust=thrust,
            torque_per_thrust=airframe.command_per_thrust if self.per_thrust is None else self.per_thrust,
            thrust_by_expo=None if self.by_expo is None else thrust * self.by_expo,
            expo=None if self.by_expo is None else expo,
        )

    def _yaw_with_command(self, per_thrust: FloatArray) -> FloatArray:
        """Return yaw that goes with thrust times motor command, as yaw command at the thrust it is used at.

        A unit of it does what a small unit of command does at the mean thrust, weighted by the square
        of the command as least squares is: there the effectiveness is found.
        """
        drag, rows = self.command_thrust * self.actuator, self.flown
        thrust, yaw = self.command_thrust[rows], self.command[rows, 2]
        if not (np.isfinite(yaw).all() and yaw.any()):
            return self.command[:, 2]
        where = float(np.average(thrust.mean(axis=1), weights=yaw**2))
        slope = slope_at(thrust.ravel(), drag[rows].ravel(), where)
        return drag @ per_thrust / slope if slope > 0.0 else self.command[:, 2]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebuilt:
    """The motor series that a log allows, the check of them, what stood in the way, and the expo assumed.

    ``told_by_speed``: measured speeds of the rotors told thrust curve and drift, so that the outputs are
    the input, whose lag is to be found. ``output_range_us``: as of `TorqueModel`.
    """

    series: tuple[MotorSeries, ...] = ()
    check: MixerCheck | None = None
    remarks: tuple[str, ...] = ()
    expo: AssumedExpo | None = None
    told_by_speed: bool = False
    output_range_us: tuple[FloatArray, FloatArray] | None = None

    @property
    def trusted(self) -> bool:
        """Whether the recomputed pulse widths fit, or could not be compared."""
        return self.check is None or self.check.fits


class Mixing(Protocol):
    """What the torque needs to know of an autopilot."""

    def find_airframe(self, log: FlightLog) -> Airframe | Unknown:
        """Tell the frame, its motors and outputs from a log's parameters."""

    def rebuild(self, log: CleanLog, airframe: Airframe) -> Rebuilt:
        """Rebuild what the motors did from commands and outputs."""
