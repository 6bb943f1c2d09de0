"""What gusts make of the attitude, from what a log shows of them."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.torque_noise import Spectrum, gusts_of
from quadid_logs.data.closed_loop import Plant

FREQUENCY_HZ = np.geomspace(0.1, 5.0, 200)


def lines_hz(apart_hz: float) -> FloatArray:
    return np.asarray(np.arange(1.0, 5.0 / apart_hz + 1.0) * apart_hz, dtype=np.float64)


def flown(frequency_hz: FloatArray) -> FloatArray:
    """What two research vehicles were disturbed by, hovering indoors, in no unit."""
    return frequency_hz**-0.8


def power(spectrum: Spectrum, known_from_hz: float) -> FloatArray:
    one = np.ones(1)
    plant = Plant(effectiveness=300.0 * one, damping=-2.0 * one, lag_s=0.03 * one, delay_s=0.004 * one)
    found = gusts_of(spectrum, plant, (known_from_hz, 5.0), FREQUENCY_HZ)
    assert found is not None
    return found.power


def test_gusts_below_the_known_band_rise_as_those_of_flown_vehicles() -> None:
    """A flight that is fitted from 1 Hz tells of the slow gusts that the integral holds."""
    spectrum = Spectrum(lines_hz(0.01), flown(lines_hz(0.01)))
    np.testing.assert_allclose(power(spectrum, 1.0), power(spectrum, 0.01), rtol=0.01)


def test_a_single_line_at_the_edge_of_the_known_band_tells_little_of_slow_gusts() -> None:
    """Lines of a short flight scatter by their own size."""
    frequency_hz = lines_hz(0.25)
    loud = np.where(frequency_hz == 1.0, 2.0, 1.0) * flown(frequency_hz)
    both = (power(Spectrum(frequency_hz, density), 1.0) for density in (loud, flown(frequency_hz)))
    ratio = np.divide(*both)[FREQUENCY_HZ < 0.9]
    assert np.all(ratio < 1.3)
