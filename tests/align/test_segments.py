"""What a segment is cut from: ends, gaps, marks, references, and the counts that describe a source."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.align import assemble, clean, cut
from quadid_logs.align.series import CleanSeries, TorqueSeries
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.data.settings import AlignSettings

from .flights import align, flight_log, flown, motion, signal

PERIOD_S = 0.005
STAMPS = np.arange(10.0, 40.0, PERIOD_S)


def with_signals(*others: Signal, time_s: np.ndarray = STAMPS) -> FlightLog:
    """Return a flight with these signals besides, or instead of those of the same name."""
    named = {each.name for each in others}
    kept = [each for name, each in flown(time_s).signals.items() if name not in named]
    return flight_log(*(each for sources in kept for each in sources), *others)


def only_segment(data: FlightData) -> Segment:
    (segment,) = data.segments
    return segment


def marked(saturated: np.ndarray, settings: AlignSettings, log: FlightLog | None = None) -> FlightData:
    """Cut a flight whose torque is known to be limited where ``saturated`` (n_samples, 3) is 1."""
    log = log or flown(STAMPS)
    cleaned = clean(log)
    series = cleaned.candidates["torque_command"][0]
    marks = dataclasses.replace(series, name="torque_saturation", stored=saturated)
    return cut(assemble(log, cleaned, [TorqueSeries(series=series, saturated=marks)]), settings)


def test_a_flight_begins_a_second_after_take_off_and_ends_a_second_before_landing() -> None:
    """The ground still pushes there."""
    throttle = np.where((STAMPS > 15.0) & (STAMPS < 30.0), 0.4, 0.0)[:, np.newaxis]
    segment = only_segment(align(with_signals(signal("throttle", STAMPS, throttle)), AlignSettings()))
    assert segment.start_s == pytest.approx(16.0, abs=0.21)
    assert segment.end_s == pytest.approx(29.0, abs=0.21)


def test_motors_that_idle_do_not_fly() -> None:
    """At 3 % of throttle on the ground, 40 % in the air."""
    throttle = np.where((STAMPS > 15.0) & (STAMPS < 30.0), 0.4, 0.03)[:, np.newaxis]
    segment = only_segment(align(with_signals(signal("throttle", STAMPS, throttle)), AlignSettings()))
    assert segment.start_s > 15.5


def test_a_bounce_of_the_evidence_is_no_landing() -> None:
    """Half a second at idle throttle is one flight, five seconds at rest are two."""
    for pause_s, n_flights in ((0.5, 1), (5.0, 2)):
        idle = ((STAMPS > 20.0) & (20.0 + pause_s > STAMPS))[:, np.newaxis]
        throttle = signal("throttle", STAMPS, np.where(idle, 0.0, 0.4))
        rate = signal("body_rate", STAMPS, np.where(idle, 0.0, motion(STAMPS)))
        data = align(with_signals(throttle, rate), AlignSettings())
        assert len(data.flights) == n_flights


def test_a_segment_ends_with_the_last_sample_ahead_of_a_gap() -> None:
    """At the rate of the log, so that the grid falls on its samples."""
    time_s = STAMPS[(STAMPS < 25.0) | (STAMPS > 26.0)]
    first, second = align(flown(time_s), AlignSettings()).segments
    assert first.end_s == pytest.approx(time_s[time_s < 25.5][-1], abs=1e-6)
    assert second.start_s == pytest.approx(time_s[time_s > 25.5][0], abs=1e-6)


def test_a_pause_that_is_short_for_the_grid_is_no_gap() -> None:
    """100 ms: twenty periods of the log, two of the grid."""
    time_s = STAMPS[(STAMPS < 25.0) | (STAMPS > 25.1)]
    assert len(align(flown(time_s), AlignSettings()).segments) == 2
    assert len(align(flown(time_s), AlignSettings(sample_rate_hz=20.0)).segments) == 1


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("off_s", [-0.012, 0.0, 0.012])
def test_saturation_of_any_axis_marks_the_grid_points_up_to_a_period_away(axis: int, off_s: float) -> None:
    """A single sample of the log between points 20 ms apart: the one before it and the one behind it."""
    grid = only_segment(marked(np.zeros((STAMPS.size, 3)), AlignSettings(sample_rate_hz=50.0))).time_s
    at = int(np.argmin(np.abs(STAMPS - grid[400] - off_s)))
    saturated = np.zeros((STAMPS.size, 3))
    saturated[at, axis] = 1.0
    data = marked(saturated, AlignSettings(sample_rate_hz=50.0))
    near = np.abs(grid - STAMPS[at])
    found = only_segment(data).saturated
    assert found[near < 0.0195].all()
    assert not found[near > 0.0205].any()
    assert data.input is not None
    assert data.input.saturated_fraction == pytest.approx(np.mean(found))


def test_limits_are_told_apart_by_axis() -> None:
    """Yaw at its limits says nothing of roll."""
    limited = np.zeros((STAMPS.size, 3))
    limited[::4, 2] = 1.0
    found = marked(limited, AlignSettings(sample_rate_hz=50.0)).input
    assert found is not None
    assert found.limited_fraction == pytest.approx((0.0, 0.0, 0.25), abs=0.005)


def test_a_chirp_is_zero_outside_the_time_for_which_it_ran() -> None:
    """Its message ends with the manoeuvre, at a value of its own."""
    running = np.arange(20.0, 30.0, PERIOD_S)
    chirp = signal("sysid_chirp", running, np.full((running.size, 1), 0.7), start=50 * 2000 + 3)
    setpoint = signal("body_rate_setpoint", STAMPS, motion(STAMPS), start=7)
    segment = only_segment(align(with_signals(chirp, setpoint), AlignSettings()))
    assert segment.reference is not None
    inside = (segment.time_s > 20.01) & (segment.time_s < 29.98)
    outside = (segment.time_s < 19.99) | (segment.time_s > 30.01)
    np.testing.assert_allclose(segment.reference[inside, 3], 0.7)
    np.testing.assert_array_equal(segment.reference[outside, 3], 0.0)
    np.testing.assert_allclose(segment.reference[:, :3], motion(segment.time_s), atol=1e-4)


def test_a_source_is_described_by_its_steps_and_its_pauses_in_flight() -> None:
    """Rates at 200 Hz that jitter by a fifth, and two pauses of a quarter of a second."""
    jitter = 0.001 * np.random.default_rng(6).uniform(-1.0, 1.0, STAMPS.size)
    time_s = STAMPS + jitter
    for begin in (18.0, 28.0):
        time_s = time_s[(time_s < begin) | (time_s > begin + 0.25)]
    found = align(flown(time_s), AlignSettings()).sources["body_rate"]
    inside = time_s[(time_s >= 11.0) & (time_s <= 39.0)]
    assert found.n_gaps == 2
    assert found.longest_gap_s == pytest.approx(0.25, abs=0.01)
    assert found.rate_hz == pytest.approx(200.0, rel=0.01)
    assert found.mean_rate_hz == pytest.approx((inside.size - 1) / (inside[-1] - inside[0]), rel=1e-3)


def test_the_mean_rate_of_a_handful_of_rows_counts_the_steps_between_them() -> None:
    """Ten rows, nine steps of a second in a log without flight."""
    few = np.arange(10.0, 20.0, 1.0)
    log = flight_log(signal("attitude", few, motion(few)))
    assert align(log, AlignSettings()).sources["attitude"].mean_rate_hz == pytest.approx(1.0)


def series(time_s: np.ndarray, values: np.ndarray) -> CleanSeries:
    """Return a cleaned series of one signal alone."""
    return clean(flight_log(signal("throttle", time_s, values))).candidates["throttle"][0]


def test_an_interval_holds_the_samples_at_both_its_ends() -> None:
    """As written."""
    found = series(np.arange(0.0, 10.0), np.ones((10, 1))).within(3.0, 6.0)
    assert (found.start, found.stop) == (3, 7)


def test_a_sample_counts_from_its_own_time_on() -> None:
    """Just ahead of it the one before does, and ahead of the first none."""
    one = series(np.arange(0.0, 10.0), np.ones((10, 1)))
    np.testing.assert_array_equal(
        one.last_before(np.array([-0.1, 0.0, 2.9, 3.0, 3.1, 99.0])), [-1, 0, 2, 3, 3, 9]
    )


def test_of_rows_with_one_stamp_the_last_stands() -> None:
    """It is what the autopilot knew last at that time."""
    time_s = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    values = np.arange(12.0)[:, np.newaxis]
    found = series(time_s, values)
    np.testing.assert_array_equal(found.values[:, 0], [0, 1, 4, 5, 6, 7, 8, 9, 10, 11])


def test_a_vehicle_that_idles_within_a_flight_is_not_certainly_off_the_ground() -> None:
    """Less than half of the throttle that is typical there; half and more is."""
    log = clean(flown(STAMPS))
    time_s = np.arange(15.0, 35.0, 0.1)
    throttle = np.where(time_s < 18.0, 0.19, np.where(time_s < 20.0, 0.22, 0.4))
    np.testing.assert_array_equal(log.flown(time_s, throttle), time_s >= 18.0)


def test_a_row_with_a_stopped_motor_stays_and_one_without_any_number_goes() -> None:
    """NaN is how a stopped motor is logged."""
    thrust = np.full((STAMPS.size, 4), 0.5)
    thrust[100, 2], thrust[200] = np.nan, np.nan
    found = clean(flight_log(signal("motor_thrust", STAMPS, thrust))).candidates["motor_thrust"][0]
    assert found.n_samples == STAMPS.size - 1
    assert np.isnan(found.values[100]).tolist() == [False, False, True, False]


@pytest.mark.parametrize(("rate_hz", "source"), [(45.0, "preferred"), (25.0, "other")])
def test_a_preferred_source_may_be_a_little_slower_than_needed(rate_hz: float, source: str) -> None:
    """Attitude is needed at 50 Hz: four fifths of that are enough, half is not."""
    slow = np.arange(10.0, 40.0, 1.0 / rate_hz)
    preferred = signal("attitude", slow, motion(slow), source="preferred")
    other = signal("attitude", STAMPS, motion(STAMPS), source="other", start=3)
    assert align(with_signals(preferred, other), AlignSettings()).sources["attitude"].source == source
