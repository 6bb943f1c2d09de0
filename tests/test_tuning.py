"""The next gains: what is promised is what the file makes, one step at a time, and there is a way back."""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.mavparm import MAVParmDict

import quadid_logs.control.recommend as recommending
from quadid_logs.autopilots import named
from quadid_logs.cli import main
from quadid_logs.control.guard import Case
from quadid_logs.control.loop import close, on_angle, on_rate
from quadid_logs.control.next_flight import of_next_flight
from quadid_logs.control.posterior import draw
from quadid_logs.control.recommend import filter_note
from quadid_logs.control.scaled_loop import scaled_loops, spare
from quadid_logs.data.closed_loop import Estimated, FrameModes, LoopMargins, Margins, Modes, Plant
from quadid_logs.data.controller import AxisController, Replay
from quadid_logs.data.off_nominal import AS_FLOWN
from quadid_logs.data.promise import Decision, Held
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, AxisTuning, GainChange, GainNames, Tuning
from quadid_logs.diagnose.findings import finding
from quadid_logs.promise import checked
from quadid_logs.report.gain_files import gain_files
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.tune_card import flight_files
from quadid_logs.report.tune_page import tune_page
from quadid_logs.report.tune_pictures import rise_words
from quadid_logs.report.tune_view import tune_view
from quadid_logs.report.tuning_json import tuning_text
from quadid_logs.tuning import autotune_forecasts, next_loops, recommend, tuning_of, what_if_grids
from quadid_logs.vocabulary import AXES
from tests.analyses import Analyzed
from tests.control.loop_flights import Vehicle
from tests.marks import thorough, thorough_but
from tests.synthetic_tuning import synthetic_tune_page
from tests.tuned_flights import as_flown, flown, of_axes, with_parameters

pytestmark = pytest.mark.usefixtures("quick_multisines")

ROLL = ("ATC_RAT_RLL_P", "ATC_RAT_RLL_I", "ATC_RAT_RLL_D")
#: A tenth of the command's range on every axis, far above any crossover.
LOUD = 0.1 * np.random.default_rng(1).standard_normal((10_000, 3))
NOWHERE = Provenance(version="0", command="", log_sha256="")


def detuned(factor: float, **gains: float) -> Result:
    """The same vehicle with other gains of roll, which replay as if they had flown."""
    now = flown("ardupilot")
    gains = {**now.log.parameters, **gains}
    parameters = {**gains, **{name: factor * gains[name] for name in ROLL}}
    controllers = named("ardupilot").controllers(now.log, parameters)
    assert controllers is not None
    assert now.closed_loop is not None
    before = now.closed_loop.axes["roll"]
    margins = scaled_loops(controllers.axes["roll"], plants_of(now), before.known_hz).margins()
    roll = replace(before, margins=margins, replay=Replay(relative_rms={}, agrees=True))
    loop = replace(now.closed_loop, controllers=controllers, axes={"roll": roll})
    return replace(now, log=replace(now.log, parameters=parameters), closed_loop=loop)


def plants_of(result: Result) -> Plant:
    model, loop = result.identification.recommended, result.closed_loop
    assert model is not None
    assert model.posterior is not None
    assert loop is not None
    plants = draw(model.posterior, 0, loop.controllers.axes["roll"].period_s)
    assert plants is not None
    return plants


@pytest.fixture(scope="module")
def raised() -> Tuning:
    """Gains that are low for the vehicle."""
    return together(flown("ardupilot"))


@pytest.fixture(scope="module")
def lowered() -> Tuning:
    """Gains that are far too high."""
    return together(detuned(5.0))


@pytest.fixture(scope="module")
def kept() -> Tuning:
    """Gains at their target."""
    target = together(flown("ardupilot")).axes["roll"].gains[ROLL[0]].target
    return together(detuned(target / flown("ardupilot").log.parameters[ROLL[0]]))


def together(result: Result) -> Tuning:
    """One factor on P, I and D of roll, of the vehicle as it flew."""
    return recommend(result, GOOD, ["roll"], apart=False, ranges=AS_FLOWN)


def test_low_gains_are_raised_and_reject_gusts_better(raised: Tuning) -> None:
    """Rejection is what higher gains are for."""
    found = raised.axes["roll"]
    assert found.verdict == "change"
    assert all(one.next > one.now for one in found.changes.values())
    assert found.attitude_error < 0.9


def test_a_raise_keeps_the_limits_in_the_worst_vehicle(raised: Tuning) -> None:
    """97.5 % of the vehicles that the flight allows, not the estimate."""
    found = raised.axes["roll"]
    assert found.next is not None
    assert spare(found.next, GOOD) >= 1.0


def bending(factor: float, *, seen: bool) -> Result:
    """The vehicle with other gains, of which every tenth that the flight allows bends at 20 Hz."""
    result = detuned(factor)
    assert result.closed_loop is not None
    loop = result.closed_loop.axes["roll"]
    plants = plants_of(result)
    number = np.arange(plants.effectiveness.size)
    modes = Modes(
        natural_hz=np.full(number.size, 20.0),
        damping_ratio=np.full(number.size, 0.02),
        # A mode that is seen is one of the estimate, too.
        gain=np.where((number % 10 == 1) | (seen & (number == 0)), 0.3, 0.0),
    )
    frame = FrameModes(
        modes=modes, seen=seen, line_hz=math.nan, line_height=math.nan, absent=0.9, visible_hz=20.0
    )
    roll = replace(loop, frame=frame, plants=plants._replace(modes=modes))
    return replace(result, closed_loop=replace(result.closed_loop, axes={"roll": roll}))


def test_a_frame_that_is_seen_to_bend_lowers_gains_and_one_that_only_may_bend_does_not(kept: Tuning) -> None:
    """Most slow logs rule no bending out: their pilots were told to lower gains with room to spare."""
    factor = kept.axes["roll"].gains[ROLL[0]].now / flown("ardupilot").log.parameters[ROLL[0]]
    seen = together(bending(factor, seen=True)).axes["roll"]
    possible = together(bending(factor, seen=False)).axes["roll"]
    assert seen.direction == "lower"
    assert possible.direction == "keep"
    assert possible.reasons[0].code == "QL645"


