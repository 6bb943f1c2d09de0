"""Effectiveness by the trajectories that a position controller followed, from flights of seconds.

The flights are integrated here, sample by sample, and share nothing with the package's simulator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.log import GyroFilter
from quadid_logs.data.model import SpectralFit
from quadid_logs.identify.spectral import fit_spectra
from quadid_logs.identify.spectral_effects import fit_by_spectra
from quadid_logs.maths.block_spectra import BlockSpectra

PERIOD_S, LAG_S, DELAY_STEPS, GRAVITY = 0.004, 0.045, 2, 9.81
GAIN, DAMPING = np.array([180.0, 140.0]), np.array([-1.0, -1.2])
#: Moment of the speed through the air [rad/s^2 per m/s]: a tilt of 1 Hz and below is held against it.
BY_SPEED = np.array([-4.0, -3.0])
N_FLIGHTS, SECONDS = 12, 6.0


def _plan(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    """Return position, speed, acceleration and jerk of moves to and fro; (n, 2) each."""
    time_s = PERIOD_S * np.arange(n)
    jerk = np.zeros((n, 2))
    start = 0.3
    while start < SECONDS - 1.5:
        length = rng.uniform(0.7, 1.5)
        phase = (time_s - start) / length
        inside = (phase > 0.0) & (phase < 1.0)
        # A third-order pulse: the speed returns to zero.
        shape = np.where(inside, np.sin(2.0 * np.pi * phase) - 2.0 * np.sin(4.0 * np.pi * phase), 0.0)
        jerk += shape[:, np.newaxis] * rng.choice([-1.0, 1.0], 2) * rng.uniform(10.0, 30.0, 2)
        start += length
    acceleration = PERIOD_S * np.cumsum(jerk, axis=0)
    speed = PERIOD_S * np.cumsum(acceleration, axis=0)
    return PERIOD_S * np.cumsum(speed, axis=0), speed, acceleration, jerk


def _fly(rng: np.random.Generator, gusts: float) -> Segment:
    """Follow a trajectory: position, speed, angle and rate controller, delay, lag, vehicle in gusts."""
    n = round(SECONDS / PERIOD_S)
    planned = _plan(rng, n)
    white = rng.standard_normal((n, 2))
    torque, rates, speeds = np.zeros((3, n, 3))
    for axis in range(2):
        series = (*(each[:, axis].tolist() for each in planned), white[:, axis].tolist())
        rates[:, axis], torque[:, axis], along = _one_axis(series, axis, gusts)
        # To the right by rolling right, backwards by raising the nose.
        speeds[:, 1 - axis] = along if axis == 0 else -along
    reference = np.column_stack([planned[3] / GRAVITY, np.zeros(n)])
    return Segment(
        time_s=PERIOD_S * np.arange(n),
        body_rate_rad_s=rates,
        torque=torque,
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(n, dtype=bool),
        reference=reference,
        command=reference,
        planned=True,
        velocity_m_s=speeds + 0.02 * rng.standard_normal((n, 3)),
    )


def _one_axis(
    series: tuple[list[float], ...], axis: int, gusts: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rate, command and speed; in plain floats, which cost a tenth of numpy's."""
    gain, damping, by_speed = (float(each[axis]) for each in (GAIN, DAMPING, BY_SPEED))
    decay = np.exp(-PERIOD_S * 2.0 * np.pi * 0.5)
    keep, new = float(decay), float(np.sqrt(1.0 - decay**2))
    position = speed = angle = rate = thrust = air = 0.0
    waiting, found = [0.0] * (DELAY_STEPS + 1), []
    for place, planned, acceleration, jerk, white in zip(*series, strict=True):
        wanted = acceleration + 3.0 * (planned - speed) + 4.0 * (place - position)
        setpoint = 8.0 * (wanted / GRAVITY - angle) + jerk / GRAVITY
        command = 15.0 / gain * (setpoint - rate)
        waiting = [*waiting[1:], command]
        found.append((rate, command, speed))
        air = keep * air + new * white
        thrust = thrust + PERIOD_S / LAG_S * (waiting[0] - thrust)
        rate = rate + PERIOD_S * (gain * thrust + damping * rate + by_speed * speed + gusts * air)
        angle = angle + PERIOD_S * rate
        speed = speed + PERIOD_S * (GRAVITY * angle + 0.3 * air)
        position = position + PERIOD_S * speed
    rates, commands, speeds = np.array(found).T
    return rates, commands, speeds


def _pool(seed: int, gusts: float = 2.0) -> FlightData:
    """Return flights whose log has no velocity."""
    data = _pool_with_speed(seed, gusts)
    return replace(data, segments=tuple(replace(each, velocity_m_s=None) for each in data.segments))


def _pool_with_speed(seed: int, gusts: float = 2.0) -> FlightData:
    rng = np.random.default_rng(seed)
    segments = [
        replace(each, time_s=each.time_s + 100.0 * number, flight=number)
        for number, each in enumerate(_fly(rng, gusts) for _ in range(N_FLIGHTS))
    ]
    return FlightData(
        sample_period_s=PERIOD_S,
        segments=tuple(segments),
        flights=(),
        sources={},
        input=None,
        start_s=0.0,
        duration_s=N_FLIGHTS * SECONDS,
    )


@pytest.fixture(scope="module")
def pools() -> list[tuple[SpectralFit, ...]]:
    """Eight pools of twelve flights of six seconds; they take half a second each to integrate."""
    return [fit_by_spectra(_pool(seed)) for seed in range(8)]


