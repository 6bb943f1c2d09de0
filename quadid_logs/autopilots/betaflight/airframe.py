"""Which frame a Betaflight log describes: found in how the motors follow the PID sums.

The header names neither the frame nor the direction of the rotors, so both are told by the outputs.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog

#: Betaflight's quad X (``mixer_init.c``): rear right, front right, rear left, front left; FRD, longest arm 1.
_POSITION: Final = np.sqrt(0.5) * np.array([[-1.0, 1, 0], [1, 1, 0], [-1, -1, 0], [1, -1, 0]])
#: Counter-clockwise from above is +1; the other way round with yaw_motors_reversed, "props out".
_SPIN: Final = np.array([-1.0, 1.0, 1.0, -1.0])
#: Slopes of flown logs on those of the mixer: without airmode it halves them at low throttle; thrust
#: linearisation and rounding of whole numbers change less.
_SLOPES: Final = (0.4, 1.5)
#: Rows that tell slopes to well within the tolerance.
_FEWEST_ROWS, _MOST_ROWS = 500, 20_000


def find_airframe(log: FlightLog) -> Airframe | Unknown:
    """Compare the outputs' slopes on roll, pitch and yaw sums with a quad X, rotors either way round.

    Parameters
    ----------
    log : FlightLog

    Returns
    -------
    Airframe or Unknown
        Factors are fractions of the outputs' range per unit of command.
    """
    slopes = _slopes(log)
    if slopes is None:
        return Unknown(remark="The log holds too few PID sums and motor outputs to tell the frame from.")
    mix = np.column_stack([-np.sign(_POSITION[:, 1]), np.sign(_POSITION[:, 0]), _SPIN])
    if slopes.shape[1] != len(mix):
        return Unknown(
            remark=f"The log has {slopes.shape[1]} motors; of Betaflight's frames only quad X is known."
        )
    for direction in (1.0, -1.0):
        expected = mix * [1.0, 1.0, direction]
        along = slopes.T * expected
        if ((along > _SLOPES[0]) & (along < _SLOPES[1])).all():
            return _quad_x(expected, direction)
    return Unknown(remark="The motors do not follow the PID sums as those of Betaflight's quad X do.")


def _quad_x(mix: FloatArray, direction: float) -> Airframe:
    """Return the frame with its rotors this way round."""
    return Airframe(
        name="quad X",
        source="how the motors follow the PID sums" + ("" if direction > 0 else "; rotors reversed"),
        factors=np.column_stack([mix, np.ones(len(mix))]),
        position=_POSITION,
        spin=_SPIN * direction,
        remarks=("The arms are those of a symmetric frame: no header tells them.",),
    )


def _slopes(log: FlightLog) -> FloatArray | None:
    """Return the slopes (3, n_motors) of the outputs on the PID sums, with throttle and a constant beside."""
    logged = [log.candidates(name) for name in ("torque_command", "throttle", "motor_thrust")]
    if not all(logged):
        return None
    command, throttle, motors = (sources[0].values for sources in logged)
    rows = np.flatnonzero(((motors > 0.0) & (motors < 1.0)).all(axis=1))
    rows = rows[:: max(1, len(rows) // _MOST_ROWS)]
    regressors = np.column_stack([command[rows], throttle[rows], np.ones(len(rows))])
    if len(rows) < _FEWEST_ROWS or np.linalg.matrix_rank(regressors) < regressors.shape[1]:
        return None
    return np.asarray(np.linalg.lstsq(regressors, motors[rows], rcond=None)[0][:3], dtype=np.float64)
