"""What gusts make of the attitude, and noise of the command, from what a log shows of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.control.torque_noise import Spectrum, gusts_of, logged_spectrum
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


def _logged(row_hz: float, data_hz: float) -> tuple[Any, Any]:
    """Return rows of a command that holds a line at 300 Hz, and data of it in another unit."""
    log, segments = None, []
    for rate_hz, unit in ((row_hz, 1.0), (data_hz, 2.0)):
        time_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
        slow, line = np.sin(2.0 * np.pi * 12.0 * time_s), 0.1 * np.sin(2.0 * np.pi * 300.0 * time_s)
        values = unit * np.repeat((slow + line)[:, np.newaxis], 3, axis=1)
        if log is None:
            signal = SimpleNamespace(rows=SimpleNamespace(time_s=time_s), values=values)
            log = SimpleNamespace(signals={"torque_command": [signal]})
        segments = [SimpleNamespace(time_s=time_s, torque=values)]
    return log, SimpleNamespace(segments=segments, sample_period_s=1.0 / data_hz)


def test_a_line_that_the_data_fold_down_stands_where_it_is_in_faster_rows() -> None:
    spectrum = logged_spectrum(*_logged(1000.0, 400.0), 0)
    assert spectrum is not None
    line = np.abs(spectrum.frequency_hz - 300.0) < 2.0
    # A sine of 0.1 in rows whose unit is half of the data's.
    assert spectrum.deviation(np.ones(line.shape), line) == pytest.approx(0.2 / np.sqrt(2.0), rel=0.02)


def test_rows_that_are_no_faster_than_the_data_show_nothing_more() -> None:
    assert logged_spectrum(*_logged(400.0, 400.0), 0) is None
