"""From the thrust of rotors at their places to torque, and back."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.errors import ShapeError


def torque_matrix(position: FloatArray, spin: FloatArray, torque_to_thrust_m: float) -> FloatArray:
    """Return the torque about the centre of mass per newton of each rotor's thrust.

    For a rotor that pushes along -z: L = -y F, M = x F, N = spin * k_m * F, the cross
    product of place and force, and the drag that turns the vehicle against the rotor.

    Parameters
    ----------
    position : ndarray, shape (n_rotors, 3)
        FRD from the centre of mass [m].
    spin : ndarray, shape (n_rotors,)
        +1 counter-clockwise from above, -1 clockwise.
    torque_to_thrust_m : float
        Drag torque over thrust [m].

    Returns
    -------
    ndarray, shape (3, n_rotors)
        [N m / N].
    """
    if position.shape != (*spin.shape, 3):
        raise ShapeError(f"Positions {position.shape} and spins {spin.shape} do not belong together.")
    return np.vstack([-position[:, 1], position[:, 0], spin * torque_to_thrust_m])


def normalised_allocation(effectiveness: FloatArray) -> FloatArray:
    """Return the motor command per normalised torque and thrust.

    The pseudo-inverse of the effectiveness, its columns scaled so that a
    command of 1 means full use: roll and pitch by the larger of their two
    root mean squares, yaw by its largest element, thrust by its mean
    magnitude.

    Parameters
    ----------
    effectiveness : ndarray, shape (4, n_rotors)
        L, M, N and downward force per unit of each motor's command.

    Returns
    -------
    ndarray, shape (n_rotors, 4)
        Motor command per unit of normalised roll, pitch, yaw, and of upward thrust.
    """
    mix = np.asarray(np.linalg.pinv(effectiveness), dtype=np.float64)
    roll, pitch = (_root_mean_square(mix[:, axis]) for axis in (0, 1))
    tilt = max(roll, pitch)
    yaw = float(mix[:, 2].max())
    lift = float(np.mean(np.abs(mix[:, 3])))
    scaled = mix / np.array([tilt, tilt, yaw if yaw > 0.0 else 1.0, -lift])
    return np.where(np.abs(scaled) < 1e-3, 0.0, scaled)


def _root_mean_square(column: FloatArray) -> float:
    """Norm over the square root of half the number of motors that take part."""
    active = np.count_nonzero(np.abs(column) > 1e-3)
    return float(np.sqrt(np.sum(column**2) / (active / 2.0))) if active else 1.0
