"""From motor thrust in shares of full command to newtons and newton metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries
from quadid_logs.actuation.slow import at_rows, first
from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.data.torque import Calibration
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.maths.frames import torque_matrix
from quadid_logs.maths.resampling import typical_period

#: One standard deviation, as a share, of what a user measures or a parameter claims: a kitchen scale, a
#: ruler from hub to hub, a thrust stand without the airframe below the rotor, CA_ROTORn_CT as set by an
#: owner, a torque-to-thrust ratio from a data sheet, and a calibrated accelerometer's scale.
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
#: A log with this many parameters of ArduPilot's simulator was made by it.
_SIMULATOR_PARAMETERS: Final = 50

#: Standard gravity [m/s^2], and the tilt (its cosine) beyond which no vertical balance is drawn.
GRAVITY: Final = 9.80665
_LEAST_UPRIGHT: Final = 0.5

ThrustOf = Callable[[MotorSeries], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaled:
    """A calibration with what it takes to apply it.

    ``thrust_of`` gives newtons per motor (n_samples, n_rotors); None where
    thrust is not known. ``position`` (n_rotors, 3) [m], None where not known.
    """

    calibration: Calibration
    thrust_of: ThrustOf | None
    position: FloatArray | None
    yaw_with_command: bool
    remarks: tuple[str, ...]
    needs: tuple[str, ...]


def calibrate(
    log: FlightLog, airframe: Airframe, vehicle: Vehicle | None, series: tuple[MotorSeries, ...]
) -> Scaled:
    """Find the best route to N m that vehicle file, parameters and hover allow.

    Parameters
    ----------
    log : FlightLog
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
    simulated = log.autopilot == "ardupilot" and (
        sum(name.startswith("SIM_") for name in log.parameters) >= _SIMULATOR_PARAMETERS
    )
    hover = _hover(log, series[0], given.mass_kg) if series and given.mass_kg else None
    thrust = _thrust(airframe, given, hover)
    remarks = list(thrust.remarks)
    if simulated and thrust.of is not None and math.isfinite(ratio_m):
        remarks.append(
            "Flown in ArduPilot's simulator, whose yaw torque is torque_to_thrust_m times thrust times motor "
            "command (SIM_Motor.cpp); N is computed like that here, unlike for a real propeller."
        )
    calibration = _calibration(
        airframe, given, thrust, position=position, ratio_m=ratio_m, series=series, simulated=simulated
    )
    return Scaled(
        calibration=calibration,
        thrust_of=thrust.of,
        position=position,
        yaw_with_command=simulated,
        remarks=tuple(remarks),
        needs=_needs(thrust, position, ratio_m),
    )


def torque_n_m(series: MotorSeries, airframe: Airframe, scaled: Scaled) -> FloatArray | None:
    """Return L, M, N [N m] of a motor series, NaN on axes that are not calibrated; shape (n_samples, 3)."""
    if scaled.thrust_of is None or scaled.position is None:
        return None
    return _torque(
        scaled.thrust_of(series),
        series.actuator,
        airframe.spin,
        position=scaled.position,
        ratio_m=scaled.calibration.torque_to_thrust_m,
        with_command=scaled.yaw_with_command,
    )


