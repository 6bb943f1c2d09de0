"""What is known together of an axis' effectiveness, damping, lag and delay."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.model import Posterior
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.inference import Uncertainty, posterior_of, with_damping_of_vehicles
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS

from .vehicles import QUAD, fly, multisine

PERIOD_S = 0.0025


def actuator(lag_s: float = 0.03, delay_s: float = 0.01, limit_s: float = 0.03) -> ActuatorFit:
    grid = np.zeros(2)
    return ActuatorFit(
        lag_s=lag_s,
        delay_s=delay_s,
        lag_grid_s=grid,
        delay_grid_s=grid,
        loss=np.zeros((2, 2)),
        lag_limit_s=limit_s,
    )


def test_an_axis_covariance_is_carried_over_from_all_parameters() -> None:
    """Two parameters, lag and delay: effectiveness is the first, the others are mixtures."""
    generator = np.random.default_rng(1)
    root = generator.standard_normal((4, 4))
    found = Uncertainty(root @ root.T, ("lag", "delay"))
    slopes = np.zeros((3, 3, 2))
    slopes[0] = [[1.0, 0.0], [-1.0, 3.0], [0.0, 2.0]]
    drawn = generator.standard_normal((200_000, 4)) @ root.T
    axis = np.column_stack(
        [drawn[:, 0], 3.0 * drawn[:, 1] - drawn[:, 0], drawn[:, 2], drawn[:, 3], 2.0 * drawn[:, 1]]
    )
    np.testing.assert_allclose(found.of_axes(slopes)[0], np.cov(axis.T), rtol=0.05, atol=0.05)
    assert found.lag_s == pytest.approx(np.sqrt((root @ root.T)[2, 2]))


def test_each_number_has_the_interval_that_is_reported_of_it() -> None:
    """What is systematic is added; the correlations are those of the fit."""
    of_axes = np.tile(np.diag([4.0, 0.01, 1e-6, 1e-6, 0.04]), (3, 1, 1))
    of_axes[:, 0, 3] = of_axes[:, 3, 0] = 1e-3
    reported = np.tile([5.0, 0.3, 0.5], (3, 1))
    found = posterior_of(np.tile([300.0, -2.0, 12.0], (3, 1)), reported, actuator(), of_axes, PERIOD_S)
    half_width = NORMAL_95 * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))[0]
    timing_s = 0.015 * PERIOD_S
    lag_s = np.sqrt(1e-6 + timing_s**2 + (0.003 * 0.03) ** 2)
    np.testing.assert_allclose(half_width, [5.0, 0.3, lag_s, np.hypot(1e-3, timing_s), 0.5], rtol=1e-9)
    assert found.mean[2].tolist() == [300.0, -2.0, 0.03, 0.01, 12.0]
    assert found.covariance[0, 0, 3] == pytest.approx(1e-3 / NORMAL_95**2)


def test_no_more_delay_than_there_is_may_be_lag() -> None:
    of_axes, reported = np.tile(np.eye(5), (3, 1, 1)), np.ones((3, 3))
    some, all_of_it = (
        posterior_of(np.ones((3, 3)), reported, actuator(0.001, 0.004, limit_s), of_axes, PERIOD_S)
        for limit_s in (0.003, 0.02)
    )
    assert some.lag_or_delay_s == pytest.approx(0.002)
    assert all_of_it.lag_or_delay_s == pytest.approx(0.004)


def test_the_posterior_of_a_flight_has_the_models_numbers_and_intervals_but_for_the_gyros_scale() -> None:
    """Of both structures that have an actuator; the published ones have none.

    The controller is given the rates of the same gyro: its scale is part of the loop, not an error of it.
    """
    models = identify(fly(QUAD, multisine(40.0), feedback=8.0), IdentifySettings()).models
    assert any(model.posterior is None for model in models)
    for model in models:
        if model.posterior is None or model.actuator is None:
            continue
        half_width = NORMAL_95 * np.sqrt(np.diagonal(model.posterior.covariance, axis1=1, axis2=2))
        for axis, target in enumerate(ACCELERATION_SYMBOLS):
            for number, name in enumerate((TORQUE_SYMBOLS[axis], RATE_SYMBOLS[axis])):
                entry = model.entries[target, name]
                size = 0.5 * (entry.ci95[1] - entry.ci95[0])
                assert abs(model.posterior.mean[axis, number] - entry.value) <= size
                of_gyro = 0.01 * abs(entry.value) if name in TORQUE_SYMBOLS else 0.0
                assert half_width[axis, number] <= 1.1 * size
                assert np.hypot(half_width[axis, number], of_gyro) >= 0.9 * size
        of_actuator = [model.actuator.lag_s, model.actuator.delay_s]
        assert model.posterior.mean[0, 2:4].tolist() == pytest.approx(of_actuator, abs=1e-6)


def flight_of_yaw(damping_1_s: float, deviation_1_s: float, correlation: float = 0.0) -> Posterior:
    """Return what a flight tells of an effectiveness of 12 +- 1 and of a damping, on every axis alike."""
    covariance = np.diag([1.0, deviation_1_s**2, 1e-6, 1e-6, 0.01])
    covariance[0, 1] = covariance[1, 0] = correlation * deviation_1_s
    mean = np.array([12.0, damping_1_s, 0.03, 0.01, 0.5])
    return Posterior(
        mean=np.tile(mean, (3, 1)), covariance=np.tile(covariance, (3, 1, 1)), lag_or_delay_s=0.0
    )


@pytest.mark.parametrize("axis", range(3))
def test_a_damping_that_no_flight_shows_is_none_with_the_spread_of_vehicles(axis: int) -> None:
    """An infinite variance says nothing of a loop, though vehicles are damped by no more than some 1/s."""
    most_1_s = np.array([5.0, 5.0, 1.0])
    found = with_damping_of_vehicles(flight_of_yaw(0.0, 0.0), np.zeros(3, np.bool_), most_1_s)
    assert found.mean[axis, 1] == 0.0
    assert NORMAL_95 * np.sqrt(found.covariance[axis, 1, 1]) == pytest.approx(most_1_s[axis])
    assert found.only_brakes[axis]


def test_a_damping_that_a_flight_shows_well_is_the_flights() -> None:
    found = with_damping_of_vehicles(
        flight_of_yaw(-0.8, 0.02), np.ones(3, np.bool_), np.array([5.0, 5.0, 1.0])
    )
    assert found.mean[2, 1] == pytest.approx(-0.8, rel=0.01)
    assert not found.only_brakes[2]


def test_an_effectiveness_goes_with_a_damping_that_only_feedback_makes_positive() -> None:
    """No rotor drives yaw: without that damping, the effectiveness is what the flight then shows."""
    found = with_damping_of_vehicles(
        flight_of_yaw(0.4, 0.2, correlation=0.9), np.ones(3, np.bool_), np.array([5.0, 5.0, 1.0])
    )
    assert found.mean[2, 1] == pytest.approx(0.0, abs=1e-9)
    assert found.mean[2, 0] == pytest.approx(12.0 - 0.4 * 0.9 / 0.2)
    assert found.only_brakes[2]
