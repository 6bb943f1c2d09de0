"""Excitation that fits a vehicle: both crossovers in its band, limits kept, the promise that of its air."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quadid_logs.autopilots.discrete import first_order, gain, unit
from quadid_logs.control.excitation_design import Air, AxisExcitation, Chirp, _least, crossovers, design
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.simulator.sweep import Sweep, sweep_wave

PERIOD_S = 1.0 / 400.0
FREQUENCY_HZ = np.geomspace(0.05, 150.0, 400)


def plant(effectiveness: float = 200.0, lag_s: float = 0.03) -> Plant:
    """Return a quadrotor's roll axis."""
    return Plant(*(np.array([each]) for each in (effectiveness, -1.0, lag_s, 0.004)))


def controller(P: float = 0.08) -> AxisController:
    """Return a proportional rate controller with an angle loop of 4 / s."""
    return AxisController(
        period_s=PERIOD_S,
        error=gain(P, PERIOD_S),
        target=unit(PERIOD_S),
        gyro=(first_order(60.0, PERIOD_S),),
        angle_gain_per_s=4.0,
    )


def air(density: float = 0.02) -> Air:
    """Return white disturbances [(rad/s^2)^2 / Hz]."""
    return Air(FREQUENCY_HZ, np.full(FREQUENCY_HZ.shape, density))


def fitting(wanted: float = 0.05, *, density: float = 0.02, effectiveness: float = 200.0) -> AxisExcitation:
    """Return what fits the axis."""
    found = design(controller(), plant(effectiveness), air(density), 0, wanted)
    assert found is not None
    return found


@pytest.mark.parametrize("effectiveness", [60.0, 120.0, 200.0])
def test_both_crossovers_lie_inside_the_band(effectiveness: float) -> None:
    """Between them the margins are read off."""
    found = fitting(effectiveness=effectiveness)
    assert found.start_hz < found.crossover_hz < found.phase_crossover_hz < found.stop_hz
    assert found.start_hz <= 0.25 * found.crossover_hz or found.start_hz == 0.2
    assert found.stop_hz >= 2.4 * found.crossover_hz


def test_crossovers_are_those_of_the_loop() -> None:
    """An integrator of gain 10 rad/s with a delay of 20 ms crosses at 1.59 Hz and at 12.5 Hz."""
    frequency_hz = np.geomspace(0.1, 40.0, 4000)
    s = 2j * np.pi * frequency_hz
    found = crossovers(frequency_hz, 10.0 / s * np.exp(-0.02 * s))
    assert found == pytest.approx((10.0 / (2.0 * math.pi), 12.5), rel=0.01)


def test_a_loop_without_a_crossover_gets_no_sweep() -> None:
    """Nothing says then where its margins are."""
    weak = AxisController(period_s=PERIOD_S, error=gain(1e-6, PERIOD_S), target=unit(PERIOD_S))
    assert design(weak, plant(), air(), 0, 0.05) is None


def test_no_sweep_leaves_the_limits_of_motion() -> None:
    """8 degrees, 60 deg/s and 15 % of the torque, however strong the air is."""
    found = fitting(0.011, density=10.0)
    assert found.peak_angle_rad <= math.radians(8.0) * 1.001
    assert found.peak_rate_rad_s <= math.radians(60.0) * 1.001
    assert found.peak_torque <= 0.15 * 1.001
    assert found.magnitude <= found.most_magnitude


def test_the_promise_is_kept_where_a_sweep_can() -> None:
    """And no stronger than it takes, but for settings of two digits."""
    found = fitting(0.075, density=0.3)
    assert 0.07 < found.half_width <= 0.075


def test_where_no_sweep_can_the_promise_says_how_wide_it_is() -> None:
    """In a gale the longest and strongest sweep does not reach 2 %."""
    found = fitting(0.02, density=30.0)
    assert found.half_width > 0.02
    assert found.record_s == 90.0


def test_twice_the_density_of_the_air_takes_the_root_of_two_of_the_magnitude() -> None:
    """Below the largest magnitude, from which on a sweep gets longer."""
    magnitudes = [fitting(0.075, density=density).magnitude for density in (0.05, 0.1)]
    assert magnitudes[1] == pytest.approx(math.sqrt(2.0) * magnitudes[0], rel=0.08)


@pytest.mark.parametrize("wanted", [0.02, 0.08])
def test_a_sweep_whose_strength_tells_no_more_is_short_and_gentle(wanted: float) -> None:
    """Where an interval is all that no lag describes, it took the logarithm of nothing."""
    magnitude, record_s = _least(lambda _magnitude, _record_s: 0.05, 1.0, wanted)
    assert 0.0 < magnitude <= 0.01
    assert record_s == 30.0


def test_an_interval_is_no_narrower_than_the_gyro_s_scale() -> None:
    """1 %, which no flight tells."""
    assert fitting(0.05, density=1e-9).half_width >= 0.01


def test_a_sweep_turns_a_vehicle_more_than_hovering_does() -> None:
    """In still air the smallest sweeps would be called none."""
    found = fitting(0.5, density=1e-6)
    assert found.peak_rate_rad_s > math.radians(2.0)


def test_the_energy_of_a_chirp_is_that_of_its_wave() -> None:
    """Parseval: of the rising part, without the fades."""
    chirp = Chirp(0.5, 20.0, 0.05, 40.0)
    time_s = np.arange(0.0, 40.0, 1e-3)
    wave = sweep_wave(
        Sweep(magnitude=0.05, start_hz=0.5, stop_hz=20.0, record_s=40.0, fade_in_s=1e-6, fade_out_s=1e-6),
        time_s,
    )
    rising = wave[time_s > 4.0]
    spectrum = 2.0 * np.abs(np.fft.rfft(rising) * 1e-3) ** 2
    frequency_hz = np.fft.rfftfreq(rising.size, 1e-3)
    for low, high in ((1.0, 2.0), (4.0, 8.0)):
        inside = (frequency_hz >= low) & (frequency_hz < high)
        measured = float(np.sum(spectrum[inside]) * frequency_hz[1])
        fine = np.linspace(low, high, 500)
        assert measured == pytest.approx(float(np.trapezoid(chirp.energy(fine), fine)), rel=0.1)


def test_a_rate_set_point_is_given_in_rad_per_second() -> None:
    """Of a loop that follows it, the peak rate is about the magnitude."""
    found = design(controller(), plant(), air(0.3), 0, 0.05, entry="rate", most_hz=5.0)
    assert found is not None
    assert found.stop_hz == 5.0
    assert 0.5 < found.peak_rate_rad_s / found.magnitude < 2.0
