"""Each figure of the validation against what it is by definition, on rows made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.model import FitSeries, Validation
from quadid_logs.identify.design import Design, lay_blocks
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.validate import validate
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

PERIOD_S, DURATION_S = 0.02, 60.0
TIME_S = np.arange(0.0, DURATION_S, PERIOD_S)
GAIN = np.array([50.0, 40.0, 10.0])
TONES_HZ = np.array([1.1, 0.7, 0.9])
#: Torque of one tone per axis, and the rate of a vehicle without damping: its integral.
TORQUE = np.cos(2.0 * np.pi * TONES_HZ * TIME_S[:, np.newaxis])
RATE = GAIN * np.sin(2.0 * np.pi * TONES_HZ * TIME_S[:, np.newaxis]) / (2.0 * np.pi * TONES_HZ)


def rows(rate: np.ndarray, acceleration: np.ndarray) -> Design:
    """Return rows of a flight in blocks of five seconds; of the torque nothing is asked."""
    block, held_out, edge = lay_blocks(np.zeros(TIME_S.size, dtype=np.int64), PERIOD_S, 0.2)
    p, q, r = rate.T
    columns = {
        **dict(zip(RATE_SYMBOLS, rate.T, strict=True)),
        **dict(zip(ACCELERATION_SYMBOLS, acceleration.T, strict=True)),
        "qr": 0.0 * q * r, "pr": 0.0 * p * r, "pq": 0.0 * p * q, "1": np.ones(TIME_S.size),
    }  # fmt: skip
    return Design(
        time_s=TIME_S,
        columns=columns,
        chunk=np.zeros(TIME_S.size, dtype=np.int64),
        block=block,
        held_out=held_out,
        edge=edge,
        period_s=PERIOD_S,
        smoothing_hz=5.0,
        torque=None,  # type: ignore[arg-type]
        chunks=(),
        sample_period_s=PERIOD_S,
    )


def judged(
    design: Design, gain: np.ndarray = GAIN, torque: np.ndarray = TORQUE
) -> tuple[Validation, FitSeries]:
    """Validate a model with this effectiveness and nothing else."""
    theta = np.zeros((3, len(DAMPED.columns)))
    theta[:, -3:] = np.diag(gain)
    return validate(design, DAMPED, theta, torque, disturbance=np.zeros((3, 0)), high_pass_hz=0.0)


PERFECT = rows(RATE, GAIN * TORQUE)
HELD_OUT = PERFECT.held_out


def test_nonsense_in_the_fitted_blocks_lowers_no_figure() -> None:
    """All figures are of held-out flight, from its first row to its last and not beyond."""
    rng = np.random.default_rng(1)
    fitted = ~HELD_OUT[:, np.newaxis]
    nonsense = 30.0 * rng.standard_normal(RATE.shape) * fitted
    found, _ = judged(rows(RATE + nonsense, GAIN * TORQUE + nonsense))
    for figures in (found.r2_acceleration, found.r2_simulated_rate, found.r2_high_passed_rate):
        assert min(figures.values()) > 0.995
    assert min(found.fit_percent.values()) > 95.0
    assert max(max(errors) for errors in found.horizon_rmse_rad_s.values()) < 0.1


def test_nonsense_in_the_held_out_blocks_lowers_every_figure() -> None:
    """Or the test above would pass with figures that are always good."""
    rng = np.random.default_rng(1)
    nonsense = 30.0 * rng.standard_normal(RATE.shape) * HELD_OUT[:, np.newaxis]
    found, _ = judged(rows(RATE + nonsense, GAIN * TORQUE + nonsense))
    for figures in (found.r2_acceleration, found.r2_simulated_rate, found.r2_high_passed_rate):
        assert max(figures.values()) < 0.7
    assert max(found.fit_percent.values()) < 50.0
    assert min(min(errors) for errors in found.horizon_rmse_rad_s.values()) > 5.0


def test_the_time_that_is_held_out_is_in_seconds() -> None:
    """A third of a minute, in whole blocks."""
    assert judged(PERFECT)[0].held_out_s == pytest.approx(np.count_nonzero(HELD_OUT) * PERIOD_S)


def test_rates_are_simulated_to_the_second_order_of_the_step() -> None:
    """A tone of 1 Hz in steps of 20 ms: Heun's rule misses a thousandth of it, Euler's six hundredths."""
    _, series = judged(PERFECT)
    wrong = np.abs(series.simulated_rate - RATE)[HELD_OUT].max(axis=0)
    assert (wrong < 0.005 * np.abs(RATE).max(axis=0)).all()


def test_a_horizon_ends_as_much_later_as_it_says() -> None:
    """Of a gain that is a fifth too large, a fifth of what the rate has changed by is missed."""
    found, _ = judged(PERFECT, 1.2 * GAIN)
    for number, horizon_s in enumerate((0.1, 0.2, 0.5)):
        n = round(horizon_s / PERIOD_S)
        inside = HELD_OUT[:-n] & HELD_OUT[n:]
        missed = 0.2 * np.sqrt(np.mean((RATE[n:] - RATE[:-n])[inside] ** 2, axis=0))
        errors = [found.horizon_rmse_rad_s[name][number] for name in RATE_SYMBOLS]
        np.testing.assert_allclose(errors, missed, rtol=0.1)


def test_r2_and_fit_are_what_textbooks_define() -> None:
    """1 - e'e / y'y about the mean, and 100 (1 - |e| / |y|), of the simulated rates."""
    found, series = judged(PERFECT, 1.3 * GAIN)
    y, e = series.rate[HELD_OUT], (series.rate - series.simulated_rate)[HELD_OUT]
    ratio = np.linalg.norm(e, axis=0) / np.linalg.norm(y - y.mean(axis=0), axis=0)
    np.testing.assert_allclose(list(found.r2_simulated_rate.values()), 1.0 - ratio**2)
    np.testing.assert_allclose(list(found.fit_percent.values()), 100.0 * (1.0 - ratio))


def test_a_gain_that_is_a_tenth_too_small_leaves_a_hundredth_of_the_acceleration() -> None:
    """Of a torque without a mean."""
    found, _ = judged(PERFECT, 0.9 * GAIN)
    np.testing.assert_allclose(list(found.r2_acceleration.values()), 0.99, atol=1e-3)


def test_air_that_moves_the_vehicle_lowers_no_r2_of_what_was_commanded() -> None:
    """Gusts twice as strong as what was commanded leave its R2; a gain a tenth too small takes 0.01."""
    gust = 2.0 * GAIN * np.sin(2.0 * np.pi * 2.3 * TIME_S[:, np.newaxis])
    flown = dataclasses.replace(rows(RATE, GAIN * TORQUE + gust), instruments=TORQUE)
    found, _ = judged(flown)
    assert max(found.r2_acceleration.values()) < 0.3
    assert min(found.r2_commanded.values()) > 0.99
    wrong, _ = judged(flown, 0.9 * GAIN)
    assert [*wrong.r2_commanded.values()] == pytest.approx([0.99] * 3, abs=0.005)


def test_without_setpoints_nothing_is_said_of_what_was_commanded() -> None:
    """There is nothing to tell it by."""
    assert judged(PERFECT)[0].r2_commanded == {}


def test_the_memory_of_a_residual_is_in_seconds() -> None:
    """The autocorrelation of a cosine of 0.8 Hz falls below 0.2 after acos(0.2) / (2 pi 0.8 Hz)."""
    residual = np.cos(2.0 * np.pi * 0.8 * TIME_S)[:, np.newaxis] * np.ones(3)
    found, _ = judged(rows(RATE, GAIN * TORQUE + residual))
    expected = np.arccos(0.2) / (2.0 * np.pi * 0.8)
    np.testing.assert_allclose(list(found.residual_memory_s.values()), expected, atol=1.5 * PERIOD_S)


@pytest.mark.parametrize("later_s", [-0.4, -0.1, 0.0, 0.1, 0.4])
def test_a_residual_that_goes_with_the_torque_is_seen_on_either_side(later_s: float) -> None:
    """White torque; the residual is the same torque a little later or earlier."""
    torque = np.random.default_rng(4).standard_normal(RATE.shape)
    residual = np.roll(torque, round(later_s / PERIOD_S), axis=0)
    found, _ = judged(rows(RATE, GAIN * torque + residual), torque=torque)
    assert min(found.input_correlation.values()) > 0.85


def test_a_residual_that_has_nothing_to_do_with_the_torque_is_not_correlated_with_it() -> None:
    """Chance makes some hundredths of a thousand rows, largest of fifty."""
    rng = np.random.default_rng(4)
    torque, residual = rng.standard_normal(RATE.shape), rng.standard_normal(RATE.shape)
    found, _ = judged(rows(RATE, GAIN * torque + residual), torque=torque)
    assert max(found.input_correlation.values()) < 0.15
