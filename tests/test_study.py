"""The coverage study: what it draws, how it counts, that it goes on where it stopped."""

from __future__ import annotations

import dataclasses
import functools
import json
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.loop import close, on_rate
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, AxisTuning, GainChange, Tuning
from quadid_logs.diagnose.findings import finding
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.vendors import parameters
from quadid_logs.vocabulary import AXES
from study import optimum, rate_mode, run
from study.draw import FRAMES, GYRO_SCALE_SIGMA, MANOEUVRES, draw_flight
from study.margin_tables import WORDS, draw_margins, loops_of, margins_page
from study.margins import draw_loop, measure_loops
from study.measure import kind_of, setup_of, simulate_drawn
from study.plots import draw_plots
from study.structural import CLEAN_FRACTION, EFFECTS, ROUGH_FRACTION
from study.summary import (
    GROUPS,
    binomial_interval,
    coverage_table,
    flights_interval,
    grouped,
    page,
    parameters_of,
    read_flights,
    verdict_table,
)
from study.tuning import _ratios, draw_vehicle, of_each_gain
from study.tuning import setup_of as flight_of
from tests.tuned_flights import flown


@pytest.fixture(scope="module")
def drawn():
    """Four hundred flights, drawn but not flown."""
    return [draw_flight(1, number) for number in range(400)]


def parameter(**changes):
    """One row as `measure` returns it: an on-axis effectiveness of roll that is right."""
    return {
        "name": "B11",
        "target": "p_dot",
        "regressor": "L",
        "kind": "on-axis effectiveness",
        "axis": "p",
        "identifiable": True,
        "value": 100.0,
        "low": 98.0,
        "high": 102.0,
        "truth": 100.0,
        "scale": 100.0,
    } | changes


def flight(number, *parameters, **changes):
    """One line of the study with these parameters."""
    settings = {name: 0.5 for name in GROUPS if name not in ("structure", "verdict")}
    return {
        **settings,
        "number": number,
        "seed": 1,
        "manoeuvre": "doublets",
        "autopilot": "px4",
        "structure": "damped",
        "structural": "",
        "disturbance_rad_s2": 0.0,
        "analysis_s": 0.5,
        "verdicts": {"roll": "usable", "pitch": "refused", "yaw": "caution"},
        "parameters": list(parameters),
    } | changes


def test_seed_and_number_decide_the_flight():
    """Another seed, or another number, is another flight."""
    assert draw_flight(1, 5).settings == draw_flight(1, 5).settings
    assert draw_flight(1, 5).settings["mass_kg"] != draw_flight(2, 5).settings["mass_kg"]
    assert draw_flight(1, 5).settings["mass_kg"] != draw_flight(1, 6).settings["mass_kg"]


def test_every_frame_manoeuvre_and_autopilot_is_flown(drawn):
    """In any study of some hundred flights."""
    for name, all_names in (
        ("frame", FRAMES),
        ("manoeuvre", {*MANOEUVRES, "single tone"}),
        ("autopilot", ("ardupilot", "px4")),
    ):
        assert {flight.settings[name] for flight in drawn} == set(all_names)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("mass_kg", 0.3, 8.0),
        ("lag_s", 0.010, 0.0875),
        ("wind_m_s", 0.0, 6.0),
        ("rate_hz", 100.0, 400.0),
        ("duration_s", 30.0, 60.0),
        ("gyro_noise_rad_s_per_rthz", 0.3e-4, 5e-4),
    ],
)
def test_settings_fill_their_range(drawn, name, low, high):
    """From one end nearly to the other, and not beyond."""
    values = np.array([flight.settings[name] for flight in drawn])
    assert values.min() >= low
    assert values.max() <= high
    assert np.ptp(values) > 0.8 * (high - low)


