"""Chirps that drive one axis after the other."""

from __future__ import annotations

import numpy as np

from quadid_logs.identify.driven import by_driven_axis

TIME_S = np.arange(0.0, 12.0, 0.01)
SWEEP = np.sin(2.0 * np.pi * (1.0 + 0.2 * TIME_S) * TIME_S)


def two_runs() -> tuple[np.ndarray, np.ndarray]:
    """Return commands and torque of a flight whose chirp drives pitch first, and then yaw."""
    first, second = (TIME_S > 1.0) & (TIME_S < 5.0), (TIME_S > 7.0) & (TIME_S < 11.0)
    chirp = SWEEP * (first | second)
    torque = 0.01 * np.random.default_rng(1).standard_normal((TIME_S.size, 3))
    torque[:, 1] += 0.2 * chirp * first
    torque[:, 2] -= 0.2 * chirp * second
    return np.column_stack([np.zeros((TIME_S.size, 3)), chirp]), torque


def test_each_run_of_a_chirp_is_the_command_of_the_axis_that_it_drives() -> None:
    """In a column of its own; the sum of all is what was injected."""
    commands, torque = two_runs()
    apart = by_driven_axis(commands, torque, TIME_S)
    assert apart.shape == (TIME_S.size, 6)
    np.testing.assert_array_equal(apart[:, 3:].sum(axis=1), commands[:, 3])
    driven = [np.flatnonzero(apart[:, column]) for column in (3, 4, 5)]
    assert not driven[0].size
    assert TIME_S[driven[1]].max() < 5.0
    assert TIME_S[driven[2]].min() > 7.0


def test_what_was_commanded_stays_unknown_where_the_chirp_is() -> None:
    """In every column, so that the rows are left out."""
    commands, torque = two_runs()
    commands[:50, 3] = np.nan
    assert np.isnan(by_driven_axis(commands, torque, TIME_S)[:50, 3:]).all()


def test_set_points_alone_stay_as_they_are() -> None:
    """A flight without a test mode."""
    commands, torque = two_runs()
    assert by_driven_axis(commands[:, :3], torque, TIME_S) is not None
    np.testing.assert_array_equal(by_driven_axis(commands[:, :3], torque, TIME_S), commands[:, :3])
