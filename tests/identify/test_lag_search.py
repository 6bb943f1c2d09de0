"""The search for lag and delay: what it is given, and that it never makes things worse."""

from __future__ import annotations

import dataclasses
import gc
import weakref
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Actuator
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.identify import identify, thrust_curve
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.actuator_model import FitProblem, _Search
from quadid_logs.identify.design import build_design
from quadid_logs.identify.structures import DAMPED, Structure
from quadid_logs.load import prepare
from quadid_logs.simulator import Scenario, fly, plan_flights
from quadid_logs.simulator.airframes import quad_x
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.manoeuvres import doublets
from quadid_logs.simulator.sweep import Sweep, sweeps_in_turn
from quadid_logs.simulator.truth import flight_truth
from tests.marks import thorough

from .vehicles import QUAD, multisine
from .vehicles import fly as fly_plainly

START = np.array([0.025, 0.007])


@cache
def plainly() -> FlightData:
    """Roll is behind a lag of 30 ms and a delay of 5 ms, and so is pitch."""
    return fly_plainly(QUAD, multisine(15.0))


def search(structure: Structure, axes: tuple[int, ...]) -> _Search:
    """Return the search over one flight, with every column that may be used."""
    design = build_design(plainly(), 5.0, [structure])
    assert design is not None
    kept = np.ones((len(structure.targets), len(structure.columns)), dtype=np.bool_)
    if structure is not DAMPED:
        kept[:2, len(DAMPED.terms)] = False
    return _Search(FitProblem(design.high_passed(0.3), structure, kept, axes), None)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_reaction_of_the_rotors_in_yaw_changes_no_other_axis_search(axis: int) -> None:
    """It took the place of the roll torque: a start that explains all led to 60 ms and R2 of 0.2."""
    lag_s, delay_s = search(DAMPED.with_reaction(), (axis,)).least(START)[0]
    assert lag_s == pytest.approx(QUAD.lag_s, abs=0.001)
    assert delay_s == pytest.approx(QUAD.delay_s, abs=0.001)


def test_a_search_that_ends_with_more_error_than_it_began_with_returns_its_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever happens to it on the way."""
    made = search(DAMPED, (0, 1))
    monkeypatch.setattr(_Search, "_solve", lambda *_: np.array([0.2, 0.06]))
    found, loss = made.least(START)
    np.testing.assert_array_equal(found, START)
    # The same sum, added up in another order on some processors.
    assert loss == pytest.approx(made._loss(START), rel=1e-12)


@pytest.mark.parametrize("ended", [(0.03, 0.06), (0.25, 0.005)])
def test_instruments_as_few_as_unknowns_lead_to_no_bound(
    ended: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The largest lag or delay that is tried is none that was found."""
    data = dataclasses.replace(
        plainly(),
        segments=tuple(
            dataclasses.replace(each, reference=each.torque.copy()) for each in plainly().segments
        ),
    )
    design = build_design(data, 5.0, [DAMPED])
    assert design is not None
    kept = np.ones((len(DAMPED.targets), len(DAMPED.columns)), dtype=np.bool_)
    made = _Search(FitProblem(design.high_passed(0.3), DAMPED, kept, (0, 1)), None)
    assert made.project.n_instruments
    monkeypatch.setattr(_Search, "_solve", lambda *_: np.array(ended))
    np.testing.assert_array_equal(made.jackknifed(START), START)
    monkeypatch.setattr(_Search, "_solve", lambda *_: np.array([0.03, 0.004]))
    np.testing.assert_array_equal(made.jackknifed(START), [0.03, 0.004])


