"""Drawn vehicles have the means, spreads and correlations of the posterior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.control.posterior import draw
from quadid_logs.data.model import Posterior

HOLD_S = 0.0025
DEVIATION = np.array([6.0, 0.2, 5e-4, 4e-4, 0.3])
CORRELATION = np.eye(5)
CORRELATION[0, 1] = CORRELATION[1, 0] = 0.6
CORRELATION[2, 3] = CORRELATION[3, 2] = -0.8
CORRELATION[0, 4] = CORRELATION[4, 0] = -0.4


def posterior(mean: np.ndarray, deviation: np.ndarray = DEVIATION, lag_or_delay_s: float = 0.0) -> Posterior:
    covariance = CORRELATION * np.outer(deviation, deviation)
    return Posterior(
        mean=np.tile(mean, (3, 1)), covariance=np.tile(covariance, (3, 1, 1)), lag_or_delay_s=lag_or_delay_s
    )


def test_drawn_vehicles_have_the_posteriors_mean_and_covariance() -> None:
    """Correlations matter: a longer lag with a shorter delay is the same phase."""
    mean = np.array([300.0, -2.0, 0.03, 0.01, 12.0])
    plants = draw(posterior(mean), 1, HOLD_S, n_draws=20000)
    assert plants is not None
    drawn = np.array([*plants[:4], plants.reaction])[:, 1:]
    off = drawn.mean(axis=1) - mean + [0, 0, 0, HOLD_S / 2, 0]
    np.testing.assert_allclose(off / DEVIATION, 0.0, atol=0.05)
    np.testing.assert_allclose(np.corrcoef(drawn), CORRELATION, atol=0.03)
    np.testing.assert_allclose(drawn.std(axis=1), DEVIATION, rtol=0.03)


def test_vehicles_that_two_flights_tell_almost_alike_are_drawn_almost_alike() -> None:
    """Nothing hangs on the axes of an ellipsoid that is nearly a ball, which may point anywhere."""
    mean, told = np.array([300.0, -2.0, 0.03, 0.01, 12.0]), []
    for mixed in (1e-3, -1e-3):
        correlation = np.eye(5) + mixed * (np.ones((5, 5)) - np.eye(5))
        covariance = np.tile(correlation * np.outer(DEVIATION, DEVIATION), (3, 1, 1))
        plants = draw(replace(posterior(mean), covariance=covariance), 0, HOLD_S)
        assert plants is not None
        told.append(plants.effectiveness)
    assert np.abs(told[0] - told[1]).max() < 0.02 * DEVIATION[0]


def test_the_lead_of_a_drawn_vehicle_is_its_own_reaction_over_its_own_effectiveness() -> None:
    """Far above its corner yaw turns with the reaction alone, whatever the effectiveness is."""
    mean, deviation = np.array([60.0, -0.5, 0.025, 0.002, 10.0]), np.array([6.0, 0.0, 0.0, 0.0, 0.1])
    plants = draw(posterior(mean, deviation), 2, HOLD_S, n_draws=2000)
    assert plants is not None
    high = np.abs(plants.response(np.array([20.0]), HOLD_S))[1:, 0]
    assert plants.effectiveness[1:].std() / plants.effectiveness[0] > 0.09
    assert 0.008 < high.std() / high.mean() < 0.012


def test_half_of_the_loops_period_is_taken_off_the_identified_delay() -> None:
    """It contains the zero-order hold."""
    plants = draw(posterior(np.array([300.0, -2.0, 0.03, 0.01, 0.0])), 0, HOLD_S)
    assert plants is not None
    assert plants.delay_s[0] == pytest.approx(0.01 - HOLD_S / 2)


def test_a_delay_shorter_than_the_hold_is_none_and_as_uncertain_as_that() -> None:
    """The stamps are off by a millisecond at least; nothing acts before its command."""
    plants = draw(posterior(np.array([300.0, -2.0, 0.03, 0.00025, 0.0]), 1e-6 * DEVIATION), 0, HOLD_S)
    assert plants is not None
    assert plants.delay_s[0] == 0.0
    assert plants.delay_s.min() == pytest.approx(-0.001, rel=0.02)
    assert plants.delay_s.max() == pytest.approx(0.001, rel=0.02)


def test_what_may_be_lag_or_delay_leaves_their_sum_alone() -> None:
    mean = np.array([300.0, -2.0, 0.001, 0.006, 0.0])
    plants = draw(posterior(mean, 1e-6 * DEVIATION, lag_or_delay_s=0.002), 0, HOLD_S)
    assert plants is not None
    np.testing.assert_allclose(plants.lag_s + plants.delay_s, 0.007 - HOLD_S / 2, atol=1e-6)
    assert plants.lag_s.max() > 0.0028


def test_an_axis_that_tells_nothing_gives_no_vehicles() -> None:
    infinite = Posterior(mean=np.ones((3, 5)), covariance=np.full((3, 5, 5), np.inf), lag_or_delay_s=0.0)
    assert draw(infinite, 0, HOLD_S) is None
    assert draw(posterior(np.array([-300.0, -2.0, 0.03, 0.01, 0.0])), 0, HOLD_S) is None


def test_vehicles_whose_damping_is_estimated_as_none_are_drawn_braking_alone() -> None:
    """The other numbers go with the damping, so that the one which is moved takes them along."""
    mean, deviation = np.array([12.0, 0.0, 0.03, 0.01, 0.0]), np.array([1.0, 0.3, 1e-6, 1e-6, 1e-6])
    one = posterior(mean, deviation)
    covariance = np.tile(np.diag(deviation**2), (3, 1, 1))
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.999 * 1.0 * 0.3
    plants = draw(replace(one, covariance=covariance, only_brakes=(False, False, True)), 2, HOLD_S)
    assert plants is not None
    assert plants.damping.max() <= 0.0
    assert np.quantile(plants.damping, 0.05) == pytest.approx(-1.96 * 0.3, rel=0.15)
    assert plants.effectiveness[1:] - 12.0 == pytest.approx(plants.damping[1:] / 0.3, abs=0.2)
