"""The motor table."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.autopilots.ardupilot.frames import frame_geometry, known_frames
from quadid_logs.errors import ShapeError
from quadid_logs.maths.frames import normalised_allocation, torque_matrix

FRAMES = pytest.mark.parametrize("key", known_frames())
TAILS = ((1, 4), (1, 5))
SYMMETRIC = pytest.mark.parametrize("key", [key for key in known_frames() if key not in TAILS])


@FRAMES
def test_the_largest_factor_of_each_axis_is_a_half(key):
    """ArduPilot's normalise_rpy_factors."""
    np.testing.assert_allclose(np.abs(frame_geometry(*key).mixer).max(axis=0), 0.5)


@SYMMETRIC
def test_torques_survive_the_mixer(key):
    """Factors times commands, solved for the commands, are the commands again."""
    mixer = frame_geometry(*key).mixer
    command = np.array([0.11, -0.07, 0.05])
    np.testing.assert_allclose(np.linalg.lstsq(mixer, mixer @ command)[0], command, atol=1e-12)


@SYMMETRIC
def test_a_positive_command_makes_a_positive_torque(key):
    """Roll, pitch and yaw factors have the signs of the torques that their rotors make."""
    frame = frame_geometry(*key)
    gain = torque_matrix(frame.position, frame.spin, 0.02) @ frame.mixer
    assert np.all(np.diagonal(gain) > 0.0)


@pytest.mark.parametrize("key", [(1, 0), (1, 1), (1, 3), (2, 0), (2, 1), (3, 0), (3, 1), (4, 1), (12, 1)])
def test_the_axes_of_a_regular_frame_do_not_mix(key):
    """On frames with equal arms, each command moves its own axis only."""
    frame = frame_geometry(*key)
    gain = torque_matrix(frame.position, frame.spin, 0.02) @ frame.mixer
    np.testing.assert_allclose(gain, np.diag(np.diagonal(gain)), atol=1e-12)


def test_a_quad_x_is_the_documented_one():
    """Motor 1 front right and 2 rear left turn counter-clockwise, 3 and 4 clockwise."""
    frame = frame_geometry(1, 1)
    side = np.sqrt(0.5)
    np.testing.assert_allclose(
        frame.position[:, :2], [[side, side], [-side, -side], [side, -side], [-side, side]]
    )
    assert frame.spin.tolist() == [1.0, 1.0, -1.0, -1.0]


def test_the_iris_allocation_is_the_known_one():
    """PX4's scale for a quadrotor: roll and pitch by the larger root mean square, yaw by its maximum."""
    position = np.array([[0.13, 0.22, 0], [-0.13, -0.2, 0], [0.13, -0.22, 0], [-0.13, 0.2, 0]])
    spin = np.array([1.0, 1.0, -1.0, -1.0])
    effectiveness = 6.5 * np.vstack([torque_matrix(position, spin, 0.05), -np.ones(4)])
    mix = normalised_allocation(effectiveness)
    raw = np.linalg.pinv(effectiveness)
    scale = max(np.sqrt(np.sum(raw[:, axis] ** 2) / 2.0) for axis in (0, 1))
    np.testing.assert_allclose(mix[:, :2], raw[:, :2] / scale)
    assert mix[:, 2].max() == pytest.approx(1.0)
    assert np.mean(mix[:, 3]) == pytest.approx(1.0)


def test_an_unknown_frame_is_refused():
    """A helicopter has no motor table."""
    with pytest.raises(ShapeError, match="FRAME_CLASS 6"):
        frame_geometry(6, 0)
