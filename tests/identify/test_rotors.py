"""The lag on the speed of the rotors."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.model import Model
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.rotors import Rotors, lagged_speeds
from quadid_logs.load import prepare
from quadid_logs.simulator import Simulation, simulate

from .structures import ACTUATED
from .vehicles import QUAD, fly, multisine


@pytest.fixture(scope="module")
def flight() -> Simulation:
    """Rotors that speed up in 45 ms and slow down in 70 ms."""
    return simulate("slow-motors", seed=5, duration_s=40.0)


@pytest.fixture(scope="module")
def slow_motors(flight: Simulation) -> Model:
    found = identify(cut(prepare(flight.log), AlignSettings()), IdentifySettings(), ACTUATED).recommended
    assert found is not None
    return found


@pytest.mark.thorough
def test_rotors_that_spin_up_and_down_at_different_rates_are_found_so(slow_motors: Model) -> None:
    """Both time constants within 2 ms."""
    actuator = slow_motors.actuator
    assert actuator is not None
    assert actuator.acts_on == "rotor speed"
    assert actuator.lag_up_s == pytest.approx(0.045, abs=0.002)
    assert actuator.lag_down_s == pytest.approx(0.070, abs=0.002)


@pytest.mark.thorough
def test_asymmetric_rotors_do_not_bias_the_effectiveness(flight: Simulation, slow_motors: Model) -> None:
    """A lag on the torque would leave 1.6 %."""
    truth = np.array(flight.truth["models"]["damped"]["B"])
    np.testing.assert_allclose(np.diag(slow_motors.B), np.diag(truth), rtol=0.005)


def test_without_known_rotors_the_lag_acts_on_the_torque() -> None:
    """A table of moments says nothing of rotors."""
    model = identify(fly(QUAD, multisine(20.0), feedback=8.0), IdentifySettings(), ACTUATED).recommended
    assert model is not None
    assert model.actuator is not None
    assert model.actuator.acts_on == "torque"
    assert np.isnan(model.actuator.lag_up_s)


@pytest.mark.parametrize("rotors", [Rotors(0.03, 0.05), Rotors(0.05, 0.03), Rotors(0.04, 0.04)])
def test_intervals_side_by_side_give_the_recursion_of_one_after_the_other(rotors: Rotors) -> None:
    """To a thousandth of the step, the start forgotten; whichever direction is the quicker one."""
    rng = np.random.default_rng(1)
    target = 1.0 + np.cumsum(0.02 * rng.standard_normal((9000, 2)), axis=0)
    period_s = 0.0025
    up, down = 1.0 - np.exp(-period_s / rotors.up_s), 1.0 - np.exp(-period_s / rotors.down_s)
    speed, expected = target[0].copy(), np.empty_like(target)
    for row, wanted in enumerate(target):
        gap = wanted - speed
        speed = speed + gap * np.where(gap > 0.0, up, down)
        expected[row] = speed
    np.testing.assert_allclose(lagged_speeds(target, period_s, rotors), expected, atol=1e-3)


def test_mean_and_asymmetry_make_the_two_time_constants() -> None:
    """Up over down is the exponential, their mean is the lag."""
    rotors = Rotors.of(0.05, np.log(0.6))
    assert 0.5 * (rotors.up_s + rotors.down_s) == pytest.approx(0.05)
    assert rotors.log_asymmetry == pytest.approx(np.log(0.6))
