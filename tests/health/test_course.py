"""Rates, tilt, throttle, thrust and steady torque are judged by what was put into the flight."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.health.course import (
    find_rates,
    find_throttle,
    find_thrust,
    find_tilt,
    find_torque,
    find_tumble,
)
from tests.health.flights import coloured, grid, series

T = grid(50.0)
FLIGHT = ((T[0], T[-1]),)


def test_the_fastest_rate_is_that_of_the_flight() -> None:
    """A roll at 700 deg/s in one sample; the ground's 1500 deg/s do not count."""
    rates = np.radians(100.0) * coloured(1, T.size, 50.0)
    rates[500, 0] = np.radians(700.0)
    rates[:10, 1] = np.radians(1500.0)
    found = find_rates(series("body_rate", T, rates), ((T[10], T[-1]),))
    assert found is not None
    assert np.degrees(found.figures["highest"].value) == pytest.approx(700.0)
    assert found.level == "normal"


def test_a_rate_at_the_end_of_the_gyros_range_is_high() -> None:
    """Gyros of flight controllers end at 2000 deg/s."""
    rates = np.radians(100.0) * coloured(1, T.size, 50.0)
    rates[500:510, 2] = np.radians(-1998.0)
    found = find_rates(series("body_rate", T, rates), FLIGHT)
    assert found is not None
    assert found.level == "high"


def test_a_rate_beyond_the_gyros_range_is_not_close_to_its_end() -> None:
    """A table of extrapolated rows holds 3100 deg/s."""
    rates = np.radians(100.0) * coloured(1, T.size, 50.0)
    rates[500:510, 2] = np.radians(3100.0)
    found = find_rates(series("body_rate", T, rates), FLIGHT)
    assert found is not None
    assert found.level == "high"
    assert "3100 deg/s, more than most gyros measure (2000 deg/s)" in found.sentence


