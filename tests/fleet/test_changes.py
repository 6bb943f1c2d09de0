"""Change points and outliers: found where they are, and nowhere else."""

import numpy as np
import pytest

from quadid_logs.fleet.changes import (
    FALSE_ALARMS,
    Series,
    Usual,
    compare_vehicles,
    count_tests,
    find_changes,
    present_value,
    usual_scatter,
)

N_FLIGHTS = 24


def series(values, *, half_width=1.96, floor=0.0, name="gain"):
    values = np.asarray(values, dtype=float)
    return Series(
        name=name, axis="roll", value=values, half_width=np.full(values.shape, half_width), floor=floor
    )


def fleet(rng, n_vehicles, *, scatter=1.0, n_series=4, n_flights=N_FLIGHTS):
    return [
        [
            series(100.0 + scatter * rng.standard_normal(n_flights), name=f"series {k}")
            for k in range(n_series)
        ]
        for _ in range(n_vehicles)
    ]


def all_changes(lives):
    n_tests, usual = count_tests(lives), usual_scatter(lives)
    return [find_changes(life, n_tests, usual) for life in lives]


@pytest.mark.parametrize("scatter", [0.5, 1.0, 5.0])
def test_fleets_that_never_change_give_no_alarm(scatter):
    """Also where flights scatter by five times their intervals: 60 fleets, at one alarm in a hundred."""
    rng = np.random.default_rng(1)
    alarms = sum(bool(any(all_changes(fleet(rng, 6, scatter=scatter)))) for _ in range(60))
    # Three or more of 60 have a chance of 2 % even if every fleet had its full 1 %.
    assert alarms <= 2
    assert FALSE_ALARMS == 0.01


@pytest.mark.parametrize("flight", [3, 11, N_FLIGHTS - 3])
def test_a_change_is_found_at_its_flight(flight):
    """Fifteen standard errors, at the earliest, a middle and the latest place."""
    lives = fleet(np.random.default_rng(2), 6)
    changed = lives[2][1].value.copy()
    changed[flight:] += 15.0
    lives[2][1] = series(changed, name="series 1")
    found = all_changes(lives)
    assert [len(changes) for changes in found] == [0, 0, 1, 0, 0, 0]
    assert found[2][0].flight == flight
    assert [shift.name for shift in found[2][0].shifts] == ["series 1"]


def test_several_changes_of_one_life_are_all_found():
    """Worn, replaced, worn again: the parts are split again."""
    lives = fleet(np.random.default_rng(3), 6)
    lives[0] = [series(one.value - 12.0 * np.isin(np.arange(N_FLIGHTS) // 6, (1, 3))) for one in lives[0]]
    assert [change.flight for change in all_changes(lives)[0]] == [6, 12, 18]


def test_the_floor_hides_what_is_no_damage():
    """Warm air costs every gain 5 %: nothing broke."""
    values = np.repeat([100.0, 95.0], 12)
    lives = [[series(values, half_width=0.1, floor=10.0)]]
    assert all_changes(lives) == [()]
    assert all_changes([[series(values, half_width=0.1, floor=1.0)]])[0][0].flight == 12


def test_one_bad_day_is_no_change():
    """A single flight far off splits no life, wherever it lies."""
    for bad in range(N_FLIGHTS):
        lives = fleet(np.random.default_rng(bad), 6)
        values = lives[0][0].value.copy()
        values[bad] += 40.0
        lives[0][0] = series(values, name="series 0")
        assert not any(all_changes(lives)), bad


def test_flights_that_do_not_tell_are_left_out():
    """Refused flights leave holes; the change is dated by the flights around them."""
    lives = fleet(np.random.default_rng(4), 6, n_series=1)
    values = lives[0][0].value + np.where(np.arange(N_FLIGHTS) >= 13, 20.0, 0.0)
    values[[2, 12, 13]] = np.nan
    lives[0] = [series(values, name="series 0")]
    (change,) = all_changes(lives)[0]
    assert change.flight in (12, 13, 14)
    assert change.shifts[0].before == pytest.approx(100.0, abs=2.0)


def test_wide_intervals_count_little():
    """Two flights that tell hardly anything, far off, move neither mean."""
    rng = np.random.default_rng(5)
    lives = fleet(rng, 6, n_series=1)
    values, half_width = lives[0][0].value.copy(), np.full(N_FLIGHTS, 1.96)
    values[20:23] += 300.0
    half_width[20:23] = 600.0
    lives[0] = [Series(name="series 0", axis="roll", value=values, half_width=half_width, floor=0.0)]
    assert not any(all_changes(lives))


def test_a_life_too_short_to_split_is_left_alone():
    """Five flights have no two sides of three."""
    assert all_changes([[series([1.0, 1.0, 1.0, 99.0, 99.0])]]) == [()]
    assert all_changes([[]]) == [()]


def test_the_usual_scatter_is_not_moved_by_changed_vehicles():
    """Two of eight vehicles jump; the median of the others stays."""
    lives = fleet(np.random.default_rng(6), 8, scatter=3.0, n_series=1)
    calm = usual_scatter(lives)[("series 0", "roll")]
    for life in lives[:2]:
        life[0] = series(life[0].value + np.where(np.arange(N_FLIGHTS) > 9, 500.0, 0.0), name="series 0")
    assert usual_scatter(lives)[("series 0", "roll")].scatter == pytest.approx(calm.scatter, rel=0.5)
    assert calm.scatter == pytest.approx(9.0, rel=0.4)


def test_few_vehicles_say_nothing_about_what_is_usual():
    """Four are too few for a prior."""
    assert usual_scatter(fleet(np.random.default_rng(7), 4)) == {}


def present(rng, n_vehicles):
    return {f"v{k}": (100.0 + rng.standard_normal(), 0.3) for k in range(n_vehicles)}


def test_several_outliers_do_not_hide_each_other():
    """Four of twenty, all to the same side."""
    vehicles = present(np.random.default_rng(8), 20)
    for name in ("v3", "v7", "v11", "v12"):
        vehicles[name] = (150.0, 0.3)
    found = compare_vehicles(vehicles, name="gain", axis="roll", floor=1.0, n_tests=260)
    assert sorted(one.vehicle for one in found if one.stands_out) == ["v11", "v12", "v3", "v7"]


def test_ordinary_vehicles_do_not_stand_out():
    """100 fleets of twenty, 13 quantities each: one in a hundred fleets may."""
    rng = np.random.default_rng(9)
    alarms = 0
    for _ in range(100):
        quantities = (
            compare_vehicles(present(rng, 20), name="gain", axis="roll", floor=0.0, n_tests=260)
            for _ in range(13)
        )
        alarms += any(one.stands_out for found in quantities for one in found)
    # Five or more of 100 have a chance of 0.3 % at 1 % each.
    assert alarms <= 4


def test_five_vehicles_compare_with_nobody():
    """Four others do not say what is usual."""
    assert (
        compare_vehicles(present(np.random.default_rng(1), 5), name="", axis="", floor=0.0, n_tests=1) == ()
    )


def test_the_present_value_is_that_since_the_last_change():
    """Flights before it belong to another vehicle."""
    one = series([1.0] * 10 + [5.0] * 10)
    assert present_value(one, 10, Usual()) == pytest.approx((5.0, 1.0 / np.sqrt(10.0)), rel=1e-4)
    assert np.isnan(present_value(one, 20, Usual())[0])
