"""Digital filters without a loop over the samples, against scipy's."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from quadid_logs.maths.recurrence import anti_windup_sum, band_both_ways, lag, linear_filter

VALUES = np.random.default_rng(3).standard_normal((500, 2))


@pytest.mark.parametrize("order", [1, 2])
def test_a_digital_filter_gives_what_scipy_gives(order: int) -> None:
    """The filters of controllers are of the first and the second order."""
    numerator, denominator = signal.butter(order, 0.05)
    expected = signal.lfilter(numerator, denominator, VALUES, axis=0)
    np.testing.assert_allclose(linear_filter(numerator, denominator, VALUES), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("band_hz", "rate_hz"), [((0.3, 5.0), 1000.0), ((0.5, 8.0), 50.0), ((2.0, 20.0), 100.0)]
)
def test_a_band_both_ways_gives_what_scipy_gives(band_hz: tuple[float, float], rate_hz: float) -> None:
    """At the ends, too, of values that drift away from zero."""
    drifting = 3.0 + VALUES.cumsum(axis=0)
    band = signal.butter(2, band_hz, "bandpass", fs=rate_hz, output="sos")
    expected = signal.sosfiltfilt(band, drifting, axis=0)
    found = band_both_ways(drifting, band_hz, 1.0 / rate_hz)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_a_lag_forgets_all_but_one_part_in_e_within_its_time_constant() -> None:
    """From rest at the first value towards a step: y = 1 - exp(-t / T)."""
    step = np.array([0.0, 1.0, 1.0, 1.0, 1.0])
    expected = 1.0 - np.exp(-np.arange(5) * 0.01 / 0.02)
    np.testing.assert_allclose(lag(step, 0.01, 0.02), expected, atol=1e-15)


def test_a_lag_rests_at_its_first_value() -> None:
    """A rotor speed that does not change is not run up from zero."""
    np.testing.assert_allclose(lag(np.full((4, 3), 7.0), 0.01, 0.02), 7.0, rtol=1e-15)


def test_no_values_give_none() -> None:
    """An axis may have no row at all."""
    assert lag(np.zeros((0, 2)), 0.01, 0.02).shape == (0, 2)


def test_an_analysis_starts_without_scipy() -> None:
    """Each of its packages takes as long to import as everything else together; the fit alone needs some."""
    code = (
        "import pkgutil, sys, importlib, quadid_logs.pipeline, quadid_logs.autopilots as autopilots, "
        "quadid_logs.control as control\n"
        "for package in (autopilots, control):\n"
        "    for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "        importlib.import_module(module.name)\n"
        "sys.exit('scipy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def flown_integral(increments: np.ndarray, limited: np.ndarray) -> np.ndarray:
    """As firmware sums up: at the limits only towards zero."""
    total, found = 0.0, [0.0]
    for step, stopped in zip(increments[1:], limited[1:], strict=True):
        total += 0.0 if stopped and total * step > 0.0 else step
        found.append(total)
    return np.array(found)


@pytest.mark.parametrize("seed", range(5))
def test_a_rounding_of_an_integral_at_its_limits_stays_a_rounding(seed: int) -> None:
    """Else the side of zero on which it was rounded decides about whole increments, once in so many rows."""
    random = np.random.default_rng(seed)
    increments = np.cumsum(random.standard_normal(4000)) * 0.01
    increments -= np.convolve(increments, np.full(50, 0.02), mode="same")
    limited = random.random(4000) < 0.3
    flown = flown_integral(increments, limited)
    off = 1e-5 * random.standard_normal(4000)
    found = anti_windup_sum(increments + off, limited, 1e3, first=1e-4, told=flown)
    assert np.abs(found - flown).max() < 0.01 * np.std(flown)
