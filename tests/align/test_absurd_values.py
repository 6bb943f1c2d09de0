"""A handful of absurd samples costs itself and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align import clean
from quadid_logs.align.series import CleanSeries
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.structures import DAMPED
from tests.identify.vehicles import PERIOD_S, QUAD, fly, multisine
from tests.marks import thorough

from .flights import align, flight_log, signal

#: Of the vehicle's own: what a flight reaches, and yet no motion when it lasts for one sample.
SPIKE = 1.0
#: Of the vehicle's own: twenty times as much is beyond any motor, and less than a damaged exponent.
ABSURD = 20.0


@pytest.fixture(scope="module")
def flown() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    (segment,) = fly(QUAD, multisine(40.0), feedback=8.0).segments
    return segment.time_s, segment.body_rate_rad_s, segment.torque


def gains(time_s: np.ndarray, rate: np.ndarray, torque: np.ndarray) -> np.ndarray:
    data = align(
        flight_log(signal("body_rate", time_s, rate), signal("torque_n_m", time_s, torque)), AlignSettings()
    )
    return np.diag(identify(data, IdentifySettings(), (DAMPED,)).models[0].B)


@pytest.mark.parametrize("which", ["torque", thorough("rate")])
def test_six_absurd_samples_change_no_gain(
    which: str, flown: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    """Left in, they make the model explain nothing."""
    time_s, rate, torque = flown
    damaged = {"torque": torque.copy(), "rate": rate.copy()}
    rows = np.linspace(1000, time_s.size - 1000, 6).astype(int)
    damaged[which][rows, 0] = ABSURD * np.abs(damaged[which][:, 0]).max() * np.array([1, -1, 1, 1, -1, -1])
    np.testing.assert_allclose(
        gains(time_s, damaged["rate"], damaged["torque"]), gains(time_s, rate, torque), rtol=2e-3
    )


@pytest.mark.thorough
@pytest.mark.parametrize("which", [thorough("torque"), "rate"])
def test_spikes_of_one_sample_change_no_gain(
    which: str, flown: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    """No larger than what the flight reaches: left in, they move it."""
    time_s, rate, torque = flown
    spoilt = {"torque": torque.copy(), "rate": rate.copy()}
    rows = np.linspace(1000, time_s.size - 1000, 20).astype(int)
    spoilt[which][rows, 0] += SPIKE * np.abs(spoilt[which][:, 0]).max() * np.resize([1, -1, 1], rows.size)
    np.testing.assert_allclose(
        gains(time_s, spoilt["rate"], spoilt["torque"]), gains(time_s, rate, torque), rtol=2e-3
    )


def spiked(
    shape: list[float], *, period_s: float = PERIOD_S, name: str = "torque_command"
) -> tuple[CleanSeries, int]:
    """Return half a minute of noise with a shape of some samples in it, cleaned, and the rows that it had."""
    time_s = period_s * np.arange(int(30.0 / period_s))
    values = 0.01 * np.random.default_rng(0).standard_normal((time_s.size, 3))
    values[1000 : 1000 + len(shape), 1] += shape
    (series,) = clean(flight_log(signal(name, time_s, values))).candidates[name]
    return series, time_s.size


@pytest.mark.parametrize("name", ["body_rate", "torque_command", "motor_thrust", "rotor_speed"])
def test_a_spike_costs_its_own_row(name: str) -> None:
    """One sample of one axis or motor, twenty times the noise."""
    series, n_rows = spiked([0.2], name=name)
    assert series.n_not_finite == 1
    assert series.values.shape[0] == n_rows - 1
    assert np.abs(series.values).max() < 0.06


@pytest.mark.parametrize("shape", [[0.2, 0.2], [0.2, 0.08], [0.2, -0.2, 0.2, -0.2], [0.08, 0.2, 0.08]])
def test_what_lasts_for_more_than_a_sample_stays(shape: list[float]) -> None:
    """A step that is taken back, a kick that fades, a vibration, a bump."""
    series, n_rows = spiked(shape)
    assert series.n_not_finite == 0
    assert series.values.shape[0] == n_rows


def test_in_a_slow_log_one_sample_may_be_a_manoeuvre() -> None:
    """At 50 Hz a rate loop's answer to a step of the stick is over with the next sample."""
    series, _ = spiked([0.2], period_s=0.02)
    assert series.n_not_finite == 0


def test_noise_has_no_spikes() -> None:
    """Thirteen standard deviations are none of its."""
    series, _ = spiked([])
    assert series.n_not_finite == 0


@pytest.mark.thorough
def test_rows_without_numbers_change_no_gain(flown: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """Nine of them, two in a row at most."""
    time_s, rate, torque = flown
    rows = np.linspace(1000, time_s.size - 1000, 5).astype(int)
    torque = torque.copy()
    whole = gains(time_s, rate, torque)
    torque[np.concatenate([rows, rows[:4] + 1])] = np.nan
    np.testing.assert_allclose(gains(time_s, rate, torque), whole, rtol=2e-3)


@pytest.mark.parametrize("duration_s", [0.1, 1.0])
def test_a_short_strong_manoeuvre_stays(duration_s: float) -> None:
    """A doublet in a minute of hovering is a hundred times its noise, and motion all the same."""
    time_s = PERIOD_S * np.arange(24_000)
    rate = 0.001 * np.random.default_rng(0).standard_normal((time_s.size, 3))
    moving = (time_s > 30.0) & (time_s < 30.0 + duration_s)
    rate[moving, 0] = 0.5
    data = align(
        flight_log(signal("body_rate", time_s, rate), signal("torque_n_m", time_s, rate)), AlignSettings()
    )
    assert data.sources["body_rate"].n_not_finite == 0
