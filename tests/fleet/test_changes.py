"""ChangePoint points and outliers: found where they are, and nowhere else."""

import numpy as np
import pytest

from quadid_logs.fleets.changes import (
    FALSE_ALARMS,
    ScatterPrior,
    Series,
    compare_vehicles,
    count_tests,
    find_changes,
    find_open_change,
    present_value,
    scatter_prior,
)
from tests.marks import thorough

N_FLIGHTS = 24


def series(values, *, half_width=1.96, systematic=0.0, name="gain"):
    values = np.asarray(values, dtype=float)
    return Series(
        name=name,
        axis="roll",
        value=values,
        half_width=np.full(values.shape, half_width),
        systematic=systematic,
    )


def fleet(rng, n_vehicles, *, scatter=1.0, n_series=4, n_flights=N_FLIGHTS):
    return [
        [
            series(100.0 + scatter * rng.standard_normal(n_flights), name=f"series {k}")
            for k in range(n_series)
        ]
        for _ in range(n_vehicles)
    ]


def all_changes(histories):
    n_tests, prior = count_tests(histories), scatter_prior(histories)
    return [find_changes(history, n_tests, prior) for history in histories]


@pytest.mark.parametrize("scatter", [thorough(0.5), thorough(1.0), 5.0])
def test_fleets_that_never_change_give_no_alarm(scatter):
    """Also where flights scatter by five times their intervals: 30 fleets, at one alarm in a hundred."""
    rng = np.random.default_rng(1)
    alarms = sum(bool(any(all_changes(fleet(rng, 6, scatter=scatter)))) for _ in range(30))
    # Two or more of 30 have a chance of 4 % even if every fleet had its full 1 %.
    assert alarms <= 1
    assert FALSE_ALARMS == 0.01


def uneven_fleet(rng, n_vehicles, *, scatter, n_flights, n_series=13, unequal=0.5):
    """Flights whose intervals differ by a factor of exp(`unequal`), and whose scatter adds to them."""
    histories = []
    for _ in range(n_vehicles):
        history = []
        for k in range(n_series):
            error = np.exp(unequal * rng.standard_normal(n_flights))
            noise = error * rng.standard_normal(n_flights) + scatter * rng.standard_normal(n_flights)
            history.append(
                Series(
                    name=f"s{k}", axis="roll", value=100.0 + noise, half_width=1.96 * error, systematic=0.0
                )
            )
        histories.append(history)
    return histories


def changes_of_first(histories):
    """Return the changes of the first vehicle alone, among the others."""
    return find_changes(histories[0], count_tests(histories), scatter_prior(histories))


def open_changes(histories):
    n_tests, prior = count_tests(histories), scatter_prior(histories)
    return [find_open_change(history, 0, n_tests, prior) for history in histories]


@pytest.mark.thorough
@pytest.mark.parametrize("n_flights", [4, thorough(6), thorough(12)])
@pytest.mark.parametrize("scatter", [thorough(0.0), 5.0])
def test_last_flights_of_vehicles_that_never_change_give_no_alarm(n_flights, scatter):
    """20 vehicles alone and 5 fleets of six, with even and uneven intervals: one in a hundred may."""
    rng = np.random.default_rng(21)
    alarms = 0
    for n_vehicles, n_fleets in ((1, 20), (6, 5)):
        for _ in range(n_fleets):
            even = fleet(rng, n_vehicles, scatter=max(scatter, 1.0), n_series=13, n_flights=n_flights)
            uneven = uneven_fleet(rng, n_vehicles, scatter=scatter, n_flights=n_flights)
            alarms += sum(any(open_changes(histories)) for histories in (even, uneven))
    # Four or more of 50 have a chance of 0.2 % at 1 % each.
    assert alarms <= 3


@pytest.mark.thorough
def test_uneven_intervals_of_vehicles_that_never_change_give_no_alarm():
    """Days scatter alike whether a flight's interval is wide or narrow: 20 fleets."""
    rng = np.random.default_rng(22)
    alarms = sum(
        any(all_changes(uneven_fleet(rng, 6, scatter=5.0, n_flights=12, unequal=1.0))) for _ in range(20)
    )
    # Three or more of 20 have a chance of 0.1 % at 1 % each.
    assert alarms <= 2


@pytest.mark.parametrize("n_after", [1, 2])
@pytest.mark.parametrize("n_flights", [6, 12])
def test_last_flights_that_differ_are_an_open_change(n_flights, n_after):
    """They are too few for a change; said is since when, by how much, and what decides."""
    histories = [[series(100.0 + np.random.default_rng(23).standard_normal(n_flights))]]
    values = histories[0][0].value.copy()
    values[-n_after:] -= 50.0
    histories[0][0] = series(values)
    assert all_changes(histories) == [()]
    (found,) = open_changes(histories)
    assert (found.flight, found.n_after, found.n_missing) == (n_flights - n_after, n_after, 3 - n_after)
    (shift,) = found.shifts
    assert shift.after - shift.before == pytest.approx(-50.0, abs=4.0)
    assert 0.5 < shift.half_width < 6.0


