"""What a gyro that is not quite right does to the coefficients."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.identify.structures import RIGID_BODY as WITH_THROTTLE
from quadid_logs.identify.systematic import gyro_half_width, systematic_half_width
from quadid_logs.maths.rotational_dynamics import gyroscopic_matrix
from quadid_logs.vocabulary import TORQUE_SYMBOLS
from tests.reference_maths import rate_products

#: Throttle is not known.
RIGID_BODY = WITH_THROTTLE.known(TORQUE_SYMBOLS)
INERTIA = np.array([[0.010, -0.0009, 0.0012], [-0.0009, 0.012, 0.0007], [0.0012, 0.0007, 0.020]])


def coefficients() -> np.ndarray:
    B = np.linalg.inv(INERTIA)
    damping = -B @ np.diag([0.015, 0.014, 0.012])
    return np.concatenate([gyroscopic_matrix(INERTIA), damping, np.zeros((3, 1)), B], axis=1)


def measured_by(E: np.ndarray, seed: int = 0) -> np.ndarray:
    """Coefficients that fit rates measured as (I + E) w, by least squares on exact data."""
    rng = np.random.default_rng(seed)
    w, u = rng.standard_normal((500, 3)), rng.standard_normal((500, 3))
    theta = coefficients()
    truth = np.column_stack([rate_products(w), w, np.ones(500), u]) @ theta.T
    measured, answer = w @ (np.eye(3) + E).T, truth @ (np.eye(3) + E).T
    Z = np.column_stack([rate_products(measured), measured, np.ones(500), u])
    return np.linalg.lstsq(Z, answer, rcond=None)[0].T


def test_the_systematic_uncertainty_is_what_errors_of_the_gyro_do() -> None:
    """The root of the summed squares over all nine entries of E, to 3 %."""
    changes = []
    for a in range(3):
        for b in range(3):
            E = np.zeros((3, 3))
            E[a, b] = 0.01
            changes.append(measured_by(E) - coefficients())
    expected = np.sqrt(np.sum(np.square(changes), axis=0))
    found = gyro_half_width(RIGID_BODY, coefficients())
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=0.01 * 0.03)


def test_an_on_axis_effectiveness_is_known_to_one_per_cent_at_best() -> None:
    """The scale of the gyro, and a third of that for the torque."""
    found = systematic_half_width(RIGID_BODY, coefficients())
    column = RIGID_BODY.columns.index("L")
    assert 0.0104 <= found[0, column] / coefficients()[0, column] < 0.0115


def test_damping_is_known_to_five_per_cent_at_best() -> None:
    """It goes with the air that flows through the rotors, and nothing in a log tells that."""
    found = systematic_half_width(RIGID_BODY, coefficients())
    column = RIGID_BODY.columns.index("p")
    assert 0.05 <= found[0, column] / abs(coefficients()[0, column]) < 0.055


def test_the_reaction_of_rotors_is_known_to_two_per_cent_of_the_throttle_and_one_of_the_gyro_at_best() -> (
    None
):
    """The slope of their speed by command changes with the throttle."""
    reacting = RIGID_BODY.with_reaction()
    column = reacting.columns.index("N_dot")
    theta = np.insert(coefficients(), column, 0.0, axis=1)
    theta[2, column] = 10.0
    assert systematic_half_width(reacting, theta)[2, column] == pytest.approx(10.0 * np.hypot(0.02, 0.01))