def test_half_of_the_flights_are_clean_and_air_is_rough_with_or_without(drawn):
    """By 400 draws, each within three standard deviations; every effect comes."""
    names = [each.settings["structural"].split(" + ") for each in drawn]
    clean = np.array([each == [""] for each in names])
    rough = np.array([each.settings["disturbance_rad_s2"] > 0.0 for each in drawn])
    assert clean.mean() == pytest.approx(CLEAN_FRACTION, abs=0.075)
    for part in (clean, ~clean):
        assert rough[part].mean() == pytest.approx(ROUGH_FRACTION, abs=0.105)
    assert {name for each in names for name in each} == {"", *EFFECTS}


def test_a_structural_effect_changes_nothing_else_of_the_flight(monkeypatch):
    """Vehicle, air and sensors are those of the flight that has none."""
    number = next(n for n in range(200) if str(draw_flight(1, n).settings["structural"]) == "dead zone")
    changed = draw_flight(1, number)
    monkeypatch.setattr("study.structural.CLEAN_FRACTION", 1.0)
    clean = draw_flight(1, number)
    differing = {name for name in clean.settings if clean.settings[name] != changed.settings[name]}
    assert differing == {"structural"}
    assert changed.scenario.effects.dead_zone > 0.0
    assert clean.scenario.effects.dead_zone == 0.0


@pytest.mark.thorough
def test_a_hidden_limit_clips_the_fraction_that_was_drawn():
    """Of the commands as they were without it, each axis by itself."""
    number = next(n for n in range(100) if draw_flight(1, n).clipped_fraction)
    drawn = dataclasses.replace(draw_flight(1, number), clipped_fraction=0.05)
    scenario = dataclasses.replace(drawn.scenario, duration_s=20.0)
    _, truth = simulate_drawn(dataclasses.replace(drawn, scenario=scenario))
    (setup,) = plan_flights(
        scenario,
        seed=1000 + number,
        duration_s=20.0,
        rate_hz=scenario.logging.rate_hz,
        autopilot=drawn.autopilot,
    )
    record = fly(setup)
    rows = (record.time_s >= setup.schedule.manoeuvre_s) & (record.time_s < setup.schedule.land_s)
    beyond = (
        np.abs(record.channels["achieved"][rows]) > truth["effects"]["unlogged saturation"]["torque_limit"]
    )
    np.testing.assert_allclose(beyond.mean(axis=0), 0.05, atol=0.002)


def test_every_drawn_inertia_is_one_of_matter(drawn):
    """No principal moment exceeds the sum of the other two."""
    for each in drawn:
        moments = np.linalg.eigvalsh(each.scenario.airframe().inertia_kg_m2)
        assert moments[0] > 0.0
        assert moments[2] < moments[0] + moments[1]


def test_the_gyro_scale_errs_by_what_the_intervals_allow_for(drawn):
    """One per cent in 95 of 100 cases; 1200 draws fix their spread to 2 %, three times that is allowed."""
    errors = [flight.settings[f"gyro_scale_{axis}"] for flight in drawn for axis in "pqr"]
    assert np.std(errors) == pytest.approx(GYRO_SCALE_SIGMA, rel=0.06)


@pytest.mark.parametrize(
    ("target", "regressor", "kind"),
    [
        ("p_dot", "L", "on-axis effectiveness"),
        ("p_dot", "N", "off-axis effectiveness"),
        ("q_dot", "q", "on-axis damping"),
        ("q_dot", "r", "off-axis damping"),
        ("r_dot", "pq", "gyroscopic"),
        ("r_dot", "pr", "product of inertia"),
        ("q_dot", "pp", "product of inertia"),
        ("q_dot", "1", ""),
        ("phi_dot", "p", ""),
    ],
)
def test_parameters_are_sorted_by_what_they_mean(target, regressor, kind):
    """Trim and kinematics are no property of a vehicle."""
    assert kind_of(target, regressor) == kind


def test_a_parameter_is_claimed_only_on_an_axis_that_is_not_refused():
    """And only if it is called identifiable."""
    table = parameters_of(
        [
            flight(
                0,
                parameter(),
                parameter(axis="q"),
                parameter(axis="r"),
                parameter(axis="", kind="lag"),
                parameter(identifiable=False),
            )
        ]
    )
    assert list(table["claimed"]) == [True, False, True, True, False]


