"""Attitude: Euler 3-2-1 angles, quaternions, and their kinematics.

A quaternion (w, x, y, z) turns body (FRD) into Earth (NED) vectors. Arrays
carry the components on the last axis; `quaternion_rate` takes them one by one,
so that it works on floats and on arrays alike.
"""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np

from quadid_logs.arrays import FloatArray

#: Angles that are integrated from rates fade in this time [s]: three times the five seconds in which drag
#: stops a vehicle, or 0.011 Hz, a thirtieth of the slowest motion that is fitted. A gyro's bias of some
#: hundredths of a rad/s, times this time, does not turn a vehicle over.
TILT_MEMORY_S: Final = 15.0
#: Steps of the integration [s]: no vehicle turns far enough in a fiftieth of a second to tell two axes apart.
_TILT_STEP_S = 0.02

Component: TypeAlias = Any
"""A float or an ndarray."""


def unwrapped(angles_rad: FloatArray) -> FloatArray:
    """Remove the jumps of 2 pi from angles over time.

    As `numpy.unwrap`, in a quarter of its time where few steps wrap.

    Parameters
    ----------
    angles_rad : ndarray, shape (n_samples, n_angles)
        Finite [rad].

    Returns
    -------
    ndarray, shape (n_samples, n_angles)
        The first sample as it was.

    Examples
    --------
    >>> unwrapped(np.array([[3.0], [-3.0], [-2.9]])).round(3).ravel().tolist()
    [3.0, 3.283, 3.383]
    """
    smooth = angles_rad.copy()
    for k in range(angles_rad.shape[1]):
        steps = np.diff(angles_rad[:, k])
        jumps = np.flatnonzero(np.abs(steps) > np.pi)
        turns = np.cumsum(np.round(steps[jumps] / (2.0 * np.pi)))
        smooth[1:, k] -= (
            2.0 * np.pi * np.repeat(np.append(0.0, turns), np.diff([0, *jumps.tolist(), steps.size]))
        )
    return smooth


def quaternion_from_euler(euler_rad: FloatArray) -> FloatArray:
    """Return the unit quaternion of Euler 3-2-1 angles.

    Parameters
    ----------
    euler_rad : ndarray, shape (..., 3)
        Roll, pitch, yaw [rad].

    Returns
    -------
    ndarray, shape (..., 4)
        w, x, y, z; body to Earth.

    References
    ----------
    J. Diebel, "Representing attitude: Euler angles, unit quaternions, and rotation vectors,"
    Stanford University, 2006, eq. (297).
    """
    half = 0.5 * np.asarray(euler_rad, dtype=np.float64)
    (cr, cp, cy), (sr, sp, sy) = np.moveaxis(np.cos(half), -1, 0), np.moveaxis(np.sin(half), -1, 0)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def euler_from_quaternion(quaternion: FloatArray) -> FloatArray:
    """Return the Euler 3-2-1 angles of a quaternion.

    Parameters
    ----------
    quaternion : ndarray, shape (..., 4)
        w, x, y, z; body to Earth, of any length but zero.

    Returns
    -------
    ndarray, shape (..., 3)
        Roll in (-pi, pi], pitch in [-pi/2, pi/2], yaw in (-pi, pi] [rad].
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    norm = w * w + x * x + y * y + z * z
    roll = np.arctan2(2.0 * (w * x + y * z), norm - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x) / norm, -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), norm - 2.0 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=-1)


def multiply_quaternions(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the Hamilton product, the rotation by `right` followed by that by `left`.

    Parameters
    ----------
    left, right : ndarray, shape (..., 4)

    Returns
    -------
    ndarray, shape (..., 4)
    """
    a, b, c, d = np.moveaxis(left, -1, 0)
    w, x, y, z = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=-1,
    )


def conjugate(quaternion: FloatArray) -> FloatArray:
    """Return the way back of unit quaternions.

    Parameters
    ----------
    quaternion : ndarray, shape (..., 4)

    Returns
    -------
    ndarray, shape (..., 4)
    """
    return np.asarray(quaternion * np.array([1.0, -1.0, -1.0, -1.0]), dtype=np.float64)


