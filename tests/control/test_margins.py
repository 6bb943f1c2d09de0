"""Margins against loops whose margins are known, and stability against the poles of discrete loops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from quadid_logs.arrays import FloatArray
from quadid_logs.control.margins import figures_and_worse, figures_of, grid_hz, is_stable, margins_of
from quadid_logs.data.closed_loop import Modes
from quadid_logs.maths.band import ComplexArray

F = grid_hz(0.0025)
S = 2j * np.pi * F
NO = np.array([False])


@pytest.mark.parametrize("k", [29.0, 30.0, 31.1])
def test_an_integrator_with_a_delay_has_the_margins_of_the_textbook(k: float) -> None:
    """k exp(-s T) / s: crossover k, phase margin 90 degrees less k T, gain margin pi / (2 k T)."""
    T = 0.02
    found = figures_of(F, (k * np.exp(-S * T) / S)[np.newaxis], 1, NO)
    assert found.stable[0]
    assert found.crossover_hz[0] == pytest.approx(k / (2 * np.pi), rel=1e-4)
    assert found.phase_margin_rad[0] == pytest.approx(np.pi / 2 - k * T, abs=1e-4)
    assert found.delay_margin_s[0] == pytest.approx((np.pi / 2 - k * T) / k, rel=1e-4)
    assert found.gain_margin[0] == pytest.approx(np.pi / (2 * k * T), rel=1e-3)
    assert found.oscillation_hz[0] == pytest.approx(1 / (4 * T), rel=1e-3)
    assert np.isnan(found.gain_margin_down[0])


def test_the_gain_margin_is_that_of_the_crossing_nearest_to_minus_one() -> None:
    """Through -180 degrees at 4 Hz with 0.135, and, behind a mode of the frame, at 16 Hz with half of one."""
    octaves = np.log2(F[(F > 1.0) & (F < 30.0)] / 2.0)
    loop = np.exp(-2.0 + 0.65 * (octaves - 1.0) - 1j * np.pi * octaves)
    found = figures_of(2.0 * 2.0**octaves, loop[np.newaxis], 1, NO)
    assert found.gain_margin[0] == pytest.approx(np.exp(0.7), rel=2e-3)
    assert found.oscillation_hz[0] == pytest.approx(16.0, rel=2e-3)


def test_the_margin_downwards_is_that_of_the_crossing_nearest_to_minus_one() -> None:
    """Of -7.4 and -2.0 the second comes first when gains fall."""
    octaves = np.log2(F[(F > 1.0) & (F < 30.0)] / 2.0)
    loop = np.exp(2.0 - 0.65 * (octaves - 1.0) - 1j * np.pi * octaves)
    found = figures_of(2.0 * 2.0**octaves, loop[np.newaxis], 1, NO)
    assert found.gain_margin_down[0] == pytest.approx(np.exp(0.7), rel=2e-3)


def test_the_phase_margin_is_that_of_the_worst_crossover() -> None:
    """70 degrees at 1.4 Hz, 30 at 5.7 Hz."""
    octaves = np.log2(F[(F > 1.0) & (F < 8.0)])
    loop = np.exp(np.cos(np.pi * octaves) - 1j * np.radians(100.0 + 20.0 * octaves))
    found = figures_of(2.0**octaves, loop[np.newaxis], 1, NO)
    assert np.degrees(found.phase_margin_rad[0]) == pytest.approx(30.0, abs=0.1)
    assert found.crossover_hz[0] == pytest.approx(2.0**2.5, rel=2e-3)
    assert found.delay_margin_s[0] == pytest.approx(30.0 / 360.0 / 2.0**2.5, rel=5e-3)


def with_mode(delay_s: float, mode: tuple[float, float, float], crossover_hz: float) -> ComplexArray:
    """An integrator with a delay, behind a mode of the frame: frequency, damping ratio, gain."""
    frame = Modes(*(np.array([each]) for each in mode))
    rigid = 2.0 * np.pi * crossover_hz * np.exp(-DENSE_S * delay_s) / DENSE_S
    return np.asarray(rigid * frame.response(DENSE))


#: Dense enough for a sharp mode.
DENSE = np.geomspace(0.05, 190.0, 20_000)
DENSE_S = 2j * np.pi * DENSE
#: Above the crossover the modes bring the gain above one again, and it falls back beyond -180 degrees.
MODES = [(0.005, (30.0, 0.05, 0.8), 4.0), (0.01, (20.0, 0.01, 0.2), 2.0), (0.02, (60.0, 0.05, 0.8), 8.0)]


@pytest.mark.parametrize(("delay_s", "mode", "crossover_hz"), MODES)
def test_a_stable_loop_behind_a_mode_has_phase_to_spare(
    delay_s: float, mode: tuple[float, float, float], crossover_hz: float
) -> None:
    loop = with_mode(delay_s, mode, crossover_hz)
    margin_rad = figures_of(DENSE, loop, 1, NO).phase_margin_rad[0]
    lost_rad = np.linspace(0.0, 0.99, 30)[:, np.newaxis] * margin_rad
    assert margin_rad > 0.0
    assert is_stable(loop * np.exp(-1j * lost_rad * np.minimum(DENSE, 1.0)), 1, np.repeat(NO, 30)).all()


@pytest.mark.parametrize(("delay_s", "mode", "crossover_hz"), MODES)
def test_a_stable_loop_behind_a_mode_bears_delay(
    delay_s: float, mode: tuple[float, float, float], crossover_hz: float
) -> None:
    loop = with_mode(delay_s, mode, crossover_hz)
    margin_s = figures_of(DENSE, loop, 1, NO).delay_margin_s[0]
    late_s = np.array([[0.0], [0.5], [0.99], [1.01]]) * margin_s
    stable = is_stable(loop * np.exp(-DENSE_S * late_s), 1, np.repeat(NO, 4))
    assert stable.tolist() == [True, True, True, False]


def test_a_conditionally_stable_loop_has_a_gain_margin_downwards() -> None:
    """k (1 + s)^2 / s^3 is stable for k above 1/2 only."""
    found = figures_of(F, (2.0 * (1 + S) ** 2 / S**3)[np.newaxis], 3, NO)
    assert found.stable[0]
    assert found.gain_margin_down[0] == pytest.approx(4.0, rel=2e-3)
    assert not figures_of(F, (0.4 * (1 + S) ** 2 / S**3)[np.newaxis], 3, NO).stable[0]


def test_disk_margin_and_peak_are_those_of_python_control() -> None:
    """The same loop by an independent package."""
    control = pytest.importorskip("control")
    s = control.tf("s")
    system = 60.0 / (s * (1 + 0.02 * s) * (1 + 0.005 * s))
    disk, _, _ = control.disk_margins(system, 2 * np.pi * F, skew=0.0)
    found = figures_of(F, np.atleast_2d(system(S)), 1, NO)
    assert found.disk_margin[0] == pytest.approx(float(disk), rel=2e-3)
    assert found.peak_sensitivity[0] == pytest.approx(np.max(np.abs(1 / (1 + system(S)))), rel=1e-6)


def test_stability_is_that_of_the_poles_of_the_discrete_loop() -> None:
    """Random vehicles and gains, sampled exactly; some stable, some not."""
    generator = np.random.default_rng(5)
    T = 0.0025
    z1 = np.exp(-2j * np.pi * F * T)
    told, true, far = [], [], []
    for _ in range(200):
        lag_s, A = generator.uniform(0.01, 0.06), generator.uniform(-4.0, 1.5)
        gain, integral = generator.uniform(1.0, 120.0), generator.uniform(0.0, 3.0)
        steps = int(generator.integers(1, 8))
        body = signal.cont2discrete(([gain], np.polymul([1.0, -A], [lag_s, 1.0])), T)
        above = np.polymul(np.ravel(body[0]), [1.0 + integral * T, -1.0])
        below = np.polymul(body[1], [1.0, -1.0])
        below = np.concatenate([below, np.zeros(steps)])
        # A zero of the controller at one leaves no integrator there.
        integrators = int(integral > 0.0)
        response = np.polyval(above, 1 / z1) / np.polyval(below, 1 / z1)
        roots = np.abs(np.roots(np.polyadd(below, above)))
        told.append(is_stable(response[np.newaxis], integrators, np.array([A > 0.0]))[0])
        true.append(roots.max() < 1.0)
        far.append(abs(roots.max() - 1.0) > 1e-4)
    told, true, far = np.array(told), np.array(true), np.array(far)
    assert np.count_nonzero(far) > 190
    assert 0.1 < np.mean(true) < 0.9
    np.testing.assert_array_equal(told[far], true[far])


def test_a_vehicle_whose_loop_is_unstable_has_no_margin_left() -> None:
    """Three of four drawn vehicles are stable: the intervals reach down to none, and never to less."""
    k = np.array([30.0, 28.0, 32.0, 200.0])[:, np.newaxis]
    found = margins_of(F, k * np.exp(-S * 0.02) / S, 1, np.zeros(4, dtype=bool), 1e9)
    assert found.stable
    assert found.stable_fraction == 0.75
    assert found.phase_margin_deg is not None
    assert found.gain_margin_db is not None
    assert found.phase_margin_deg.ci95[0] == 0.0
    assert found.gain_margin_db.ci95[0] == 0.0
    assert not found.extrapolated


def test_an_unstable_loop_has_no_figures() -> None:
    found = margins_of(F, (200.0 * np.exp(-S * 0.02) / S)[np.newaxis], 1, NO, 1e9)
    assert not found.stable
    assert found.phase_margin_deg is None


def low_pass(cutoff_hz: float, frequency_hz: FloatArray) -> ComplexArray:
    """Return a Butterworth low-pass of the second order."""
    above, below = signal.butter(2, 2.0 * np.pi * cutoff_hz, analog=True)
    return signal.freqs(above, below, 2.0 * np.pi * frequency_hz)[1]


def unknown_deg(frequency_hz: FloatArray, known_hz: float) -> FloatArray:
    """Return how far the phase of a low-pass lies below what its delay up to a frequency tells, at worst."""
    worst = np.zeros(frequency_hz.shape)
    for cutoff_hz in np.geomspace(known_hz, 60.0 * known_hz, 500):
        here, there = (
            -np.degrees(np.unwrap(np.angle(low_pass(cutoff_hz, one))))
            for one in (np.array([1e-3, known_hz]), np.concatenate([[1e-3], frequency_hz]))
        )
        worst = np.maximum(worst, there[1:] - frequency_hz / known_hz * here[1])
    return np.where(frequency_hz > known_hz, worst, 0.0)


def test_what_was_not_measured_may_take_phase_away() -> None:
    """Nothing is known above 1 Hz: what is allowed for at the crossover widens the interval."""
    k = 30.0
    loop = (k * np.exp(-S * 0.02) / S)[np.newaxis]
    known, unknown = (margins_of(F, loop, 1, NO, known_hz) for known_hz in (1e9, 1.0))
    assert unknown.extrapolated
    assert known.phase_margin_deg is not None
    assert unknown.phase_margin_deg is not None
    crossover_hz = np.linspace(1.0, k / (2 * np.pi), 200)
    lost_deg = unknown_deg(crossover_hz, 1.0)[-1]
    low, high = unknown.phase_margin_deg.ci95
    assert low == pytest.approx(known.phase_margin_deg.value - lost_deg, abs=0.1)
    assert high == known.phase_margin_deg.value


@pytest.mark.parametrize("cutoff_hz", [7.0, 10.0, 14.0, 20.0, 40.0])
def test_a_low_pass_that_shows_in_the_band_as_a_delay_keeps_what_is_told(cutoff_hz: float) -> None:
    """The vehicle has one that nobody knows of; the model has as much delay as the band shows of it."""
    known_hz, k = 5.0, 15.0
    delay_s = -float(np.angle(low_pass(cutoff_hz, np.array([known_hz])))[0]) / (2.0 * np.pi * known_hz)
    rigid = k * np.exp(-S * 0.015) / S
    told = margins_of(F, (rigid * np.exp(-S * delay_s))[np.newaxis], 1, NO, known_hz)
    true = figures_of(F, (rigid * low_pass(cutoff_hz, F))[np.newaxis], 1, NO)
    assert told.gain_margin_db is not None
    assert told.disk_margin is not None
    assert told.gain_margin_db.ci95[0] <= 20.0 * np.log10(true.gain_margin[0]) + 0.01
    assert told.disk_margin.ci95[0] <= true.disk_margin[0] + 0.005


def test_a_resonance_beyond_the_unstable_point_is_counted_in_both_senses() -> None:
    """A lightly damped mode crosses the axis twice: beyond -1 with a low delay there and back, or around."""
    told, true = [], []
    for delay_s in np.linspace(0.0, 0.02, 15):
        x = S / (2j * np.pi * 20.0)
        mode = 1.0 + 1.5 * x**2 / (1.0 - x**2 + 0.04j * x)
        loop = 30.0 / S * np.exp(-S * delay_s) * mode
        told.append(is_stable(loop[np.newaxis], 1, NO)[0])
        # Turns of 1 + L counted step by step.
        steps = np.angle((1.0 + loop[1:]) / (1.0 + loop[:-1]))
        true.append(abs(np.angle(1.0 + loop[0]) + steps.sum()) < np.pi)
    assert told == true
    assert 0 < sum(told) < len(told)


def test_many_loops_have_the_figures_that_each_has_alone() -> None:
    """They are looked at some hundred at once, one after the other in memory."""
    gains = np.linspace(4.0, 34.0, 151)
    loops = gains[:, np.newaxis] * np.exp(-S * 0.02) / S
    loops[::7] *= (1.0 + 3.0 * S) / (1.0 + S) * np.exp(-S * 0.0425)
    assert loops[7, -1].imag > 0.0 > loops[8, 0].imag
    together = figures_of(F, loops, 1, np.zeros(len(loops), dtype=bool))
    alone = [figures_of(F, one[np.newaxis], 1, NO) for one in loops]
    for name, figures in together._asdict().items():
        assert np.array_equal(figures, [getattr(one, name)[0] for one in alone], equal_nan=True), name


@pytest.mark.parametrize("crossover_hz", [3.0, 5.0, 8.0])
def test_worse_figures_are_those_of_the_loop_with_the_further_loss_of_phase(crossover_hz: float) -> None:
    """Whether the loop crosses one before, in the step after, or beyond the last frequency that is known."""
    known_hz = float(F[np.searchsorted(F, 5.0) - 1])
    loop = (2 * np.pi * crossover_hz * np.exp(-S * 0.02) / S)[np.newaxis]
    later = loop * np.exp(-1j * np.radians(unknown_deg(F, known_hz)))
    found, worse = figures_and_worse(F, loop, 1, NO, known_hz)
    for told, curve in ((found, loop), (worse, later)):
        whole = figures_of(F, curve, 1, NO)
        assert told.phase_margin_rad[0] == pytest.approx(whole.phase_margin_rad[0], abs=1e-4)
        assert told.gain_margin[0] == pytest.approx(whole.gain_margin[0], rel=1e-4)
        assert told.disk_margin[0] == pytest.approx(whole.disk_margin[0], rel=1e-4)
    assert worse.gain_margin[0] < found.gain_margin[0]


def test_a_loop_that_crosses_the_axis_there_and_back_is_stable() -> None:
    """100 (1 + s)^2 / s / (1 + 10 s)^2 lags by 200 degrees at 0.05 Hz and by 90 later, its gain being 30."""
    loop = (100.0 * (1.0 + S) ** 2 / S / (1.0 + 10.0 * S) ** 2)[np.newaxis]
    assert np.unwrap(np.angle(loop[0])).min() < -np.pi
    assert is_stable(loop, 1, NO)[0]
    # There it lags by 180 degrees at 0.1298 and 0.7702 rad/s, the roots of 10 w^2 - 9 w + 1.
    assert figures_of(F, loop, 1, NO).gain_margin_down[0] == pytest.approx(3.430, rel=2e-3)