def test_the_half_of_the_interval_that_points_to_the_truth_counts():
    """Intervals need not be symmetric: the truth lies at the upper end of one, the lower of the other."""
    table = parameters_of([flight(0, parameter(low=99.0, truth=102.0), parameter(low=99.0, truth=99.0))])
    np.testing.assert_allclose(table["z"], [-1.96, 1.96], atol=1e-4)
    assert list(table["inside"]) == [True, True]


def test_a_truth_outside_the_interval_is_not_counted():
    """By however little."""
    table = parameters_of([flight(0, parameter(truth=102.01), parameter(truth=97.99))])
    assert list(table["inside"]) == [False, False]


def test_right_intervals_keep_the_promise():
    """Normal errors with the width that they state."""
    rng = np.random.default_rng(3)
    truths = 100.0 + 2.0 / 1.96 * rng.standard_normal((700, 3))
    table = parameters_of(flight(n, *(parameter(truth=t) for t in row)) for n, row in enumerate(truths))
    (row,) = coverage_table(table).itertuples()
    assert 0.93 < row.coverage < 0.97
    assert row.low < 0.95 < row.high
    assert row.z_spread == pytest.approx(1.0, abs=0.1)


def test_values_of_one_flight_that_fail_together_count_as_one():
    """Ten values of each of fifty flights: all wrong or all right."""
    number = np.repeat(np.arange(50), 10)
    inside = number >= 5
    low, high = flights_interval(inside, number)
    alone_low, alone_high = binomial_interval(450, 500)
    few_low, few_high = binomial_interval(45, 50)
    assert low < alone_low
    assert high > alone_high
    assert (low, high) == pytest.approx((few_low, few_high), abs=0.03)


def test_independent_values_count_one_by_one():
    """Two of each of three hundred flights, right by chance."""
    rng = np.random.default_rng(4)
    inside = rng.random(600) < 0.9
    low, high = flights_interval(inside, np.repeat(np.arange(300), 2))
    expected = binomial_interval(int(inside.sum()), 600)
    assert (low, high) == pytest.approx(expected, abs=0.02)


def test_a_gain_is_wrong_beyond_twice_its_interval_and_three_per_cent():
    """Either alone is not enough: a wide interval is honest, a small error harms nobody."""
    table = parameters_of(
        [
            flight(0, parameter(truth=104.5)),
            flight(1, parameter(truth=103.9)),
            flight(2, parameter(low=99.5, high=100.5, truth=102.5)),
        ]
    )
    assert list(table["wrong"]) == [True, False, False]


def test_what_is_usable_and_wrong_is_counted_by_effect():
    """A flight with two effects counts for both; what is refused is never wrong."""
    wrong = parameter(truth=110.0)
    flights = [
        flight(0, wrong),
        flight(1, wrong, structural="dead zone + outliers"),
        flight(2, wrong, structural="outliers", verdicts=dict.fromkeys(AXES, "refused")),
        flight(3, parameter(), disturbance_rad_s2=1.3),
    ]
    counted = verdict_table(flights, parameters_of(flights)).set_index("effect")
    assert counted["wrong"].to_dict() == {
        "none, calm air": 1,
        "none, air as rough as flown": 0,
        "dead zone": 1,
        "outliers": 1,
        "any structural effect": 1,
        "all": 2,
    }
    assert counted.loc["outliers", ["flights", "axes", "usable", "refused"]].tolist() == [2, 6, 1, 4]


def test_coverage_is_that_of_flights_without_structural_effects():
    """A gain that a dead zone makes wrong says nothing of the interval's statistics."""
    flights = [flight(0, parameter()), flight(1, parameter(truth=110.0), structural="dead zone")]
    assert "| on-axis effectiveness | 1 of 1 | 100.0 %" in page(flights, parameters_of(flights))


