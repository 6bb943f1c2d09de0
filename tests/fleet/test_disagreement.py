"""Few flights that do not agree are an alarm; days that differ as days do are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quadid_logs.fleets.changes import Series, count_tests
from quadid_logs.fleets.disagreement import find_disagreements, n_disagreement_tests
from tests.fleet.synthetic_store import make_store, scaled
from tests.fleet.test_history import report

#: Of 100: a hundredth, as flights at 400 Hz tell it; a tenth may differ between days.
SIGMA, SYSTEMATIC = 1.0, 10.0


def gain(values, axis="roll", throttle=None, half_width=1.96 * SIGMA):
    values = np.asarray(values, float)
    return Series(
        name="gain",
        axis=axis,
        value=values,
        half_width=np.full(values.shape, half_width),
        systematic=SYSTEMATIC,
        throttle=None if throttle is None else np.asarray(throttle, float),
    )


def found(*history, n_tests=50):
    return find_disagreements(history, (0, len(history[0].value)), n_tests, {})


def flown(factors, seed=0):
    return 100.0 * np.asarray(factors) + SIGMA * np.random.default_rng(seed).standard_normal(len(factors))


def test_the_last_of_three_flights_with_half_the_effectiveness_is_open():
    """One degree of freedom made an alarm impossible, whatever the intervals said."""
    still = found(gain(flown([1.0, 1.0, 0.5]))).open_change
    assert (still.flight, still.n_before, still.n_after) == (2, 2, 1)
    (shift,) = still.shifts
    assert shift.after - shift.before == pytest.approx(-50.0, abs=4.0)
    assert shift.p_value < 1e-9


def test_the_second_of_two_flights_is_tested_too():
    """As `compare` does, which has no more."""
    assert found(gain(flown([1.0, 0.5]))).open_change.flight == 1
    assert found(gain(flown([1.0, 1.0]))) == ((), None, ())


@pytest.mark.parametrize("n_flights", [3, 6, 12])
def test_flights_that_alternate_by_a_factor_of_two_are_not_one_vehicle(n_flights):
    """Two vehicles under one name: their scatter hid every change."""
    alternating = [1.0 if k % 2 else 2.0 for k in range(n_flights)]
    one = found(gain(flown(alternating)))
    assert (one.changes, one.open_change) == ((), None)
    (scatter,) = one.scatter
    assert (scatter.axis, scatter.first, scatter.last) == ("roll", 0, n_flights - 1)
    assert scatter.p_value < 1e-9
    assert scatter.highest / scatter.lowest == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("begins", [2, 4])
def test_two_flights_before_a_repair_are_an_episode(begins):
    """Roll at 0.6 for two flights, then as before: changed, and changed back."""
    factors = np.ones(8)
    factors[begins : begins + 2] = 0.6
    history = gain(flown(factors)), gain(flown(np.ones(8), seed=1), axis="pitch")
    one = found(*history)
    assert [change.flight for change in one.changes] == [begins, begins + 2]
    assert [shift.axis for change in one.changes for shift in change.shifts] == ["roll", "roll"]
    down, up = (change.shifts[0] for change in one.changes)
    assert (down.after / down.before, up.after / up.before) == pytest.approx((0.6, 1 / 0.6), rel=0.05)
    assert (one.open_change, one.scatter) == (None, ())


@pytest.mark.parametrize("day", [0, 2, 4])
def test_one_bad_day_is_no_alarm(day):
    """Wherever it lies before the last flight."""
    factors = np.ones(6)
    factors[day] = 0.5
    assert found(gain(flown(factors))) == ((), None, ())


def test_axes_that_differ_together_are_one_question():
    """A lighter vehicle answers more on roll and pitch."""
    both = [gain(flown([1.0, 1.0, 1.6], seed), axis) for seed, axis in enumerate(("roll", "pitch"))]
    assert [shift.axis for shift in found(*both).open_change.shifts] == ["roll", "pitch"]


@pytest.mark.parametrize(("throttle", "differs"), [(0.45, False), (0.30, True)])
def test_yaw_that_answers_as_the_throttle_lets_it_agrees(throttle, differs):
    """With a load of a half of its weight it takes 1.5 times the throttle: yaw answers up to 2.25 times."""
    loaded = gain(flown([1.0, 1.0, 2.0]), axis="yaw", throttle=[0.3, 0.3, throttle])
    assert (found(loaded).open_change is not None) == differs


@pytest.mark.parametrize("n_flights", [2, 3, 6, 12])
def test_unchanged_vehicles_give_one_false_alarm_in_a_hundred_fleets(n_flights):
    """Estimates scatter as their intervals say, and days by what may differ between days."""
    rng = np.random.default_rng(5)
    days = SYSTEMATIC / (1.96 * math.sqrt(2.0))
    alarms, n_fleets = 0, 300
    for _ in range(n_fleets):
        half_width = 1.96 * np.exp(0.5 * rng.standard_normal((3, n_flights)))
        history = [
            Series(
                name="gain",
                axis=axis,
                value=100.0
                + half / 1.96 * rng.standard_normal(n_flights)
                + days * rng.standard_normal(n_flights),
                half_width=half,
                systematic=SYSTEMATIC,
            )
            for axis, half in zip(("roll", "pitch", "yaw"), half_width, strict=True)
        ]
        n_tests = n_disagreement_tests([history])
        assert n_tests == 3
        alarms += any(find_disagreements(history, (0, n_flights), n_tests, {}))
    # Nine or more of 300 have a chance of 0.4 % at 1 % each.
    assert alarms <= 8


def test_the_agreement_is_tested_at_the_stated_level():
    """Of 20 000 pairs of flights a hundredth: neither a stricter nor a laxer test."""
    rng = np.random.default_rng(6)
    days = SYSTEMATIC / (1.96 * math.sqrt(2.0))
    values = 100.0 + np.hypot(SIGMA, days) * rng.standard_normal((4000, 3))
    alarms = sum(any(found(gain(row), n_tests=1)) for row in values)
    assert alarms == pytest.approx(40, abs=19)  # three standard deviations


def test_one_count_holds_all_tests_of_a_fleet():
    """Two vehicles, roll of one known in one flight only."""
    histories = [[gain([1.0, 2.0]), gain([1.0], axis="pitch")], [gain([1.0, 2.0, 3.0])]]
    assert n_disagreement_tests(histories) == 2
    assert count_tests(histories) >= 2


NAMES = ("quad-1", "quad-2")


def changed(factors):
    """Multiply roll's effectiveness of one vehicle flight by flight."""

    def change(row, flight):
        if row["vehicle"] == "quad-2" and row["axis"] == "roll":
            scaled(row, "gain", factors[flight])

    return change


@pytest.mark.parametrize(
    ("factors", "code", "words"),
    [
        ([1.0, 1.0, 0.5], 3, "quad-2 may have changed: the last flight differs"),
        ([1.0, 2.0] * 4, 1, "quad-2 flights are not of one vehicle: they scatter far beyond their intervals"),
        ([1.0, 1.0, 1.0, 0.6, 0.6, 1.0, 1.0, 1.0], 1, "quad-2 changed with flight 4 of 8"),
        ([1.0, 1.0, 1.0], 0, ""),
    ],
)
def test_the_command_tells_what_does_not_agree_and_how_likely_that_is(tmp_path, capsys, factors, code, words):
    """By its exit code and a line with a p-value; the page says the same."""
    store = make_store(tmp_path / "store", NAMES, len(factors), change=changed(factors))
    found_code, lines, page = report(tmp_path, capsys, store)
    told = [line for line in lines if line.startswith("quad-")]
    assert found_code == code
    if not words:
        assert not told
        return
    assert all(line.startswith("quad-2") for line in told)
    assert words in told[0]
    assert "p < 1e-09" in told[0]
    assert words.removeprefix("quad-2 ") in page
