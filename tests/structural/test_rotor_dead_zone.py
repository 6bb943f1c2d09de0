"""Rotors that ignore small commands: the effectiveness comes out low, and the interval holds the truth."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from quadid_logs import analyze
from quadid_logs.align import cut
from quadid_logs.data.model import EffectCheck
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.identify.structural import _Extended, _Lost, is_seen
from quadid_logs.load import prepare
from quadid_logs.pipeline import judge
from quadid_logs.simulator import SCENARIOS, fly, plan_flights, simulate
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.vocabulary import AXES, ON_AXIS
from tests.marks import thorough
from tests.structural.test_seen_effects import ROLL, YAW, check, widened


@functools.cache
def flown(scenario: str, autopilot: str) -> tuple[dict, Result]:
    """Fly half a minute, and analyze the log."""
    flight = simulate(scenario, seed=3, duration_s=40.0, autopilot=autopilot)
    prepared = prepare(flight.log)
    data = cut(prepared, Settings().align)
    return flight.truth, judge(
        prepared.log, data, Settings(), vehicle=None, published=False, loop="verdict", timings_s={}
    )


def of_rotors(axis: int, **values: float) -> EffectCheck:
    given = {"statistic": 100.0, "explained": 0.02, "shift": 0.2, "most": 0.25} | values
    return EffectCheck(axis=axis, effect="rotor threshold", **given)


@pytest.mark.thorough
@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_the_interval_holds_what_rotors_that_ignore_small_commands_hide(axis: str, autopilot: str) -> None:
    """Per unit of command; it was low by 3 to 5 half widths, at an R2 of 0.98, and called usable."""
    truth, result = flown("rotor-dead-zone", autopilot)
    assert result.closed_loop is not None
    effectiveness = result.closed_loop.axes[axis].effectiveness
    assert effectiveness is not None
    low, high = effectiveness.ci95
    gain = float(np.diag(np.array(truth["models"]["damped"]["B"]))[AXES.index(axis)])
    assert low <= gain <= high
    assert result.diagnosis.axes[axis].verdict != "refused"
    named = [each for each in result.diagnosis.findings if each.code == "QL523"]
    assert any(axis in each.axes for each in named)


@pytest.mark.thorough
@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_the_level_is_that_of_the_rotors(autopilot: str) -> None:
    """Within the steps of the levels that are tried; a command of one is the full thrust of a rotor."""
    model = flown("rotor-dead-zone", autopilot)[1].identification.recommended
    assert model is not None
    assert model.structural is not None
    levels = {each.place for each in model.structural.effects if each.effect == "rotor threshold"}
    assert len(levels) == 1


@pytest.mark.thorough
def test_what_is_lost_at_most_is_more_than_what_is_likely() -> None:
    """On each axis."""
    model = flown("rotor-dead-zone", "ardupilot")[1].identification.recommended
    assert model is not None
    assert model.structural is not None
    found = [each for each in model.structural.effects if each.effect == "rotor threshold"]
    assert len(found) == 3
    assert all(0.0 < each.shift < each.most < 1.5 * each.shift for each in found)


@pytest.mark.thorough
def test_rotors_that_follow_all_commands_leave_the_interval_narrow() -> None:
    """The clean flight stays usable, within 4 % on all axes."""
    _, result = flown("sysid-quad-x", "ardupilot")
    model = result.identification.recommended
    assert model is not None
    for axis in AXES:
        entry = model.entries[ON_AXIS[axis]]
        assert entry.ci95[1] - entry.ci95[0] < 0.1 * entry.value
        assert result.diagnosis.axes[axis].verdict == "usable"


def test_a_dead_zone_of_the_rotors_is_seen_however_rough_the_air() -> None:
    """Gusts are most of what a model leaves; the shape is that of nothing else."""
    effect = of_rotors(ROLL)
    assert is_seen(check(effect), effect)


def test_thrust_that_bends_is_no_dead_zone() -> None:
    """Little of the command is lost below any level, however clear it is: rotors do follow."""
    bends = [_Extended(1000.0, 0.5, 0.01, coefficient=-0.05, held=0.3) for _ in range(3)]
    assert _Lost.of(bends).fraction == pytest.approx(0.05 / 1.01)


def test_axes_that_contradict_each_other_are_no_dead_zone() -> None:
    """Yaw lost all below a level, and roll, which was better known, a tenth: they have the same rotors."""
    yaw = _Extended(57.6, 0.14, 0.0, coefficient=-0.99, held=0.3)
    roll = _Extended(6.3, 0.09, 0.0, coefficient=-0.1, held=0.3)
    assert _Lost.of([yaw, roll]).fraction < 0.25


@pytest.mark.parametrize("statistic", [14.0, 100.0])
def test_the_interval_covers_how_large_a_dead_zone_of_the_rotors_may_be(statistic: float) -> None:
    """Not only what the effectiveness most likely is with it."""
    low, high = widened(of_rotors(YAW, statistic=statistic))
    assert (low[YAW], high[YAW]) == pytest.approx((1.0, 1.25))


def test_what_chance_makes_of_rotors_widens_nothing() -> None:
    """One flight in two hundred has as much by chance."""
    _, high = widened(of_rotors(YAW, statistic=8.0))
    assert high[YAW] == 1.0


@pytest.mark.thorough
def test_two_effects_that_come_together_move_the_effectiveness_further_than_either() -> None:
    """A dead zone of each axis beside that of the rotors: 5 % low, and either alone explains half of that."""
    effects = Effects(dead_zone=0.003, rotor_dead_zone=0.006)
    scenario = replace(SCENARIOS["sysid-quad-x"], effects=effects)
    (setup,) = plan_flights(scenario, seed=3, duration_s=30.0, rate_hz=400.0, autopilot="ardupilot")
    record = fly(setup)
    truth = flight_truth((record,), scenario="both", boot_s=0.0)
    prepared = prepare(log_flights((record,), scenario.logging))
    result = judge(
        prepared.log,
        cut(prepared, Settings().align),
        Settings(),
        vehicle=None,
        published=False,
        loop="verdict",
        timings_s={},
    )
    model = result.identification.recommended
    assert model is not None
    gains = np.diag(np.array(truth["models"]["damped"]["B"]))
    for axis, gain in zip(AXES, gains, strict=True):
        low, high = model.entries[ON_AXIS[axis]].ci95
        assert low <= gain <= high, axis


@pytest.mark.thorough
def test_what_rotors_lose_of_nearly_all_torque_is_no_second_effect() -> None:
    """A vehicle without a dead zone, logged at half its loop's rate: pitch was told as 50 to 1260."""
    flight = simulate("doublets", duration_s=60.0, rate_hz=250.0, autopilot="px4")
    pitch = analyze(flight.log).identification.recommended.entries[ON_AXIS["pitch"]]
    assert pitch.ci95[1] < 1.5 * pitch.value
