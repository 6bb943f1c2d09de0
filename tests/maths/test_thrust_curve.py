"""The thrust curve's derivatives, held against differences."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from quadid_logs.maths.thrust_curve import mean_while_moved, relative_by_expo, slope_at, slopes_at


@pytest.mark.parametrize("expo", [0.0, 0.2, 0.65, 1.0])
def test_the_derivative_by_the_expo_is_that_of_the_curve(expo: float) -> None:
    """Over thrust: (T(e + h) - T(e - h)) / 2h / T."""
    y = np.linspace(0.05, 1.0, 20)

    def thrust(e: float) -> np.ndarray:
        return (1.0 - e) * y + e * y**2

    expected = (thrust(expo + 1e-5) - thrust(expo - 1e-5)) / 2e-5 / thrust(expo)
    np.testing.assert_allclose(relative_by_expo(y, expo), expected, atol=1e-9)


def test_a_rotor_at_rest_has_a_finite_derivative() -> None:
    """With all of the thrust in the square, thrust and derivative are both zero there."""
    assert np.isfinite(relative_by_expo(np.zeros(3), 1.0)).all()


def test_the_slope_of_a_thrust_curve_is_found_from_scattered_points() -> None:
    """The derivative by the expo over thrust, where nothing but points is known: to a thousandth."""
    rng, expo = np.random.default_rng(0), 0.65
    y = np.clip(rng.normal(0.55, 0.15, 20_000), 0.0, 1.0)
    slope = slope_at((1.0 - expo) * y + expo * y**2, y**2 - y, (1.0 - expo) * 0.6 + expo * 0.36)
    assert slope == pytest.approx((2.0 * 0.6 - 1.0) / (1.0 - expo + 2.0 * expo * 0.6), abs=2e-3)


def test_slopes_at_several_points_are_those_at_each() -> None:
    """One polynomial serves them all."""
    x = np.random.default_rng(4).uniform(0.2, 0.9, 2_000)
    where = np.array([0.3, 0.5, 0.8])
    each = [slope_at(x, np.exp(x), one) for one in where]
    np.testing.assert_allclose(slopes_at(x, np.exp(x), where), each, rtol=1e-9)


def test_points_that_do_not_vary_have_no_slope() -> None:
    """Nor do too few."""
    assert np.isnan(slope_at(np.ones(50), np.arange(50.0), 1.0))
    assert np.isnan(slope_at(np.arange(3.0), np.arange(3.0), 1.0))


def test_what_is_flown_between_manoeuvres_does_not_count() -> None:
    """A minute at 1, a minute of motion at 2: the mean is 2 but for the five seconds between them."""
    moved = np.repeat([0.0, 1.0], 6000)
    torque = (moved * np.where(np.arange(12_000) % 2, 1.0, -1.0))[:, np.newaxis]
    assert mean_while_moved(1.0 + moved, torque, 0.01) == pytest.approx(2.0, abs=0.02)


def test_without_motion_all_of_the_flight_counts() -> None:
    """The weight of nothing is no weight."""
    assert mean_while_moved(np.arange(5.0), np.zeros((5, 3)), 0.01) == 2.0


def test_the_slope_of_a_long_log_takes_less_memory_than_its_points() -> None:
    """The powers of all points side by side are six times as large as they, and were copied four times."""
    x = np.random.default_rng(5).uniform(0.2, 0.9, 1_000_000)
    y = np.exp(x)
    tracemalloc.start()
    try:
        assert slope_at(x, y, 0.5) == pytest.approx(np.exp(0.5), abs=1e-3)
        assert tracemalloc.get_traced_memory()[1] < 3 * x.nbytes
    finally:
        tracemalloc.stop()


def test_every_part_of_a_long_log_has_a_say_in_the_slope() -> None:
    """Two halves of a flight at other thrusts: neither holds the curve of both."""
    x = np.concatenate([np.linspace(0.1, 0.4, 100_000), np.linspace(0.6, 0.9, 100_000)])
    assert slope_at(x, np.exp(x), 0.25) == pytest.approx(np.exp(0.25), abs=1e-3)