def test_three_flights_decide_what_was_open():
    """Two that differ are an open change, with the third alike it is one, with the third as before none."""
    values = 100.0 + np.random.default_rng(24).standard_normal(9)
    decided, returned = values.copy(), values.copy()
    decided[6:] -= 50.0
    returned[6:8] -= 50.0
    assert [change.flight for change in all_changes([[series(decided)]])[0]] == [6]
    assert open_changes([[series(returned[:8])]])[0].n_missing == 1
    assert open_changes([[series(returned)]]) == [None]


def test_a_bad_day_that_is_over_is_not_open():
    """Wherever it lies before the last flight."""
    for bad in range(N_FLIGHTS - 1):
        histories = fleet(np.random.default_rng(bad), 6)
        values = histories[0][0].value.copy()
        values[bad] += 40.0
        histories[0][0] = series(values, name="series 0")
        n_tests, prior = count_tests(histories), scatter_prior(histories)
        assert find_open_change(histories[0], 0, n_tests, prior) is None, bad


def test_a_flight_that_is_like_those_before_again_closes_the_question():
    """Of a fleet with hardly any scatter: one bad day and a good one after it are no changed vehicle."""
    of_fleet = {("gain", "roll"): ScatterPrior(scatter=1.0, flights=1000.0)}
    bad_day, changed = series([100.0] * 10 + [140.0, 100.0]), series([100.0] * 10 + [140.0, 140.0])
    assert find_open_change([changed], 0, 1, of_fleet) is not None
    assert find_open_change([bad_day], 0, 1, of_fleet) is None


def test_too_few_flights_before_leave_it_open():
    """Two and three: no flight to come can say which of the two is the vehicle."""
    (found,) = open_changes([[series([100.0, 100.5, 50.0, 50.3, 49.8])]])
    assert (found.flight, found.n_before, found.n_after, found.n_missing) == (2, 2, 3, 0)


@pytest.mark.parametrize("flight", [3, 11, N_FLIGHTS - 3])
def test_a_change_is_found_at_its_flight(flight):
    """Fifteen standard errors, at the earliest, a middle and the latest place."""
    histories = fleet(np.random.default_rng(2), 6)
    changed = histories[2][1].value.copy()
    changed[flight:] += 15.0
    histories[2][1] = series(changed, name="series 1")
    found = all_changes(histories)
    assert [len(changes) for changes in found] == [0, 0, 1, 0, 0, 0]
    assert found[2][0].flight == flight
    assert [shift.name for shift in found[2][0].shifts] == ["series 1"]


