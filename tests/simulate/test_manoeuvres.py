"""What is flown: amplitudes, frequencies and order of the excitation, from their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.simulator import manoeuvres
from quadid_logs.simulator.sweep import Sweep, sweep_wave

TIME_S = np.arange(0.0, 60.0, 0.0025)


def rng():
    """Return always the same random numbers."""
    return np.random.default_rng(4)


def cycles(wave):
    """Count periods by changes of sign; zeros belong to what came before."""
    signs = np.sign(wave[wave != 0.0])
    return 0.5 * np.count_nonzero(np.diff(signs))


def test_a_multisine_has_the_rms_that_was_given():
    """Over one period of 20 s, away from the fades."""
    inside = (TIME_S >= 20.0) & (TIME_S < 40.0)
    rate = manoeuvres.multisine(TIME_S, rng(), rms_rad_s=(0.9, 0.6, 0.3)).rate_rad_s[inside]
    np.testing.assert_allclose(np.sqrt(np.mean(rate**2, axis=0)), [0.9, 0.6, 0.3], rtol=1e-6)


def test_the_axes_of_a_multisine_are_orthogonal():
    """Over one period, in whatever phases: no two axes have a harmonic in common."""
    inside = (TIME_S >= 20.0) & (TIME_S < 40.0)
    rate = manoeuvres.multisine(TIME_S, rng()).rate_rad_s[inside]
    power = np.abs(np.fft.rfft(rate, axis=0)) ** 2
    power /= power.sum(axis=0)
    assert (power.T @ power)[~np.eye(3, dtype=bool)].max() < 1e-9


def test_a_chirp_goes_through_its_band():
    """Exponentially from f0 to f1 in T: (f1 - f0) T / ln(f1 / f0) cycles, most of them late."""
    wave = manoeuvres.chirp(TIME_S, rng(), band_hz=(0.5, 8.0)).torque[:, 0]
    assert cycles(wave) == pytest.approx(7.5 * 60.0 / np.log(16.0), abs=1.5)
    assert cycles(wave[TIME_S < 30.0]) == pytest.approx(1.5 * 60.0 / np.log(16.0), abs=1.5)


def test_a_sweep_holds_its_first_frequency_for_two_cycles():
    """Then it rises exponentially to the last one, and is silent before and after."""
    sweep = Sweep(magnitude=0.1, start_hz=0.5, stop_hz=8.0, record_s=40.0)
    assert cycles(sweep_wave(sweep, TIME_S[TIME_S < 4.0])) == pytest.approx(2.0, abs=0.5)
    assert cycles(sweep_wave(sweep, TIME_S)) == pytest.approx(2.0 + 7.5 * 36.0 / np.log(16.0), abs=1.5)
    assert not sweep_wave(sweep, np.array([-1.0, -0.01, 40.01, 50.0])).any()


@pytest.mark.parametrize(
    ("manoeuvre", "levels"), [(manoeuvres.doublets, [1, -1]), (manoeuvres.steps_3211, [3, -2, 1, -1])]
)
def test_steps_are_played_on_one_axis_after_the_other(manoeuvre, levels):
    """Roll, then pitch, then yaw with half the amplitude and twice the time, with a rest behind each."""
    rate = manoeuvre(TIME_S, rng(), pulse_s=0.2).rate_rad_s
    assert (np.count_nonzero(rate, axis=1) <= 1).all()
    first = [int(np.flatnonzero(rate[:, axis])[0]) for axis in range(3)]
    assert first == sorted(first)
    for axis, (width, gain) in enumerate(((1, 1.0), (1, 1.0), (2, 0.5))):
        begin, level = first[axis], gain * np.abs(rate[:, 0]).max()
        for pulses in levels:
            n = width * abs(pulses) * 80
            held = rate[begin + 2 : begin + n - 2, axis]
            np.testing.assert_array_equal(held, np.full(n - 4, np.sign(pulses) * level))
            begin += n
        assert not rate[begin + 2 : begin + 200, axis].any()


def test_sticks_stay_within_their_deflection():
    """And come back to the centre after every deflection."""
    flown = manoeuvres.sticks(TIME_S, rng(), tilt_rad=0.2, yaw_rate_rad_s=0.5)
    assert 0.15 < np.abs(flown.tilt_rad).max() <= 0.2
    assert 0.3 < np.abs(flown.yaw_rate_rad_s).max() <= 0.5
    roll = flown.tilt_rad[:, 0]
    holds = roll[np.flatnonzero(np.diff(roll, prepend=np.nan))]
    assert not holds[::2].any()
