"""The strength of instruments against what theory says of it."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from quadid_logs.align import cut
from quadid_logs.data.settings import Settings
from quadid_logs.identify import identify
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.first_stage import FirstStage, first_stage, with_strong_instruments
from quadid_logs.identify.instruments import from_attitude, held_by_attitude
from quadid_logs.load import prepare
from quadid_logs.planning import _airframe, _manoeuvre, make_plan
from quadid_logs.simulator import Scenario, plan_flights
from quadid_logs.simulator import fly as fly_setup
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.truth import flight_truth

from .vehicles import QUAD, fly, multisine


def driven(reference: np.ndarray, torque: np.ndarray) -> FirstStage:
    """Return the strength of these set-points in a flight with that torque."""
    data = fly(QUAD, torque)
    (segment,) = data.segments
    known = dataclasses.replace(segment, reference=reference)
    design = build_design(dataclasses.replace(data, segments=(known,)), 5.0)
    assert design is not None
    found = first_stage(design.high_passed(0.3))
    assert found is not None
    return found


TORQUE = multisine(40.0)


def test_setpoints_that_nothing_follows_have_a_strength_of_about_one() -> None:
    """What follows from them is what would by chance."""
    noise = np.random.default_rng(0).standard_normal(TORQUE.shape)
    found = driven(noise, TORQUE)
    assert np.all((found.statistic > 0.3) & (found.statistic < 3.0))
    assert not found.strong.any()


def test_the_critical_value_of_many_instruments_lies_between_the_published_ones() -> None:
    """Montiel Olea and Pflueger: 23.1 for one instrument, 10 in the limit of many."""
    noise = np.random.default_rng(1).standard_normal(TORQUE.shape)
    assert np.all((driven(noise, TORQUE).needed > 10.0) & (driven(noise, TORQUE).needed < 23.2))


def test_each_axis_has_a_strength_of_its_own() -> None:
    """Roll follows its set-point to two thirds, pitch and yaw follow none."""
    reference = np.random.default_rng(2).standard_normal(TORQUE.shape)
    reference[:, 0] = TORQUE[:, 0] + 0.5 * np.std(TORQUE[:, 0]) * reference[:, 0]
    assert driven(reference, TORQUE).strong.tolist() == [True, False, False]


@pytest.mark.parametrize("seed", range(3))
def test_a_flight_without_setpoints_has_no_strength(seed: int) -> None:
    """There is nothing that drives."""
    design = build_design(fly(QUAD, multisine(20.0 + seed)), 5.0)
    assert design is not None
    assert first_stage(dataclasses.replace(design, instruments=None)) is None


def held_roll(*, injected: bool, smoothing_hz: float = 5.0, gain: float = -4.0, asked: float = 0.0) -> Design:
    """Return a flight whose roll set-points answer the angle by `gain` [1/s], with a chirp or without."""
    data = fly(QUAD, TORQUE)
    (segment,) = data.segments
    angle = np.cumsum(segment.body_rate_rad_s, axis=0) * data.sample_period_s
    reference = np.zeros_like(angle)
    reference[:, 0] = gain * angle[:, 0]
    wanted = np.random.default_rng(3).standard_normal(angle.shape[0])
    wanted = uniform_filter1d(wanted, 20)
    reference[:, 0] += asked * wanted * np.std(reference[:, 0]) / np.std(wanted)
    if injected:
        reference = np.column_stack([reference, segment.torque[:, 0]])
    known = dataclasses.replace(segment, attitude_rad=angle, reference=reference)
    built = build_design(dataclasses.replace(data, segments=(known,)), smoothing_hz)
    assert built is not None
    return built


def chosen(design: Design) -> Design:
    """Return the design with the instruments that serve roll."""
    return with_strong_instruments(design, design.high_passed(0.3), [0])


def test_setpoints_that_hold_an_attitude_are_no_instruments_beside_a_chirp() -> None:
    """Of -4 times the angle nothing is left; the chirp stays as it is."""
    before, after = held_roll(injected=True), chosen(held_roll(injected=True))
    assert before.instruments is not None
    assert after.instruments is not None
    left, logged = np.std(after.instruments[:, 0::6], axis=0), np.std(before.instruments[:, 0::6], axis=0)
    assert np.all(left < 1e-3 * logged)
    np.testing.assert_allclose(after.instruments[:, 3::6], before.instruments[:, 3::6])


def test_high_passed_setpoints_without_what_held_an_attitude_are_not_those_before() -> None:
    """Both designs have the same columns, and each its own instruments."""
    design = held_roll(injected=True)
    before, after = design.high_passed(0.3), chosen(design).high_passed(0.3)
    assert before.instruments is not None
    assert after.instruments is not None
    assert np.all(np.std(after.instruments[:, 0::6]) < 1e-3 * np.std(before.instruments[:, 0::6]))


def test_a_design_high_passed_again_loses_more_to_a_higher_edge() -> None:
    design = held_roll(injected=True)
    low, high = (design.high_passed(each).columns["p"] for each in (0.3, 1.0))
    assert np.std(high) < 0.9 * np.std(low)


def test_setpoints_that_hold_an_attitude_stay_where_nothing_else_drives_the_axis() -> None:
    """Without a chirp the axis would have no instrument: its interval widens instead."""
    before, after = held_roll(injected=False), chosen(held_roll(injected=False))
    assert after.instruments is not None
    np.testing.assert_array_equal(after.instruments, before.instruments)


def test_setpoints_that_ask_more_than_they_answer_stay() -> None:
    """Three times as much of roll is asked for as answers the angle."""
    design = held_roll(injected=True, asked=3.0)
    np.testing.assert_array_equal(chosen(design).instruments, design.instruments)


def test_setpoints_that_go_with_the_attitude_stay() -> None:
    """What does not oppose the angle answers no gust: taking it out would leave more of what does."""
    design = held_roll(injected=True, gain=4.0)
    assert not held_by_attitude(design.high_passed(0.3)).any()
    np.testing.assert_array_equal(chosen(design).instruments, design.instruments)


def test_the_interval_knows_what_was_held_after_it_was_taken_out() -> None:
    """The fraction that follows from the attitude is that of the set-points as logged."""
    assert from_attitude(chosen(held_roll(injected=True)).high_passed(0.3))[0] == pytest.approx(1.0, abs=1e-3)


def test_another_band_gets_the_same_instruments() -> None:
    """The set-points that were taken out stay out."""
    other = held_roll(injected=True, smoothing_hz=8.0)
    again = other.instrumented_as(chosen(held_roll(injected=True)))
    assert other.instruments is not None
    assert again.instruments is not None
    assert np.std(again.instruments[:, 0]) < 1e-3 * np.std(other.instruments[:, 0])
    none = other.instrumented_as(other.without_instruments())
    assert none.instruments is None


@pytest.mark.thorough
def test_a_chirp_in_gusts_tells_the_effectiveness_within_three_per_cent() -> None:
    """The flight that `plan` promises, in gusts of 0.5 rad/s^2: its set-points hold roll and answer them."""
    plan = make_plan("ardupilot", ["roll"])
    scenario = Scenario(
        name="sweep",
        sentence="Roll is swept in gusts.",
        airframe=partial(_airframe, 0),
        manoeuvre=partial(_manoeuvre, plan),
        duration_s=plan.duration_s,
        effects=Effects(disturbance_rad_s2=(0.5, 0.5, 0.5)),
    )
    setups = plan_flights(
        scenario, seed=8, duration_s=plan.duration_s, rate_hz=scenario.logging.rate_hz, autopilot="ardupilot"
    )
    records = tuple(fly_setup(each) for each in setups)
    truth = flight_truth(records, scenario="sweep", boot_s=scenario.logging.boot_s)
    data = cut(prepare(log_flights(records, scenario.logging)), Settings().align)
    found = identify(data, Settings().identify).recommended
    assert found is not None
    assert found.B[0, 0] == pytest.approx(truth["models"]["damped"]["B"][0][0], rel=0.03)
