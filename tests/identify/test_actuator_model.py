"""Lag, delay and rotors together, and what else the torque may have been."""

from __future__ import annotations

import dataclasses
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import NO_GYRO_FILTER, GyroFilter, Notch
from quadid_logs.data.model import Model
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.identify import actuator_model, identify
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.actuator_model import (
    ActuatorModel,
    FitProblem,
    _Scores,
    _Search,
    _with_asymmetry,
    free_actuator_model,
)
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.structures import DAMPED, STRUCTURES, Structure
from quadid_logs.identify.torque_errors import battery_errors, sampling_errors
from quadid_logs.load import prepare
from quadid_logs.maths.band import angular_frequency, notch_response
from quadid_logs.simulator import SCENARIOS, fly, plan_flights
from quadid_logs.simulator.airframes import Battery
from quadid_logs.simulator.closed_loop import Noise
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.manoeuvres import doublets
from quadid_logs.simulator.scenarios import Scenario, slow_motors, with_products
from quadid_logs.simulator.truth import flight_truth

from .structures import ACTUATED
from .vehicles import QUAD, multisine
from .vehicles import fly as fly_plainly

_SILENT = Noise(gyro_rad_s_per_rthz=1e-7, gyro_bias_rad_s=(0.0, 0.0, 0.0), gyro_resolution_rad_s=1e-7)


def flown(scenario: Scenario, autopilot: str = "ardupilot") -> tuple[FlightData, dict[str, Any]]:
    """Fly a scenario, and return what `identify` gets, and the truth."""
    (setup,) = plan_flights(
        scenario,
        seed=7,
        duration_s=scenario.duration_s,
        rate_hz=scenario.logging.rate_hz,
        autopilot=autopilot,
    )
    record = fly(setup)
    log = prepare(log_flights((record,), scenario.logging))
    return cut(log, AlignSettings()), flight_truth((record,), scenario=scenario.name, boot_s=31.0)


def recommended(data: FlightData, *structures: Structure) -> Model:
    """Return the recommended model; of these structures, or of all that are ever recommended."""
    model = identify(data, IdentifySettings(), structures or ACTUATED).recommended
    assert model is not None
    return model


@pytest.fixture(scope="module")
def clean() -> tuple[Model, dict[str, Any]]:
    """Rotors that lag asymmetrically, without noise, and with a battery that does not run down."""
    steady = Battery(resistance_ohm=1e-6, capacity_a_s=1e9)
    scenario = dataclasses.replace(
        SCENARIOS["sysid-quad-x"],
        airframe=lambda: dataclasses.replace(slow_motors(), battery=steady),
        noise=_SILENT,
        duration_s=40.0,
        gyro_filter_hz=20.0,
    )
    data, truth = flown(scenario)
    return recommended(data, DAMPED), truth


def test_without_noise_nothing_is_left_of_lag_and_delay(
    clean: tuple[Model, dict[str, Any]],
) -> None:
    """Lag to three thousandths, delay to 0.1 ms: found one after the other they stop short by per cents."""
    model, truth = clean
    assert model.actuator is not None
    assert model.actuator.lag_s == pytest.approx(truth["actuator"]["lag_s"], rel=3e-3)
    # The simulator's digital filter is 0.09 ms quicker than the analogue one that the fit knows.
    known_s = np.sqrt(2.0) / (2.0 * np.pi * 20.0)
    assert model.actuator.delay_s + known_s == pytest.approx(truth["actuator"]["delay_s"], abs=1e-4)


def test_without_noise_damping_is_found_to_half_a_per_cent(
    clean: tuple[Model, dict[str, Any]],
) -> None:
    """A lag that is off by a per cent would be worth several per cent of damping."""
    model, truth = clean
    true = np.array(truth["models"]["damped"]["A"])[:, 3:6]
    columns = [model.regressors.index(name) for name in ("p", "q", "r")]
    np.testing.assert_allclose(np.diag(model.A[:, columns]), np.diag(true), rtol=0.005)


@pytest.mark.thorough
def test_doublets_in_turn_claim_no_wrong_gyroscopic_term() -> None:
    """Products of inertia and the gyro's cross talk made claims of seven to twenty deviations' error."""
    scenario = dataclasses.replace(
        SCENARIOS["doublets"],
        airframe=with_products,
        manoeuvre=partial(doublets, pulse_s=0.2),
        noise=Noise(gyro_cross=(0.004, -0.006, 0.005, 0.007, -0.004, 0.006)),
        duration_s=60.0,
    )
    data, truth = flown(scenario)
    found = next(model for model in identify(data, IdentifySettings()).models if model.structure == "damped")
    stated = truth["models"]["damped"]
    for parameter in found.parameters:
        if parameter.identifiable and parameter.regressor in ("qr", "pr", "pq"):
            row = stated["targets"].index(parameter.target)
            true = stated["A"][row][stated["regressors"].index(parameter.regressor)]
            low, high = parameter.ci95
            # Twice the interval: five times in a hundred a right one misses the truth.
            assert low - 0.5 * (high - low) <= true <= high + 0.5 * (high - low)