def test_windless_flights_are_a_group_of_their_own():
    """And every flight is in some group."""
    groups = grouped(pd.DataFrame({"wind_m_s": [0.0, 0.5, 3.0, 6.0]}), "wind_m_s")
    assert list(groups) == ["up to 0", "0 to 2", "2 to 4", "4 to 6"]


class Here:
    """A pool that works in this process."""

    def __init__(self, *_arguments, **_keywords):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        pass

    imap_unordered = staticmethod(map)


def goes_on_where_it_stopped(folder, seed):
    """Study two flights, cut the second line in half, and study again."""
    words = ["--flights", "2", "--seed", str(seed), "--processes", "1", "--output", str(folder)]
    assert run.main(words) == 0
    (path,) = folder.glob("*.jsonl")
    first, second = path.read_text().splitlines(keepends=True)
    marked = json.dumps(json.loads(first) | {"kept": True}) + "\n"
    path.write_text(marked + second[:100])
    assert run.main(words) == 0
    flights = read_flights(path)
    assert [each["number"] for each in flights] == [0, 1]
    assert sum("kept" in each for each in flights) == 1
    assert "| on-axis effectiveness |" in (folder / "coverage.md").read_text()


@pytest.mark.thorough
def test_a_study_goes_on_where_it_stopped(tmp_path, capsys, monkeypatch):
    """What is missing is flown, and what the interruption cut in half."""
    flown = []

    def measure_one(task):
        flown.append(task)
        return flight(task[1], parameter(truth=100.0 + task[1]))

    monkeypatch.setattr(run, "_measure_one", measure_one)
    monkeypatch.setattr(run.multiprocessing, "get_context", lambda _: SimpleNamespace(Pool=Here))
    goes_on_where_it_stopped(tmp_path, 1)
    assert flown == [(1, 0), (1, 1), (1, 1)]
    assert "2 flights" in capsys.readouterr().out


@pytest.mark.thorough
def test_a_short_study_flies(tmp_path, capsys):
    """In processes of its own; of this seed the first two flights are short and slowly logged."""
    goes_on_where_it_stopped(tmp_path, 260)
    assert "2 flights" in capsys.readouterr().out


def test_a_flight_that_fails_is_told_and_fails_the_study(monkeypatch):
    """The others go on."""

    def fail(drawn):
        raise ValueError(f"no flight {drawn.number}")

    monkeypatch.setattr(run, "measure", fail)
    found = run._measure_one((1, 3))
    assert found["number"] == 3
    assert "no flight 3" in found["error"]


@pytest.mark.thorough
def test_page_and_plots_need_no_full_study(tmp_path):
    """A few flights, of which none shows a lag."""
    flights = [flight(n, parameter(truth=100.0 + n), parameter(kind="on-axis damping")) for n in range(4)]
    table = parameters_of(flights)
    text = page(flights, table)
    draw_plots(table, verdict_table(flights, table), tmp_path)
    assert "| on-axis effectiveness | 4 of 4 | 75.0 %" in text
    assert (tmp_path / "z.png").stat().st_size > 5000
    assert (tmp_path / "groups.png").stat().st_size > 5000
    assert (tmp_path / "effects.png").stat().st_size > 5000


@pytest.mark.thorough
def test_margins_are_held_against_those_of_the_simulators_own_loop():
    """Within a degree and half a decibel in a hexarotor's calm flight; both loops of the three axes."""
    drawn = draw_loop(1, 0)
    short = dataclasses.replace(drawn, scenario=dataclasses.replace(drawn.scenario, duration_s=20.0))
    loops = measure_loops(short)["loops"]
    assert [(one["axis"], one["loop"]) for one in loops] == [
        (axis, loop) for axis in AXES for loop in ("rate", "full")
    ]
    told = [one for one in loops if one["phase_margin_deg"]["value"] is not None]
    assert len(told) >= 2
    for one in told:
        assert one["phase_margin_deg"]["value"] == pytest.approx(one["phase_margin_deg"]["truth"], abs=1.0)
        assert one["gain_margin_db"]["value"] == pytest.approx(one["gain_margin_db"]["truth"], abs=0.5)


