"""The reference model of PX4's attitude controller against the closed form of its differential equation."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.px4.reference_model import followed
from quadid_logs.maths.rotations import euler_from_quaternion, quaternion_from_euler

W = 50.0
TIME_S = 0.004 * np.arange(100)


def step_of_roll(angle_rad: float) -> FloatArray:
    euler = np.zeros((TIME_S.size, 3))
    euler[1:, 0] = angle_rad
    return quaternion_from_euler(euler)


def test_a_step_is_followed_by_the_critically_damped_closed_form() -> None:
    """1 - (1 + w t) exp(-w t): the set-point is held over each step, so no step size matters."""
    found = followed(step_of_roll(0.01), np.zeros(TIME_S.size), TIME_S, W)
    expected = 0.01 * (1.0 - (1.0 + W * TIME_S) * np.exp(-W * TIME_S))
    assert euler_from_quaternion(found)[:, 0] == pytest.approx(expected, abs=1e-6)


def test_a_commanded_yaw_rate_turns_the_model_about_the_vertical() -> None:
    """Its set-point turns as fast, and the tilt stays."""
    euler = np.column_stack([np.full(TIME_S.size, 0.3), np.zeros(TIME_S.size), 0.5 * TIME_S])
    found = followed(quaternion_from_euler(euler), np.full(TIME_S.size, 0.5), TIME_S, W)
    assert euler_from_quaternion(found) == pytest.approx(euler, abs=3e-3)


def test_after_a_gap_the_model_begins_anew() -> None:
    time_s = TIME_S.copy()
    time_s[2:] += 1.0
    found = followed(step_of_roll(0.5), np.zeros(TIME_S.size), time_s, W)
    assert euler_from_quaternion(found)[2, 0] == pytest.approx(0.5)


def test_both_signs_of_a_quaternion_are_one_set_point() -> None:
    wanted = step_of_roll(0.5)
    flipped = wanted * np.where(np.arange(TIME_S.size) % 2, -1.0, 1.0)[:, np.newaxis]
    one, other = (
        euler_from_quaternion(followed(each, np.zeros(TIME_S.size), TIME_S, W)) for each in (wanted, flipped)
    )
    assert one == pytest.approx(other, abs=1e-9)
