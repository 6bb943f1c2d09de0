"""Thrust from measured rotor speeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries
from quadid_logs.align.series import CleanLog, CleanSeries
from quadid_logs.arrays import BoolArray, FloatArray, IntArray

#: Speeds that a rotor in flight cannot fall below or exceed [rad/s]; 100 and 100 000 rpm.
_SPEEDS: Final = (10.0, 10_500.0)
#: Speeds of a multirotor in flight vary; what does not is no measurement.
_LEAST_SPREAD: Final = 1e-3
#: A measurement has lag, noise and rounding; what follows the command closer than this is computed from it.
_COMPUTED: Final = 0.9995
#: Below this the speeds belong to other rotors, or their clock is off.
_UNLIKE: Final = 0.5
#: Telemetry is this much older than its stamp, or less [s].
_AGES_S: Final = (0.0, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.08)
_FEW_ROWS: Final = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotorSpeed:
    """What the ESCs' speeds are, in words, and the thrust series if they are measurements."""

    verdict: str = ""
    series: MotorSeries | None = None


def from_rotor_speed(log: CleanLog, airframe: Airframe, reference: MotorSeries | None) -> RotorSpeed:
    """Judge the rotor speeds and turn them into thrust, which goes with their square.

    Parameters
    ----------
    log : CleanLog
    airframe : Airframe
    reference : MotorSeries or None
        Thrust from commands: fixes the scale, and tells measured from computed speeds.

    Returns
    -------
    RotorSpeed
    """
    signal = log.first("rotor_speed")
    if signal is None:
        return RotorSpeed()
    columns = [channel - 1 for channel in airframe.channels] or list(range(airframe.n_rotors))
    if reference is None or max(columns) >= signal.values.shape[1]:
        return RotorSpeed(verdict=f"{signal.source}: {signal.values.shape[1]} speeds fit no known motors")
    speed = signal.values[:, columns]
    believable = np.asarray(((speed > _SPEEDS[0]) & (speed < _SPEEDS[1])).all(axis=1), dtype=np.bool_)
    up = np.asarray(log.flown(signal.time_s, np.nan_to_num(speed).mean(axis=1)) & believable, np.bool_)
    if np.count_nonzero(up) < _FEW_ROWS or np.ptp(speed[up]) < _LEAST_SPREAD * speed[up].mean():
        return RotorSpeed(verdict=f"{signal.source}: zero or constant in flight, not used")
    likeness, row = max(
        (_likeness(speed[up], signal.time_s[up] - age_s, reference) for age_s in _AGES_S),
        key=lambda found: found[0],
    )
    if likeness > _COMPUTED:
        return RotorSpeed(verdict=f"{signal.source}: computed from the command, not measured; not used")
    if likeness < _UNLIKE:
        return RotorSpeed(
            verdict=f"{signal.source}: not used, it does not follow the commanded thrust "
            f"(correlation {likeness:.2f})"
        )
    thrust = float(reference.thrust[row].mean() / np.mean(speed[up] ** 2)) * speed**2
    return RotorSpeed(
        verdict=f"{signal.source}: follows the commanded thrust (correlation {likeness:.3f})",
        series=_of_thrust(signal, thrust, up, airframe, reference),
    )


def _of_thrust(
    signal: CleanSeries, thrust: FloatArray, flown: BoolArray, airframe: Airframe, reference: MotorSeries
) -> MotorSeries:
    """Return the series of a thrust (n_samples, n_rotors), with the reference's scale of the command."""
    per_thrust = airframe.command_per_thrust
    # By how much the reference's thrust was raised against battery and air.
    gain = _slope(reference.command[reference.flown], reference.thrust[reference.flown] @ per_thrust.T)
    return MotorSeries(
        base=signal,
        thrust=thrust,
        command_thrust=thrust / gain,
        actuator=np.sqrt(np.clip(thrust, 0.0, 1.0)),
        command=thrust @ per_thrust.T / gain,
        saturated=None,
        flown=flown,
        source=f"{signal.source} squared",
        reason="measured rotor speeds: lag and saturation are in them",
        achieved=True,
    )


def _likeness(speed: FloatArray, time_s: FloatArray, reference: MotorSeries) -> tuple[float, IntArray]:
    """Return how well speeds follow command or thrust, and the rows of the reference at their times."""
    row = np.maximum(reference.base.last_before(time_s), 0)
    both = (
        _correlation(speed, reference.actuator[row]),
        _correlation(speed**2, reference.thrust[row]),
    )
    return max(both), row


def _correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of two arrays of one shape, 0 where one does not vary."""
    both = np.isfinite(one) & np.isfinite(other)
    n_rows = np.maximum(both.sum(axis=0), 1)
    means = (np.where(both, values, 0.0).sum(axis=0) / n_rows for values in (one, other))
    a, b = ((values - mean)[both] for values, mean in zip((one, other), means, strict=True))
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0


def _slope(one: FloatArray, other: FloatArray) -> float:
    """Return how much larger `other` is than `one`, by least squares; 1 where `one` is zero."""
    known = np.isfinite(one) & np.isfinite(other)
    size = float(one[known] @ one[known])
    return float(one[known] @ other[known]) / size if size > 0.0 else 1.0
