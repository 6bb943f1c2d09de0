"""The paper's 6x6 inversion on simulated rotation: exact where it can be."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.rotational_dynamics import (
    angular_acceleration,
    gyroscopic_matrix,
    integrate_adams,
)
from quadid_logs.maths.sliding_windows import solve_windows, stack_windows
from tests.reference_maths import rate_products

DIAGONAL = np.diag([0.008, 0.009, 0.014])
FULL = np.array([[0.0150, -0.0011, 0.0017], [-0.0011, 0.0172, 0.0008], [0.0017, 0.0008, 0.0268]])


def flown(J):
    """All axes excited at once: torques, rates and exact accelerations every 0.2 s."""
    time = np.arange(0.0, 12.0, 0.2)

    def torque(t):
        return np.array([0.03 * np.sin(2.1 * t), 0.03 * np.sin(3.7 * t + 1.0), 0.03 * np.cos(5.3 * t)])

    rate, _ = integrate_adams(J, torque, time, rate_rad_s=np.zeros(3))
    inputs = np.array([torque(t) for t in time])
    return rate, inputs, angular_acceleration(rate, inputs, J)


def solved(regressors, targets):
    """Windows as wide as there are unknowns, the well conditioned ones."""
    width = regressors.shape[1]
    solution = solve_windows(
        stack_windows(regressors, width=width, stride=1), stack_windows(targets, width=width, stride=1)
    )
    good = solution.condition_number < 1e5
    assert good.sum() > 20
    return solution.coefficients[good]


def test_the_6x6_inversion_returns_a_diagonal_vehicle_exactly():
    """Simultaneous excitation, no noise, exact derivative: A and B to 1e-8."""
    rate, torque, acceleration = flown(DIAGONAL)
    p, q, r = rate.T
    found = solved(np.column_stack([q * r, p * r, p * q, torque]), acceleration)
    (xx, yy, zz) = np.diagonal(DIAGONAL)
    A = np.diag([(yy - zz) / xx, (zz - xx) / yy, (xx - yy) / zz])
    np.testing.assert_allclose(found[:, :, :3], np.broadcast_to(A, (len(found), 3, 3)), atol=1e-8)
    B = np.broadcast_to(np.linalg.inv(DIAGONAL), (len(found), 3, 3))
    np.testing.assert_allclose(found[:, :, 3:], B, atol=1e-8 * B.max())


def test_with_the_squares_of_the_rates_a_full_tensor_is_returned_exactly():
    """Products of inertia need p^2, q^2, r^2 as well: then A and B to 1e-8."""
    rate, torque, acceleration = flown(FULL)
    found = solved(np.column_stack([rate_products(rate), torque]), acceleration)
    A = np.broadcast_to(gyroscopic_matrix(FULL), (len(found), 3, 6))
    B = np.broadcast_to(np.linalg.inv(FULL), (len(found), 3, 3))
    np.testing.assert_allclose(found[:, :, :6], A, atol=1e-8)
    np.testing.assert_allclose(found[:, :, 6:], B, atol=1e-8 * B.max())


def test_without_the_squares_a_full_tensor_is_not_returned():
    """The 6x6 structure cannot express products of inertia: it is off by more than a hundredth."""
    rate, torque, acceleration = flown(FULL)
    p, q, r = rate.T
    found = solved(np.column_stack([q * r, p * r, p * q, torque]), acceleration)
    error = np.abs(found[:, :, 3:] - np.linalg.inv(FULL)).max(axis=(1, 2))
    assert np.median(error) > 0.01 * np.linalg.inv(FULL).max()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_axis_at_a_time_leaves_rank_one(axis):
    """From rest and with a diagonal tensor the other rates stay zero: five columns of six are empty."""
    time = np.arange(0.0, 6.0, 0.2)

    def torque(t):
        vector = np.zeros(3)
        vector[axis] = 0.01 * np.sin(t)
        return vector

    rate, _ = integrate_adams(DIAGONAL, torque, time, rate_rad_s=np.zeros(3))
    p, q, r = rate.T
    inputs = np.array([torque(t) for t in time])
    regressors = stack_windows(np.column_stack([q * r, p * r, p * q, inputs]), width=6, stride=1)
    targets = stack_windows(angular_acceleration(rate, inputs, DIAGONAL), width=6, stride=1)
    solution = solve_windows(regressors, targets)
    assert np.all(solution.rank == 1)
    assert np.all(np.isinf(solution.condition_number))
    np.testing.assert_allclose(
        solution.coefficients[:, axis, 3 + axis], 1.0 / DIAGONAL[axis, axis], rtol=1e-9
    )