@pytest.mark.parametrize("axis", range(2))
def test_intervals_hold_the_truth(pools: list[tuple[SpectralFit, ...]], axis: int) -> None:
    """In seven of eight pools or more; 95 % are promised."""
    inside = [abs(fits[axis].gain - GAIN[axis]) <= fits[axis].half_width for fits in pools]
    assert sum(inside) >= 7


@pytest.mark.parametrize("axis", range(2))
def test_pools_of_gentle_flights_are_told_within_a_tenth(
    pools: list[tuple[SpectralFit, ...]], axis: int
) -> None:
    """Seventy seconds of flight in gusts of 2 rad/s^2."""
    assert all(fits[axis].is_sound and fits[axis].half_width < 0.1 * GAIN[axis] for fits in pools)


@pytest.mark.parametrize("seed", range(4))
def test_logged_speed_brings_a_pool_in_strong_moments_of_the_air_closer_to_the_truth(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A nano-drone's: 18 rad/s^2 for each m/s. Without the speed the response below a hertz is left free."""
    monkeypatch.setattr(f"{__name__}.BY_SPEED", np.array([-18.0, -16.0]))
    data = _pool_with_speed(seed)
    without = tuple(replace(each, velocity_m_s=None) for each in data.segments)
    with_speed, blind = fit_by_spectra(data), fit_by_spectra(replace(data, segments=without))
    for axis in range(2):
        fit = with_speed[axis]
        assert fit.is_sound
        assert abs(fit.gain - GAIN[axis]) <= fit.half_width
        assert fit.half_width < blind[axis].half_width
    errors = [
        sum(abs(fits[axis].gain / GAIN[axis] - 1.0) for axis in range(2)) for fits in (with_speed, blind)
    ]
    # A tenth at least: a speed that hardly counted would change less than a thousandth.
    assert errors[0] < 0.9 * errors[1]


def test_one_flight_without_a_speed_leaves_it_out_of_the_pool() -> None:
    """Blocks of one pool hold the same columns."""
    data = _pool_with_speed(1)
    first = replace(data.segments[0], velocity_m_s=None)
    some = fit_by_spectra(replace(data, segments=(first, *data.segments[1:])))
    none = fit_by_spectra(_pool(1))
    np.testing.assert_array_equal(some[0].mean, none[0].mean)


def test_an_axis_that_no_trajectory_moves_is_not_told(pools: list[tuple[SpectralFit, ...]]) -> None:
    assert not any(fits[2].is_sound for fits in pools)


def test_trajectories_as_instruments_are_not_moved_by_what_the_controller_answers() -> None:
    """The same flights by torque and motion alone, as a regression finds them: a fifth too low."""
    data = _pool(3, gusts=12.0)
    fit = fit_by_spectra(data)[0]
    torque = np.concatenate([each.torque[:, 0] for each in data.segments])
    rate = np.concatenate([each.body_rate_rad_s[:, 0] for each in data.segments])
    direct = np.polyfit(torque, np.gradient(rate, PERIOD_S), 1)[0]
    assert direct < 0.8 * GAIN[0]
    assert abs(fit.gain - GAIN[0]) <= fit.half_width


def test_pools_of_flights_of_four_seconds_use_them_to_their_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve flights of 4.2 s in gusts of 6 rad/s^2: their first three seconds alone leave 7.5 %."""
    monkeypatch.setattr(f"{__name__}.SECONDS", 4.2)
    widths = []
    for seed in range(4):
        fits = fit_by_spectra(_pool_with_speed(seed, gusts=6.0))
        for axis in range(2):
            assert abs(fits[axis].gain - GAIN[axis]) <= fits[axis].half_width
            widths.append(fits[axis].half_width / GAIN[axis])
    assert np.mean(widths) < 0.07


def test_fewer_than_four_blocks_tell_nothing() -> None:
    """One flight of six seconds has three."""
    data = _pool(0)
    assert fit_by_spectra(replace(data, segments=data.segments[:1])) == ()


def _departing(seed: int) -> BlockSpectra:
    """Return blocks whose response is the equation's but for 20 % in each sixth of an octave."""
    rng, n_blocks, hz = np.random.default_rng(seed), 40, np.arange(2, 46) / 3.0
    s = 2j * np.pi * hz
    behind = np.exp(-s * PERIOD_S * DELAY_STEPS) / (1.0 + s * LAG_S)
    band = np.round(6.0 * np.log2(hz)).astype(int)
    values = np.zeros((n_blocks, hz.size, 15), dtype=np.complex128)
    for axis in range(2):
        real, imaginary = rng.standard_normal((2, 2, n_blocks, hz.size))
        planned, air = (real + 1j * imaginary) / hz
        response = GAIN[axis] * behind * (1.0 + 0.2 * rng.standard_normal(40)[band - band[0]])
        values[:, :, axis] = (response * planned + 0.025 * GAIN[axis] * air) / s
        values[:, :, 3 + axis] = values[:, :, 12 + axis] = planned
    starts = np.arange(n_blocks)
    return BlockSpectra(hz, values, np.zeros_like(values), 1.5 * starts, starts, PERIOD_S)


def test_what_the_equation_does_not_describe_draws_the_effectiveness_nowhere() -> None:
    """On the mean of 16 axes, each of which is 7 % off. With sizes as measured all are low, by a fifth."""
    fits = [fit_spectra(_departing(seed), GyroFilter(), planned=True, moved=(0, 1)) for seed in range(8)]
    errors = [each[axis].gain / GAIN[axis] - 1.0 for each in fits for axis in range(2)]
    assert abs(np.mean(errors)) < 0.05
