"""Filters beside an axis without a model: what they may change of its loop, and make of its noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from quadid_logs.control.axis_without_model import AxisWithoutModel
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.control.torque_noise import Spectrum
from quadid_logs.data.closed_loop import LoopMargins
from quadid_logs.data.controller import AxisController
from quadid_logs.simulator.true_loop import true_controller, true_plant
from study import filters as study
from study.tuning import resting_truth

YAW = 2
#: Of white noise, so many samples at each step of the loop.
N_SAMPLES = 40_000


@pytest.fixture(scope="module")
def setup() -> Any:
    """Return a vehicle with the gyro's low-pass at 40 Hz and no notch."""
    return _behind(40.0)


@cache
def _behind(gyro_hz: float) -> Any:
    """Return the vehicle with the gains that flew, and another low-pass of the gyro."""
    scenario, setting, _ = study.draw_vehicle(1, 0)
    return study._setup(scenario, setting._replace(gyro_hz=gyro_hz, notch=None), 1)


def _controller(setup: Any, values: Mapping[str, float]) -> AxisController:
    return true_controller(_behind(values.get("GYRO", 40.0)), YAW, study.rotors_hz(setup))


def _axis(setup: Any, crossover_hz: float, rows: Spectrum | None = None) -> AxisWithoutModel:
    rng = np.random.default_rng(1)
    torque = np.zeros((N_SAMPLES, 3))
    torque[:, YAW] = rng.normal(scale=0.01, size=N_SAMPLES)
    period_s = 1.0 / setup.loop_hz
    data = SimpleNamespace(
        segments=[SimpleNamespace(command=None, planned=False, torque=torque)], sample_period_s=period_s
    )
    case: Any = SimpleNamespace(axis="yaw", data=data, rows=rows, log_hz=setup.loop_hz)
    return AxisWithoutModel(
        case, _controller(setup, {}), lambda values: _controller(setup, values), crossover_hz
    )


def _missing(setup: Any, gyro_hz: float, crossover_hz: float = 3.0) -> float:
    found = _axis(setup, crossover_hz).filtered({"GYRO": gyro_hz})
    assert found is not None
    return found.quick({}).missing


def test_a_low_pass_may_take_no_more_than_a_flight_would_tell(setup: Any) -> None:
    """A Butterworth low-pass of the second order turns by sqrt(2) f / f_c: 1.7 and 5.2 degrees more."""
    assert _missing(setup, 35.0, crossover_hz=6.0) == 0.0
    assert _missing(setup, 28.0, crossover_hz=6.0) > 0.0


def test_what_a_low_pass_takes_counts_up_to_the_highest_crossover(setup: Any) -> None:
    assert _missing(setup, 28.0, crossover_hz=2.0) == 0.0


def test_a_low_pass_may_open(setup: Any) -> None:
    assert _missing(setup, 80.0, crossover_hz=1.0) == 0.0


def test_no_loop_is_raised_where_it_may_be_closed(setup: Any) -> None:
    """A loop that crosses over at 6 Hz is not small yet at the cut-off."""
    assert _missing(setup, 80.0, crossover_hz=6.0) > 0.0


@pytest.mark.parametrize("gyro_hz", [30.0, 80.0])
def test_noise_is_what_the_controller_makes_of_it(setup: Any, gyro_hz: float) -> None:
    """Far above the crossover a command's noise goes as the low-pass: white in the command as flown."""
    found = _axis(setup, 3.0).filtered({"GYRO": gyro_hz})
    assert found is not None
    frequency_hz = np.linspace(15.0, 0.499 * setup.loop_hz, 4000)
    low_pass = [1.0 / (1.0 + (frequency_hz / one) ** 4) for one in (gyro_hz, 40.0)]
    expected = math.sqrt(float(np.mean(low_pass[0] / low_pass[1])))
    assert found.quick({}).noise == pytest.approx(expected, rel=0.2)


def test_noise_stands_where_faster_rows_of_the_log_show_it(setup: Any) -> None:
    """The data hold white noise, and the rows a line at 150 Hz."""
    frequency_hz = 0.25 * np.arange(1.0, 2001.0)
    line = Spectrum(frequency_hz, np.where(frequency_hz == 150.0, 1.0, 0.0))
    found = _axis(setup, 3.0, line).filtered({"GYRO": 30.0})
    assert found is not None
    # Far above both cut-offs a low-pass of the second order lets pass by their square.
    assert found.quick({}).noise == pytest.approx((30.0 / 40.0) ** 2, rel=0.05)


@pytest.mark.parametrize("gyro_hz", [30.0, 80.0])
def test_the_true_loop_keeps_its_margins_behind_filters_that_are_allowed(setup: Any, gyro_hz: float) -> None:
    plant = true_plant(setup, resting_truth(setup), YAW)
    old, new = (
        scaled_loops(_controller(setup, {"GYRO": one}), plant, np.inf).margins() for one in (40.0, gyro_hz)
    )
    assert _missing(setup, gyro_hz, crossover_hz=1.5) == 0.0
    before, after = _figures(old), _figures(new)
    assert before["crossover_hz"] < 1.5
    assert after["phase_margin_deg"] > before["phase_margin_deg"] - 3.0
    assert after["gain_margin_db"] > before["gain_margin_db"] - 2.0


def _figures(margins: LoopMargins) -> dict[str, float]:
    """Return the worst margins of both loops, and their highest crossover."""
    found: dict[str, list[float]] = {}
    for loop in (margins.rate, margins.full):
        for name in ("crossover_hz", "phase_margin_deg", "gain_margin_db"):
            value = getattr(loop, name)
            found.setdefault(name, []).append(value.value)
    return {name: max(each) if name == "crossover_hz" else min(each) for name, each in found.items()}
