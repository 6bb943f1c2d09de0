"""Effectiveness by answers to commands alone, in air that moves the vehicle as much as they do.

The flights are integrated here, sample by sample, and share nothing with the package's simulator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.model import SpectralFit
from quadid_logs.identify.spectral import moment_noise, solve_flight, with_delay_alone
from quadid_logs.identify.spectral_effects import fit_by_spectra
from tests.marks import thorough_but

PERIOD_S, LAG_S, DELAY_STEPS = 0.005, 0.04, 2
GAIN, DAMPING = np.array([180.0, 140.0, 16.0]), np.array([-1.0, -1.2, -0.3])
ANGLE_GAIN = 4.0


def _gusts(rng: np.random.Generator, n: int, rms: float) -> np.ndarray:
    """Return accelerations with a first-order spectrum of 0.5 Hz corner, as rough air has; shape (n, 3)."""
    decay = np.exp(-PERIOD_S * 2.0 * np.pi * 0.5)
    keep, new = float(decay), float(np.sqrt(1.0 - decay**2))
    columns = []
    for white in rng.standard_normal((n, 3)).T.tolist():
        state, column = 0.0, []
        for one in white:
            state = keep * state + new * one
            column.append(state)
        columns.append(column)
    return rms * np.array(columns).T


def _fly(
    seed: int,
    *,
    gusts: float = 1.5,
    stick_rad: float = 0.12,
    seconds: float = 60.0,
    tone_hz: float = 0.0,
    sweep: np.ndarray | None = None,
    older_steps: int = 0,
    motor: tuple[float, int] = (LAG_S, DELAY_STEPS),
) -> FlightData:
    """Fly in angle mode: sticks, angle controller, rate controller, delay, lag, vehicle.

    ``tone_hz``: of sticks that follow a sinusoid. ``sweep``: shape (n, 3), injected at the mixer.
    ``older_steps``: the angle controller has the angle of so many samples before. ``motor``: lag, delay.
    """
    rng, n = np.random.default_rng(seed), round(seconds / PERIOD_S)
    steps = np.repeat(rng.choice([-1.0, 0.0, 1.0], (n // 60 + 1, 3)), 60, axis=0)[:n] * stick_rad
    if tone_hz:
        times = 2.0 * np.pi * tone_hz * PERIOD_S * np.arange(n)
        steps = stick_rad * np.sin(times[:, np.newaxis] + np.array([0.0, 1.0, 2.0]))
    injected = np.zeros((n, 3)) if sweep is None else sweep
    air = _gusts(rng, n, gusts) * np.array([1.0, 1.0, 0.1])
    torque, rates, setpoints = (np.empty((n, 3)) for _ in range(3))
    for axis in range(3):
        series = [each[:, axis].tolist() for each in (steps, injected, air)]
        rates[:, axis], setpoints[:, axis], torque[:, axis] = _one_axis(series, axis, older_steps, motor)
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
        command=np.column_stack(
            [setpoints + ANGLE_GAIN * turned, *([] if sweep is None else [injected.sum(axis=1)])]
        ),
    )
    return _data(segment)


def _one_axis(series: list[list[float]], axis: int, older_steps: int, motor: tuple[float, int]) -> np.ndarray:
    """Return rate, set-point and command, (3, n); in plain floats, which cost a tenth of numpy's."""
    gain, damping = float(GAIN[axis]), float(DAMPING[axis])
    lag_s, delay_steps = motor
    rate = angle = thrust = 0.0
    angles, waiting = [0.0] * (older_steps + 1), [0.0] * (delay_steps + 1)
    found = []
    for step, injected, air in zip(*series, strict=True):
        angles = [*angles[1:], angle]
        setpoint = ANGLE_GAIN * (step - angles[0])
        command = 12.0 / gain * (setpoint - rate) + injected
        waiting = [*waiting[1:], command]
        found.append((rate, setpoint, command))
        thrust = thrust + PERIOD_S / lag_s * (waiting[0] - thrust)
        rate = rate + PERIOD_S * (gain * thrust + damping * rate + air)
        angle = angle + PERIOD_S * rate
    return np.array(found).T


def _sweeps(amplitude: float, seconds: float) -> np.ndarray:
    """Return a linear sweep of 0.5 to 12 Hz for each axis in turn, shape (n, 3): rests of 2 s between."""
    time_s = PERIOD_S * np.arange(round(seconds / 3.0 / PERIOD_S))
    rising_s = time_s[-1] - 2.0
    phase = 2.0 * np.pi * (0.5 * time_s + 0.5 * (12.0 - 0.5) / rising_s * time_s**2)
    one = np.where(time_s < rising_s, amplitude * np.sin(phase), 0.0)
    apart = np.zeros((3 * one.size, 3))
    for axis in range(3):
        apart[axis * one.size : (axis + 1) * one.size, axis] = one / GAIN[axis]
    return apart


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


@pytest.mark.thorough
@pytest.mark.parametrize("axis", range(3))
def test_intervals_hold_the_truth_in_rough_air(flown: list[tuple[SpectralFit, ...]], axis: int) -> None:
    """In eleven of twelve flights or more; 95 % are promised."""
    inside = [abs(fits[axis].gain - GAIN[axis]) <= fits[axis].half_width for fits in flown]
    assert sum(inside) >= 11


@pytest.mark.thorough
def test_roll_and_pitch_are_told_within_a_fifth(flown: list[tuple[SpectralFit, ...]]) -> None:
    """Of air that accelerates the vehicle by 1.5 rad/s^2 rms."""
    assert all(fits[axis].is_sound for fits in flown for axis in (0, 1))