def test_several_changes_of_one_history_are_all_found():
    """Worn, replaced, worn again: the parts are split again."""
    histories = fleet(np.random.default_rng(3), 6)
    histories[0] = [
        series(one.value - 12.0 * np.isin(np.arange(N_FLIGHTS) // 6, (1, 3))) for one in histories[0]
    ]
    assert [change.flight for change in all_changes(histories)[0]] == [6, 12, 18]


def test_the_systematic_uncertainty_hides_what_is_no_damage():
    """Warm air costs every gain 5 %: nothing broke."""
    values = np.repeat([100.0, 95.0], 12)
    histories = [[series(values, half_width=0.1, systematic=10.0)]]
    assert all_changes(histories) == [()]
    assert all_changes([[series(values, half_width=0.1, systematic=1.0)]])[0][0].flight == 12


def test_one_bad_day_is_no_change():
    """A single flight far off splits no history, wherever it lies."""
    for bad in range(N_FLIGHTS):
        histories = fleet(np.random.default_rng(bad), 6)
        values = histories[0][0].value.copy()
        values[bad] += 40.0
        histories[0][0] = series(values, name="series 0")
        assert not changes_of_first(histories), bad


def test_flights_without_the_quantity_are_left_out():
    """Refused flights leave holes; the change is dated by the flights around them."""
    histories = fleet(np.random.default_rng(4), 6, n_series=1)
    values = histories[0][0].value + np.where(np.arange(N_FLIGHTS) >= 13, 20.0, 0.0)
    values[[2, 12, 13]] = np.nan
    histories[0] = [series(values, name="series 0")]
    (change,) = all_changes(histories)[0]
    assert change.flight in (12, 13, 14)
    assert change.shifts[0].before == pytest.approx(100.0, abs=2.0)


def test_wide_intervals_count_little():
    """Two flights with wide intervals, far off, move neither mean."""
    rng = np.random.default_rng(5)
    histories = fleet(rng, 6, n_series=1)
    values, half_width = histories[0][0].value.copy(), np.full(N_FLIGHTS, 1.96)
    values[20:23] += 300.0
    half_width[20:23] = 600.0
    histories[0] = [Series(name="series 0", axis="roll", value=values, half_width=half_width, systematic=0.0)]
    assert not any(all_changes(histories))


def test_a_history_too_short_to_split_is_left_alone():
    """Five flights have no two sides of three."""
    assert all_changes([[series([1.0, 1.0, 1.0, 99.0, 99.0])]]) == [()]
    assert all_changes([[]]) == [()]


def test_the_prior_scatter_is_not_moved_by_changed_vehicles():
    """Two of eight vehicles jump; the median of the others stays."""
    histories = fleet(np.random.default_rng(6), 8, scatter=3.0, n_series=1)
    calm = scatter_prior(histories)[("series 0", "roll")]
    for history in histories[:2]:
        history[0] = series(
            history[0].value + np.where(np.arange(N_FLIGHTS) > 9, 500.0, 0.0), name="series 0"
        )
    assert scatter_prior(histories)[("series 0", "roll")].scatter == pytest.approx(calm.scatter, rel=0.5)
    assert calm.scatter == pytest.approx(9.0, rel=0.4)


def test_few_vehicles_give_no_prior():
    """Four are too few for a prior."""
    assert scatter_prior(fleet(np.random.default_rng(7), 4)) == {}


def present(rng, n_vehicles):
    return {f"v{k}": (100.0 + rng.standard_normal(), 0.3) for k in range(n_vehicles)}


def test_several_outliers_do_not_hide_each_other():
    """Four of twenty, all to the same side."""
    vehicles = present(np.random.default_rng(8), 20)
    for name in ("v3", "v7", "v11", "v12"):
        vehicles[name] = (150.0, 0.3)
    found = compare_vehicles(vehicles, name="gain", axis="roll", systematic=1.0, n_tests=260)
    assert sorted(one.vehicle for one in found if one.is_outlier) == ["v11", "v12", "v3", "v7"]


@pytest.mark.thorough
def test_ordinary_vehicles_are_no_outliers():
    """50 fleets of twenty, 13 quantities each: one in a hundred fleets may."""
    rng = np.random.default_rng(9)
    alarms = 0
    for _ in range(50):
        quantities = (
            compare_vehicles(present(rng, 20), name="gain", axis="roll", systematic=0.0, n_tests=260)
            for _ in range(13)
        )
        alarms += any(one.is_outlier for found in quantities for one in found)
    # Four or more of 50 have a chance of 0.2 % at 1 % each.
    assert alarms <= 3


def test_five_vehicles_compare_with_nobody():
    """Four others are too few for a median."""
    assert (
        compare_vehicles(present(np.random.default_rng(1), 5), name="", axis="", systematic=0.0, n_tests=1)
        == ()
    )


def test_the_present_value_is_that_since_the_last_change():
    """Flights before it belong to another vehicle."""
    one = series([1.0] * 10 + [5.0] * 10)
    assert present_value(one, 10, ScatterPrior()) == pytest.approx((5.0, 1.0 / np.sqrt(10.0)), rel=1e-4)
    assert np.isnan(present_value(one, 20, ScatterPrior())[0])


def yaw_flights(values, throttle):
    values = np.asarray(values, dtype=float)
    half = np.full(values.shape, 0.1)
    return Series(
        name="gain",
        axis="yaw",
        value=values,
        half_width=half,
        systematic=0.1 * values[0],
        throttle=np.asarray(throttle, dtype=float),
    )


LOADED = [14.0, 14.1, 13.9, 18.0, 18.1, 17.9]


@pytest.mark.parametrize(("throttle", "n_changes"), [(0.35, 0), (0.30, 1), (float("nan"), 1)])
def test_yaw_that_answers_as_the_throttle_lets_it_is_no_change(throttle, n_changes):
    """Three flights with a load need more throttle; yaw then answers more strongly."""
    history = [yaw_flights(LOADED, [0.3] * 3 + [throttle] * 3)]
    assert len(find_changes(history, count_tests([history]), {})) == n_changes


@pytest.mark.parametrize(("throttle", "differs"), [(0.35, False), (0.30, True)])
def test_the_last_flights_at_more_throttle_leave_no_question_open(throttle, differs):
    """Two loaded flights at the end."""
    history = [yaw_flights(LOADED[:5], [0.3] * 3 + [throttle] * 2)]
    found = find_open_change(history, 0, count_tests([history]), {})
    assert (found is not None) == differs


@pytest.mark.parametrize(("throttle", "is_outlier"), [(0.36, False), (0.30, True)])
def test_a_heavier_vehicle_is_no_outlier_in_yaw(throttle, is_outlier):
    """It hovers at more throttle than the others of its model."""
    present = {f"quad-{k}": (14.0 + 0.01 * k, 0.05) for k in range(8)} | {"heavy": (19.0, 0.05)}
    tests = compare_vehicles(
        present,
        name="gain",
        axis="yaw",
        systematic=1.4,
        n_tests=9,
        throttle=dict.fromkeys(present, 0.3) | {"heavy": throttle},
    )
    assert next(test.is_outlier for test in tests if test.vehicle == "heavy") == is_outlier