@pytest.mark.thorough
def test_the_true_loop_is_that_of_the_logs_parameters():
    """Made of the simulator's gains, not by the package from what the log says of them."""
    for number in range(6):
        drawn = draw_loop(1, number)
        log, truth = simulate_drawn(
            dataclasses.replace(drawn, scenario=dataclasses.replace(drawn.scenario, duration_s=15.0))
        )
        setup = setup_of(drawn)
        told = named(drawn.autopilot).controllers(log, log.parameters).axes["roll"]
        true = true_controller(setup, 0)
        frequency_hz = np.array([0.5, 2.0])
        for loop in (told, true):
            assert loop.period_s == pytest.approx(1.0 / setup.loop_hz, rel=0.01)
        plant = true_plant(setup, truth, 0)
        found, wanted = (close(each, plant, frequency_hz).rate for each in (told, true))
        np.testing.assert_allclose(found, wanted, rtol=0.02)
        if drawn.autopilot == "px4":
            return
    pytest.fail("none of the flights was PX4's")


@pytest.mark.thorough
def test_the_table_of_margins_counts_what_holds_the_truth(tmp_path):
    """Of two phase margins one is off by three of its half-widths; a picture is drawn of few flights."""

    def figure(value):
        return {"truth": 40.0, "value": value, "low": value - 1.0, "high": value + 1.0}

    def loop(value):
        shared = {"axis": "roll", "loop": "rate", "verdict": "usable", "extrapolated": False}
        names = {name: figure(value) for name in WORDS}
        return {**shared, "true_stable": True, "stable": True, **names}

    settings = {"seed": 1, "autopilot": "px4", "rate_hz": 400.0, "manoeuvre": "sticks"}
    flights = [{**settings, "number": n, "loops": [loop(40.5 + 2.5 * n)]} for n in range(2)]
    table = loops_of(flights)
    draw_margins(table, tmp_path / "margins.png")
    assert "| phase margin | 2 | 50.0 % |" in margins_page(flights, table)
    assert (tmp_path / "margins.png").stat().st_size > 5000


def test_the_study_of_margins_flies_its_own_flights(monkeypatch):
    """`--margins` measures loops, and leaves the other study's table alone."""
    monkeypatch.setattr(run, "measure_loops", lambda drawn: {"number": drawn.number})
    assert run._measure_margins((1, 5)) == {"number": 5}


def test_a_tuned_vehicle_flies_every_gain_of_its_file() -> None:
    """P, I, D and the angle gain each by itself, or all three by a common one."""
    tunable = named("px4").tunable({"MC_ROLLRATE_K": 1.0})
    assert tunable is not None
    names = tunable.axes["roll"]

    def found(**next_over_now: float) -> list[float]:
        gains = {name: GainChange(2.0, 2.0 * ratio, 9.0) for name, ratio in next_over_now.items()}
        return _ratios(AxisTuning(verdict="change", reasons=(), gains=gains), names).tolist()

    assert found(MC_ROLLRATE_K=1.3) == [1.3, 1.3, 1.3, 1.0]
    assert found(MC_ROLLRATE_P=1.2, MC_ROLLRATE_D=0.8, MC_ROLL_P=1.1) == [1.2, 1.0, 0.8, 1.1]


@functools.cache
def _judged(axis: int) -> tuple[optimum.Judge, dict[str, float]]:
    """An axis of a drawn vehicle of PX4, and the parameters of its log."""
    scenario, autopilot, _ = next(one for one in map(partial(draw_vehicle, 5), range(20)) if one[1] == "px4")
    gusty = dataclasses.replace(scenario.effects, disturbance_rad_s2=(1.0, 1.0, 0.5))
    scenario = dataclasses.replace(scenario, effects=gusty)
    setup = flight_of(scenario, autopilot, of_each_gain((1.0, 1.0, 1.0)), 1)
    known = parameters(setup, rate_hz=280.0)
    return optimum.judge_of(setup, known, axis), known


