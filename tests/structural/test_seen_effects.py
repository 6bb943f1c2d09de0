"""Which effects count as seen: beyond chance, and much of what the model leaves."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.model import EffectCheck, StructuralCheck
from quadid_logs.diagnose.structural_findings import _effects
from quadid_logs.identify.inference import Estimate
from quadid_logs.identify.structural import (
    _Candidate,
    _checked,
    _Extended,
    _fits,
    _modes,
    _resonance,
    _tilts,
    seen_effects,
    with_alternatives,
)
from quadid_logs.identify.structures import DAMPED

ROLL, YAW = 0, 2


def named_of(found: StructuralCheck, number: int) -> list[Finding]:
    """Return the findings of an axis whose rotors no log names."""
    return list(_effects(found, number, averaged=False, rotors_told=False))


def check(
    *effects: EffectCheck, instrumented: bool = False, own_timing: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> StructuralCheck:
    nothing = np.zeros((0, 3))
    return StructuralCheck(
        effects=effects,
        timing=None,
        flight_gain=nothing,
        flight_half_width=nothing,
        persistence=np.zeros(3),
        spread=np.zeros(3),
        feedback=np.zeros(3),
        instrumented=instrumented,
        own_timing=np.array(own_timing),
    )


def dead_zone(axis: int, *, explained: float, statistic: float = 100.0) -> EffectCheck:
    return EffectCheck(axis=axis, effect="threshold", statistic=statistic, explained=explained, shift=0.2)


def tilt(axis: int, *, explained: float, statistic: float = 100.0) -> EffectCheck:
    return EffectCheck(axis=axis, effect="tilt", statistic=statistic, explained=explained, shift=-0.1)


def widened(
    *effects: EffectCheck, own_timing: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> tuple[FloatArray, FloatArray]:
    """Return the ends (3,) of intervals about an effectiveness of one, known exactly but for the effects."""
    theta = np.zeros((3, len(DAMPED.columns)))
    theta[range(3), [len(DAMPED.terms) + axis for axis in range(3)]] = 1.0
    known = Estimate(theta=theta, low=theta, high=theta, kept=theta > 0.0)
    found = with_alternatives(DAMPED, known, check(*effects, own_timing=own_timing))
    return DAMPED.on_axis(found.low), DAMPED.on_axis(found.high)


def test_a_dead_zone_that_explains_a_third_is_not_seen_alone() -> None:
    """Without set-points, small torques are answers to gusts and seem to have less effect."""
    assert not seen_effects(check(dead_zone(YAW, explained=0.32)), YAW)


def test_it_is_seen_alone_where_set_points_tell_gusts_apart() -> None:
    """With set-points as instruments no answer to a gust passes for a dead zone."""
    yaw = dead_zone(YAW, explained=0.32)
    assert seen_effects(check(yaw, instrumented=True), YAW) == [yaw]


@pytest.mark.parametrize("small", [{"explained": 0.32}, {"explained": 0.13, "statistic": 20.0}])
def test_it_is_seen_where_another_axis_shows_it_clearly(small: dict[str, float]) -> None:
    """All axes have the same rotors, and on one that was commanded more it explains less."""
    yaw = dead_zone(YAW, **small)
    assert seen_effects(check(yaw, dead_zone(ROLL, explained=0.9)), YAW) == [yaw]


def test_it_must_be_beyond_chance_on_its_own_axis() -> None:
    """What noise does as often is no dead zone wherever else one is."""
    yaw = dead_zone(YAW, explained=0.32, statistic=5.0)
    assert not seen_effects(check(yaw, dead_zone(ROLL, explained=0.9)), YAW)


def test_a_limit_is_seen_where_another_axis_shows_it_clearly() -> None:
    """A pitch that was 12 % low had a fiftieth of the evidence of the roll beside it."""
    pitch, roll = (
        EffectCheck(axis=axis, effect="limit", statistic=statistic, explained=0.8, shift=0.1)
        for axis, statistic in ((1, 19.0), (ROLL, 1000.0))
    )
    assert seen_effects(check(pitch, roll), 1) == [pitch]
    assert not seen_effects(check(pitch), 1)


def test_of_levels_that_are_clear_the_one_that_explains_most_counts() -> None:
    """Beyond the true limit the statistic may still grow, with less of the residual explained."""
    at, beyond = (
        EffectCheck(axis=ROLL, effect="limit", statistic=statistic, explained=explained, shift=0.1)
        for statistic, explained in ((1028.0, 0.97), (1252.0, 0.85))
    )
    assert max(at, beyond, key=_fits) is at


def test_of_levels_that_chance_makes_the_likeliest_counts() -> None:
    """What explains most may be a rare outlier's doing."""
    rare, likely = (
        EffectCheck(axis=ROLL, effect="limit", statistic=statistic, explained=explained, shift=0.1)
        for statistic, explained in ((5.0, 0.5), (20.0, 0.1))
    )
    assert max(rare, likely, key=_fits) is likely