def _torque(
    thrust_n: FloatArray,
    actuator: FloatArray,
    spin: FloatArray,
    *,
    position: FloatArray,
    ratio_m: float,
    with_command: bool,
) -> FloatArray:
    """Return torque about the centre of mass (n_samples, 3) [N m]."""
    matrix = torque_matrix(position, spin, ratio_m)
    torque = thrust_n @ matrix.T
    if with_command:
        torque[:, 2] = (thrust_n * actuator) @ matrix[2]
    return np.asarray(torque, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Thrust:
    """A way to newtons: in words, as a function, its uncertainty, thrust at full command [N].

    ``other_n`` is that thrust by the next best way.
    """

    route: str = ""
    of: ThrustOf | None = None
    sigma: float = math.nan
    max_thrust_n: float = math.nan
    other_n: float = math.nan
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hover:
    """Thrust per share of full command [N] that carries the weight, and how it varies."""

    newton: float
    sigma: float
    voltage_exponent: float
    voltage: Signal | None
    mean_voltage: float

    def thrust(self, series: MotorSeries) -> FloatArray:
        """Return thrust per motor (n_samples, n_rotors) [N]."""
        return self.newton * series.thrust * self.sag(series.position)[:, None]

    def sag(self, position: IntArray) -> FloatArray:
        """Return thrust against that at the mean voltage [1]; shape of `position`."""
        if not self.voltage_exponent:
            return np.ones(position.shape)
        volt = at_rows(self.voltage, position, missing=self.mean_voltage)
        return np.asarray((volt / self.mean_voltage) ** self.voltage_exponent, dtype=np.float64)


def _thrust(airframe: Airframe, given: Vehicle, hover: _Hover | None) -> _Thrust:
    """Choose the way to newtons: thrust given, weight given and carried, CA_ROTOR*."""
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
            sigma=STAND_SIGMA,
            max_thrust_n=newton,
            other_n=math.nan if hover is None else hover.newton,
        )
    newton = airframe.max_thrust_n
    if hover is not None:
        # The mass is given, and what is given wins over the log's parameters.
        ratio = hover.newton / newton
        odd = math.isfinite(ratio) and not _HOVER_RANGE[0] <= ratio <= _HOVER_RANGE[1]
        remark = f"CA_ROTORn_CT ({newton:.3g} N) is not used: the weight needs {ratio:.2f} times that."
        return _Thrust(
            route="mass times specific force over the flight",
            of=hover.thrust,
            sigma=hover.sigma,
            max_thrust_n=hover.newton,
            other_n=newton,
            remarks=(remark,) if odd else (),
        )
    if math.isfinite(newton):
        return _Thrust(
            route="CA_ROTORn_CT",
            of=lambda one: newton * one.thrust,
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


def _hover(log: FlightLog, series: MotorSeries, mass_kg: float) -> _Hover | None:
    """Balance thrust with mass times specific force over blocks of flight.

    Over a block the mean of the shares of all motors times the newtons of a
    full one is the mean of m f, f the specific force that the rotors must
    give: in any manoeuvre, not only at hover.
    """
    blocks = _blocks(log, series)
    if blocks is None:
        return None
    share, force, place = blocks
    voltage = first(log, "battery_voltage")
    volt = at_rows(voltage, place, missing=math.nan)
    newton, exponent = mass_kg * force / share, 0.0
    if voltage is not None and np.isfinite(volt).all() and (volt > 0.0).all():
        compensated = newton / (volt / volt.mean()) ** 2
        if np.std(compensated) < _STEADIER * np.std(newton):
            newton, exponent = compensated, 2.0
    middle = float(np.sum(newton * share) / np.sum(share))
    scatter = float(np.std(newton) / (abs(middle) * math.sqrt(len(newton))))
    return _Hover(
        newton=middle,
        sigma=math.hypot(scatter, MASS_SIGMA, ACCELEROMETER_SIGMA),
        voltage_exponent=exponent,
        voltage=voltage,
        mean_voltage=float(volt.mean()),
    )


def _blocks(log: FlightLog, series: MotorSeries) -> tuple[FloatArray, FloatArray, IntArray] | None:
    """Return sum of shares, specific force of the rotors [m/s^2] and place in the file, block by block."""
    needed = _rotor_force(log)
    period_s = typical_period(series.time_s)
    if needed is None or not period_s > 0.0:
        return None
    length = max(round(_BLOCK_S / period_s), 1)
    n_blocks = len(series.time_s) // length
    rows = slice(0, n_blocks * length)
    total = np.where(series.flown, series.thrust.sum(axis=1), np.nan)[rows].reshape(n_blocks, length)
    place = series.position[rows].reshape(n_blocks, length)
    edges = np.searchsorted(needed.position, place[:, [0, -1]])
    cumulated = np.concatenate([[0.0], np.cumsum(needed.force)])
    count = edges[:, 1] - edges[:, 0]
    force = np.divide(
        cumulated[edges[:, 1]] - cumulated[edges[:, 0]], count, out=np.full(n_blocks, np.nan), where=count > 0
    )
    share = total.mean(axis=1) if n_blocks else np.zeros(0)
    usable = np.isfinite(share) & np.isfinite(force) & (share > 0.0) & (force > 0.0)
    if np.count_nonzero(usable) < _FEW_BLOCKS:
        return None
    return share[usable], force[usable], place[usable, length // 2]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _RotorForce:
    """Specific force that the rotors give [m/s^2] at places in the file, both (n_samples,)."""

    position: IntArray
    force: FloatArray


def _rotor_force(log: FlightLog) -> _RotorForce | None:
    """Return thrust over mass: from the accelerometer less the air's drag, or from weight and tilt.

    In level flight the air pushes horizontally, so that the vertical part of
    the specific force is the rotors' alone: with phi and theta from the
    attitude, T / m = -(R f)_z / (cos phi cos theta). Without an
    accelerometer, the vertical acceleration is taken as zero in the mean.
    """
    attitude = first(log, "attitude")
    accelerometer = max(log.candidates("specific_force"), key=lambda signal: signal.n_samples, default=None)
    if accelerometer is None or not accelerometer.n_samples:
        if attitude is None or not attitude.n_samples:
            return None
        order = np.argsort(attitude.position, kind="stable")
        phi, theta = attitude.values[order, 0], attitude.values[order, 1]
        upright = np.cos(phi) * np.cos(theta)
        return _RotorForce(
            position=attitude.position[order],
            force=np.nan_to_num(GRAVITY / np.where(upright > _LEAST_UPRIGHT, upright, np.nan)),
        )
    order = np.argsort(accelerometer.position, kind="stable")
    position = accelerometer.position[order]
    ax, ay, az = np.nan_to_num(accelerometer.values[order]).T
    force = -az
    if attitude is not None and attitude.n_samples:
        phi, theta = _tilt(attitude, position)
        upright = np.cos(phi) * np.cos(theta)
        drag = ax * np.sin(theta) - ay * np.sin(phi) * np.cos(theta)
        force = force + np.where(upright > _LEAST_UPRIGHT, drag / np.maximum(upright, _LEAST_UPRIGHT), 0.0)
    return _RotorForce(position=position, force=force)


def _tilt(attitude: Signal, position: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return roll and pitch [rad] at rows of the file."""
    order = np.argsort(attitude.position, kind="stable")
    known = order[np.isfinite(attitude.values[order, :2]).all(axis=1)]
    if not len(known):
        return np.zeros(position.shape), np.zeros(position.shape)
    place = attitude.position[known].astype(np.float64)
    phi, theta = (np.interp(position.astype(np.float64), place, attitude.values[known, i]) for i in (0, 1))
    return phi, theta


def _calibration(
    airframe: Airframe,
    given: Vehicle,
    thrust: _Thrust,
    *,
    position: FloatArray | None,
    ratio_m: float,
    series: tuple[MotorSeries, ...],
    simulated: bool,
) -> Calibration:
    """Put the numbers together."""
    arms = position if position is not None else np.zeros((0, 3))
    arm_length_m = float(np.hypot(arms[:, 0], arms[:, 1]).max()) if len(arms) else math.nan
    if thrust.of is None or position is None or not series:
        return Calibration(
            mass_kg=given.mass_kg or math.nan, arm_length_m=arm_length_m, torque_to_thrust_m=ratio_m
        )
    per_command = _per_command(
        series[0],
        _torque(
            thrust.of(series[0]),
            series[0].actuator,
            airframe.spin,
            position=position,
            ratio_m=ratio_m,
            with_command=simulated,
        ),
    )
    tilt_sigma, yaw_sigma = math.hypot(thrust.sigma, ARM_SIGMA), math.hypot(thrust.sigma, RATIO_SIGMA)
    sigma = tuple(
        each if math.isfinite(value) else math.nan
        for each, value in zip((tilt_sigma, tilt_sigma, yaw_sigma), per_command, strict=True)
    )
    return Calibration(
        route=thrust.route,
        n_m_per_command=per_command,
        relative_sigma=(sigma[0], sigma[1], sigma[2]),
        max_thrust_n=thrust.max_thrust_n,
        torque_to_thrust_m=ratio_m,
        mass_kg=given.mass_kg or math.nan,
        arm_length_m=arm_length_m,
        second_opinion=thrust.other_n / thrust.max_thrust_n,
    )


def _per_command(series: MotorSeries, torque: FloatArray) -> tuple[float, float, float]:
    """Return the slope of torque over command on flown rows [N m], NaN where either is unknown."""
    slopes = []
    rows = series.flown & np.isfinite(series.command).all(axis=1)
    for axis in range(3):
        command, made = series.command[rows, axis], torque[rows, axis]
        if len(command) < 2 or not np.isfinite(made).all():
            slopes.append(math.nan)
            continue
        command = command - command.mean()
        spread = float(command @ command)
        slopes.append(float(command @ (made - made.mean())) / spread if spread > 0.0 else math.nan)
    return slopes[0], slopes[1], slopes[2]


def _needs(thrust: _Thrust, position: FloatArray | None, ratio_m: float) -> tuple[str, ...]:
    """Say what is missing for N m."""
    needs = []
    if thrust.of is None:
        needs.append("mass_kg (or max_thrust_n or thrust_curve)")
    if position is None:
        needs.append("arm_length_m (or [[rotor]] positions)")
    if not math.isfinite(ratio_m):
        needs.append("torque_to_thrust_m for yaw")
    return tuple(needs)