def test_gains_that_are_too_high_are_lowered_though_the_frame_may_bend() -> None:
    """By what the flight shows; then as far as the vehicles that bend need, too."""
    possible = together(bending(5.0, seen=False)).axes["roll"]
    assert possible.direction == "lower"


def test_low_gains_that_lack_phase_are_raised_towards_the_limits() -> None:
    """One step does not reach them, and keeping such gains would be called right."""
    found = together(detuned(0.2)).axes["roll"]
    assert found.verdict == "change"
    assert found.reasons[0].code == "QL660"
    assert found.now is not None
    assert found.next is not None
    assert spare(found.now, GOOD) < spare(found.next, GOOD) < 1.0


def test_gains_that_noise_holds_below_the_limits_are_not_called_right() -> None:
    """One factor on all of them is held where it is: each by itself they come to the limits."""
    result = detuned(0.4)
    loud = [replace(each, torque=each.torque + LOUD[: each.n_samples]) for each in result.data.segments]
    found = together(replace(result, data=replace(result.data, segments=tuple(loud)))).axes["roll"]
    assert found.now is not None
    assert spare(found.now, GOOD) < 0.9
    assert found.verdict == "change"
    assert found.next is not None
    assert spare(found.next, GOOD) >= 1.0


@pytest.mark.parametrize("factor", [1.0, 1.05])
def test_gains_that_anything_holds_below_the_limits_are_not_called_right(
    monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    """Held five per cent above what flew is as little as held at it: what holds them is named."""
    held = recommending.Found(factor, reached=False, held_by="QL637")
    monkeypatch.setattr(recommending._Search, "target", lambda _: held)
    monkeypatch.setattr(recommending._Search, "apart", lambda _, common: None)  # noqa: ARG005
    found = together(detuned(0.4)).axes["roll"]
    assert found.direction == "refuse"
    assert codes_of(found)[:2] == ["QL624", "QL637"]


@pytest.mark.parametrize(("told_spare", "least"), [(0.84, 0.5), (0.2, 0.1)])
def test_a_loop_that_lacks_some_degrees_is_not_lowered_at_any_price(told_spare: float, least: float) -> None:
    """A fifth of the gains, and twenty times the error, for seven degrees."""
    search = SimpleNamespace(common=lambda factor: factor**-2.0)
    one = SimpleNamespace(_told_spare=told_spare, _separate=lambda: search)
    tried = np.array([0.1, 0.2, 0.49, 0.5, 1.0, 2.0])
    factors = recommending._Search._worth_it(one, tried)  # type: ignore[arg-type]
    assert factors.min() == least
    assert factors.max() == 2.0


def vague(detuning: float, **parts: float) -> Result:
    """The vehicle with other gains, known within these parts of its effectiveness and lag."""
    sharp = detuned(detuning)
    (model, *others) = sharp.identification.models
    assert model.posterior is not None
    assert sharp.closed_loop is not None
    covariance = np.array(model.posterior.covariance)
    for place, part in ((0, parts["effectiveness"]), (2, parts["lag"])):
        covariance[0, place, place] = (part * model.posterior.mean[0, place]) ** 2
    model = replace(model, posterior=replace(model.posterior, covariance=covariance))
    doubted = replace(sharp, identification=replace(sharp.identification, models=(model, *others)))
    roll = replace(sharp.closed_loop.axes["roll"], plants=plants_of(doubted))
    return replace(doubted, closed_loop=replace(sharp.closed_loop, axes={"roll": roll}))


def told_spare(result: Result, gains: dict[str, float], *, draws: int = 1) -> float:
    """Return the worst of the margins over its limit, of the estimate and of more vehicles."""
    controllers = named("ardupilot").controllers(result.log, {**result.log.parameters, **gains})
    assert controllers is not None
    plants = of_next_flight(plants_of(result)).at(slice(0, draws))
    return spare(scaled_loops(controllers.axes["roll"], plants, np.inf).margins(), GOOD)


@pytest.mark.thorough
def test_doubt_alone_costs_little_of_the_rejection_of_gusts() -> None:
    """Limits that the worst vehicle keeps in any condition would take 1.6 times the error."""
    doubted = vague(3.4, effectiveness=0.07, lag=0.1)
    found = recommend(doubted, GOOD, ["roll"]).axes["roll"]
    gains = {name: one.next for name, one in found.changes.items()}
    assert found.verdict == "change"
    assert found.attitude_error < 1.33
    assert told_spare(doubted, {}) < 0.95
    assert told_spare(doubted, gains) > 0.98
    # What may be paid buys the worst vehicles, as they fly, the limits: they flew with 0.81 of them.
    assert told_spare(doubted, gains, draws=401) > 0.95


@pytest.mark.thorough
def test_flights_that_differ_little_are_told_as_much_rejection() -> None:
    """From where the worst vehicle keeps its limits at a bearable price to where it does not."""
    told = []
    for effectiveness in (0.035, 0.04, 0.05, 0.07):
        found = recommend(vague(3.4, effectiveness=effectiveness, lag=0.1), GOOD, ["roll"]).axes["roll"]
        assert found.verdict == "change"
        told.append(found.attitude_error)
    assert max(told) < 1.1 * min(told)


@pytest.mark.thorough
def test_much_doubt_takes_the_loop_away_from_instability_and_not_all_rejection() -> None:
    """The worst vehicle may be close to instability: it is not any more, and keeps not all of the limits."""
    doubted = vague(3.4, effectiveness=0.3, lag=0.25)
    found = recommend(doubted, GOOD, ["roll"]).axes["roll"]
    assert found.verdict == "change"
    assert found.attitude_error < 1.3
    gains = {name: one.next for name, one in found.changes.items()}
    assert told_spare(doubted, {}, draws=401) < 2.0 / 3.0
    assert told_spare(doubted, gains, draws=401) > 0.66
    assert told_spare(doubted, gains) > 0.98


def agile(**gains: float) -> Result:
    """Roll of a vehicle four times as agile, flown by rates alone, with these factors on its gains."""
    rates = with_parameters(of_axes(flown("ardupilot"), "roll"), ATC_ANG_RLL_P=None)
    (model, *others) = rates.identification.models
    assert model.posterior is not None
    assert rates.closed_loop is not None
    times = np.array([4.0, 1.0, 1.0, 1.0, 1.0])[: model.posterior.mean.shape[1]]
    mean, covariance = np.array(model.posterior.mean), np.array(model.posterior.covariance)
    mean[0] *= times
    covariance[0] *= np.outer(times, times)
    model = replace(model, posterior=replace(model.posterior, mean=mean, covariance=covariance))
    rates = replace(rates, identification=replace(rates.identification, models=(model, *others)))
    roll = replace(rates.closed_loop.axes["roll"], plants=plants_of(rates))
    rates = replace(rates, closed_loop=replace(rates.closed_loop, axes={"roll": roll}))
    return as_flown(rates, **{name: factor * rates.log.parameters[name] for name, factor in gains.items()})


def test_gusts_alone_do_not_make_a_rate_that_rings() -> None:
    """The integral of gains that lack margin was raised four times, and a step overshot by half of it."""
    result = agile(ATC_RAT_RLL_D=0.5)
    found = recommend(result, GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    assert found.verdict == "change"
    gains = {name: one.next for name, one in found.changes.items()}
    following = named("ardupilot").controllers(result.log, {**result.log.parameters, **gains})
    assert following is not None
    assert result.closed_loop is not None
    plants = result.closed_loop.axes["roll"].plants
    assert plants is not None
    turns = close(following.axes["roll"], plants.at(slice(0, 1)), np.geomspace(0.05, 100.0, 800))
    # That of a damping ratio of 0.35, within what gains in a file are rounded by.
    most = 1.0 / (2.0 * 0.35 * math.sqrt(1.0 - 0.35**2))
    assert np.abs(turns.target_to_rate).max() < 1.02 * most


@pytest.mark.thorough
def test_gains_that_a_file_rounds_off_keep_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Betaflight's are whole numbers: at the limits, one less of each may be too little or too much."""

    def quarters(_: GainNames, value: float) -> float:
        digit = 10.0 ** math.floor(math.log10(value))
        return math.floor(4.0 * value / digit) / 4.0 * digit

    monkeypatch.setattr(GainNames, "written", quarters)
    found = recommend(agile(ATC_RAT_RLL_D=0.5), GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    assert found.verdict == "change"
    assert found.next is not None
    assert spare(found.next, GOOD) >= 0.99


def test_the_worst_vehicle_counts_and_not_the_estimate() -> None:
    """9 dB that may be 3 are half of the 6 that are to be kept."""
    loose = Margins(
        stable=True, stable_fraction=1.0, extrapolated=False, gain_margin_db=Estimated(9.0, (3.0, 12.0))
    )
    assert spare(LoopMargins(rate=loose, full=None), GOOD) == pytest.approx(0.5)


def test_high_gains_are_lowered(lowered: Tuning) -> None:
    """The target stands beside the next step."""
    found = lowered.axes["roll"]
    assert found.reasons[0].code == "QL630"
    assert all(one.target <= one.next < one.now for one in found.changes.values())


def worst_gain_margin(found: AxisTuning) -> float:
    """Return by how much the gain of the next flight may rise in the worst vehicle and loop."""
    assert found.next is not None
    assert found.next.full is not None
    both = [one.gain_margin_db for one in (found.next.rate, found.next.full)]
    return min(10.0 ** (one.ci95[0] / 20.0) for one in both if one is not None)


def test_a_flight_lowers_gains_by_no_more_than_half(lowered: Tuning) -> None:
    """A model that is wrong does no more harm than that."""
    assert min(one.next / one.now for one in lowered.changes.values()) >= 0.5 * 0.999


def test_a_flight_raises_gains_by_no_more_than_its_worst_gain_margin(raised: Tuning) -> None:
    """A vehicle whose gain is as many times what was told would just be stable."""
    ratios = [one.next / one.now for one in raised.changes.values()]
    assert max(ratios) <= max(2.0, worst_gain_margin(raised.axes["roll"])) * 1.01


def test_gains_that_leave_much_gain_margin_are_raised_by_more_than_twice(raised: Tuning) -> None:
    """From 15 dB in the worst vehicle 7.6 are left."""
    assert min(one.next / one.now for one in raised.changes.values()) > 2.2


def test_gains_at_their_target_are_kept(kept: Tuning) -> None:
    """Fly, tune, fly again comes to an end."""
    assert kept.axes["roll"].verdict == "keep"
    assert not kept.changes
    assert kept.axes["roll"].reasons[0].code == "QL634"


def test_the_promise_is_that_of_the_values_in_the_file(raised: Tuning) -> None:
    """Rounded as they are written, through the autopilot's own law."""
    result, found = flown("ardupilot"), raised.axes["roll"]
    written = {name: one.next for name, one in found.changes.items()}
    parameters = {**result.log.parameters, **written}
    controllers = named("ardupilot").controllers(result.log, parameters)
    assert controllers is not None
    assert result.closed_loop is not None
    known_hz = result.closed_loop.axes["roll"].known_hz
    loops = scaled_loops(controllers.axes["roll"], of_next_flight(plants_of(result)), known_hz)
    assert found.next == loops.margins()


def test_scaled_loops_are_the_loops_of_scaled_gains() -> None:
    """One factor on P, I and D: with angle loop, and without computing the loop anew."""
    plant = Plant(*(np.array([value]) for value in (300.0, -2.0, 0.03, 0.005)))
    now = Vehicle()
    twice = replace(now, P=2 * now.P, I=2 * now.I, D=2 * now.D)
    assert scaled_loops(now.controller, plant, 50.0).margins(2.0) == pytest.approx(
        scaled_loops(twice.controller, plant, 50.0).margins(), abs=1e-9
    )


def loaded(text: str, folder: Path) -> MAVParmDict:
    path = folder / "one.param"
    path.write_text(text)
    found = MAVParmDict()
    assert found.load(str(path))
    return found


@pytest.fixture(scope="module")
def apart() -> AxisTuning:
    """P, I, D and angle gain of gains that are low for the vehicle."""
    return recommend(flown("ardupilot"), GOOD, ["roll"], apart=True, ranges=AS_FLOWN).axes["roll"]


def test_gains_apart_keep_the_limits_in_the_worst_vehicle(apart: AxisTuning) -> None:
    """The angle gain is one of them."""
    assert apart.reasons[0].code == "QL641"
    assert set(apart.changes) <= {*ROLL, "ATC_ANG_RLL_P"}
    assert apart.next is not None
    assert spare(apart.next, GOOD) >= 1.0


def test_a_flight_answers_more_by_no_more_than_its_worst_gain_margin(apart: AxisTuning) -> None:
    """From the crossover up; a vehicle whose gain is as many times what was told would just be stable."""
    result = flown("ardupilot")
    following = {name: one.next for name, one in apart.changes.items()}
    answers = []
    for changes in ({}, following):
        controllers = named("ardupilot").controllers(result.log, {**result.log.parameters, **changes})
        assert controllers is not None
        assert apart.now is not None
        assert apart.now.rate.crossover_hz is not None
        roll = controllers.axes["roll"]
        frequency_hz = np.geomspace(apart.now.rate.crossover_hz.value, 0.49 / roll.period_s, 200)
        answers.append(np.abs(on_rate(roll, frequency_hz) + on_angle(roll, frequency_hz)))
    assert np.max(answers[1] / answers[0]) <= max(2.0, worst_gain_margin(apart)) * 1.02


def test_the_attitude_follows_as_fast_as_it_did(apart: AxisTuning) -> None:
    """Gusts alone are rejected best by a vehicle that does not listen to its pilot."""
    result = flown("ardupilot")
    following = {name: one.next for name, one in apart.changes.items()}
    bandwidths = []
    for changes in ({}, following):
        controllers = named("ardupilot").controllers(result.log, {**result.log.parameters, **changes})
        assert controllers is not None
        roll = controllers.axes["roll"]
        frequency_hz = np.geomspace(0.1, 50.0, 2000)
        loop = close(roll, plants_of(result).at(slice(0, 1)), frequency_hz)
        assert loop.full is not None
        follows = np.abs((loop.full - loop.rate) / (1.0 + loop.full))[0]
        bandwidths.append(frequency_hz[np.argmax(follows < 0.5**0.5)])
    assert bandwidths[1] >= 0.99 * bandwidths[0]


def test_an_integral_that_is_far_too_small_rises_by_more_than_four_times() -> None:
    """It holds what is slower than the crossover: there, its gain is bounded by margins alone."""
    low = flown("ardupilot").log.parameters[ROLL[1]] / 16.0
    found = recommend(detuned(1.0, **{ROLL[1]: low}), GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    assert found.gains[ROLL[1]].target > 4.0 * low


def test_gains_one_by_one_reject_gusts_better_than_one_factor(raised: Tuning, apart: AxisTuning) -> None:
    """Or one factor is recommended."""
    errors = [
        wind_rad(result := flown("ardupilot"), {name: one.target for name, one in found.gains.items()})
        / wind_rad(result, {})
        for found in (apart, raised.axes["roll"])
    ]
    assert errors[0] < errors[1]


@pytest.mark.thorough
def test_it_does_not_matter_which_of_two_parameters_holds_the_gain_of_px4s_loop() -> None:
    """MC_ROLLRATE_K multiplies P, I and D: a P at the end of its range and a small K are the same loop."""
    before = of_axes(flown("px4"), "roll")
    gains = {name: before.log.parameters[f"MC_ROLLRATE_{name}"] for name in "KPID"}
    more = 0.5 / gains["P"]
    same = {f"MC_ROLLRATE_{name}": more * gains[name] for name in "PID"} | {
        "MC_ROLLRATE_K": gains["K"] / more
    }
    errors = [
        recommend(one, GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"].attitude_error
        for one in (before, as_flown(before, **same))
    ]
    assert errors[1] == pytest.approx(errors[0], rel=0.01)


def test_no_parameter_of_px4_is_raised_beyond_its_documented_range() -> None:
    """MC_ROLLRATE_P may be 0.5, D 0.01 and K 5 at most."""
    before = of_axes(flown("px4"), "roll")
    more = 0.5 / before.log.parameters["MC_ROLLRATE_P"]
    same = {f"MC_ROLLRATE_{name}": more * before.log.parameters[f"MC_ROLLRATE_{name}"] for name in "PID"}
    result = as_flown(before, **same, MC_ROLLRATE_K=1.0 / more)
    changes = recommend(result, GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"].changes
    highest = {"MC_ROLLRATE_P": 0.5, "MC_ROLLRATE_D": 0.01, "MC_ROLLRATE_K": 5.0}
    assert "MC_ROLLRATE_K" in changes
    assert all(one.next <= highest[name] for name, one in changes.items() if name in highest)


def wind_rad(result: Result, changes: dict[str, float]) -> float:
    """What gusts of one density make of the attitude, in no unit."""
    controllers = named("ardupilot").controllers(result.log, {**result.log.parameters, **changes})
    assert controllers is not None
    frequency_hz, plant = np.geomspace(0.05, 15.0, 2000), plants_of(result).at(slice(0, 1))
    loop, s = close(controllers.axes["roll"], plant, frequency_hz), 2j * np.pi * frequency_hz
    assert loop.full is not None
    gain = np.abs(1.0 / (s * (s - plant.damping[0]) * (1.0 + loop.full[0]))) ** 2
    return float(np.sqrt(np.trapezoid(gain, frequency_hz)))


@pytest.mark.parametrize("apart", [thorough(True), False])
def test_uncertainty_lowers_no_gains(apart: bool) -> None:
    """The loop keeps its limits as told; of vehicles that the flight allows too, some would not."""
    result = detuned(1.0)
    assert result.closed_loop is not None
    loop = result.closed_loop.axes["roll"]
    assert loop.plants is not None
    random = 5.0 ** np.random.default_rng(3).uniform(-1.0, 1.0, loop.plants.effectiveness.size)
    random[0] = 1.0
    plants = loop.plants._replace(effectiveness=loop.plants.effectiveness * random, modes=None)
    loose = replace(result.closed_loop, axes={"roll": replace(loop, plants=plants)})
    flown_so = replace(result, closed_loop=loose)
    found = recommend(flown_so, GOOD, ["roll"], apart=apart, ranges=AS_FLOWN).axes["roll"]
    assert found.direction in {"keep", "refuse"}
    assert {"QL646", "QL618"} & set(codes_of(found))


@pytest.mark.thorough
def test_gains_that_only_uncertainty_keeps_are_not_called_right() -> None:
    """The effectiveness is known to a factor of two: known better, this vehicle would bear more."""
    result = detuned(1.5)
    assert result.closed_loop is not None
    loop = result.closed_loop.axes["roll"]
    assert loop.plants is not None
    random = 2.0 ** np.random.default_rng(3).uniform(-1.0, 1.0, loop.plants.effectiveness.size)
    random[0] = 1.0
    plants = loop.plants._replace(effectiveness=loop.plants.effectiveness * random, modes=None)
    loose = replace(result.closed_loop, axes={"roll": replace(loop, plants=plants)})
    flown_so = replace(result, closed_loop=loose)
    found = recommend(flown_so, GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    assert found.verdict == "keep"
    assert found.reasons[0].code == "QL647"
    known = recommend(result, GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    assert known.attitude_error < 0.75


def test_gains_apart_reject_gusts_better(apart: AxisTuning) -> None:
    """That is what they are searched for."""
    assert apart.attitude_error < 0.95


@pytest.mark.parametrize("frame", ["stiff", thorough("may bend")])
def test_no_gains_of_a_grid_that_keep_the_limits_reject_gusts_better_by_a_tenth(frame: str) -> None:
    """Where the search ends, P and D are the best of a quarter more and less of each."""
    result = flown("ardupilot") if frame == "stiff" else bending(1.0, seen=False)
    assert result.closed_loop is not None
    loop = result.closed_loop.axes["roll"]
    assert loop.plants is not None
    found = recommend(result, GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    target = {name: one.target for name, one in found.gains.items()}
    much_better_rad = 0.9 * wind_rad(result, target)
    for p, d in itertools.product((0.75, 0.9, 1.0, 1.1, 1.25), repeat=2):
        changes = target | {ROLL[0]: p * target[ROLL[0]], ROLL[2]: d * target[ROLL[2]]}
        if wind_rad(result, changes) > much_better_rad:
            continue
        controllers = named("ardupilot").controllers(result.log, {**result.log.parameters, **changes})
        assert controllers is not None
        following = scaled_loops(controllers.axes["roll"], of_next_flight(loop.plants), loop.known_hz)
        assert spare(following.margins(), GOOD) < 1.0


@pytest.mark.thorough
def test_an_integral_gain_keeps_what_trims_the_vehicle() -> None:
    """No spectrum of gusts shows a load off centre: without it, a quarter of I would reject gusts as well."""
    found = recommend(flown("px4"), GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    factor = {name: one.target / one.now for name, one in found.gains.items()}
    assert found.reasons[0].code == "QL641"
    assert factor["MC_ROLLRATE_P"] > 1.0
    assert factor["MC_ROLLRATE_I"] > 0.95


def test_mavproxy_loads_the_next_gains(raised: Tuning, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """By pymavlink's reader, which names every line that it cannot read."""
    text = gain_files(flown("ardupilot"), raised)["next.param"]
    found = loaded(text, tmp_path)
    assert dict(found) == {name: one.next for name, one in raised.changes.items()}
    assert "Invalid" not in capsys.readouterr().out


def test_no_line_but_comments_holds_more_than_name_and_value(raised: Tuning) -> None:
    """Mission Planner skips every line that does not split into two."""
    for text in gain_files(flown("ardupilot"), raised).values():
        values = [line for line in text.splitlines() if not line.startswith("#")]
        assert all(len(line.split(",")) == 2 and " " not in line for line in values)


def test_going_back_restores_the_flown_values_exactly(raised: Tuning, tmp_path: Path) -> None:
    """In single precision, as the autopilot holds them."""
    result = flown("ardupilot")
    files = gain_files(result, raised)
    vehicle = {name: np.float32(value) for name, value in result.log.parameters.items()}
    before = dict(vehicle)
    for name in ("next.param", "back.param"):
        vehicle |= {one: np.float32(value) for one, value in loaded(files[name], tmp_path).items()}
        assert (vehicle == before) == (name == "back.param")


def test_qgroundcontrol_loads_the_next_gains() -> None:
    """Vehicle, component, name, value and the type of single precision, between tabs."""
    result = flown("px4")
    result = replace(result, log=replace(result.log, parameters={**result.log.parameters, "MAV_SYS_ID": 7.0}))
    tuning = together(result)
    lines = gain_files(result, tuning)["next.params"].splitlines()
    columns = [line.split("\t") for line in lines if not line.startswith("#")]
    following = tuning.axes["roll"].changes["MC_ROLLRATE_K"].next
    assert columns == [["7", "1", "MC_ROLLRATE_K", f"{following:g}", "9"]]


def test_a_kept_vehicle_gets_no_file(kept: Tuning) -> None:
    """Nothing to load, and nothing to go back from."""
    assert gain_files(detuned(1.0), kept) == {}


@cache
def before() -> Result:
    """The flight of which gains of roll are recommended."""
    return of_axes(flown("ardupilot"), "roll")


@pytest.fixture(scope="module")
def advised() -> Tuning:
    """What is recommended for gains that are low for the vehicle."""
    return tuning_of(before())


def followed(tuning: Tuning, factor: float = 1.0) -> Result:
    """The next flight, with the recommended gains, on a vehicle so many times as effective."""
    following = {name: one.next for name, one in tuning.axes["roll"].changes.items()}
    result = detuned(factor, **following)
    parameters = {**result.log.parameters, **{name: one.next for name, one in tuning.changes.items()}}
    return replace(result, log=replace(result.log, parameters=parameters))


def test_a_comparison_tells_that_the_promise_was_kept(advised: Tuning) -> None:
    """The flight after has the margins that the flight before said it would have."""
    (one,) = checked(before(), followed(advised)).items()
    assert one[0] == "roll"
    assert one[1].held is Held.INSIDE


@pytest.mark.thorough
def test_a_promise_of_px4s_own_p_i_and_d_is_compared_too() -> None:
    """MC_ROLLRATE_K, which scales all of them, stays where it was."""
    first = of_axes(flown("px4"), "roll")
    following = {name: one.next for name, one in tuning_of(first).changes.items()}
    assert following
    assert "MC_ROLLRATE_K" not in following
    assert checked(first, as_flown(first, **following))["roll"].held is Held.INSIDE


def test_a_comparison_tells_that_the_promise_was_not_kept(advised: Tuning) -> None:
    """The payload was left at home: the vehicle is five times as effective, and near to oscillating."""
    one = checked(before(), followed(advised, 5.0))["roll"]
    assert one.held is Held.WORSE
    assert one.decision is Decision.BACK


@pytest.mark.thorough
def test_a_broken_promise_sends_back_from_no_gains_that_keep_the_limits(advised: Tuning) -> None:
    """More effective by 40 %: less margin than promised, and still enough of it."""
    one = checked(before(), followed(advised, 1.4))["roll"]
    assert one.held is Held.WORSE
    assert one.decision is Decision.KEEP


@pytest.mark.thorough
def test_a_promise_of_lowered_gains_that_was_not_kept_does_not_send_back() -> None:
    """More effective than it was, and still further from oscillating than before."""
    high = detuned(5.0)
    lowered = tuning_of(high)
    following = {name: one.next for name, one in lowered.axes["roll"].changes.items()}
    assert following[ROLL[0]] < high.log.parameters[ROLL[0]]
    after = detuned(1.6, **following)
    parameters = {**after.log.parameters, **{name: one.next for name, one in lowered.changes.items()}}
    one = checked(high, replace(after, log=replace(after.log, parameters=parameters)))["roll"]
    assert one.held is Held.WORSE
    assert one.decision is not Decision.BACK


@pytest.mark.thorough
def test_nothing_is_promised_of_gains_that_nobody_recommended() -> None:
    """The pilot chose others."""
    assert checked(before(), detuned(0.77)) == {}
    assert checked(before(), before()) == {}


def test_the_page_escapes_what_a_log_says(raised: Tuning) -> None:
    """A log is untrusted."""
    result = flown("ardupilot")
    hostile = replace(result.log, path="<script>alert(1)</script>.bin", firmware="<img src=x onerror=y>")
    page = tune_page(replace(result, log=hostile), raised, NOWHERE)
    assert "<script" not in page
    assert "<img" not in page


def test_the_page_says_what_changes_and_by_which_sign_to_land(raised: Tuning) -> None:
    """What a pilot looks for first."""
    page = tune_page(flown("ardupilot"), raised, NOWHERE)
    # P's: each gain is rounded to what its parameter holds, and I's may be half a per cent and a little more.
    one = raised.changes[ROLL[0]]
    assert f"Roll: raise the gains to {round(100.0 * one.next / one.now)} %" in page
    assert "Land if roll shakes or the motors buzz (near " in page
    assert "After that, load back.param." in page


def test_the_page_says_what_its_step_leaves_out(raised: Tuning) -> None:
    """Betaflight's iterm relax holds the integral that makes the overshoot of the picture."""
    result = flown("ardupilot")
    relaxed = {**result.log.parameters, "iterm_relax": 1.0}
    betaflight = replace(result, log=replace(result.log, autopilot="betaflight", parameters=relaxed))
    assert "for sticks at rest" in tune_page(betaflight, raised, NOWHERE)
    assert "for sticks at rest" not in tune_page(result, raised, NOWHERE)


def test_the_page_draws_the_step_that_the_log_shows_beside_the_computed_ones(raised: Tuning) -> None:
    """A pilot believes a promise whose "as flown" is what was flown."""
    result = flown("ardupilot")
    loop = result.closed_loop
    assert loop is not None
    assert loop.axes["roll"].step is not None

    def page(measured: np.ndarray | None) -> str:
        axes = {
            axis: replace(one, step=None if one.step is None else replace(one.step, measured=measured))
            for axis, one in loop.axes.items()
        }
        return tune_page(replace(result, closed_loop=replace(loop, axes=axes)), raised, NOWHERE)

    shown = page(0.9 * loop.axes["roll"].step.response)
    assert '<polyline class="measured" points="34.0,' in shown
    assert "Dotted: measured in this flight" in shown
    assert '<polyline class="measured"' not in page(None)
    assert "Dotted" not in page(None)


def test_the_open_loop_that_is_drawn_has_the_promised_margins(raised: Tuning) -> None:
    """Read off as a pilot reads them: phase where the gain passes 0 dB, gain where the phase passes -180."""
    promised = raised.axes["roll"].next
    assert promised is not None
    assert promised.full is not None
    assert promised.full.phase_margin_deg is not None
    assert promised.full.gain_margin_db is not None
    drawn = next_loops(flown("ardupilot"), raised)["roll"]
    gain_db = 20.0 * np.log10(np.abs(drawn.response))
    phase_deg = np.degrees(np.unwrap(np.angle(drawn.response)))
    phase_deg -= 360.0 * np.round((phase_deg[np.argmin(np.abs(gain_db))] + 120.0) / 360.0)
    # The last place where it falls below.
    at_0_db = float(np.interp(0.0, -gain_db, phase_deg))
    falling = np.flatnonzero((phase_deg[:-1] > -180.0) & (phase_deg[1:] <= -180.0))[-1]
    part = (phase_deg[falling] + 180.0) / (phase_deg[falling] - phase_deg[falling + 1])
    at_180 = gain_db[falling] + part * (gain_db[falling + 1] - gain_db[falling])
    assert 180.0 + at_0_db == pytest.approx(promised.full.phase_margin_deg.value, abs=0.5)
    assert -at_180 == pytest.approx(promised.full.gain_margin_db.value, abs=0.2)


def test_the_page_draws_the_open_loop_and_lets_only_its_own_scripts_run(raised: Tuning) -> None:
    """Three of them; without a loop to draw no library for charts is in it."""
    result = flown("ardupilot")
    page = tune_page(
        result, raised, NOWHERE, grids=what_if_grids(result, raised), following=next_loops(result, raised)
    )
    assert 'id="chart-next-loop"' in page
    policy = html.unescape(page).split("script-src ")[1].split(";")[0]
    runnable = [part.partition("</script>")[0] for part in page.split("<script>")[1:]]
    hashes = [base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in runnable]
    assert len(hashes) == 2
    assert all(one in policy for one in hashes)
    assert "chart-next-loop" not in tune_page(result, raised, NOWHERE)


def test_the_page_shows_flown_gains_to_four_digits(raised: Tuning) -> None:
    """The file that goes back has all of them."""
    found = raised.axes["roll"]
    name = next(iter(found.changes))
    odd = replace(found, gains={name: GainChange(0.083082230, 0.108, 0.108)})
    view = tune_view(flown("ardupilot"), replace(raised, axes={"roll": odd}))
    assert view.axes[0].gains[0].now == "0.08308"


def test_a_rate_that_has_not_come_to_its_set_point_is_not_said_to_have_risen() -> None:
    """Yaw at 84 % of the step after four seconds "rose in 1640 ms and overshot by 1 %"."""
    assert rise_words(1.64, 1.0, 0.84, 4.0) == "reaches 84 % after 4 s"


def test_an_interval_on_the_page_does_not_collapse(raised: Tuning) -> None:
    """50 (50 to 50) degrees would say that nothing is left to know."""
    found = raised.axes["roll"]
    assert found.now is not None
    assert found.now.full is not None
    narrow = replace(found.now.full, phase_margin_deg=Estimated(50.1, (49.8, 50.3)))
    kept = replace(found, verdict="keep", now=replace(found.now, full=narrow))
    view = tune_view(flown("ardupilot"), replace(raised, axes={"roll": kept}))
    assert "50.10 (49.80 to 50.30) degrees" in view.axes[0].promise


def test_the_page_lets_only_its_own_script_run(raised: Tuning) -> None:
    """What it looks up is data, escaped for a script element."""
    result = flown("ardupilot")
    page = tune_page(result, raised, NOWHERE, grids=what_if_grids(result, raised))
    assert "default-src 'none'" in page
    assert page.count("script-src &#39;sha256-") == 1
    assert page.count("<script") == 2
    assert "ATC_RAT_RLL_FLTD" in page


def test_page_and_json_tell_where_autotune_would_end(raised: Tuning) -> None:
    """Whether to fly it at all: gains and margins as intervals."""
    result = flown("ardupilot")
    told = autotune_forecasts(result, raised)
    page = tune_page(result, raised, NOWHERE, told)
    assert "AutoTune would end at ATC_RAT_RLL_P 0." in page
    assert "QuikTune would end at ATC_RAT_RLL_P 0." in page
    found = json.loads(tuning_text(result, raised, NOWHERE, (), told))["axes"]["roll"]["autotune"]
    low, high = found["gains"][ROLL[0]]
    assert 0.01 < low <= high < 2.0
    assert found["gain_margin_db"][0] > 0.0


def test_the_confirming_flight_comes_with_the_gains(raised: Tuning, kept: Tuning) -> None:
    """What to set and to fly, and the sign by which to land."""
    files = flight_files(flown("ardupilot"), raised)
    assert {"plan.md", "excite.lua", "sweep-roll.param", "sweep-off.param"} == set(files)
    # Its own mask, which holds the needed bit and others: no file writes another.
    assert "LOG_BITMASK is 442367" in files["plan.md"]
    assert "Land if roll shakes" in files["plan.md"]
    assert "If anything was wrong, load back.param." in files["plan.md"]
    assert not flight_files(flown("ardupilot"), kept)


def test_refused_axes_make_exit_code_1_and_a_page(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Scripts tell by it; the reasons stand in page and JSON."""
    code = main(["tune", "sample_logs/default-logging.bin", "-o", str(tmp_path / "new"), "--json"])
    content = json.loads(capsys.readouterr().out)
    assert code == 1
    assert {found["verdict"] for found in content["axes"].values()} == {"refused"}
    assert all(found["reasons"] for found in content["axes"].values())
    assert content["folder"] == "default-logging"
    assert {path.name for path in (tmp_path / "new" / "default-logging").iterdir()} == {*content["files"]}


def test_lowered_gains_are_not_sent_back_into_the_loop_that_was_close_to_oscillating(lowered: Tuning) -> None:
    """A pilot who sees the vehicle shake must not load what shakes more: on page, card and terminal."""
    result = detuned(5.0)
    (axis,) = tune_view(result, lowered).axes
    assert not axis.way_back
    for text in (flight_files(result, lowered)["plan.md"], tune_page(result, lowered, NOWHERE), axis.warning):
        assert "not load the flown gains of roll" in text
        assert "load back.param" not in text


def test_a_step_that_does_not_reach_the_limits_says_so_and_how_many_flights_are_missing() -> None:
    """It promises less than is to be kept, and keeps no margins yet."""
    result = detuned(0.2)
    tuning = together(result)
    (axis,) = tune_view(result, tuning).axes
    n_flights = tuning.axes["roll"].flights_to_limits
    assert n_flights >= 1
    assert f"Not there yet for 45 degrees: expect about {n_flights} " in axis.sentence
    content = json.loads(tuning_text(result, tuning, NOWHERE, ()))["axes"]["roll"]
    assert content["limits_missed"] == ["phase_deg"]
    assert content["direction"] == "raise"


def test_as_many_flights_as_are_told_to_be_missing_lead_to_the_limits() -> None:
    """Each doubles gains that are a tenth of those that the vehicle bears; the next ones are a fifth."""
    missing = together(detuned(0.1)).axes["roll"].flights_to_limits
    before, after = (detuned(min(0.2 * 2.0**n, 1.0)).closed_loop for n in (missing - 2, missing))
    assert before is not None
    assert after is not None
    assert spare(before.margins["roll"], GOOD) < 1.0 <= spare(after.margins["roll"], GOOD)


def test_gains_that_come_nearer_to_the_limits_and_end_below_them_promise_no_arrival() -> None:
    """No number of flights leads where one factor does not."""
    result = detuned(0.2)
    found = together(result).axes["roll"]
    short = replace(found, reasons=(*found.reasons, finding("QL638", "info", {}, axes=("roll",))))
    (axis,) = tune_view(result, Tuning(axes={"roll": short}, limits=GOOD)).axes
    assert "do not reach it" in axis.sentence
    assert "Not there yet" not in axis.sentence


@pytest.mark.parametrize("factor", thorough_but([3.6, 4.0], [3.6, 3.8, 4.0, 4.2]))
def test_a_last_step_down_keeps_the_limits_in_all_vehicles_that_the_flight_allows(factor: float) -> None:
    """The search looks at some of them; what it promises holds for all."""
    found = together(detuned(factor)).axes["roll"]
    assert found.direction == "lower"
    assert found.more_flights == 0
    assert found.next is not None
    assert spare(found.next, GOOD) >= 1.0


def test_the_tuning_of_a_result_is_computed_once() -> None:
    """Page, terminal and next steps say the same because it is the same."""
    # Refused at once: what is found costs nothing here.
    result = replace(flown("ardupilot"), closed_loop=None)
    assert tuning_of(result) is tuning_of(result)


def test_limits_that_mean_nothing_are_wrong_usage(capsys: pytest.CaptureFixture) -> None:
    """Before the log is read."""
    assert main(["tune", "sample_logs/default-logging.bin", "--gain-margin-db", "-3"]) == 2
    assert "--gain-margin-db" in capsys.readouterr().err


def true_plant(corpus: Path, name: str, axis: int) -> Plant:
    truth = json.loads((corpus / "firmware" / name).with_suffix(".truth.json").read_text())
    if "at_hover" in truth:
        B, A, lag_s = truth["at_hover"]["B_rad_s2_per_unit"]["M"], truth["at_hover"]["A_1_s"], 0.0
    else:
        B, A, lag_s = truth["B_rad_s2_per_torque_setpoint"], truth["A_1_s"], truth["motor_lag_effective_s"]
    numbers = (B[axis][axis], A[axis][axis], lag_s, 0.0)
    return Plant(*(np.array([value]) for value in numbers))


def low_ends(found: AxisTuning) -> tuple[float, float]:
    """Return the least gain and phase margin that are promised of the whole loop."""
    assert found.next is not None
    outer = found.next.full or found.next.rate
    assert outer.phase_margin_deg is not None
    gain = math.inf if outer.gain_margin_db is None else outer.gain_margin_db.ci95[0]
    return gain, outer.phase_margin_deg.ci95[0]


#: Of every firmware log the axes that get gains, and by which codes the others are refused. At 10 Hz and in
#: telemetry no loop is seen; the rate thread's rows are not those of every step; the chirp moves roll alone.
FIRMWARE: dict[str, tuple[str, dict[str, str]]] = {
    "ac47_quadx_multisine.BIN": ("roll pitch yaw", {}),
    "ac47_quadx_doublets.BIN": ("roll pitch yaw", {}),
    "ac47_quadx_esc_rpm.BIN": ("roll pitch yaw", {}),
    "ac47_two_flights.BIN": ("roll pitch yaw", {}),
    "ac47_quadx_sid_roll.BIN": ("roll", {"pitch": "QL615", "yaw": "QL615"}),
    "px4_quad_multisine.ulg": ("roll pitch yaw", {}),
    "ac47_rate_thread.BIN": ("", dict.fromkeys(("roll", "pitch", "yaw"), "QL613")),
    "ac47_quadx_default_logging.BIN": ("", dict.fromkeys(("roll", "pitch", "yaw"), "QL613")),
    "px4_quad_default_logging.ulg": ("", dict.fromkeys(("roll", "pitch", "yaw"), "QL613")),
    "ac47_quadx_doublets.tlog": ("", dict.fromkeys(("roll", "pitch", "yaw"), "QL611")),
    "ac47_quadx_multisine.tlog": ("", dict.fromkeys(("roll", "pitch", "yaw"), "QL611")),
}


def true_margins(corpus: Path, name: str, result: Result, axis: str, found: AxisTuning) -> Margins:
    """Return those of the simulator's own physics with the gains of the file."""
    changed = {key: one.next for key, one in found.changes.items()}
    parameters = {**result.log.parameters, **changed}
    controllers = named(result.log.autopilot).controllers(result.log, parameters)
    assert controllers is not None
    plant = true_plant(corpus, name, AXES.index(axis))
    full = scaled_loops(controllers.axes[axis], plant, 1e9).margins().full
    assert full is not None
    return full


@pytest.mark.parametrize("name", thorough_but(["ac47_quadx_doublets.tlog"], FIRMWARE))
def test_the_true_vehicle_of_a_firmware_log_has_the_promised_margins(
    corpus: Path, analyzed: Analyzed, name: str
) -> None:
    """The simulator's own physics behind the firmware's own controller; or a refusal by its name."""
    tuned, refused = FIRMWARE[name]
    result = analyzed(corpus / "firmware" / name)
    tuning = recommend(result)
    assert {axis: one for axis, one in refused.items() if one not in codes_of(tuning.axes[axis])} == {}
    assert tuning.refused == tuple(refused)
    for axis in tuned.split():
        true = true_margins(corpus, name, result, axis, tuning.axes[axis])
        assert true.gain_margin_db is not None
        assert true.phase_margin_deg is not None
        gain, phase = low_ends(tuning.axes[axis])
        assert true.gain_margin_db.value >= gain
        assert true.phase_margin_deg.value >= phase


def codes_of(found: AxisTuning) -> list[str]:
    return [one.code for one in found.reasons]


def test_a_filter_that_limits_the_vehicle_is_named() -> None:
    """Quick motors behind a filter of 20 Hz: 40 Hz give much phase back (by other code 20 and 36 degrees)."""
    quick = Vehicle(
        B=437.5, lag_s=1e-4, delay_steps=0, P=0.135, I=0.135, D=0.0036, cutoff_hz=20.0, gyro_hz=20.0
    )
    plant = Plant(*(np.array([value]) for value in (437.5, -2.0, 0.0, 0.0)))
    names = GainNames(
        scaled=(), proportional="", integral="", derivative="", angle="", ranges={}, low_passes=("D", "GYRO")
    )
    case = Case(
        axis="roll", log=None, data=None, diagnosis=None, controllers=None, found=None, plants=plant,
        names=names, parameters={"D": 200.0, "GYRO": 20.0},
    )  # fmt: skip

    def rebuild(changes: dict[str, float]) -> AxisController:
        return replace(quick, gyro_hz=changes.get("GYRO", quick.gyro_hz)).controller

    (note,) = filter_note(case, rebuild, scaled_loops(quick.controller, plant, 50.0))
    told = {"parameter": "GYRO", "cutoff_hz": 20.0, "phase_margin_deg": 20.0}
    assert dict(note.evidence) == told | {"phase_margin_with_twice_that_deg": 38.0}
    assert "GYRO at 40 Hz instead of 20 Hz" in note.title
    assert not any(filter_note(case, lambda _: quick.controller, scaled_loops(quick.controller, plant, 50.0)))


def test_the_filter_that_limits_a_vehicle_stands_on_its_card() -> None:
    """A pilot who only loads the gains would never reach the margins."""
    assert "A filter, not the gain, limits roll: with GYRO at 40 Hz" in synthetic_tune_page()
