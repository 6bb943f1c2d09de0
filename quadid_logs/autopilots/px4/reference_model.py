"""The attitude that PX4 follows since 1.18: a model of second order behind the set-point."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotational_dynamics import Quadruple, Triple

#: mc_att_control_main.cpp: steps are no longer than this; after a gap the model begins anew [s].
_LONGEST_STEP_S: Final = 0.02
_GAP_S: Final = 0.1
#: A smaller turn is none.
_NOTHING_RAD: Final = 1e-12


def followed(
    wanted: FloatArray, yaw_rate_rad_s: FloatArray, time_s: FloatArray, natural_rad_s: float
) -> FloatArray:
    """Return what the model makes of attitude set-points.

    Parameters
    ----------
    wanted : ndarray, shape (n_steps, 4)
        Set-points as unit quaternions.
    yaw_rate_rad_s : ndarray, shape (n_steps,)
        Commanded about the vertical.
    time_s : ndarray, shape (n_steps,)
        Of the attitudes, which drive the controller.
    natural_rad_s : float
        MC_REF_W_N.

    Returns
    -------
    ndarray, shape (n_steps, 4)
        Unit quaternions.

    Notes
    -----
    AttitudeControl.cpp, `propagateReferenceModel`: the error e of the model against its set-point, twice the
    vector part of a quaternion, drives e'' + 2 w e' + w^2 e = 0 about a held set-point, in closed form over a
    step; the commanded yaw rate turns the model beside it.
    """
    found = np.empty_like(wanted)
    state, rate = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    steps_s = np.diff(time_s, prepend=-math.inf)
    rows = zip(wanted.tolist(), yaw_rate_rad_s.tolist(), steps_s.tolist(), strict=True)
    for place, (target, yaw_rate, step_s) in enumerate(rows):
        if 0.0 < step_s <= _GAP_S:
            state, rate = _step(state, rate, target, yaw_rate, natural_rad_s, min(step_s, _LONGEST_STEP_S))
        else:
            state, rate = target, (0.0, 0.0, 0.0)
        found[place] = state
    return found


def _step(
    state: Quadruple, rate: Triple, target: Quadruple, yaw_rate: float, natural: float, step_s: float
) -> tuple[Quadruple, Triple]:
    w, x, y, z = state
    error = _product((w, -x, -y, -z), target)
    twice = 2.0 if error[0] >= 0.0 else -2.0
    left, turned = math.exp(-natural * step_s), natural * step_s
    # The vertical in the model's own axes.
    down = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z)
    angle = [
        (1.0 - (1.0 + turned) * left) * twice * one + step_s * left * speed + axis * yaw_rate * step_s
        for one, speed, axis in zip(error[1:], rate, down, strict=True)
    ]
    p, q, r = (
        natural * turned * left * twice * one + (1.0 - turned) * left * speed
        for one, speed in zip(error[1:], rate, strict=True)
    )
    size = math.sqrt(sum(one * one for one in angle))
    half = 0.5 * math.sin(0.5 * size) / (0.5 * size) if size > _NOTHING_RAD else 0.5
    new = _product(state, (math.cos(0.5 * size), half * angle[0], half * angle[1], half * angle[2]))
    length = math.sqrt(sum(one * one for one in new))
    return (new[0] / length, new[1] / length, new[2] / length, new[3] / length), (p, q, r)


def _product(left: Quadruple, right: Quadruple) -> Quadruple:
    w, x, y, z = left
    e, i, j, k = right
    return (
        w * e - x * i - y * j - z * k,
        w * i + x * e + y * k - z * j,
        w * j - x * k + y * e + z * i,
        w * k + x * j - y * i + z * e,
    )
