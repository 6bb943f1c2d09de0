"""A motor that loses thrust in mid-flight: one model of two vehicles, and the page of the model says so."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs import analyze
from quadid_logs.data.result import Result
from quadid_logs.simulator import Scenario, fly, manoeuvres, plan_flights
from quadid_logs.simulator.airframes import quad_x
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.vocabulary import AXES, ON_AXIS

pytestmark = pytest.mark.usefixtures("verdicts_only")


def flown(**effects: object) -> tuple[Result, np.ndarray]:
    """Analyze a flight of multisines in nearly calm air; its control effectiveness before any fault."""
    scenario = Scenario(
        name="fault",
        sentence="",
        airframe=quad_x,
        manoeuvre=manoeuvres.multisine,
        duration_s=30.0,
        gyro_filter_hz=60.0,
        logging=Logging(rate_hz=200.0),
        effects=Effects(disturbance_rad_s2=(0.1, 0.1, 0.03), **effects),  # type: ignore[arg-type]
    )
    (setup,) = plan_flights(scenario, seed=3, duration_s=30.0, rate_hz=200.0, autopilot="ardupilot")
    record = fly(setup)
    truth = flight_truth((record,), scenario=scenario.name, boot_s=scenario.logging.boot_s)
    log = log_flights((record,), scenario.logging)
    return analyze(log), np.diagonal(truth["models"]["damped"]["B"])[:3]


@pytest.fixture(scope="module")
def weakened() -> tuple[Result, np.ndarray]:
    """A flight of which one motor gives 80 % from the middle on."""
    return flown(motor_fault=1, motor_effectiveness=0.8)


@pytest.mark.thorough
def test_each_interval_holds_the_vehicle_before_and_after(weakened: tuple[Result, np.ndarray]) -> None:
    """A quarter of every torque is this motor's: 5 % are lost."""
    result, gains = weakened
    model = result.identification.recommended
    assert model is not None
    for axis, before in zip(AXES, gains, strict=True):
        low, high = model.entries[ON_AXIS[axis]].ci95
        assert low < 0.95 * before, axis
        assert high > before, axis


@pytest.mark.thorough
def test_every_axis_is_called_a_caution_for_it(weakened: tuple[Result, np.ndarray]) -> None:
    """One model describes neither vehicle."""
    result, _ = weakened
    (found,) = (each for each in result.diagnosis.findings if each.code == "QL536")
    assert found.level == "warning"
    assert [found.evidence[axis] for axis in AXES] == pytest.approx([0.95] * 3, abs=0.01)
    assert all("QL536" in result.diagnosis.axes[axis].reasons for axis in AXES)


@pytest.mark.thorough
def test_margins_are_drawn_from_both(weakened: tuple[Result, np.ndarray]) -> None:
    """What margins are drawn from is as wide as what is told."""
    result, _ = weakened
    model = result.identification.recommended
    assert model is not None
    assert model.posterior is not None
    for number, axis in enumerate(AXES):
        entry = model.entries[ON_AXIS[axis]]
        drawn = 1.96 * np.sqrt(model.posterior.covariance[number, 0, 0])
        assert drawn > 0.05 * entry.value
        assert drawn == pytest.approx(max(abs(end - entry.value) for end in entry.ci95), rel=0.2)


@pytest.mark.thorough
def test_a_flight_of_whole_motors_says_nothing_of_it() -> None:
    """The same flight without the fault."""
    result, _ = flown()
    assert "QL536" not in {each.code for each in result.diagnosis.findings}