def test_an_axis_does_not_vouch_for_itself() -> None:
    """A dead zone that explains too little is not clear because it is its own witness."""
    assert not seen_effects(check(dead_zone(YAW, explained=0.32, statistic=1000.0)), YAW)


@pytest.mark.parametrize(("statistic", "upper"), [(14.0, 1.2), (10.0, 1.0)])
def test_an_interval_covers_an_effect_that_chance_seldom_makes(statistic: float, upper: float) -> None:
    """A roll that was 8 % low by a dead zone in rough air had no more evidence than the first."""
    _, high = widened(dead_zone(ROLL, explained=0.1, statistic=statistic))
    assert high[ROLL] == pytest.approx(upper)


def test_a_dead_zone_that_may_be_on_one_axis_may_be_on_all() -> None:
    """They have the same rotors; a roll that was 6 % low had half the evidence of the pitch beside it."""
    _, high = widened(
        dead_zone(ROLL, explained=0.1, statistic=14.0), dead_zone(YAW, explained=0.1, statistic=6.0)
    )
    assert high[YAW] == pytest.approx(1.2)


def test_a_misfit_of_the_response_may_move_the_effectiveness_either_way() -> None:
    """Saturation that no log shows looked like a second lag, which moved the gain away from the truth."""
    found = EffectCheck(axis=ROLL, effect="second lag", statistic=52.0, explained=0.24, shift=-0.05)
    low, high = widened(found)
    assert (low[ROLL], high[ROLL]) == pytest.approx((0.95, 1.05))


def test_a_dead_zone_that_may_be_there_only_raises_the_effectiveness() -> None:
    """Torque that is lost makes an effectiveness low, never high."""
    low, _ = widened(dead_zone(ROLL, explained=0.1, statistic=14.0))
    assert low[ROLL] == 1.0


@pytest.mark.parametrize(("rate_hz", "highest_hz"), [(20.0, None), (50.0, 6.0), (400.0, 12.0)])
def test_no_resonance_is_looked_for_that_the_log_is_too_slow_for(
    rate_hz: float, highest_hz: float | None
) -> None:
    """At 20 Hz one was found that no vehicle had: its flank is what the torque does between two samples."""
    torque = SimpleNamespace(shaped=lambda _: np.zeros((2, 3)))
    design = SimpleNamespace(sample_period_s=1.0 / rate_hz, torque=torque, train=slice(None))
    model = SimpleNamespace(actuator=SimpleNamespace(lag_s=0.0, delay_s=0.0))
    tried = [float(each.place[0]) for each in _modes(cast("Any", design), cast("Any", model))]
    assert max(tried, default=None) == highest_hz


def test_a_resonance_is_looked_for_in_any_phase() -> None:
    """Deflection and rate are a quarter of a turn apart, and as large at their frequency."""
    deflection, rate = (response(np.array([2j * np.pi * 2.0])) for response in _resonance(2.0))
    np.testing.assert_allclose(rate / deflection, 1j)


@pytest.mark.parametrize(("explained", "statistic"), [(-0.1, 0.0), (0.5, 4000.0)])
def test_a_resonance_that_leaves_more_than_there_was_is_none(explained: float, statistic: float) -> None:
    """By its statistic it hid the one beside it that explained half of the residual."""
    mode = _Candidate("mode", np.zeros((1, 3, 2)), np.full(3, 12.0))
    found = _Extended(statistic=4000.0, explained=explained, shift=0.6, coefficient=0.1, held=0.0)
    assert _checked(mode, ROLL, found).statistic == statistic


@pytest.mark.parametrize(("coefficient", "statistic"), [(0.8, 300.0), (-0.8, 0.0)])
def test_where_only_peaks_are_a_torque_may_be_limited_and_not_dead(
    coefficient: float, statistic: float
) -> None:
    """A dead zone is below: of flown doublets one was found that all but the peaks would be in."""
    peaks = _Candidate("limit", np.zeros((1, 3, 1)), np.full(3, 0.2))
    found = _Extended(statistic=300.0, explained=0.5, shift=-0.7, coefficient=coefficient, held=0.0)
    assert _checked(peaks, ROLL, found).statistic == statistic