@pytest.fixture(scope="module")
def slow_log() -> FlightData:
    """Sharp doublets in a log that holds every fourth step of the loop."""
    scenario = dataclasses.replace(
        SCENARIOS["doublets"], duration_s=60.0, logging=Logging(rate_hz=100.0), noise=_SILENT
    )
    return flown(scenario, "px4")[0]


@pytest.mark.thorough
def test_a_log_with_each_step_of_the_loop_is_known_as_such(slow_log: FlightData) -> None:
    """By the loop's rate among the parameters."""
    data, _ = flown(dataclasses.replace(SCENARIOS["doublets"], duration_s=30.0), "px4")
    assert data.input is not None
    assert data.input.every_step
    assert slow_log.input is not None
    assert not slow_log.input.every_step


@pytest.mark.thorough
def test_what_the_torque_was_between_the_samples_widens_the_interval(slow_log: FlightData) -> None:
    """Of the same flight, taken for one with each step of the loop, damping would be claimed too well."""
    assert slow_log.input is not None
    # Without commands: what answers to them tell does not rest on each step of the torque.
    slow_log = dataclasses.replace(
        slow_log, segments=tuple(dataclasses.replace(each, command=None) for each in slow_log.segments)
    )
    assert slow_log.input is not None
    taken_for_whole = dataclasses.replace(
        slow_log, input=dataclasses.replace(slow_log.input, every_step=True)
    )
    width, narrow = (
        [p.ci95[1] - p.ci95[0] for p in recommended(data, DAMPED).parameters if p.regressor == p.target[0]]
        for data in (slow_log, taken_for_whole)
    )
    assert (np.array(width) > 1.2 * np.array(narrow)).any()
    assert (np.array(width) >= 0.99 * np.array(narrow)).all()


@pytest.fixture
def steady() -> Design:
    """A flight whose torque is one unit throughout."""
    data = fly_plainly(QUAD, multisine(12.0))
    design = build_design(
        dataclasses.replace(
            data,
            segments=tuple(dataclasses.replace(s, torque=np.ones_like(s.torque)) for s in data.segments),
        ),
        5.0,
    )
    assert design is not None
    return design


def test_every_second_sample_of_a_steady_torque_is_as_good_as_all(steady: Design) -> None:
    """No error, for nothing happens between the samples."""
    for error in sampling_errors(steady):
        np.testing.assert_allclose(error.behind(0.0, 0.0), 0.0, atol=1e-12)


def test_a_battery_takes_at_the_end_what_it_gave_at_the_beginning(steady: Design) -> None:
    """Of a steady torque: minus and plus the same, and nothing on the other axes."""
    roll = battery_errors(steady)[0].behind(0.0, 0.0)
    np.testing.assert_allclose(roll[:, 1:], 0.0, atol=1e-15)
    (chunk,) = steady.chunks
    middle_s = chunk.time_s.mean()
    np.testing.assert_allclose(roll[:, 0], 0.01 / 60.0 * (steady.time_s - middle_s), atol=1e-4)


@pytest.mark.thorough
def test_a_known_notch_is_no_part_of_the_delay() -> None:
    """The delay of the vehicle is found, with a notch of 1 ms in the path of the gyro."""
    data = fly_plainly(QUAD, multisine(30.0), feedback=8.0)
    notch = Notch(frequency_hz=60.0, inverse_q=0.8, depth=0.01)
    (segment,) = data.segments
    s = angular_frequency(segment.n_samples, data.sample_period_s)
    response = notch_response(s, *notch)[:, np.newaxis]
    rate = np.fft.irfft(np.fft.rfft(segment.body_rate_rad_s, axis=0) * response, segment.n_samples, axis=0)
    notched = dataclasses.replace(
        data,
        segments=(dataclasses.replace(segment, body_rate_rad_s=rate),),
        gyro_filter=GyroFilter(notches=(notch,)),
    )
    untold = dataclasses.replace(notched, gyro_filter=NO_GYRO_FILTER)
    delays = [
        model.actuator.delay_s + model.actuator.lag_s
        for model in (recommended(one, DAMPED) for one in (data, notched, untold))
        if model.actuator is not None
    ]
    assert delays[1] == pytest.approx(delays[0], abs=1e-4)
    # Not known, it would be taken for delay: then the test above would prove nothing.
    assert delays[2] - delays[0] == pytest.approx(0.99 * 0.8 / (2.0 * np.pi * 60.0), abs=3e-4)


