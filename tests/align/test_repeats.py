"""What flights that repeat one trajectory have in common stands for what was commanded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.align.repeats import with_common_commands
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.maths.recurrence import lag

PERIOD_S = 0.01
SECONDS = 40.0


def smooth(seed: int, seconds: float = SECONDS + 4.0) -> FloatArray:
    """Return three random signals of half a second's memory, standard deviation one."""
    rng = np.random.default_rng(seed)
    n = round(seconds / PERIOD_S)
    kernel = np.exp(-0.5 * (np.arange(-100, 101) / 20.0) ** 2)
    found = np.stack([np.convolve(rng.normal(size=n), kernel, "same") for _ in range(3)], axis=1)
    return np.asarray(found / found.std(axis=0))


def flown(seed: int, *, trajectory: int = 1, late_s: float = 0.0, air: float = 0.7) -> FlightData:
    """Return a flight along a trajectory that begins late, in air of its own."""
    n, first = round(SECONDS / PERIOD_S), round((2.0 + late_s) / PERIOD_S)
    wanted = smooth(trajectory)[first : first + n]
    gusts = air * smooth(1000 + seed)[:n]
    time_s = 100.0 + PERIOD_S * np.arange(n)
    rate = 0.3 * (wanted + gusts)
    segment = Segment(
        time_s=time_s,
        body_rate_rad_s=rate,
        # What is commanded, and the controller's answer to gusts.
        torque=0.01 * (np.gradient(wanted, axis=0) * 20.0 - 0.5 * gusts),
        # An angle controller forgets what a gust did within a second.
        attitude_rad=lag(rate, PERIOD_S, 1.0),
        throttle=None,
        saturated=np.zeros(n, dtype=np.bool_),
        velocity_m_s=np.zeros((n, 3)),
    )
    return FlightData(
        sample_period_s=PERIOD_S,
        segments=(segment,),
        flights=((segment.start_s, segment.end_s),),
        sources={},
        input=None,
        start_s=segment.start_s,
        duration_s=SECONDS,
    )


def commands(flights: Sequence[FlightData]) -> list[FloatArray | None]:
    """Return what was commanded of each flight."""
    return [flight.segments[0].command for flight in with_common_commands(flights)]


def correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of two arrays where both are known."""
    known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    return float(np.corrcoef(one[known].ravel(), other[known].ravel())[0, 1])


def test_flights_of_one_trajectory_tell_each_other_what_was_commanded() -> None:
    """The mean torque of three others follows the commanded one, and no gust of this flight."""
    flights = [flown(seed) for seed in range(4)]
    found = commands(flights)[0]
    assert found is not None
    wanted = 0.2 * np.gradient(smooth(1)[200 : 200 + len(found)], axis=0)
    gusts = 0.7 * smooth(1000)[: len(found)]
    assert correlation(found, wanted) > 0.7
    assert abs(correlation(found, gusts)) < 0.08


def test_flights_that_begin_earlier_or_later_are_laid_beside_each_other() -> None:
    """Half a second and a second apart, in logs whose clocks know nothing of each other."""
    flights = [flown(seed, late_s=late_s) for seed, late_s in enumerate((0.0, 0.5, -1.0, 1.0))]
    for number, late_s in enumerate((0.0, 0.5, -1.0, 1.0)):
        found = commands(flights)[number]
        assert found is not None
        first = round((2.0 + late_s) / PERIOD_S)
        wanted = 0.2 * np.gradient(smooth(1)[first : first + len(found)], axis=0)
        assert correlation(found, wanted) > 0.6


def test_they_are_marked_as_repeated_and_planned() -> None:
    """So that the estimate takes them for an instrument as it is, and the report says what it rests on."""
    segment = with_common_commands([flown(seed) for seed in range(3)])[0].segments[0]
    assert segment.planned
    assert segment.repeated


def test_flights_of_other_trajectories_tell_nothing() -> None:
    """Four flights, each along a trajectory of its own."""
    assert commands([flown(seed, trajectory=10 + seed) for seed in range(4)]) == [None] * 4


def test_flights_of_two_trajectories_are_told_apart() -> None:
    """Each has the commands of its own group."""
    flights = [flown(seed, trajectory=1 + seed % 2) for seed in range(6)]
    for number, found in enumerate(commands(flights)):
        assert found is not None
        own, other = (
            np.gradient(smooth(trajectory)[200 : 200 + len(found)], axis=0)
            for trajectory in ((1, 2) if number % 2 == 0 else (2, 1))
        )
        assert correlation(found, own) > 0.5
        assert abs(correlation(found, other)) < 0.15


def test_a_flight_that_was_logged_twice_is_no_repeat() -> None:
    """Its air is in both, and would be taken for a command."""
    once = flown(1)
    segment = once.segments[0]
    noise = 0.002 * np.random.default_rng(5).normal(size=segment.torque.shape)
    again = replace(once, segments=(replace(segment, body_rate_rad_s=segment.body_rate_rad_s + noise),))
    assert commands([once, again]) == [None, None]


def test_logs_that_tell_what_was_commanded_stay_as_they_are() -> None:
    """Set-points without the answer of the angle controller are better."""
    flights = [flown(seed) for seed in range(3)]
    segment = flights[0].segments[0]
    given = np.zeros((segment.n_samples, 3))
    flights[0] = replace(flights[0], segments=(replace(segment, command=given),))
    found = commands(flights)
    assert found[0] is given
    assert found[1:] == [None, None]


def test_logs_without_velocity_stay_as_they_are() -> None:
    """The moments of the speed are the same in each flight, and would be taken for the torque's."""
    flights = [flown(seed) for seed in range(3)]
    flights[1] = replace(
        flights[1], segments=tuple(replace(each, velocity_m_s=None) for each in flights[1].segments)
    )
    assert commands(flights) == [None] * 3


