"""Noise in the controller's output: size and source are those that were put in, and the loop makes none."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align.clock import find_clock
from quadid_logs.arrays import FloatArray
from quadid_logs.data.health import CommandNoise
from quadid_logs.data.log import ControllerTerms, Rows, Signal
from quadid_logs.health.command_noise import find_command_noise
from tests.health.flights import coloured, grid, series

RATE_HZ = 1000.0


def noise_of(
    output: FloatArray, rate_hz: float = RATE_HZ, terms: dict[str, FloatArray] | None = None
) -> CommandNoise | None:
    """Return what is found in a flight of one minute; terms of roll, each of shape (n_samples,)."""
    t = grid(rate_hz)
    rows = Rows(t, np.arange(t.size))
    clock = find_clock([Signal(name="torque_command", rows=rows, values=output, source="made")])
    logged = () if terms is None else (ControllerTerms(axis="roll", rows=rows, values=terms),)
    return find_command_noise(series("torque_command", t, output), logged, clock, ((t[0], t[-1]),))


def white(rms: float, seed: int = 0, columns: int = 3) -> FloatArray:
    """Return white noise of one minute, shape (n_samples, columns)."""
    return rms * np.random.default_rng(seed).standard_normal((grid(RATE_HZ).size, columns))


def test_the_size_is_that_of_the_noise_above_40_hz() -> None:
    """White noise up to 500 Hz has 92 % of its power there."""
    found = noise_of(white(0.02))
    assert found is not None
    for axis in ("roll", "pitch", "yaw"):
        assert found.axes[axis].rms.value == pytest.approx(0.02 * np.sqrt(460.0 / 500.0), rel=0.03)


def test_what_the_loop_does_is_no_noise() -> None:
    """Sticks and gusts up to some hertz, and an oscillation at 20 Hz."""
    t = grid(RATE_HZ)
    output = coloured(1, t.size, RATE_HZ)
    output += 0.2 * np.sin(2.0 * np.pi * 20.0 * t)[:, np.newaxis]
    found = noise_of(output + white(0.001))
    assert found is not None
    assert found.level == "normal"
    assert found.axes["roll"].rms.value < 0.01


@pytest.mark.parametrize(("rms", "level"), [(0.04, "normal"), (0.07, "high"), (0.15, "severe")])
def test_more_than_a_twentieth_of_the_range_is_not_normal(rms: float, level: str) -> None:
    """`tune` accepts no more noise either; the worst axis decides."""
    output = white(0.001)
    output[:, 1] = white(rms)[:, 1]
    found = noise_of(output)
    assert found is not None
    assert found.level == level


def test_the_term_that_makes_the_noise_is_named() -> None:
    """D with three times the noise of P has nine tenths of the power; without terms nothing is named."""
    p, d = white(0.01, 1)[:, 0], white(0.03, 2)[:, 0]
    output = np.column_stack([p + d, 0.0 * p, 0.0 * p])
    found, alone = noise_of(output, terms={"P": p, "I": 0.0 * p, "D": d}), noise_of(output)
    assert found is not None
    assert alone is not None
    assert found.axes["roll"].terms["D"].value == pytest.approx(0.03 * np.sqrt(0.92), rel=0.03)
    assert found.axes["roll"].terms["P"].value == pytest.approx(0.01 * np.sqrt(0.92), rel=0.03)
    assert "In roll, D makes most of it (90 %)" in found.sentence
    assert not alone.axes["roll"].terms
    assert "makes most" not in alone.sentence


def test_an_axis_that_is_never_commanded_shows_nothing() -> None:
    """A spectrum of zeros has no logarithm to draw."""
    output = white(0.01)
    output[:, 2] = 0.0
    found = noise_of(output)
    assert found is not None
    assert [*found.axes] == ["roll", "pitch"]


@pytest.mark.parametrize(("rate_hz", "shown"), [(50.0, False), (100.0, False), (200.0, True)])
def test_a_slow_log_shows_no_noise(rate_hz: float, shown: bool) -> None:
    """Half of what is folded down must stand above 40 Hz, or little would be taken for all."""
    output = np.random.default_rng(5).standard_normal((grid(rate_hz).size, 3))
    assert (noise_of(output, rate_hz) is not None) is shown


def test_folded_noise_counts_in_full() -> None:
    """Every fourth row of a loop: the rms of the rows is that of all noise, wherever it stands then."""
    fast = white(0.05)
    found = noise_of(fast[::4], RATE_HZ / 4.0)
    assert found is not None
    assert found.axes["roll"].rms.value == pytest.approx(0.05 * np.sqrt(85.0 / 125.0), rel=0.03)


def test_damaged_terms_cost_only_themselves() -> None:
    """Rows without numbers are left out; terms of nothing but such rows show nothing."""
    p, d = white(0.01, 1)[:, 0], white(0.03, 2)[:, 0]
    output = np.column_stack([p + d, p, p])
    d[100:200] = np.nan
    found, lost = noise_of(output, terms={"P": p, "D": d}), noise_of(output, terms={"D": np.nan * d})
    with np.errstate(over="ignore"):
        beyond = noise_of(output, terms={"P": p, "D": 1e200 * d})
    assert found is not None
    assert lost is not None
    assert found.axes["roll"].terms["D"].value == pytest.approx(0.03 * np.sqrt(0.92), rel=0.05)
    assert lost.axes["roll"].rms == found.axes["roll"].rms
    assert not lost.axes["roll"].terms
    assert beyond is not None
    assert [*beyond.axes["roll"].terms] == ["P"]
