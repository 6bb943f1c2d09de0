"""Frame geometry and thrust curves: from logged outputs to L, M, N."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown, with_rotors
from quadid_logs.actuation.calibration import calibrate, torque_n_m
from quadid_logs.actuation.motors import Mixing, MotorSeries, Rebuilt
from quadid_logs.actuation.rotor_speed import RotorSpeed, from_rotor_speed
from quadid_logs.align.series import CleanLog, TorqueSeries
from quadid_logs.data.torque import TorqueModel
from quadid_logs.data.vehicle import Vehicle

__all__ = ["Torques", "reconstruct"]

#: As in the choice among sources of one signal: a little slower is as good.
_MOST_LOST = 0.8


class Torques(NamedTuple):
    """What is known of the torque, and its sources, of each kind the preferred one first.

    ``without_speeds`` is the same from motor commands, where measured rotor speeds come first.
    """

    model: TorqueModel
    sources: tuple[TorqueSeries, ...]
    without_speeds: Torques | None = None


# Damaged numbers pass on as NaN or infinity, silently: `TorqueSeries.possible` drops them.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def reconstruct(log: CleanLog, autopilot: Mixing, vehicle: Vehicle | None = None) -> Torques:
    """Rebuild the torque that the motors achieved, in newton metres where that is known.

    Parameters
    ----------
    log : CleanLog
    autopilot : Mixing
        That of the log.
    vehicle : Vehicle, optional
        What the user knows; it wins over the log's parameters.

    Returns
    -------
    Torques
        With ``torque_command`` rebuilt from what the motors did ahead of what
        was commanded, ``torque_n_m`` where all three axes are calibrated, and
        the airframe as the model. Where nothing can be rebuilt, the model says
        why and what to pass with --vehicle.
    """
    airframe = with_rotors(autopilot.find_airframe(log.log), vehicle)
    # The torques that the log holds.
    logged = tuple(
        TorqueSeries(series=one) for one in (*log.sources("torque_command"), *log.sources("torque_n_m"))
    )
    if isinstance(airframe, Unknown):
        return Torques(TorqueModel(remarks=(airframe.remark,), needs=(airframe.need,)), logged)
    rebuilt = autopilot.rebuild(log, airframe)
    series = rebuilt.series
    speed = from_rotor_speed(log, airframe, series[0] if series else None)
    # A thrust stand's curve is over the motor command, which a speed does not tell.
    by_speed = speed.fast and not rebuilt.told_by_speed
    if speed.series is None:
        return _torques(log, airframe, vehicle, rebuilt, speed)
    commanded = replace(rebuilt, series=(*series, speed.series))
    without = _torques(log, airframe, vehicle, commanded, speed)
    if not by_speed or not (vehicle is None or vehicle.thrust_curve is None):
        return without
    measured = replace(rebuilt, series=(speed.series, *series))
    return _torques(log, airframe, vehicle, measured, speed, n_measured=1)._replace(without_speeds=without)


def _torques(
    log: CleanLog,
    airframe: Airframe,
    vehicle: Vehicle | None,
    rebuilt: Rebuilt,
    speed: RotorSpeed,
    *,
    n_measured: int = 0,
) -> Torques:
    """Put the torques together; the first ``n_measured`` of the series come before what was commanded."""
    scaled = calibrate(log, airframe, vehicle, rebuilt.series)
    refused = (*airframe.refused, *scaled.refused)
    # Say why the mixer's output is not used although it could be computed.
    mistrust = []
    if not rebuilt.trusted and rebuilt.check is not None:
        mistrust.append(
            f"The recomputed pulse widths differ from the logged ones by {rebuilt.check.typical_us:.1f} us "
            "(one sigma). This firmware mixes in another way, or the rows do not fit together. The torque "
            "is taken as it was commanded."
        )
    in_metres = scaled.position is not None
    model = TorqueModel(
        frame=airframe.name,
        frame_source=airframe.source,
        position=airframe.position if scaled.position is None else scaled.position,
        position_unit="m" if in_metres else "arm length",
        spin=airframe.spin,
        allocation=airframe.factors,
        channels=airframe.channels,
        channel_source=airframe.channel_source,
        calibration=scaled.calibration,
        output_range_us=rebuilt.output_range_us,
        check=rebuilt.check,
        saturated_fraction=_saturated_fraction(rebuilt.series),
        needs=scaled.needs,
        rotor_speed=speed.verdict,
        refused=refused,
        remarks=(*airframe.remarks, *rebuilt.remarks, *mistrust, *scaled.remarks, *refused),
    )
    # The torques in N m, logged and calibrated.
    in_newton_metres = [TorqueSeries(series=one) for one in log.sources("torque_n_m")]
    # Torque in N m is to be about as dense as the best command: units are not worth samples.
    best = max((one.n_samples for one in log.sources("torque_command")), default=0)
    dense = max((len(one.time_s) for one in rebuilt.series), default=0) >= _MOST_LOST * best
    if dense and all(scaled.calibration.known):
        made = (torque_n_m(one, airframe, scaled, rebuilt.expo) for one in rebuilt.series)
        in_newton_metres += [one for one in made if one is not None]
    sources = (
        *_commands(log, rebuilt, airframe, n_first=n_measured + rebuilt.trusted),
        *in_newton_metres,
    )
    return Torques(model, tuple(one.possible() for one in sources))


def _commands(
    log: CleanLog, rebuilt: Rebuilt, airframe: Airframe, *, n_first: int
) -> tuple[TorqueSeries, ...]:
    """Return the normalised torques, rebuilt and logged, in their order of preference."""
    achieved = [one for one in rebuilt.series if one.achieved]
    commanded = [one for one in rebuilt.series if not one.achieved]
    logged, throttle = [], log.first("throttle")
    for one in log.sources("torque_command"):
        # A logged command with the thrust that the mixing would give for it without limits.
        if throttle is None or not airframe.inverts:
            logged.append(TorqueSeries(series=one))
        else:
            thrust = np.column_stack([one.values, throttle.at(one.time_s)]) @ airframe.factors.T
            logged.append(
                TorqueSeries(
                    series=one,
                    rotor_thrust=np.clip(thrust, 0.0, None),
                    torque_per_thrust=airframe.command_per_thrust,
                )
            )
    if logged:
        # Where the mixer is not believed, the motors were limited all the same where theirs is found to be.
        told = commanded or (
            [] if rebuilt.trusted else [one for one in achieved if one.saturated is not None]
        )
        logged[0] = replace(logged[0], saturated=told[0].marks if told else None)
    if logged and commanded and logged[0].rotor_thrust is not None and commanded[0].by_expo is not None:
        by_expo = logged[0].rotor_thrust * commanded[0].by_expo
        logged[0] = replace(logged[0], thrust_by_expo=by_expo, expo=rebuilt.expo)
    # What the motors did comes before what was commanded; slower outputs are the second opinion.
    made = [one.as_command(airframe, rebuilt.expo) for one in achieved]
    return (*made[:n_first], *logged, *made[n_first:])


def _saturated_fraction(series: Sequence[MotorSeries]) -> tuple[float, float, float]:
    """Return the fraction of flown rows that each axis was limited in, by the best series that tells."""
    for one in series:
        if one.saturated is not None and one.flown.any():
            roll, pitch, yaw = (float(value) for value in one.saturated[one.flown].mean(axis=0))
            return roll, pitch, yaw
    return math.nan, math.nan, math.nan