@pytest.mark.parametrize("seed", thorough_but([0], range(3)))
def test_in_calm_air_the_effectiveness_is_exact(seed: int) -> None:
    """To 0.4 %: behind a window with a slope, a lag is no multiplier alone."""
    fits = fit_by_spectra(_fly(seed, gusts=0.02))
    np.testing.assert_allclose([each.gain for each in fits], GAIN, rtol=0.004)


@pytest.mark.thorough
def test_lag_and_damping_are_those_of_the_vehicle(flown: list[tuple[SpectralFit, ...]]) -> None:
    """Their medians over the flights; lag and a delay of two steps are hardly told apart."""
    lags = [fits[0].mean[2] + fits[0].mean[3] for fits in flown]
    assert abs(np.median(lags) - (LAG_S + DELAY_STEPS * PERIOD_S)) < 0.006
    assert abs(np.median([fits[0].mean[1] for fits in flown]) - DAMPING[0]) < 0.6


@pytest.mark.thorough
@pytest.mark.parametrize("seed", thorough_but([0], range(3)))
def test_one_sweep_of_each_axis_tells_it_in_rough_air(seed: int) -> None:
    """To a tenth: each frequency passes once, in one axis at a time, and nobody moves a stick."""
    sweep = _sweeps(8.0, 96.0)
    fits = fit_by_spectra(_fly(seed, gusts=1.0, stick_rad=0.0, seconds=96.0, sweep=sweep))
    assert all(fits[axis].half_width < 0.1 * GAIN[axis] for axis in (0, 1))
    assert all(abs(fits[axis].gain - GAIN[axis]) <= fits[axis].half_width for axis in (0, 1))


@pytest.mark.parametrize("older_steps", [0, 1])
def test_what_is_left_of_the_answer_of_an_angle_controller_is_no_command(older_steps: int) -> None:
    """Sticks at rest: put back a sample too early, the answer leaves a part that follows every gust."""
    fits = fit_by_spectra(_fly(2, stick_rad=0.0, older_steps=older_steps))
    assert not any(fit.is_of_use for fit in fits)


@pytest.mark.parametrize("seed", thorough_but([0], range(3)))
def test_a_single_tone_tells_the_effectiveness_as_well_as_lags_are_known(seed: int) -> None:
    """At one frequency lag and effectiveness are one number: the interval knows what lags motors have."""
    fits = fit_by_spectra(_fly(seed, gusts=0.2, stick_rad=0.05, tone_hz=2.5))
    for axis in (0, 1):
        assert abs(fits[axis].gain - GAIN[axis]) <= fits[axis].half_width
        assert 0.04 * GAIN[axis] < fits[axis].half_width < 0.4 * GAIN[axis]


@pytest.mark.parametrize("lag_s", [0.01, 0.04, 0.1])
def test_a_single_tone_leaves_a_long_lag_and_a_larger_effectiveness_open(lag_s: float) -> None:
    """Motors of small and of large propellers: twice the lag takes more than half the lag gives."""
    fits = fit_by_spectra(_fly(0, gusts=0.2, stick_rad=0.1, tone_hz=4.0, motor=(lag_s, 0)))
    for axis in (0, 1):
        middle = fits[axis].gain * (1.0 + fits[axis].skew)
        assert abs(middle - GAIN[axis]) <= fits[axis].half_width


def test_sticks_of_all_frequencies_leave_the_effectiveness_in_the_middle_of_its_interval() -> None:
    """They tell the lag, and around one that is known an effectiveness is as likely to be more as less."""
    fits = fit_by_spectra(_fly(0, gusts=0.2))
    for axis in (0, 1):
        assert abs(fits[axis].skew) * fits[axis].gain < 0.1 * fits[axis].half_width


def test_the_noise_beside_bands_without_commands_is_that_of_the_air() -> None:
    """Of white noise, the variance of a moment is that of a line times the power of what was commanded."""
    solution = solve_flight(_fly(0, seconds=40.0))
    assert solution is not None
    axis = solution.axes[0]
    rng = np.random.default_rng(0)
    told, air = (
        rng.standard_normal((*axis.told.shape, 2)) @ np.array([1.0, 1.0j]) / np.sqrt(2.0) for _ in range(2)
    )
    told[:, : axis.edges[2]] = 0.0
    noise = moment_noise(axis, told, air)[2:8]
    power = axis.power(told).sum(axis=0)[2:8]
    assert np.all(noise > 0.4 * power)
    assert np.all(noise < 2.5 * power)


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


def test_a_lag_that_no_motor_has_is_a_part_of_the_delay() -> None:
    """Firmware in the loop flew without motors: lag 1.8 ms and delay -0.4 ms left 3 ms behind a hold."""
    covariance = np.diag([4.0, 0.01, 1e-6, 1e-6, 1.0])
    covariance[2, 3] = covariance[3, 2] = -0.9e-6
    fit = SpectralFit(
        mean=np.array([440.0, -2.0, 0.0018, -0.0004, 0.0]),
        covariance=covariance,
        departure=0.02,
        commanded=1.0,
        r2_commanded=1.0,
        n_blocks=32,
        half_width=12.0,
    )
    told = with_delay_alone(fit)
    assert told.mean[2:4] == pytest.approx([0.0, 0.0014])
    assert told.covariance[3, 3] == pytest.approx(0.2e-6)
    # Motors of the smallest propellers have 10 ms.
    motors = replace(fit, mean=np.array([440.0, -2.0, 0.01, -0.0004, 0.0]))
    assert with_delay_alone(motors) is motors
