"""Frame geometry and thrust curves: from logged outputs to L, M, N."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown, find_airframe
from quadid_logs.actuation.calibration import Scaled, calibrate, torque_n_m
from quadid_logs.actuation.motors import MotorSeries
from quadid_logs.actuation.rotor_speed import from_rotor_speed
from quadid_logs.autopilots.ardupilot import torque as ardupilot
from quadid_logs.autopilots.px4 import torque as px4
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.data.torque import MixerCheck, TorqueModel
from quadid_logs.data.vehicle import Vehicle

__all__ = ["reconstruct"]

#: As in the choice among sources of one signal: a little slower is as good.
_MOST_LOST = 0.8


# Damaged numbers pass on as NaN or infinity, silently: the alignment drops them.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def reconstruct(log: FlightLog, vehicle: Vehicle | None = None) -> FlightLog:
    """Add the torque that the motors achieved, in newton metres where that is known.

    Parameters
    ----------
    log : FlightLog
        As a reader returns it.
    vehicle : Vehicle, optional
        What the user knows; it wins over the log's parameters.

    Returns
    -------
    FlightLog
        With ``torque_command`` rebuilt from what the motors did ahead of what
        was asked, ``torque_saturation`` beside it, ``torque_n_m`` where all
        three axes are calibrated, and the airframe in ``torque``. Where
        nothing can be rebuilt, ``torque`` says why and what to pass with
        --vehicle.
    """
    airframe = find_airframe(log, vehicle)
    if isinstance(airframe, Unknown):
        model = TorqueModel(remarks=(airframe.remark,), needs=(airframe.need,))
        return replace(log, torque=model)
    rebuilt = ardupilot.Rebuilt()
    if log.has_time and log.autopilot == "ardupilot":
        rebuilt = ardupilot.rebuild(log, airframe)
    elif log.has_time and log.autopilot == "px4":
        rebuilt = ardupilot.Rebuilt(series=px4.rebuild(log, airframe))
    series = rebuilt.series
    speed = from_rotor_speed(log, airframe, series[0] if series else None)
    if speed.series is not None:
        # Last: that thrust goes with the square of the speed is assumed, and telemetry is slow and late.
        series = (*series, speed.series)
    scaled = calibrate(log, airframe, vehicle, rebuilt.series)
    model = _model(airframe, scaled, rebuilt.check, series)
    model = replace(
        model,
        rotor_speed=speed.verdict,
        remarks=(*airframe.remarks, *rebuilt.remarks, *_mistrust(rebuilt), *scaled.remarks),
    )
    return replace(
        log, signals=_signals(log, series, airframe, scaled, trusted=rebuilt.trusted), torque=model
    )


def _signals(
    log: FlightLog, series: Sequence[MotorSeries], airframe: Airframe, scaled: Scaled, *, trusted: bool
) -> dict[str, tuple[Signal, ...]]:
    """Return the log's signals with the rebuilt ones in their order of preference."""
    signals = dict(log.signals)
    achieved = [one for one in series if one.achieved]
    # What the motors did comes before what was asked of them; RCOU and the like are the second opinion.
    n_first = 1 if trusted else 0
    at_loop_rate, others = achieved[:n_first], achieved[n_first:]
    commands = (
        *(one.as_command() for one in at_loop_rate),
        *log.candidates("torque_command"),
        *(one.as_command() for one in others),
    )
    if commands:
        signals["torque_command"] = commands
    saturations = tuple(
        one.signal("torque_saturation", one.saturated.astype(np.float64))
        for one in series
        if one.saturated is not None
    )
    asked = log.candidates("torque_command")
    if not trusted and asked and achieved and achieved[0].saturated is not None:
        # What is mixed here may not be what the motors got, but where it is limited, theirs was too.
        marks = achieved[0].signal("torque_saturation", achieved[0].saturated.astype(np.float64))
        saturations = (replace(marks, source=asked[0].source), *saturations)
    if saturations:
        signals["torque_saturation"] = saturations
    if all(scaled.calibration.known) and _keeps_the_rate(log, series):
        made = [(one, torque_n_m(one, airframe, scaled)) for one in series]
        signals["torque_n_m"] = (
            *log.candidates("torque_n_m"),
            *(
                one.signal("torque_n_m", torque, f"{one.reason}; N m by {scaled.calibration.route}")
                for one, torque in made
                if torque is not None
            ),
        )
    return signals


def _keeps_the_rate(log: FlightLog, series: Sequence[MotorSeries]) -> bool:
    """Return whether torque in N m is about as dense as the best command: units are not worth samples."""
    best = max((signal.n_samples for signal in log.candidates("torque_command")), default=0)
    return max((len(one.time_s) for one in series), default=0) >= _MOST_LOST * best


def _model(
    airframe: Airframe, scaled: Scaled, check: MixerCheck | None, series: Sequence[MotorSeries]
) -> TorqueModel:
    """Describe the airframe for people."""
    in_metres = scaled.position is not None
    return TorqueModel(
        frame=airframe.name,
        frame_source=airframe.source,
        position=airframe.position if scaled.position is None else scaled.position,
        position_unit="m" if in_metres else "arm length",
        spin=airframe.spin,
        allocation=airframe.factors,
        channels=airframe.channels,
        channel_source=airframe.channel_source,
        calibration=scaled.calibration,
        check=check,
        saturated_fraction=_saturated_fraction(series),
        needs=scaled.needs,
    )


def _saturated_fraction(series: Sequence[MotorSeries]) -> tuple[float, float, float]:
    """Return the share of flown rows that each axis was limited in, by the best series that tells."""
    for one in series:
        if one.saturated is not None and one.flown.any():
            roll, pitch, yaw = (float(value) for value in one.saturated[one.flown].mean(axis=0))
            return roll, pitch, yaw
    return math.nan, math.nan, math.nan


def _mistrust(rebuilt: ardupilot.Rebuilt) -> tuple[str, ...]:
    """Say why the mixer's output is not used although it could be computed."""
    if rebuilt.trusted or rebuilt.check is None:
        return ()
    check = rebuilt.check
    return (
        f"The recomputed pulse widths miss the logged ones by {check.typical_us:.1f} us (one sigma): the "
        "mixer of this firmware, or the rows of the log, are not what is computed here, so the torque is "
        "taken as it was asked for.",
    )