@pytest.mark.parametrize("seconds", [0.02, 3.0, 9.0])
def test_a_short_flight_beside_others_costs_them_nothing(seconds: float) -> None:
    """Too short to be told from others, or a fifth of the trajectory."""
    flights = [flown(seed) for seed in range(4)]
    segment = flights[1].segments[0]
    flights[1] = replace(flights[1], segments=(segment.rows(slice(0, round(seconds / PERIOD_S))),))
    found = commands(flights)
    assert all(found[number] is not None for number in (0, 2, 3))


def test_a_flight_beside_the_end_of_the_others_alone_is_laid_there() -> None:
    """It overlaps them by half of a short one."""
    flights = [flown(seed) for seed in range(3)]
    segment = flights[0].segments[0]
    flights[0] = replace(flights[0], segments=(segment.rows(slice(2500, 4000)),))
    assert all(each is not None for each in commands(flights))


def test_a_log_of_two_flights_an_hour_apart_stays_as_it_is() -> None:
    """No memory is taken for the hour."""
    flights = [flown(seed) for seed in range(3)]
    segment = flights[0].segments[0]
    later = replace(segment, time_s=segment.time_s + 1e9)
    flights[0] = replace(flights[0], segments=(segment, later))
    found = commands(flights)
    assert found[0] is None
    assert all(each is not None for each in found[1:])


def test_a_crash_ends_what_was_commanded() -> None:
    """From 30 s on one of them tumbles."""
    flights = [flown(seed) for seed in range(3)]
    segment = flights[2].segments[0]
    rate = segment.body_rate_rad_s.copy()
    rate[3000:] += 40.0
    flights[2] = replace(flights[2], segments=(replace(segment, body_rate_rad_s=rate),))
    found = commands(flights)[2]
    assert found is not None
    assert np.isfinite(found[200:2800]).all()
    assert np.isnan(found[3000:]).all()


@pytest.mark.parametrize("gap", [150, 733])
def test_a_gap_in_a_flight_leaves_its_parts_in_place(gap: int) -> None:
    """The second segment begins where the clock says."""
    flights = [flown(seed) for seed in range(4)]
    segment = flights[0].segments[0]
    parts = segment.rows(slice(0, 1000)), segment.rows(slice(1000 + gap, segment.n_samples))
    whole = commands(flights)[0]
    flights[0] = replace(flights[0], segments=parts)
    cut = with_common_commands(flights)[0].segments[1].command
    assert whole is not None
    assert cut is not None
    assert correlation(cut, whole[1000 + gap :]) > 0.95
