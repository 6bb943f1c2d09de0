"""From motor thrust as a fraction of full command to newtons and newton metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries
from quadid_logs.align.series import CleanLog, CleanSeries, TorqueSeries
from quadid_logs.arrays import FloatArray
from quadid_logs.data.torque import AssumedExpo, Calibration, HeldScale
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.maths.frames import torque_matrix
from quadid_logs.maths.resampling import typical_period
from quadid_logs.vocabulary import GRAVITY_M_S2

#: One relative standard deviation of what a user measures or a parameter claims: a kitchen scale, a
#: ruler from hub to hub, a thrust stand without the airframe below the rotor, a thrust parameter as set by
#: an owner, a torque-to-thrust ratio from a data sheet, and a calibrated accelerometer's scale.
MASS_SIGMA, ARM_SIGMA, STAND_SIGMA, PARAMETER_SIGMA, RATIO_SIGMA, ACCELEROMETER_SIGMA = (
    0.01, 0.01, 0.05, 0.1, 0.05, 0.01,
)  # fmt: skip
#: Thrust and weight balance over blocks as long as a manoeuvre [s].
_BLOCK_S: Final = 2.0
_FEW_BLOCKS: Final = 5
#: Thrust goes with the square of the voltage where nothing compensates it; believed if the balance gets
#: this much steadier.
_STEADIER: Final = 0.9
#: Parameters that disagree with the hover by more than this are no calibration.
_HOVER_RANGE: Final = (0.8, 1.25)
#: The tilt (its cosine) beyond which no vertical balance is drawn.
_LEAST_UPRIGHT: Final = 0.5

ThrustOf = Callable[[MotorSeries], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaled:
    """A calibration with what it takes to apply it.

    ``thrust_of`` gives newtons per motor (n_samples, n_rotors); None where
    thrust is not known. ``position`` (n_rotors, 3) [m], None where not known.
    ``refused`` says which claims of parameters were not believed. ``held`` is what fixes
    the scale, None where the thrust was measured and no expo assumed.
    """

    calibration: Calibration
    thrust_of: ThrustOf | None
    held: HeldScale | None = None
    position: FloatArray | None
    remarks: tuple[str, ...]
    refused: tuple[str, ...]
    needs: tuple[str, ...]


def calibrate(
    log: CleanLog, airframe: Airframe, vehicle: Vehicle | None, series: tuple[MotorSeries, ...]
) -> Scaled:
    """Find the best route to N m that vehicle file, parameters and hover allow.

    Parameters
    ----------
    log : CleanLog
    airframe : Airframe
    vehicle : Vehicle or None
    series : tuple of MotorSeries
        The first one tells the hover thrust.

    Returns
    -------
    Scaled
    """
    given = vehicle or Vehicle()
    position = _position(airframe, given)
    ratio_m = given.torque_to_thrust_m or airframe.torque_to_thrust_m
    hover = _hover(log, series[0], given.mass_kg) if series and given.mass_kg else None
    thrust = _thrust(airframe, given, hover)
    arms = position if position is not None else np.zeros((0, 3))
    calibration = Calibration(
        torque_to_thrust_m=ratio_m,
        mass_kg=given.mass_kg or math.nan,
        arm_length_m=float(np.hypot(arms[:, 0], arms[:, 1]).max()) if len(arms) else math.nan,
    )
    if thrust.of is not None and position is not None and series:
        torque = _torque(thrust.of(series[0]), series[0].actuator, airframe, position, ratio_m)
        best = series[0]
        rows = best.flown & np.isfinite(best.command).all(axis=1)
        roll, pitch, yaw = (_slope(best.command[rows, axis], torque[rows, axis]) for axis in range(3))
        # Add what the way to newtons says.
        per_command = (roll, pitch, yaw)
        tilt_sigma, yaw_sigma = math.hypot(thrust.sigma, ARM_SIGMA), math.hypot(thrust.sigma, RATIO_SIGMA)
        roll, pitch, yaw = (
            each if math.isfinite(value) else math.nan
            for each, value in zip((tilt_sigma, tilt_sigma, yaw_sigma), per_command, strict=True)
        )
        calibration = replace(
            calibration,
            route=thrust.route,
            n_m_per_command=per_command,
            relative_sigma=(roll, pitch, yaw),
            max_thrust_n=thrust.max_thrust_n,
            second_opinion=thrust.other_n / thrust.max_thrust_n,
        )
    known_yaw = thrust.of is not None and math.isfinite(ratio_m)
    # Say what is missing for N m.
    needs = []
    if thrust.of is None:
        needs.append("mass_kg (or max_thrust_n or thrust_curve)")
    if position is None:
        needs.append("arm_length_m (or [[rotor]] positions)")
    if not math.isfinite(ratio_m):
        needs.append("torque_to_thrust_m for yaw")
    return Scaled(
        calibration=calibration,
        thrust_of=thrust.of,
        held=thrust.held,
        position=position,
        remarks=(airframe.yaw_remark,) if airframe.yaw_with_command and known_yaw else (),
        refused=thrust.refused,
        needs=tuple(needs),
    )


def torque_n_m(
    series: MotorSeries, airframe: Airframe, scaled: Scaled, expo: AssumedExpo | None = None
) -> TorqueSeries | None:
    """Return the torque of a motor series in N m.

    Parameters
    ----------
    series : MotorSeries
    airframe : Airframe
    scaled : Scaled
    expo : AssumedExpo, optional
        That of the thrust, where it is not measured.

    Returns
    -------
    TorqueSeries or None
        L, M, N [N m] and the rotors' thrust [N]; None where thrust or arms are not known.
    """
    if scaled.thrust_of is None or scaled.position is None:
        return None
    ratio_m = scaled.calibration.torque_to_thrust_m
    thrust = scaled.thrust_of(series)
    torque = _torque(thrust, series.actuator, airframe, scaled.position, ratio_m)
    per_thrust = torque_matrix(scaled.position, airframe.spin, ratio_m)
    if airframe.yaw_with_command:
        per_thrust[2] *= _slope((thrust @ per_thrust[2])[series.flown], torque[series.flown, 2])
    known = bool(np.isfinite(per_thrust).all())
    by_expo = series.by_expo if known and scaled.held is not None else None
    return TorqueSeries(
        series=series.series("torque_n_m", torque, f"{series.reason}; N m by {scaled.calibration.route}"),
        saturated=series.marks,
        rotor_thrust=np.clip(thrust, 0.0, None) if known else None,
        torque_per_thrust=per_thrust if known else None,
        thrust_by_expo=None if by_expo is None else np.clip(thrust, 0.0, None) * by_expo,
        expo=replace(expo, held=scaled.held, slope_by_expo=(0.0, 0.0, 0.0))
        if by_expo is not None and expo and scaled.held
        else None,
    )


def _torque(
    thrust_n: FloatArray, actuator: FloatArray, airframe: Airframe, position: FloatArray, ratio_m: float
) -> FloatArray:
    """Return torque about the centre of mass (n_samples, 3) [N m]."""
    matrix = torque_matrix(position, airframe.spin, ratio_m)
    torque = thrust_n @ matrix.T
    if airframe.yaw_with_command:
        torque[:, 2] = (thrust_n * actuator) @ matrix[2]
    return np.asarray(torque, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Thrust:
    """A way to newtons: in words, as a function, its uncertainty, thrust at full command [N].

    ``other_n`` is that thrust by the next best way; ``held`` as of `Scaled`.
    """

    route: str = ""
    of: ThrustOf | None = None
    held: HeldScale | None = None
    sigma: float = math.nan
    max_thrust_n: float = math.nan
    other_n: float = math.nan
    refused: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hover:
    """Thrust of a rotor at full command [N] that carries the weight, and how it varies."""

    newton: float
    sigma: float
    voltage_exponent: float
    voltage: CleanSeries | None
    mean_voltage: float

    def thrust(self, series: MotorSeries) -> FloatArray:
        """Return thrust per motor (n_samples, n_rotors) [N]."""
        return self.newton * series.thrust * self.sag(series.time_s)[:, None]

    def sag(self, time_s: FloatArray) -> FloatArray:
        """Return thrust against that at the mean voltage [1]; shape of `time_s`."""
        if not self.voltage_exponent or self.voltage is None:
            return np.ones(time_s.shape)
        ratio = self.voltage.at(time_s) / self.mean_voltage
        return np.asarray(ratio**self.voltage_exponent, dtype=np.float64)


def _thrust(airframe: Airframe, given: Vehicle, hover: _Hover | None) -> _Thrust:
    """Choose the way to newtons: thrust given, weight given and carried, a parameter."""
    if given.thrust_curve is not None:
        curve = given.thrust_curve
        return _Thrust(
            route="thrust curve of the vehicle file",
            of=lambda one: np.interp(one.actuator, curve[:, 0], curve[:, 1]),
            sigma=STAND_SIGMA,
            max_thrust_n=float(curve[-1, 1]),
            other_n=math.nan if hover is None else hover.newton,
        )
    if given.max_thrust_n is not None:
        newton = given.max_thrust_n
        return _Thrust(
            route="largest thrust of the vehicle file",
            of=lambda one: newton * one.thrust,
            held=HeldScale.FULL,
            sigma=STAND_SIGMA,
            max_thrust_n=newton,
            other_n=math.nan if hover is None else hover.newton,
        )
    newton = airframe.max_thrust_n
    if hover is not None:
        # The mass is given, and what is given wins over the log's parameters.
        ratio = hover.newton / newton
        odd = math.isfinite(ratio) and not _HOVER_RANGE[0] <= ratio <= _HOVER_RANGE[1]
        refused = (
            f"{airframe.thrust_source} ({newton:.3g} N) is not used: carrying the weight needs {ratio:.2f} "
            "times that."
        )
        return _Thrust(
            route="mass times specific force over the flight",
            of=hover.thrust,
            held=HeldScale.WEIGHT,
            sigma=hover.sigma,
            max_thrust_n=hover.newton,
            other_n=newton,
            refused=(refused,) if odd else (),
        )
    if math.isfinite(newton):
        return _Thrust(
            route=airframe.thrust_source,
            of=lambda one: newton * one.thrust,
            held=HeldScale.FULL,
            sigma=PARAMETER_SIGMA,
            max_thrust_n=newton,
        )
    return _Thrust()


def _position(airframe: Airframe, given: Vehicle) -> FloatArray | None:
    """Return the rotors' places [m]: as given, or the frame's shape with the given arm."""
    if given.rotors:
        return airframe.position if airframe.in_metres else None
    if given.arm_length_m is not None:
        reach = float(np.hypot(airframe.position[:, 0], airframe.position[:, 1]).max())
        return airframe.position * (given.arm_length_m / reach) if reach > 0.0 else None
    return airframe.position if airframe.in_metres else None


def _hover(log: CleanLog, series: MotorSeries, mass_kg: float) -> _Hover | None:
    """Balance thrust with mass times specific force over blocks of flight.

    Over a block the mean of the fractions of all motors times the newtons of a
    full one is the mean of m f, f the specific force that the rotors must
    give: in any manoeuvre, not only at hover.
    """
    blocks = _blocks(log, series)
    if blocks is None:
        return None
    total, force, middle_s = blocks
    voltage = log.first("battery_voltage")
    volt = log.at("battery_voltage", middle_s, missing=math.nan)
    newton, exponent = mass_kg * force / total, 0.0
    if np.isfinite(volt).all() and (volt > 0.0).all():
        compensated = newton / (volt / volt.mean()) ** 2
        if np.std(compensated) < _STEADIER * np.std(newton):
            newton, exponent = compensated, 2.0
    mean = float(np.sum(newton * total) / np.sum(total))
    scatter = float(np.std(newton) / (abs(mean) * math.sqrt(len(newton))))
    return _Hover(
        newton=mean,
        sigma=math.hypot(scatter, MASS_SIGMA, ACCELEROMETER_SIGMA),
        voltage_exponent=exponent,
        voltage=voltage,
        mean_voltage=float(volt.mean()),
    )


def _blocks(log: CleanLog, series: MotorSeries) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return block by block the sum of all motors, the rotors' specific force [m/s^2], the middle [s]."""
    needed = _rotor_force(log)
    period_s = typical_period(series.time_s)
    if needed is None or not period_s > 0.0:
        return None
    length = max(round(_BLOCK_S / period_s), 1)
    n_blocks = len(series.time_s) // length
    rows = slice(0, n_blocks * length)
    total = np.where(series.flown, series.thrust.sum(axis=1), np.nan)[rows].reshape(n_blocks, length)
    time_s = series.time_s[rows].reshape(n_blocks, length)
    edges = np.searchsorted(needed.time_s, time_s[:, [0, -1]])
    cumulated = np.concatenate([[0.0], np.cumsum(needed.force)])
    count = edges[:, 1] - edges[:, 0]
    force = np.divide(
        cumulated[edges[:, 1]] - cumulated[edges[:, 0]], count, out=np.full(n_blocks, np.nan), where=count > 0
    )
    mean = total.mean(axis=1) if n_blocks else np.zeros(0)
    usable = np.isfinite(mean) & np.isfinite(force) & (mean > 0.0) & (force > 0.0)
    if np.count_nonzero(usable) < _FEW_BLOCKS:
        return None
    return mean[usable], force[usable], time_s[usable, length // 2]


class _RotorForce(NamedTuple):
    """Specific force that the rotors give [m/s^2] at times [s], both (n_samples,)."""

    time_s: FloatArray
    force: FloatArray


def _rotor_force(log: CleanLog) -> _RotorForce | None:
    """Return thrust over mass: from the accelerometer less the air's drag, or from weight and tilt.

    In level flight the air pushes horizontally, so that the vertical part of
    the specific force is the rotors' alone: with phi and theta from the
    attitude, T / m = -(R f)_z / (cos phi cos theta). Without an
    accelerometer, the vertical acceleration is taken as zero in the mean.
    """
    attitude = log.first("attitude")
    accelerometer = max(log.sources("specific_force"), key=lambda one: one.n_samples, default=None)
    if accelerometer is None:
        if attitude is None:
            return None
        upright = np.cos(attitude.values[:, 0]) * np.cos(attitude.values[:, 1])
        force = np.nan_to_num(GRAVITY_M_S2 / np.where(upright > _LEAST_UPRIGHT, upright, np.nan))
        return _RotorForce(attitude.time_s, force)
    ax, ay, az = accelerometer.values.T
    force = -az
    if attitude is not None:
        phi, theta = (attitude.at(accelerometer.time_s, column) for column in (0, 1))
        upright = np.cos(phi) * np.cos(theta)
        drag = ax * np.sin(theta) - ay * np.sin(phi) * np.cos(theta)
        force = force + np.where(upright > _LEAST_UPRIGHT, drag / np.maximum(upright, _LEAST_UPRIGHT), 0.0)
    return _RotorForce(accelerometer.time_s, force)


def _slope(one: FloatArray, other: FloatArray) -> float:
    """Return the slope of `other` over `one` by least squares, NaN where it is not known."""
    if len(one) < 2 or not np.isfinite(other).all():
        return math.nan
    centred = one - one.mean()
    spread = float(centred @ centred)
    return float(centred @ (other - other.mean())) / spread if spread > 0.0 else math.nan