def test_the_best_gains_of_px4_are_bounded_by_what_both_of_its_parameters_make() -> None:
    """MC_ROLLRATE_P may be 0.5, and MC_ROLLRATE_K, which multiplies it, 5: `tune` may set both."""
    judge, known = _judged(0)
    assert judge.highest[0] * known["MC_ROLLRATE_P"] == pytest.approx(0.5 * 5.0)
    assert judge.highest[2] * known["MC_ROLLRATE_D"] == pytest.approx(0.01 * 5.0)
    assert judge.highest[3] * known["MC_ROLL_P"] == pytest.approx(12.0)


def test_no_gains_that_flew_and_keep_everything_are_better_than_the_best(monkeypatch) -> None:
    """Where the search ends elsewhere, it goes on from them."""
    judge, _ = _judged(0)
    monkeypatch.setattr(optimum, "_POLISHED", 20)
    good = optimum.best_factors(judge, 0.05, np.ones((1, 4)))
    monkeypatch.setattr(optimum, "_BEST", {(5, 0, 0): np.array([0.5, 0.5, 0.5, 1.0])})
    flights = [{"axes": {"roll": {"factors": one}}} for one in ([1.0, 1.0, 1.0, 1.0], good.tolist())]
    best = optimum._best(judge, 0.05, (5, 0), flights)
    assert best["error_rad"] <= judge.error_rad(judge.controller(good))


def test_the_study_of_rate_loops_counts_those_that_lose_their_limits() -> None:
    """One that flew below them may stay there, and may not lose more."""

    def axis(now: float, following: float) -> dict[str, Any]:
        true = {"resonance_db": 1.0, "error_rad": 1.0}
        return {"verdict": "change", "flown": {"spare": now, **true}, "next": {"spare": following, **true}}

    axes = {"a": axis(1.2, 1.01), "b": axis(1.2, 0.99), "c": axis(0.7, 0.7), "d": axis(0.7, 0.6)}
    text = rate_mode.summarise([{"seed": 1, "axes": {**axes, "e": {"verdict": "refused"}}}])
    assert "4 of 5 axes" in text
    assert "on 2 of 4 axes" in text


@pytest.mark.thorough
def test_a_log_without_its_angle_gains_has_no_angle_loop() -> None:
    """And its rate loop is as it was."""
    result = flown("ardupilot")
    assert result.closed_loop is not None
    found = rate_mode.without_angle_loop(result).closed_loop
    assert found is not None
    roll, before = (one.controllers.axes["roll"] for one in (found, result.closed_loop))
    assert roll.angle_gain_per_s is None
    frequency_hz = np.array([1.0, 10.0])
    np.testing.assert_allclose(on_rate(roll, frequency_hz), on_rate(before, frequency_hz), rtol=1e-9)


@pytest.mark.parametrize(
    ("rms_deg_s", "code", "is_weak"),
    [(12.0, "QL615", True), (30.0, "QL615", False), (12.0, "QL641", False), (30.0, "QL618", True)],
)
def test_a_pilot_flies_stronger_where_he_is_told_to(rms_deg_s: float, code: str, is_weak: bool) -> None:
    """The finding asks for that below 20 deg/s; a model that is too uncertain for gains always does."""
    seen = finding("QL504", "error", {"rate_rms_deg_s": rms_deg_s}, axes=("yaw",))
    result = cast(Result, SimpleNamespace(diagnosis=SimpleNamespace(findings=[seen])))
    refused = AxisTuning(verdict="refused", reasons=(finding(code, "warning", {}, axes=("yaw",)),))
    assert optimum._is_weak(result, Tuning(axes={"yaw": refused}, limits=GOOD), "yaw") == is_weak
