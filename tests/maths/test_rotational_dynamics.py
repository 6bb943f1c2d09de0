"""Eq. (6)-(8) against closed forms and conservation laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ellipj

from quadid_logs.errors import ShapeError
from quadid_logs.maths.rotational_dynamics import (
    angular_acceleration,
    gyroscopic_matrix,
    inertia_terms,
    integrate_adams,
    step_rates,
)
from quadid_logs.maths.rotations import rotation_matrix
from tests.reference_maths import integrate_fixed_step, rate_products

FULL = np.array([[0.0150, -0.0011, 0.0017], [-0.0011, 0.0172, 0.0008], [0.0017, 0.0008, 0.0268]])
INTEGRATORS = pytest.mark.parametrize("integrate", [integrate_adams, integrate_fixed_step])
vectors = st.tuples(*[st.floats(-5.0, 5.0)] * 3).map(np.array)


def free(_time):
    """No torque."""
    return np.zeros(3)


@INTEGRATORS
def test_a_symmetric_top_precesses_as_the_closed_form_says(integrate):
    """Torque-free with Ixx = Iyy, p and q turn with (Izz - Ixx) / Ixx * r."""
    J, start = np.diag([0.008, 0.008, 0.014]), np.array([0.7, 0.2, 3.0])
    time = np.arange(0.0, 20.0, 0.0025)
    rate, _ = integrate(J, free, time, rate_rad_s=start)
    turn = (0.014 - 0.008) / 0.008 * 3.0 * time
    p = 0.7 * np.cos(turn) - 0.2 * np.sin(turn)
    q = 0.7 * np.sin(turn) + 0.2 * np.cos(turn)
    expected = np.column_stack([p, q, np.full_like(time, 3.0)])
    np.testing.assert_allclose(rate, expected, atol=2e-9)


@INTEGRATORS
def test_an_asymmetric_top_follows_the_jacobi_elliptic_functions(integrate):
    """Torque-free from (p, 0, r) with Ixx < Iyy < Izz and 2 E Iyy < H^2 (Landau and Lifshitz, section 37)."""
    xx, yy, zz = 0.010, 0.014, 0.019
    p0, r0 = 1.1, 2.3
    energy2, momentum2 = xx * p0**2 + zz * r0**2, (xx * p0) ** 2 + (zz * r0) ** 2
    assert momentum2 > energy2 * yy
    time = np.arange(0.0, 20.0, 0.0025)
    rate, _ = integrate(np.diag([xx, yy, zz]), free, time, rate_rad_s=np.array([p0, 0.0, r0]))
    speed = np.sqrt((zz - yy) * (momentum2 - energy2 * xx) / (xx * yy * zz))
    modulus = (yy - xx) * (energy2 * zz - momentum2) / ((zz - yy) * (momentum2 - energy2 * xx))
    sn, cn, dn, _ = ellipj(speed * time, modulus)
    # At the start q grows with (Izz - Ixx) p r / Iyy.
    q_amplitude = np.sqrt((energy2 * zz - momentum2) / (yy * (zz - yy)))
    expected = np.column_stack([p0 * cn, np.sign((zz - xx) * p0 * r0) * q_amplitude * sn, r0 * dn])
    np.testing.assert_allclose(rate, expected, atol=2e-8)


@INTEGRATORS
def test_energy_and_angular_momentum_are_conserved(integrate):
    """Over 60 s of torque-free tumbling the relative drift stays below 1e-9."""
    time = np.arange(0.0, 60.0001, 0.0025)
    rate, quaternion = integrate(FULL, free, time, rate_rad_s=np.array([1.2, -0.8, 2.0]))
    energy = np.einsum("ni,ij,nj->n", rate, FULL, rate)
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    momentum = np.einsum("nij,nj->ni", rotation_matrix(quaternion), rate @ FULL)
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-9
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() < 1e-9 * np.linalg.norm(momentum[0])


@INTEGRATORS
def test_a_spin_about_the_middle_axis_flips(integrate):
    """The tennis racket: disturbed a little, q changes sign; about the other axes nothing does."""
    J, time = np.diag([0.010, 0.015, 0.020]), np.arange(0.0, 20.0, 0.0025)
    flipped, _ = integrate(J, free, time, rate_rad_s=np.array([0.01, 3.0, 0.01]))
    steady, _ = integrate(J, free, time, rate_rad_s=np.array([0.01, 0.01, 3.0]))
    assert flipped[:, 1].min() < -2.9
    assert steady[:, 2].min() > 2.9


def test_both_integrators_agree_under_torque():
    """With sinusoidal torques on all axes the two solutions are the same."""
    time = np.arange(0.0, 10.0, 0.0025)

    def torque(t):
        return 0.01 * np.sin(np.array([1.0, 1.7, 2.3]) * t)

    first, _ = integrate_adams(FULL, torque, time, rate_rad_s=np.zeros(3))
    second, _ = integrate_fixed_step(FULL, torque, time, rate_rad_s=np.zeros(3))
    np.testing.assert_allclose(first, second, atol=1e-9)


@given(vectors, vectors)
def test_the_equation_is_linear_in_the_products_of_rates_and_the_torques(rate, torque):
    """Eq. (8) equals `gyroscopic_matrix` times the six products plus J^-1 times the torque."""
    expected = np.linalg.solve(FULL, torque - np.cross(rate, FULL @ rate))
    linear = gyroscopic_matrix(FULL) @ rate_products(rate) + np.linalg.solve(FULL, torque)
    np.testing.assert_allclose(angular_acceleration(rate, torque, FULL), expected, atol=1e-8)
    np.testing.assert_allclose(linear, expected, atol=1e-8)


@pytest.mark.parametrize("bad", [np.diag([1.0, 1.0, -1.0]), np.arange(9.0).reshape(3, 3), np.eye(2)])
def test_an_impossible_tensor_is_refused(bad):
    """Not symmetric, not positive definite, or of the wrong shape."""
    with pytest.raises(ShapeError):
        inertia_terms(bad)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_damping_slows_a_spin_exponentially(axis):
    """I w_dot = -d w about a principal axis: after a second exp(-d / I) is left of it."""
    inertia, damping = inertia_terms(np.diag([0.01, 0.02, 0.03])), (0.002, 0.014, 0.006)
    nothing = (0.0, 0.0, 0.0)
    rate = tuple(np.eye(3)[axis].tolist())
    for _ in range(400):
        rate, _ = step_rates(rate, (nothing, nothing, nothing), 0.0025, inertia, damping)
    expected = np.exp(-np.array([0.2, 0.7, 0.2])) * np.eye(3)[axis]
    assert rate == pytest.approx(tuple(expected), rel=1e-10)
