"""Which frame a Betaflight log describes: found in how the motors follow the PID sums.

The header names neither the frame nor the direction of the rotors, so both are told by the outputs. Counter-
clockwise from above is a spin of +1; the other way round with yaw_motors_reversed, "props out".
"""

from __future__ import annotations

import math
from operator import itemgetter
from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.frames import FEW_MOTORS, FRAMES
from quadid_logs.data.log import FlightLog
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES

#: Slopes of flown logs on those of the mixer: without airmode it halves them at low throttle; thrust
#: linearisation and rounding of whole numbers change less.
_SLOPES: Final = (0.4, 1.5)
#: How far a motor's slope may be off the table's, once the axis has its scale: linearisation and rounding
#: make less of it, and two frames of the table differ by more.
_OFF: Final = 0.25
#: Rows that tell slopes to well within the tolerance.
_FEWEST_ROWS, _MOST_ROWS = 500, 20_000


def find_airframe(log: FlightLog) -> Airframe | Unknown:
    """Compare the outputs' slopes on roll, pitch and yaw sums with the motor table, rotors either way round.

    Factors are fractions of the outputs' range per unit of command. Unknown, by its name, where torque does
    not follow from the thrusts.
    """
    slopes, still = _slopes(log)
    motors = log.candidates("motor_thrust")
    n_motors = motors[0].values.shape[1] if motors else 0
    if n_motors in FEW_MOTORS:
        return _as_they_are(f"The log has the motors of {FEW_MOTORS[n_motors]}.")
    if still:
        return Unknown(
            remark=f"The controller never commanded {listed(still)}, so the outputs do not tell the frame."
        )
    if slopes is None:
        return Unknown(remark="The log holds too few PID sums and motor outputs to identify the frame.")
    if log.parameters.get("use_integrated_yaw", 0.0) > 0.0:
        return _as_they_are(
            "With use_integrated_yaw, the mixer integrates the logged yaw sum. This log therefore holds no "
            "yaw torque to identify yaw from."
        )
    # Frames of the table, rotors either way round, the one first that slopes (3, n_motors) are nearest to.
    matches = [
        (_off(slopes, frame.mixer * [1.0, 1.0, direction]), frame, direction)
        for frame in FRAMES
        if len(frame.mixer) == slopes.shape[1]
        for direction in (1.0, -1.0)
    ]
    off, frame, direction = min(matches, key=itemgetter(0), default=(math.inf, FRAMES[0], 1.0))
    if not off < _OFF:
        return _as_they_are(
            f"The {n_motors} motors do not follow the PID sums like any frame in Betaflight's motor table. "
            "The mixer or the motor order is a custom one."
        )
    if frame.unread:
        return _as_they_are(
            f"The motors follow the PID sums like those of a {frame.name}, and {frame.unread}."
        )
    mix = frame.mixer * [1.0, 1.0, direction]
    return Airframe(
        name=frame.name,
        source="how the motors follow the PID sums" + ("" if direction > 0 else "; rotors reversed"),
        factors=np.column_stack([mix, np.ones(len(mix))]),
        position=frame.position,
        spin=np.sign(mix[:, 2]),
        remarks=("The log does not hold the arms: those of a symmetric frame are assumed.",),
    )


def _as_they_are(why: str) -> Unknown:
    """Say that the torque is the one commanded."""
    return Unknown(remark=f"{why} The PID sums are therefore taken as they are.")


def _off(slopes: FloatArray, mixer: FloatArray) -> float:
    """Return by how much a slope is off a mixer (n_motors, 3) at most; infinite where an axis is scaled.

    What all motors do together is left out: the logged throttle is not the one that the mixer adds. Throttle
    boost, dynamic idle and the room that large sums need move that one, often in step with a sum.
    """
    apart, wanted = (one - one.mean(axis=1, keepdims=True) for one in (slopes, mixer.T))
    scale = np.sum(apart * wanted, axis=1) / np.sum(wanted**2, axis=1)
    if not ((scale > _SLOPES[0]) & (scale < _SLOPES[1])).all():
        return math.inf
    return float(np.max(np.abs(apart / scale[:, np.newaxis] - wanted)))


def _slopes(log: FlightLog) -> tuple[FloatArray | None, list[str]]:
    """Return the slopes (3, n_motors) of the outputs on the PID sums, with throttle and a constant beside.

    None where the log does not tell them; beside it the axes whose sum never changes, as with gains of zero.
    """
    logged = [log.candidates(name) for name in ("torque_command", "throttle", "motor_thrust")]
    if not all(logged):
        return None, []
    command, throttle, motors = (sources[0].values for sources in logged)
    rows = np.flatnonzero(((motors > 0.0) & (motors < 1.0)).all(axis=1))
    rows = rows[:: max(1, len(rows) // _MOST_ROWS)]
    regressors = np.column_stack([command[rows], throttle[rows], np.ones(len(rows))])
    if len(rows) < _FEWEST_ROWS:
        return None, []
    if np.linalg.matrix_rank(regressors) < regressors.shape[1]:
        return None, [axis for axis, sums in zip(AXES, command.T, strict=True) if not np.ptp(sums)]
    return np.asarray(np.linalg.lstsq(regressors, motors[rows], rcond=None)[0][:3], dtype=np.float64), []
