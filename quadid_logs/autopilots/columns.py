"""Columns that several vendors' messages need alike."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.maths.rotations import euler_from_quaternion


def attitude_columns(quaternion: FloatArray) -> FloatArray:
    """Return Euler 3-2-1 angles [rad] of quaternions w, x, y, z (body FRD to Earth NED).

    NaN where the quaternion is zero, as before the estimator has started.
    """
    is_zero = ~quaternion.any(axis=1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        euler = euler_from_quaternion(quaternion)
    euler[is_zero] = np.nan
    return euler


def used_columns(values: FloatArray, in_use: BoolArray) -> FloatArray:
    """Leave out the columns behind the last one that is ever `in_use`; shape (n_rows, 0 or more)."""
    columns = np.flatnonzero(in_use.any(axis=0))
    return values[:, : columns[-1] + 1] if len(columns) else values[:, :0]