def _shaken(data: FlightData, seed: int) -> FlightData:
    """Add what gusts of 3 rad/s² that last a fifth of a second make of the rates."""
    (segment,) = data.segments[:1]
    rng, period_s = np.random.default_rng(seed), data.sample_period_s
    kept = np.exp(-period_s / 0.2)
    gusts = lfilter(
        [3.0 * np.sqrt(1.0 - kept**2)], [1.0, -kept], rng.standard_normal((segment.n_samples, 3)), axis=0
    )
    rates = segment.body_rate_rad_s + np.cumsum(gusts, axis=0) * period_s
    return dataclasses.replace(data, segments=(dataclasses.replace(segment, body_rate_rad_s=rates),))


@pytest.fixture(scope="module")
def sticks() -> FlightData:
    """A pilot moves the sticks, in calm air; the rotors are symmetric."""
    data, _ = flown(dataclasses.replace(SCENARIOS["pilot-sticks"], duration_s=30.0))
    return data


@pytest.mark.thorough
def test_gusts_do_not_pass_for_asymmetric_rotors(sticks: FlightData) -> None:
    """A few follow the instruments by chance, and are alike for a while."""
    (structure,) = (each for each in STRUCTURES if each.name == "damped")
    kept = np.ones((len(structure.targets), len(structure.columns)), dtype=np.bool_)
    for seed in range(4):
        shaken = _shaken(sticks, seed)
        design = build_design(shaken, 5.0, [structure])
        assert design is not None
        search = _Search(FitProblem(design.high_passed(0.3), structure, kept, (0, 1)), shaken.input)
        found, _ = search.least(np.array([0.03, 0.005]))
        assert not search.scores(np.append(found, 0.0)).shown


@pytest.fixture(scope="module")
def unbraked() -> tuple[Model, dict[str, Any]]:
    """A pilot moves the sticks of rotors that take five times as long to slow down as to speed up."""
    scenario = dataclasses.replace(
        SCENARIOS["pilot-sticks"], duration_s=30.0, airframe=slow_motors, effects=Effects(spin_down_ratio=3.0)
    )
    data, truth = flown(scenario)
    return recommended(data, DAMPED), truth


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rotors_that_slow_down_by_drag_alone_do_not_bias_the_effectiveness(
    unbraked: tuple[Model, dict[str, Any]], axis: int
) -> None:
    """Searched for up to a factor of three only, they took 5 % from roll and pitch."""
    model, truth = unbraked
    true = truth["models"][model.structure]["B"][axis][axis]
    assert model.B[axis, axis] == pytest.approx(true, rel=0.02)


def scores(by_cluster: list[float], *, information: float, squares: float = 1.0) -> _Scores:
    return _Scores(np.array(by_cluster), information=information, squares=squares, limit=2.7)


#: One turn made nearly all of the error of asymmetric rotors: with it in the variance the score is chance.
_ONE_TURN = [9.0, 0.3, 0.2, 0.4]


def test_asymmetry_that_one_turn_shows_is_not_seen_by_its_score() -> None:
    """Its own error is in the variance that its score is held against."""
    assert not scores(_ONE_TURN, information=100.0).shown


def test_asymmetry_that_one_turn_shows_is_far_from_none_by_what_it_leaves() -> None:
    """Three axes were 5 to 7 % low, outside their intervals, for want of this."""
    assert scores([0.1, -0.1, 0.1, 0.0], information=2.0).deviates(-1.0)


def test_an_asymmetry_within_what_it_leaves_is_not_far_from_none() -> None:
    """Instruments that follow gusts make one of any size."""
    assert not scores([5.0, -4.0, 3.0, -4.0], information=2.0).deviates(-1.0)


@pytest.mark.parametrize(("better", "taken"), [(0.9, True), (0.5, False)])
def test_asymmetry_that_halves_the_error_is_taken_though_no_score_shows_it(
    better: float, taken: bool
) -> None:
    """Far from none by what it leaves, too; less of the error is what gusts make."""
    symmetric, asymmetric = np.array([0.05, 0.01]), np.array([0.05, 0.01, -1.0])
    at = {2: scores(_ONE_TURN, information=100.0, squares=10.0), 3: scores([0.1, -0.1], information=2.0)}
    search = SimpleNamespace(
        scores=lambda x: at[2 if x[2] == 0.0 else 3], least=lambda _: (asymmetric, -1.0 - better)
    )
    found, _ = _with_asymmetry(cast("Any", search), symmetric, -1.0, 0.01)
    assert (found is asymmetric) == taken


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_asymmetry_is_searched_for_on_either_side(side: float) -> None:
    """Begun at none, a search ended on the wrong side: up four times as slow as down, and gains 9 % low."""

    def least(start: FloatArray) -> tuple[FloatArray, float]:
        here = float(np.sign(start[2]))
        return np.array([0.05, 0.01, here]), -3.0 if here == side else -2.0

    search = SimpleNamespace(scores=lambda _: scores([5.0, 5.0], information=100.0), least=least)
    found, _ = _with_asymmetry(cast("Any", search), np.array([0.05, 0.01]), -1.0, 0.01)
    assert found[2] == side