@pytest.mark.parametrize(("lag_s", "delay_s"), [(0.25, 0.005), (0.03, 0.06)])
def test_no_lag_or_delay_is_identified_at_the_end_of_the_search(lag_s: float, delay_s: float) -> None:
    """However narrow its interval: the error has no minimum there."""

    def actuator(lag_s: float, delay_s: float) -> Actuator:
        return Actuator(
            lag_s=lag_s,
            lag_ci95_s=(0.99 * lag_s, 1.01 * lag_s),
            delay_s=delay_s,
            delay_ci95_s=(0.99 * delay_s, 1.01 * delay_s),
            acts_on="torque",
            lag_grid_s=np.array([0.0, 0.1, 0.25]),
            delay_grid_s=np.array([0.0, 0.03, 0.06]),
            loss=np.zeros((3, 3)),
        )

    inside, ended = actuator(0.03, 0.005), actuator(lag_s, delay_s)
    assert inside.lag_identifiable
    assert inside.delay_identifiable
    assert not ended.lag_identifiable
    assert not ended.delay_identifiable


class FlatteningOut:
    """Equations of the thrust curve's search whose error flattens out: its minimum is at 3."""

    def __init__(self, _: object, point: thrust_curve._Point) -> None:
        off, of_axes = point.shift - 3.0, np.ones((50, 3))
        self.fixed = np.zeros((50, 0))
        self.shared = {"expo": of_axes / (1.0 + off**2), "delay": np.zeros((50, 3))}
        self.residual = self.explained = -np.arctan(off) * of_axes


def test_a_step_of_the_thrust_curves_search_that_leads_uphill_is_halved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Full steps go ever farther from the minimum."""
    monkeypatch.setattr(thrust_curve, "_Linear", FlatteningOut)
    nothing: Any = None
    start = ActuatorFit(0.03, 0.005, np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    made = thrust_curve._Search(design=nothing, described=nothing, axes=[0, 1], start=start, by_expo=nothing)
    point, _ = made.least(on_rotors=False)
    assert point.shift == pytest.approx(3.0, abs=0.01)


def sweep(time_s: FloatArray, rng: np.random.Generator) -> Any:
    """Sweep roll once from 0.5 to 8 Hz, as `plan` says."""
    return sweeps_in_turn(time_s, rng, sweeps=[(0, Sweep(magnitude=0.05))], pause_s=6.0)


def roll_doublets(time_s: FloatArray, rng: np.random.Generator) -> Any:
    """Fly doublets of a third of the stick in roll alone, as `plan` says."""
    both = doublets(time_s, rng, amplitude_rad_s=0.7, pulse_s=0.4)
    return dataclasses.replace(both, rate_rad_s=both.rate_rad_s * [1.0, 0.0, 0.0])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("manoeuvre", "seed", "gust_rad_s2"), [(sweep, 3, 0.0), thorough(roll_doublets, 1, 0.15)]
)
def test_a_flight_that_moves_one_axis_finds_its_lag_and_its_effectiveness(
    manoeuvre: Callable[..., Any], seed: int, gust_rad_s2: float
) -> None:
    """With noise alone where yaw is still, two of ten sweeps were refused with R2 of 0.03."""
    scenario = Scenario(
        name="one axis",
        sentence="Roll alone.",
        airframe=quad_x,
        manoeuvre=manoeuvre,
        duration_s=58.0,
        effects=Effects(disturbance_rad_s2=(gust_rad_s2,) * 3),
    )
    (setup,) = plan_flights(
        scenario, seed=seed, duration_s=scenario.duration_s, rate_hz=scenario.logging.rate_hz
    )
    record = fly(setup)
    truth = flight_truth((record,), scenario=scenario.name, boot_s=31.0)
    data = cut(prepare(log_flights((record,), scenario.logging)), AlignSettings())
    model = identify(data, IdentifySettings()).recommended
    assert model is not None
    assert model.actuator is not None
    assert model.actuator.lag_s == pytest.approx(truth["actuator"]["lag_s"], rel=0.1)
    assert model.actuator.delay_s < 0.01
    assert model.B[0, 0] == pytest.approx(truth["models"]["damped"]["B"][0][0], rel=0.03)


def test_a_search_that_is_done_leaves_nothing_in_memory() -> None:
    """Ten minutes of flight are 130 MB in it, which a cycle of references would keep."""
    done = search(DAMPED, (0,))
    done.least(START)
    remembered = weakref.ref(done)
    gc.disable()
    try:
        del done
        assert remembered() is None
    finally:
        gc.enable()