def test_an_effect_on_one_axis_leaves_the_others_a_lag_of_their_own() -> None:
    """All have one lag: on a vehicle that tips over it took up the tilt, and yaw was 10 % high."""
    low, high = widened(tilt(ROLL, explained=0.6), own_timing=(0.03, 0.02, -0.08))
    np.testing.assert_allclose([low[YAW], high[YAW]], [0.92, 1.0])
    # The axis that has it is judged with it, at the lag of all.
    np.testing.assert_allclose([low[ROLL], high[ROLL]], [0.9, 1.0])


def test_without_an_effect_the_lag_of_all_is_that_of_each() -> None:
    """More axes tell it better than one does."""
    low, high = widened(tilt(ROLL, explained=0.6, statistic=5.0), own_timing=(0.03, 0.02, -0.08))
    np.testing.assert_allclose([low[YAW], high[YAW]], 1.0)


def test_a_moment_of_the_tilt_is_covered_whatever_it_explains() -> None:
    """It is one column: nothing was chosen to make it large."""
    low, high = widened(tilt(ROLL, explained=-0.01, statistic=20.0))
    np.testing.assert_allclose([low[ROLL], high[ROLL]], [0.9, 1.1])


@pytest.mark.parametrize(("explained", "lower"), [(0.2, 1.0), (0.3, 0.9)])
def test_a_swing_is_covered_only_where_it_explains_much(explained: float, lower: float) -> None:
    """What gusts and attitude loop make of a tilt looks like it: every third rough flight was widened."""
    load = EffectCheck(axis=ROLL, effect="swing", statistic=20.0, explained=explained, shift=-0.1)
    low, _ = widened(load)
    assert low[ROLL] == pytest.approx(lower)


@pytest.mark.parametrize(("shift", "told"), [(0.12, True), (-0.12, True), (0.08, False), (-0.08, False)])
def test_a_loss_that_may_be_there_is_told_if_it_would_change_the_number(shift: float, told: bool) -> None:
    """A yaw that was 24 % low was called usable, because its interval was wide on one side."""
    possible = EffectCheck(axis=ROLL, effect="limit", statistic=30.0, explained=0.1, shift=shift)
    assert [one.code for one in named_of(check(possible), ROLL)] == ["QL533"] * told


def test_a_tilt_that_may_be_there_is_in_the_interval_alone() -> None:
    """Small vehicles show a trace of it in every flight, beside numbers that are right."""
    assert not named_of(check(tilt(ROLL, explained=0.1)), ROLL)


@pytest.mark.parametrize(("low_hz", "places"), [(0.3, [0.35, 0.45, 0.6, 0.8]), (0.5, [0.6, 0.8]), (1.26, [])])
def test_no_load_swings_below_the_fitted_band(low_hz: float, places: list[float]) -> None:
    """A small quadrotor fitted from 1.3 Hz on seemed to have one: the flank of a swing is any slow moment."""
    grid = SimpleNamespace(s=np.zeros(4), spectrum_of=lambda _: None, lay=lambda *_: np.zeros((4, 3)))
    design = SimpleNamespace(
        chunks=(SimpleNamespace(attitude_rad=np.zeros((4, 3)), n_samples=4),),
        torque=SimpleNamespace(grids=(grid,)),
        high_pass_hz=low_hz,
        high_pass=lambda rows, _: rows,
        train=slice(None),
        sample_period_s=0.01,
    )
    tried = [each.place[0] for each in _tilts(cast("Any", design)) if each.effect == "swing"]
    assert tried == places


def test_what_would_change_the_number_is_said_in_words() -> None:
    """A pilot wants to know what to look for."""
    (finding,) = named_of(check(dead_zone(ROLL, explained=0.1, statistic=14.0)), ROLL)
    assert finding.title == (
        "The roll effectiveness would be 20 % higher if small torques had less effect: the flight "
        "does not rule that out"
    )


def test_beside_an_effect_that_is_seen_no_other_is_left_open() -> None:
    """It is its shadow."""
    shadow = EffectCheck(axis=ROLL, effect="second lag", statistic=30.0, explained=0.1, shift=0.3)
    told = named_of(check(tilt(ROLL, explained=0.6), shadow), ROLL)
    assert [one.code for one in told] == ["QL526"]


def test_a_tilt_that_leaves_more_than_there_was_keeps_its_statistic() -> None:
    """By what the instruments tell, the coefficient is beyond chance."""
    place = np.full(3, np.nan)
    found = _Extended(statistic=40.0, explained=-0.006, shift=-0.04, coefficient=1.0, held=0.0)
    assert _checked(_Candidate("tilt", np.zeros((1, 3, 1)), place), ROLL, found).statistic == 40.0