def test_an_asymmetry_at_the_end_of_its_search_is_none() -> None:
    """A flown freestyle ended where rotors slow down six times as slowly, a fifth below what is right."""
    ended = np.array([0.016, 0.007, -np.log(6.0)])
    search = SimpleNamespace(
        scores=lambda _: scores([5.0, 5.0], information=100.0), least=lambda _: (ended, -2.0)
    )
    symmetric = np.array([0.007, 0.013])
    found, loss = _with_asymmetry(cast("Any", search), symmetric, -1.0, 0.01)
    assert found is symmetric
    assert loss == -1.0


def test_a_delay_is_set_free_from_a_lag_of_nothing_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """At its bound a lag hid that torque was stamped late: no step led away from either alone."""

    class Stuck:
        project, log_asymmetry = None, 0.0

        def __init__(self, *_: object) -> None: ...

        def least(self, start: FloatArray, **_: object) -> tuple[FloatArray, float]:
            return (start, -2.0) if start[0] > 0.0 else (np.array([0.0, 0.0]), -1.0)

        def jackknifed(self, found: FloatArray, **_: object) -> FloatArray:
            return found

    monkeypatch.setattr(actuator_model, "_Search", Stuck)
    monkeypatch.setattr(actuator_model, "same_loss", lambda *_: 0.01)
    problem = FitProblem(cast("Any", None), DAMPED, np.ones((3, 1), np.bool_), (0,))
    nothing = ActuatorFit(0.0, 0.0, np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    at_bounds = ActuatorModel(nothing, cast("Any", None))
    free = free_actuator_model(problem, at_bounds, None)
    assert free is not None
    assert free.actuator.delay_s < 0.0


def test_a_score_forecasts_what_asymmetry_explains() -> None:
    """The square of the score over the information is what a squared error falls by."""
    assert scores([1.0, 1.0], information=4.0, squares=10.0).explained == pytest.approx(0.1)


def test_a_torque_that_lag_and_delay_hardly_move_is_not_searched_with() -> None:
    """Of a constant torque rounding is left, in a damaged log 1e-123 of it moves: its powers underflow."""
    design, rng = build_design(fly_plainly(QUAD, multisine(10.0)), 5.0), np.random.default_rng(4)
    assert design is not None
    kept = np.ones((len(DAMPED.targets), len(DAMPED.columns)), dtype=np.bool_)
    search = _Search(FitProblem(design.high_passed(0.3), DAMPED, kept, (0,)), None)
    still, by_lag, by_delay = rng.standard_normal((3, search._torque(0.0, 0.0, 0.0).shape[0], 3))
    still[::2], by_lag[1::2], by_delay[1::2] = 0.0, 0.0, 0.0

    def hardly_moved(lag_s: float, delay_s: float, _log_asymmetry: float) -> FloatArray:
        return np.asarray(still + 1e-123 * (lag_s * by_lag + delay_s * by_delay))

    search._torque = search._torque_at = hardly_moved  # type: ignore[method-assign,assignment]
    start = np.array([0.01, 0.01])
    assert search.least(start)[0] is start


@pytest.mark.thorough
def test_in_calm_air_lag_and_delay_stay_where_all_instruments_see_them(sticks: FlightData) -> None:
    """Nothing is there that an instrument could follow by chance."""
    (structure,) = (each for each in STRUCTURES if each.name == "damped")
    kept = np.ones((len(structure.targets), len(structure.columns)), dtype=np.bool_)
    design = build_design(sticks, 5.0, [structure])
    assert design is not None
    search = _Search(FitProblem(design.high_passed(0.3), structure, kept, (0, 1)), sticks.input)
    found, _ = search.least(np.array([0.03, 0.005]))
    np.testing.assert_allclose(search.jackknifed(found), found, atol=1e-3)
    moved = np.add(found, (0.004, -0.002))
    np.testing.assert_allclose(search.jackknifed(moved), found, atol=1e-3)