def rotation_vector(quaternion: FloatArray) -> FloatArray:
    """Return axis times angle of the shorter way that unit quaternions turn.

    Parameters
    ----------
    quaternion : ndarray, shape (n, 4)

    Returns
    -------
    ndarray, shape (n, 3)
        [rad]
    """
    shorter = quaternion * np.where(quaternion[:, :1] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(shorter[:, 1:], axis=1)
    # sin(a / 2) over a / 2 goes to one.
    over = np.divide(
        2.0 * np.arctan2(size, shorter[:, 0]), size, where=size > 0.0, out=np.full(len(size), 2.0)
    )
    return np.asarray(shorter[:, 1:] * over[:, np.newaxis], dtype=np.float64)


def tilt_and_heading(rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split rotations into one about an axis across the body's z, and one about z before it.

    Parameters
    ----------
    rotation : ndarray, shape (n, 4)
        Unit quaternions.

    Returns
    -------
    tilt : ndarray, shape (n, 4)
        Without a part about z.
    heading_rad : ndarray, shape (n,)
        About z, -pi to pi: rotation = tilt * heading.
    """
    shorter = rotation * np.where(rotation[:, :1] < 0.0, -1.0, 1.0)
    half = np.arctan2(shorter[:, 3], shorter[:, 0])
    back = np.zeros_like(shorter)
    back[:, 0], back[:, 3] = np.cos(half), -np.sin(half)
    return multiply_quaternions(shorter, back), 2.0 * half


def rotation_matrix(quaternion: FloatArray) -> FloatArray:
    """Return the matrix that turns body vectors into Earth vectors.

    Parameters
    ----------
    quaternion : ndarray, shape (..., 4)
        w, x, y, z of unit length.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_rates(euler_rad: FloatArray, body_rate_rad_s: FloatArray) -> FloatArray:
    """Return the time derivatives of roll, pitch and yaw; singular at a pitch of 90 degrees.

    Parameters
    ----------
    euler_rad : ndarray, shape (..., 3)
        Roll, pitch, yaw [rad].
    body_rate_rad_s : ndarray, shape (..., 3)
        p, q, r [rad/s].

    Returns
    -------
    ndarray, shape (..., 3)
        [rad/s].

    References
    ----------
    B. L. Stevens and F. L. Lewis, *Aircraft Control and Simulation*, eq. (1.4-4).
    """
    phi, theta, _ = np.moveaxis(euler_rad, -1, 0)
    p, q, r = np.moveaxis(body_rate_rad_s, -1, 0)
    turn = q * np.sin(phi) + r * np.cos(phi)
    return np.stack(
        [p + np.tan(theta) * turn, q * np.cos(phi) - r * np.sin(phi), turn / np.cos(theta)], axis=-1
    )


def body_rates(euler_rad: FloatArray, euler_rate_rad_s: FloatArray) -> FloatArray:
    """Return p, q, r from the derivatives of roll, pitch and yaw; nowhere singular.

    Parameters
    ----------
    euler_rad : ndarray, shape (..., 3)
        Roll, pitch, yaw [rad].
    euler_rate_rad_s : ndarray, shape (..., 3)
        Their time derivatives [rad/s].

    Returns
    -------
    ndarray, shape (..., 3)
        [rad/s].
    """
    phi, theta, _ = np.moveaxis(euler_rad, -1, 0)
    roll_rate, pitch_rate, yaw_rate = np.moveaxis(euler_rate_rad_s, -1, 0)
    return np.stack(
        [
            roll_rate - yaw_rate * np.sin(theta),
            pitch_rate * np.cos(phi) + yaw_rate * np.sin(phi) * np.cos(theta),
            -pitch_rate * np.sin(phi) + yaw_rate * np.cos(phi) * np.cos(theta),
        ],
        axis=-1,
    )


def quaternion_rate(
    quaternion: tuple[Component, Component, Component, Component],
    rate: tuple[Component, Component, Component],
) -> tuple[Component, Component, Component, Component]:
    """Return the quaternion's time derivative, half its product with (0, p, q, r).

    Parameters
    ----------
    quaternion : tuple
        w, x, y, z; body to Earth.
    rate : tuple
        p, q, r [rad/s].

    Returns
    -------
    tuple
        Derivatives of w, x, y, z [1/s].
    """
    w, x, y, z = quaternion
    p, q, r = rate
    p, q, r = 0.5 * p, 0.5 * q, 0.5 * r
    return (
        -x * p - y * q - z * r,
        w * p + y * r - z * q,
        w * q + z * p - x * r,
        w * r + x * q - y * p,
    )


def tilt_from_rates(
    body_rate_rad_s: FloatArray, period_s: float, memory_s: float = TILT_MEMORY_S
) -> FloatArray:
    """Return roll and pitch that body rates integrate to, fading towards level.

    The direction of gravity in body axes turns by g' = -w x g. What was long ago fades, so that neither
    an unknown start nor the bias of a gyro stays.

    Parameters
    ----------
    body_rate_rad_s : ndarray, shape (n_samples, 3)
    period_s, memory_s : float
        Between the samples; time constant of the fading [s].

    Returns
    -------
    ndarray, shape (n_samples, 2)
        Roll and pitch [rad].
    """
    step = max(1, int(_TILT_STEP_S / period_s))
    n_steps = -(-len(body_rate_rad_s) // step)
    padded = np.concatenate([body_rate_rad_s, np.zeros((n_steps * step - len(body_rate_rad_s), 3))])
    turns = period_s * padded.reshape(n_steps, step, 3).sum(axis=1)
    keep = math.exp(-step * period_s / memory_s)
    x, y, z = 0.0, 0.0, 1.0
    down = [(x, y, z)]
    for a, b, c in turns.tolist():
        # Midpoint rule; then towards level, and back to unit length.
        u, v, w = x + 0.5 * (c * y - b * z), y + 0.5 * (a * z - c * x), z + 0.5 * (b * x - a * y)
        x, y, z = (
            keep * (x + c * v - b * w),
            keep * (y + a * w - c * u),
            keep * (z + b * u - a * v) + 1.0 - keep,
        )
        size = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / size, y / size, z / size
        down.append((x, y, z))
    edges = step * np.arange(n_steps + 1, dtype=np.float64)
    middle = np.arange(len(body_rate_rad_s), dtype=np.float64) + 0.5
    x, y, z = (np.interp(middle, edges, column) for column in np.array(down).T)
    return np.column_stack([np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))])
