"""Effectiveness by answers to commands alone, in air that moves the vehicle as much as they do.

The flights are integrated here, sample by sample, and share nothing with the package's simulator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.model import SpectralFit
from quadid_logs.identify.spectral_effects import fit_by_spectra

PERIOD_S, LAG_S, DELAY_STEPS = 0.005, 0.04, 2
GAIN, DAMPING = np.array([180.0, 140.0, 16.0]), np.array([-1.0, -1.2, -0.3])
ANGLE_GAIN = 4.0


def _gusts(rng: np.random.Generator, n: int, rms: float) -> np.ndarray:
    """Return accelerations with a first-order spectrum of 0.5 Hz corner, as rough air has; shape (n, 3)."""
    white, state, rows = rng.standard_normal((n, 3)), np.zeros(3), np.empty((n, 3))
    keep = np.exp(-PERIOD_S * 2.0 * np.pi * 0.5)
    for row in range(n):
        state = keep * state + np.sqrt(1.0 - keep**2) * white[row]
        rows[row] = rms * state
    return rows


def _fly(seed: int, *, gusts: float = 1.5, stick_rad: float = 0.12, seconds: float = 60.0) -> FlightData:
    """Fly in angle mode: sticks, angle controller, rate controller, delay, lag, vehicle."""
    rng, n = np.random.default_rng(seed), round(seconds / PERIOD_S)
    steps = np.repeat(rng.choice([-1.0, 0.0, 1.0], (n // 60 + 1, 3)), 60, axis=0)[:n] * stick_rad
    air = _gusts(rng, n, gusts) * np.array([1.0, 1.0, 0.1])
    rate, angle, thrust = np.zeros(3), np.zeros(3), np.zeros(3)
    waiting = [np.zeros(3)] * (DELAY_STEPS + 1)
    torque, rates, setpoints = (np.empty((n, 3)) for _ in range(3))
    for row in range(n):
        setpoint = ANGLE_GAIN * (steps[row] - angle)
        command = 12.0 / GAIN * (setpoint - rate)
        waiting = [*waiting[1:], command]
        rates[row], setpoints[row], torque[row] = rate, setpoint, command
        thrust = thrust + PERIOD_S / LAG_S * (waiting[0] - thrust)
        rate = rate + PERIOD_S * (GAIN * thrust + DAMPING * rate + air[row])
        angle = angle + PERIOD_S * rate
    time_s = PERIOD_S * np.arange(n)
    turned = np.vstack([np.zeros(3), PERIOD_S * np.cumsum(rates, axis=0)[:-1]])
    segment = Segment(
        time_s=time_s,
        body_rate_rad_s=rates,
        torque=torque,
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(n, dtype=bool),
        reference=setpoints,
        command=setpoints + ANGLE_GAIN * turned,
    )
    return _data(segment)


def _data(*segments: Segment) -> FlightData:
    return FlightData(
        sample_period_s=PERIOD_S,
        segments=segments,
        flights=(),
        sources={},
        input=None,
        start_s=0.0,
        duration_s=sum(each.n_samples for each in segments) * PERIOD_S,
    )


@pytest.fixture(scope="module")
def flown() -> list[tuple[SpectralFit, ...]]:
    """Twelve flights in rough air."""
    return [fit_by_spectra(_fly(seed)) for seed in range(12)]


@pytest.mark.parametrize("axis", range(3))
def test_intervals_hold_the_truth_in_rough_air(flown: list[tuple[SpectralFit, ...]], axis: int) -> None:
    """In eleven of twelve flights or more; 95 % are promised."""
    inside = [abs(fits[axis].gain - GAIN[axis]) <= fits[axis].half_width for fits in flown]
    assert sum(inside) >= 11


def test_roll_and_pitch_are_told_within_a_fifth(flown: list[tuple[SpectralFit, ...]]) -> None:
    """Of air that accelerates the vehicle by 1.5 rad/s^2 rms."""
    assert all(fits[axis].is_sound for fits in flown for axis in (0, 1))


@pytest.mark.parametrize("seed", range(3))
def test_in_calm_air_the_effectiveness_is_exact(seed: int) -> None:
    """To 0.4 %: behind a window with a slope, a lag is no multiplier alone."""
    fits = fit_by_spectra(_fly(seed, gusts=0.02))
    np.testing.assert_allclose([each.gain for each in fits], GAIN, rtol=0.004)


def test_lag_and_damping_are_those_of_the_vehicle(flown: list[tuple[SpectralFit, ...]]) -> None:
    """Their medians over the flights; lag and a delay of two steps are hardly told apart."""
    lags = [fits[0].mean[2] + fits[0].mean[3] for fits in flown]
    assert abs(np.median(lags) - (LAG_S + DELAY_STEPS * PERIOD_S)) < 0.006
    assert abs(np.median([fits[0].mean[1] for fits in flown]) - DAMPING[0]) < 0.6


def test_set_points_that_answer_gusts_are_biased_and_say_so() -> None:
    """The rate set-points of the same flight, taken for commands: low, or refused for their departure."""
    data = _fly(0, gusts=4.0, stick_rad=0.03)
    answered = _data(replace(data.segments[0], command=data.segments[0].reference))
    right, wrong = fit_by_spectra(data)[0], fit_by_spectra(answered)[0]
    assert not wrong.is_sound or wrong.gain < 0.8 * GAIN[0]
    assert abs(right.gain - GAIN[0]) <= right.half_width


def test_a_flight_without_commands_is_not_told() -> None:
    """The sticks at rest: the torque answers the air alone."""
    assert not any(each.is_sound for each in fit_by_spectra(_fly(1, stick_rad=0.0)))


def test_without_known_commands_there_is_nothing() -> None:
    """As in a table, or in a mode that answers the position."""
    data = _fly(2, seconds=10.0)
    assert fit_by_spectra(_data(replace(data.segments[0], command=None))) == ()
    unknown = np.full((data.segments[0].n_samples, 3), np.nan)
    assert fit_by_spectra(_data(replace(data.segments[0], command=unknown))) == ()


def test_a_longer_flight_is_told_better() -> None:
    """Four times as long, about half as wide."""
    short, long = (fit_by_spectra(_fly(5, gusts=3.0, seconds=s))[0].half_width for s in (30.0, 120.0))
    assert long < 0.75 * short


def test_a_gap_costs_its_blocks_only() -> None:
    """Two halves of a flight, five seconds apart, tell what the whole does."""
    data = _fly(6)
    segment = data.segments[0]
    halves = _data(segment.rows(slice(0, 5000)), segment.rows(slice(6000, None)))
    fits = fit_by_spectra(halves)
    assert abs(fits[0].gain - GAIN[0]) <= fits[0].half_width
    assert fits[0].is_sound


@pytest.mark.parametrize("size", [0.0, 1e-150, 1e150])
def test_signals_of_no_size_tell_nothing(size: float) -> None:
    """Nor do they overflow: what is warned of is an error in these tests."""
    segment = _fly(3, seconds=12.0).segments[0]
    small = replace(segment, torque=size * segment.torque, body_rate_rad_s=size * segment.body_rate_rad_s)
    assert fit_by_spectra(_data(small)) == ()
