"""Betaflight's chirp mode: the excitation comes out of the log of every version that has the mode."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quadid_logs.autopilots.betaflight.chirp import Sweep, excitation, sweep_of
from quadid_logs.autopilots.betaflight.log import settings_of

TEXTS = {
    "chirp_frequency_start_deci_hz": "2",
    "chirp_frequency_end_deci_hz": "6000",
    "chirp_time_seconds": "20",
}
SWEEP = Sweep(0.2, 600.0, 20.0)


def flown(rate_hz: float = 1000.0, clock: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two runs by the formula of ``common/chirp.c``: time, phase in the log's unit, excitation."""
    time_s = np.arange(0.0, 50.0, 1.0 / rate_hz)
    phase, excited = np.zeros_like(time_s), np.zeros_like(time_s)
    beta = (SWEEP.end_hz / SWEEP.begin_hz) ** (1.0 / SWEEP.duration_s)
    for begin_s in (2.0, 26.0):
        run = (time_s >= begin_s) & (time_s < begin_s + 20.0)
        frequency_hz = SWEEP.begin_hz * beta ** (time_s[run] - begin_s)
        angle = 2.0 * math.pi * (frequency_hz - SWEEP.begin_hz) / math.log(beta) % (2.0 * math.pi)
        phase[run], excited[run] = np.rint(5000.0 * angle), np.cos(angle) * np.minimum(frequency_hz, 1.0)
    return time_s * clock, phase, excited


@pytest.mark.parametrize("rate_hz", [1000.0, 125.0])
@pytest.mark.parametrize("clock", [1.0, 1.01])
def test_a_log_that_holds_the_phase_alone_tells_the_excitation(rate_hz: float, clock: float) -> None:
    """2025.12 logs no more; loops of the flight controller are a little longer than their setting."""
    time_s, phase, excited = flown(rate_hz, clock)
    found = excitation(np.column_stack([phase, np.zeros((len(phase), 3))]), time_s, SWEEP)
    assert found is not None
    # The first loop of a run has no phase yet.
    assert np.count_nonzero(np.abs(found - excited) > 1e-3) <= 2


def test_a_log_that_holds_the_excitation_gives_it_as_it_is() -> None:
    """2026.6 and later: phase, axis, frequency, excitation."""
    time_s, phase, excited = flown()
    axis = np.where((phase > 0.0) | (excited != 0.0), 1.0, -1.0)
    debug = np.column_stack([phase, axis, 100.0 * (axis > 0.0), np.rint(1000.0 * excited)])
    found = excitation(debug, time_s, SWEEP)
    assert found is not None
    np.testing.assert_allclose(found, excited, atol=6e-4)


@pytest.mark.parametrize("name", ["noise", "ramp", "slow sine", "other sweep", "nothing"])
def test_another_debug_mode_is_no_chirp(name: str) -> None:
    """Its number changes from version to version, so the fields themselves must tell."""
    time_s = np.arange(20_000) / 1000.0
    traces = {
        "noise": np.random.default_rng(0).integers(0, 31_000, 20_000).astype(float),
        "ramp": 7.0 * np.arange(20_000) % 31_416.0,
        "slow sine": np.abs(30_000.0 * np.sin(time_s)),
        "other sweep": 5000.0 * (2.0 * math.pi * (time_s + 0.3 * time_s**2) % (2.0 * math.pi)),
        "nothing": np.zeros(20_000),
    }
    debug = np.column_stack([traces[name], np.zeros((20_000, 3))])
    assert excitation(debug, time_s, SWEEP) is None


def test_the_sweep_is_that_of_the_header() -> None:
    """In tenths of a hertz."""
    assert sweep_of(TEXTS) == SWEEP
    assert settings_of(TEXTS)["chirp_time_seconds"] == SWEEP.duration_s


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("value", ["0", "-3", "99999999999", "x", ""])
def test_a_damaged_sweep_is_none(name: str, value: str) -> None:
    """A header may hold anything."""
    assert sweep_of(TEXTS | {name: value}) is None
