"""Attitude algebra against itself and against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from quadid_logs.maths.rotations import (
    body_rates,
    conjugate,
    euler_from_quaternion,
    euler_rates,
    multiply_quaternions,
    quaternion_from_euler,
    quaternion_rate,
    rotation_matrix,
    rotation_vector,
    tilt_and_heading,
    tilt_from_rates,
    unwrapped,
)

angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)).map(np.array)
vectors = st.tuples(*[st.floats(-5.0, 5.0)] * 3).map(np.array)


@given(angles)
def test_angles_survive_the_way_through_a_quaternion(euler):
    """Euler angles to quaternion and back are the same angles."""
    np.testing.assert_allclose(euler_from_quaternion(quaternion_from_euler(euler)), euler, atol=1e-7)


@given(angles)
def test_the_rotation_matrix_is_scipys(euler):
    """Our 3-2-1 convention is SciPy's intrinsic ZYX."""
    ours = rotation_matrix(quaternion_from_euler(euler))
    theirs = Rotation.from_euler("ZYX", euler[::-1]).as_matrix()
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


@given(angles, angles)
def test_a_quaternion_product_is_a_matrix_product(first, second):
    """Composing rotations commutes with making matrices of them."""
    left, right = quaternion_from_euler(first), quaternion_from_euler(second)
    product = rotation_matrix(multiply_quaternions(left, right))
    np.testing.assert_allclose(product, rotation_matrix(left) @ rotation_matrix(right), atol=1e-12)


@given(angles, vectors)
def test_euler_rates_and_body_rates_are_inverse(euler, rate):
    """p, q, r to Euler rates and back are the same rates."""
    euler = euler * np.array([1.0, 0.8, 1.0])
    np.testing.assert_allclose(body_rates(euler, euler_rates(euler, rate)), rate, atol=1e-9)


@given(angles, vectors)
def test_the_quaternion_rate_is_the_derivative_of_the_attitude(euler, rate):
    """A small rotation about the body axes changes the quaternion by its rate."""
    step = 1e-6
    quaternion = quaternion_from_euler(euler)
    turn = np.concatenate([[1.0], 0.5 * step * rate])
    moved = multiply_quaternions(quaternion, turn)
    slope = np.array(quaternion_rate(tuple(quaternion), tuple(rate)))
    np.testing.assert_allclose((moved - quaternion) / step, slope, atol=1e-8)


@given(
    hnp.arrays(np.float64, st.tuples(st.integers(0, 40), st.integers(1, 3)), elements=st.floats(-20.0, 20.0))
)
def test_angles_are_unwrapped_as_by_numpy(angles: np.ndarray) -> None:
    """Jumps of any number of turns, and none at all."""
    np.testing.assert_allclose(unwrapped(angles), np.unwrap(angles, axis=0), atol=1e-9)


@given(angles, st.floats(0.1, 10.0))
def test_the_length_of_a_quaternion_does_not_change_its_angles(euler: np.ndarray, length: float) -> None:
    """Logs hold quaternions in single precision, or not normalised at all."""
    scaled = length * quaternion_from_euler(euler)
    np.testing.assert_allclose(euler_from_quaternion(scaled), euler, atol=1e-7)


def test_euler_rates_are_the_derivative_of_the_angles_that_body_rates_lead_to() -> None:
    """Through the quaternion, which knows nothing of angles."""
    euler, rate, step = np.array([0.5, -0.4, 2.0]), np.array([0.7, -1.1, 0.9]), 1e-6
    q = quaternion_from_euler(euler)
    ahead = q + step * np.array(quaternion_rate(tuple(q), tuple(rate)))
    slope = (euler_from_quaternion(ahead) - euler) / step
    np.testing.assert_allclose(euler_rates(euler, rate), slope, atol=1e-5)


def turned(period_s: float, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Euler angles of a lively hover, and the body rates that belong to them; each (n_samples, 3)."""
    t = np.arange(0.0, duration_s, period_s)
    waves = [(0.5, 0.31, 0.0), (0.4, 0.47, 1.0), (1.0, 0.11, 2.0)]
    euler = np.column_stack([a * np.sin(2.0 * np.pi * f * t + b) for a, f, b in waves])
    slope = np.column_stack([2.0 * np.pi * f * a * np.cos(2.0 * np.pi * f * t + b) for a, f, b in waves])
    return euler, body_rates(euler, slope)


@pytest.mark.parametrize("period_s", [0.001, 0.01, 0.04])
def test_body_rates_integrate_to_roll_and_pitch(period_s: float) -> None:
    """Once the unknown start has faded, to what fades of a swing while it lasts."""
    euler, rate = turned(period_s, 120.0)
    tilt = tilt_from_rates(rate, period_s, memory_s=15.0)
    late = slice(3 * len(tilt) // 4, None)
    error = tilt[late] - euler[late, :2]
    assert np.abs(error - error.mean(axis=0)).max() < 1.5 * 0.5 / (2.0 * np.pi * 0.31 * 15.0)


def test_the_bias_of_a_gyro_tilts_the_integral_by_no_more_than_it_turns_in_the_memory() -> None:
    """Without fading, half a degree a second would be a full turn in twelve minutes."""
    bias = np.radians(0.5)
    tilt = tilt_from_rates(np.tile([bias, 0.0, 0.0], (60_000, 1)), 0.01, memory_s=15.0)
    assert tilt[-1, 0] == pytest.approx(15.0 * bias, rel=0.02)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.5, 3.0, -3.0])
def test_a_rotation_vector_is_axis_times_angle(angle: float) -> None:
    """Also where the sine of half the angle vanishes."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    quaternion = np.concatenate([[np.cos(0.5 * angle)], np.sin(0.5 * angle) * axis])
    for sign in (1.0, -1.0):
        assert rotation_vector(sign * quaternion[np.newaxis])[0] == pytest.approx(angle * axis, abs=1e-12)


def test_a_tilt_without_a_part_about_z_and_a_heading_make_the_rotation() -> None:
    rotation = quaternion_from_euler(np.array([[0.4, -0.3, 2.5], [0.1, 0.2, -3.0], [0.0, 0.0, 0.0]]))
    tilt, heading = tilt_and_heading(rotation)
    about_z = quaternion_from_euler(np.column_stack([np.zeros((3, 2)), heading]))
    assert np.abs(tilt[:, 3]).max() < 1e-12
    product = multiply_quaternions(tilt, about_z)
    assert np.abs((product * rotation).sum(axis=1)) == pytest.approx(1.0)


def test_a_rotation_and_its_conjugate_are_none() -> None:
    rotation = quaternion_from_euler(np.array([[0.4, -0.3, 2.5]]))
    assert multiply_quaternions(rotation, conjugate(rotation))[0] == pytest.approx([1.0, 0.0, 0.0, 0.0])