def test_a_throttle_of_more_than_all_is_none() -> None:
    """Extrapolated rows at the end of a table gave a median of 1957 %."""
    values = np.minimum(0.4 + 0.02 * coloured(2, T.size, 50.0, columns=1), 1.0)
    some, most = values.copy(), values.copy()
    some[-T.size // 5 :] = 12.0
    most[-2 * T.size // 3 :] = 12.0
    found = find_throttle(series("throttle", T, some), FLIGHT)
    assert found is not None
    assert found.figures["median"].value == pytest.approx(0.4, abs=0.01)
    assert "upper end" not in found.sentence
    assert find_throttle(series("throttle", T, most), FLIGHT) is None


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg", "tilt_deg"), [(30.0, 0.0, 30.0), (40.0, 40.0, 54.07), (0.0, -75.0, 75.0)]
)
def test_tilt_is_the_angle_to_the_vertical(roll_deg: float, pitch_deg: float, tilt_deg: float) -> None:
    """The cosine of roll times that of pitch; the nose's direction does not matter."""
    angles = np.radians(np.column_stack([np.full(T.size, roll_deg), np.full(T.size, pitch_deg), 90.0 * T]))
    found = find_tilt(series("attitude", T, angles), FLIGHT)
    assert found is not None
    assert np.degrees(found.figures["p99"].value) == pytest.approx(tilt_deg, abs=0.01)
    assert (found.level == "normal") is (tilt_deg < 60.0)
    assert found.says_what_is_normal


@pytest.mark.parametrize(
    ("half", "level"), [(0.12, "normal"), (0.4, "normal"), (0.65, "high"), (0.8, "severe")]
)
def test_a_throttle_far_above_a_hovers_is_high(half: float, level: str) -> None:
    """Most vehicles hover at 20 to 60 %; above 70 % a published analyzer calls them underpowered."""
    values = half + 0.02 * coloured(2, T.size, 50.0, columns=1)
    found = find_throttle(series("throttle", T, values), FLIGHT)
    assert found is not None
    assert found.figures["median"].value == pytest.approx(half, abs=0.01)
    assert found.level == level


def test_a_throttle_that_is_cut_half_of_the_time_shows_no_hover() -> None:
    """A flight of flips at 40 % had "power to spare", with a median of 0 %."""
    values = np.where(np.arange(T.size) % 100 < 55, 0.0, 0.4)[:, None]
    found = find_throttle(series("throttle", T, values), FLIGHT)
    assert found is not None
    assert found.level == "fact"
    assert "spare" not in found.sentence
    assert "55 %" in found.sentence


def test_a_light_throttle_that_is_cut_now_and_then_is_light() -> None:
    """12 % while it is up, which is below the 20 % of most vehicles in hover."""
    values = np.where(np.arange(T.size) % 100 < 20, 0.0, 0.12 + 0.001 * (np.arange(T.size) % 2))[:, None]
    found = find_throttle(series("throttle", T, values), FLIGHT)
    assert found is not None
    assert (found.level, "in reserve" in found.sentence) == ("normal", True)


def test_a_throttle_that_never_changes_is_not_judged() -> None:
    """Nobody flies so: it is a value that was left there."""
    assert find_throttle(series("throttle", T, np.full((T.size, 1), 0.3)), FLIGHT) is None


def test_the_mass_that_the_thrust_carries_counts_the_tilt() -> None:
    """A vehicle of 1.5 kg that leans by 60 degrees needs twice its weight."""
    leaning = np.radians(60.0) * (T < 40.0)
    thrust = 1.5 * 9.80665 / np.cos(leaning)
    found = find_thrust(
        series("thrust_n", T, thrust[:, None]),
        series("attitude", T, np.column_stack([leaning, 0.0 * T, 0.0 * T])),
        FLIGHT,
    )
    assert found is not None
    assert found.figures["mass"].value == pytest.approx(1.5, rel=0.01)


def test_a_steady_torque_is_the_centre_of_mass_that_it_balances() -> None:
    """Weight 10 mm ahead and 4 mm to the right: nose up 0.1 N m and right side up 0.04 N m for 10 N."""
    moved = 0.05 * coloured(3, T.size, 50.0)
    torque = moved - moved.mean(axis=0) + [-0.04, 0.1, 0.0]
    found = find_torque(
        series("torque_n_m", T, torque), series("thrust_n", T, np.full((T.size, 1), 10.0)), FLIGHT
    )
    assert found is not None
    assert found.figures["ahead"].value == pytest.approx(0.010, rel=1e-6)
    assert found.figures["right"].value == pytest.approx(0.004, rel=1e-6)
    assert "10 mm ahead" in found.sentence
    assert "4 mm to the right" in found.sentence


def test_a_steady_torque_without_thrust_is_a_part_of_what_it_moves() -> None:
    """In any unit."""
    moved = coloured(3, T.size, 50.0)
    moved = (moved - moved.mean(axis=0)) / moved.std(axis=0)
    found = find_torque(series("torque_command", T, moved + np.array([0.3, 0.0, -0.5])), None, FLIGHT)
    assert found is not None
    assert [found.figures[axis].value for axis in ("roll", "pitch", "yaw")] == pytest.approx([0.3, 0.0, -0.5])


def test_too_few_samples_show_nothing() -> None:
    """Nine are no flight."""
    few = series("body_rate", T[:9], np.ones((9, 3)))
    assert find_rates(few, FLIGHT) is None


def test_numbers_that_are_none_cost_only_their_own_rows() -> None:
    """A damaged log holds them."""
    rates = np.radians(100.0) * coloured(1, T.size, 50.0)
    rates[100:200, 1] = np.nan
    found = find_rates(series("body_rate", T, rates), FLIGHT)
    assert found is not None
    assert np.isfinite(found.values).all()


def test_a_hop_of_a_tenth_of_a_second_is_long_enough_to_turn_over() -> None:
    """At 1000 rad/s^2, which a small quad's motors give, 60 degrees take 0.05 s."""
    t = grid(400.0, 30.0)
    rates = np.zeros((t.size, 3))
    rates[(t >= 10.0) & (t <= 10.1), 0] = np.radians(900.0)
    found = find_tumble(series("body_rate", t, rates), ((10.0, 10.1),))
    assert found is not None
    assert found.level == "severe"
