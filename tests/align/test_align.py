"""One clock, a fixed period, gaps kept as gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.log import ModeChange, Rows, Signal
from quadid_logs.data.settings import AlignSettings

from .flights import align, flight_log, flown, motion, signal

STEADY = np.arange(10.0, 40.0, 0.0025)


def test_a_steady_log_becomes_one_segment_at_its_own_rate() -> None:
    """Trimmed by a second at take-off and landing."""
    data = align(flown(STEADY), AlignSettings())
    (segment,) = data.segments
    assert data.sample_period_s == pytest.approx(0.0025)
    assert segment.start_s == pytest.approx(11.0, abs=0.11)
    assert segment.end_s == pytest.approx(39.0, abs=0.11)


def test_resampled_values_are_those_of_the_signal() -> None:
    """What is between the samples of a smooth signal is known to its curvature."""
    (segment,) = align(flown(STEADY), AlignSettings()).segments
    np.testing.assert_allclose(segment.body_rate_rad_s, motion(segment.time_s), atol=2e-5)


def test_a_gap_stays_a_gap() -> None:
    """Half a second without samples splits the segment; nothing is interpolated across it."""
    time_s = STEADY[(STEADY < 25.0) | (STEADY > 25.5)]
    first, second = align(flown(time_s), AlignSettings()).segments
    assert first.end_s <= 25.0
    assert second.start_s >= 25.5


def test_two_gap_free_parts_of_one_flight_are_one_flight_segment() -> None:
    """The user sees flights; the gaps inside are listed apart."""
    time_s = STEADY[(STEADY < 25.0) | (STEADY > 25.5)]
    assert len(align(flown(time_s), AlignSettings()).flight_segments) == 1


def test_a_missing_sample_or_two_is_no_gap() -> None:
    """Up to three periods are bridged."""
    keep = np.ones(STEADY.size, dtype=bool)
    keep[[3000, 3001, 5000]] = False
    assert len(align(flown(STEADY[keep]), AlignSettings()).segments) == 1


def test_a_reboot_splits_the_log_and_is_never_sorted_away() -> None:
    """The second boot starts at zero again; both parts follow each other on the common clock."""
    second = np.arange(0.0, 30.0, 0.0025)
    data = align(flown(np.concatenate([STEADY, second])), AlignSettings())
    assert data.clock_resets == 1
    assert len(data.segments) == 2
    assert data.segments[1].start_s > data.segments[0].end_s
    own_time_s = data.segments[1].time_s - (STEADY[-1] + 1.0)
    np.testing.assert_allclose(data.segments[1].body_rate_rad_s, motion(own_time_s), atol=2e-5)


def test_a_clock_that_jumps_ahead_by_hours_splits_the_log_without_a_gap_of_hours() -> None:
    """Both parts are kept; the time between them is taken out."""
    data = align(flown(np.concatenate([STEADY, STEADY + 9000.0])), AlignSettings())
    assert data.clock_resets == 1
    assert data.duration_s < 100.0


def test_rows_out_of_order_are_put_in_order_and_counted() -> None:
    """Two rows swapped in the file."""
    time_s = STEADY.copy()
    time_s[[500, 501]] = time_s[[501, 500]]
    data = align(flown(time_s), AlignSettings())
    assert data.sources["body_rate"].n_out_of_order == 1
    assert len(data.segments) == 1


def test_repeated_stamps_are_merged_and_counted() -> None:
    """The last row of a stamp stands."""
    time_s = STEADY.copy()
    time_s[100:103] = time_s[100]
    assert align(flown(time_s), AlignSettings()).sources["body_rate"].n_duplicate == 2


@pytest.mark.parametrize("stamp", [4.2e12, -1e6, np.nan, np.inf, 1e16])
def test_a_damaged_stamp_costs_only_its_own_row(stamp: float) -> None:
    """One corrupted TimeUS once broke slicing for a whole log."""
    time_s = STEADY.copy()
    time_s[700] = stamp
    data = align(
        flight_log(
            signal("body_rate", time_s, motion(STEADY)),
            signal("torque_command", time_s, 0.1 * motion(STEADY)),
            signal("throttle", time_s, np.full((time_s.size, 1), 0.4)),
        ),
        AlignSettings(),
    )
    assert data.sources["body_rate"].n_outliers == 1
    assert data.clock_resets == 0
    assert len(data.segments) == 1
    assert data.duration_s == pytest.approx(30.0, abs=0.1)


def test_not_a_number_in_the_values_costs_only_its_own_row() -> None:
    """It is counted, and no NaN reaches the segments."""
    log = flown(STEADY)
    values = motion(STEADY)
    values[400, 1] = np.nan
    broken = flight_log(
        signal("body_rate", STEADY, values), *log.candidates("torque_command"), *log.candidates("throttle")
    )
    data = align(broken, AlignSettings())
    assert data.sources["body_rate"].n_not_finite == 1
    assert np.isfinite(data.segments[0].body_rate_rad_s).all()


def test_a_log_without_time_has_no_segments() -> None:
    """And no crash."""
    data = align(flown(STEADY, has_time=False), AlignSettings())
    assert data.segments == ()


def test_a_log_in_the_time_that_its_firmware_should_have_kept_is_looked_at_and_not_identified() -> None:
    """Its flight is found; no model rests on a clock that nobody logged."""
    data = align(flown(STEADY, has_time=False, is_nominal_time=True), AlignSettings())
    assert data.flights
    assert data.segments == ()


def test_samples_that_are_written_ten_seconds_late_are_no_clock() -> None:
    """Batches of a gyro are; a row of each 32 samples would outvote the rows that are written at once."""
    late = STEADY[:-1, np.newaxis] - 10.0 + np.arange(32) / 3200.0
    place = np.repeat(50 * np.arange(len(STEADY) - 1, dtype=np.int64) + 25, 32)
    rows = Rows(late.ravel(), place)
    samples = Signal(name="gyro_samples", rows=rows, values=np.zeros((rows.n_samples, 3)), source="late")
    log = flown(STEADY)
    data = align(replace(log, signals={**log.signals, "gyro_samples": (samples,)}), AlignSettings())
    assert data.clock_resets == 0
    assert data.sources["body_rate"].n_outliers == 0
    assert len(data.segments) == len(align(log, AlignSettings()).segments)


def test_an_empty_log_has_no_segments() -> None:
    """A valid file without a single signal."""
    data = align(flight_log(), AlignSettings())
    assert (data.segments, data.input, data.duration_s) == ((), None, 0.0)


def test_a_rover_has_no_segments() -> None:
    """The model is a multirotor's; no number is given for anything else."""
    assert align(flown(STEADY, vehicle_type="rover"), AlignSettings()).segments == ()


def test_the_source_in_step_with_the_torque_is_preferred_to_a_faster_gyro() -> None:
    """The gyro is as good but not on the torque's rows."""
    log = flown(STEADY)
    fast = np.arange(10.0, 40.0, 0.001)
    gyro = signal("body_rate", fast, motion(fast), source="gyro", start=7)
    both = flight_log(*log.candidates("body_rate"), gyro, *log.candidates("torque_command"))
    choice = align(both, AlignSettings()).sources["body_rate"]
    assert choice.source == "body_rate"
    assert choice.others[0][0] == "gyro"


def test_a_preferred_source_that_is_too_slow_is_passed_over_with_the_reason() -> None:
    """10 Hz rates against a torque of 400 Hz."""
    slow = np.arange(10.0, 40.0, 0.1)
    log = flown(STEADY)
    both = flight_log(
        signal("body_rate", slow, motion(slow), source="slow one", start=7),
        signal("body_rate", STEADY, motion(STEADY), source="gyro"),
        *log.candidates("torque_command"),
    )
    choice = align(both, AlignSettings()).sources["body_rate"]
    assert choice.source == "gyro"
    assert "slow one is preferred but was logged at only 10 Hz" in choice.reason


def test_a_log_that_begins_armed_is_flown_until_the_disarm_event() -> None:
    """An event says what the state was before it."""
    log = flown(STEADY)
    disarm = signal("armed", np.array([30.0]), np.array([[0.0]]), start=400_000)
    signals = [each for name in log.signals for each in log.candidates(name)]
    (segment,) = align(flight_log(*signals, disarm), AlignSettings()).segments
    assert segment.end_s == pytest.approx(29.0, abs=0.2)


def test_two_flights_with_a_landing_between_are_two_segments() -> None:
    """From the land detector."""
    log = flown(STEADY)
    landed = signal(
        "landed", np.array([10.0, 12.0, 22.0, 26.0]), np.array([[1.0], [0.0], [1.0], [0.0]]), start=3
    )
    signals = [each for name in log.signals for each in log.candidates(name)]
    data = align(flight_log(*signals, landed), AlignSettings())
    assert [segment.flight for segment in data.segments] == [0, 1]


def test_a_vehicle_on_the_bench_has_no_flight_and_the_reason_is_given() -> None:
    """Throttle at idle all the time."""
    log = flown(STEADY)
    idle = signal("throttle", STEADY, np.zeros((STEADY.size, 1)))
    data = align(
        flight_log(*log.candidates("body_rate"), *log.candidates("torque_command"), idle), AlignSettings()
    )
    assert data.segments == ()
    assert data.on_ground_reason == "the throttle never left idle"


def test_a_log_too_short_to_show_a_flight_says_so() -> None:
    """A truncated file is no evidence that the vehicle stayed on the ground."""
    short = np.arange(10.0, 10.4, 0.0025)
    idle = signal("throttle", short, np.zeros((short.size, 1)))
    data = align(flight_log(signal("body_rate", short, motion(short)), idle), AlignSettings())
    assert data.on_ground_reason == "the throttle never left idle in the 0.4 s that the log holds"


def test_only_the_chosen_part_of_the_log_is_used() -> None:
    """--start-s and --end-s."""
    (segment,) = align(flown(STEADY), AlignSettings(start_s=20.0, end_s=30.0)).segments
    assert segment.start_s >= 20.0
    assert segment.end_s <= 30.0


def test_a_rate_that_is_set_is_the_rate_that_is_used() -> None:
    """--sample-rate-hz."""
    data = align(flown(STEADY), AlignSettings(sample_rate_hz=50.0))
    np.testing.assert_allclose(np.diff(data.segments[0].time_s), 0.02)


def test_rows_that_come_in_pairs_are_a_flight() -> None:
    """Stamps 1 us apart every 5 ms once passed for a megahertz, at which every step is a gap."""
    pairs = np.repeat(STEADY[::2], 2) + np.tile([0.0, 1e-6], STEADY.size // 2)
    (segment,) = align(flown(pairs), AlignSettings()).segments
    assert segment.end_s - segment.start_s == pytest.approx(28.0, abs=0.3)


def test_torque_faster_than_the_limit_is_resampled_to_the_limit() -> None:
    """2 kHz logs are brought to 400 Hz."""
    data = align(flown(np.arange(0.0, 20.0, 0.0005)), AlignSettings())
    assert data.sample_period_s == pytest.approx(0.0025)


def test_a_yaw_angle_that_wraps_is_unwrapped_before_interpolation() -> None:
    """No sample may lie between +pi and -pi on the way down."""
    log = flown(STEADY)
    yaw = 0.5 * STEADY
    wrapped = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    angles = signal("attitude", STEADY, np.column_stack([0.0 * yaw, 0.0 * yaw, wrapped]))
    signals = [each for name in log.signals for each in log.candidates(name)]
    (segment,) = align(flight_log(*signals, angles), AlignSettings()).segments
    assert segment.attitude_rad is not None
    np.testing.assert_allclose(np.diff(segment.attitude_rad[:, 2]), 0.5 * 0.0025, atol=1e-9)


def test_mode_changes_after_a_reboot_are_moved_with_their_epoch() -> None:
    """A mode of the second boot lies in the second part of the common clock."""
    second = np.arange(0.0, 30.0, 0.0025)
    mode = ModeChange(time_s=5.0, position=50 * (STEADY.size + 2000), name="LOITER")
    data = align(flown(np.concatenate([STEADY, second]), modes=(mode,)), AlignSettings())
    assert data.modes[0].time_s == pytest.approx(STEADY[-1] + 1.0 + 5.0)


@pytest.mark.parametrize("damage", [1e300, -1e38, np.inf])
def test_a_number_that_no_vehicle_can_reach_is_dropped_and_counted(damage: float) -> None:
    """A flipped exponent would overflow in every square that follows."""
    values = motion(STEADY)
    values[4000, 1] = damage
    data = align(
        flight_log(
            signal("body_rate", STEADY, values),
            signal("torque_command", STEADY, 0.1 * motion(STEADY)),
            signal("throttle", STEADY, np.full((STEADY.size, 1), 0.4)),
        ),
        AlignSettings(),
    )
    assert data.sources["body_rate"].n_not_finite == 1
    assert all(np.abs(segment.body_rate_rad_s).max() <= 1.0 for segment in data.segments)


def test_stamps_closer_than_any_clock_counts_are_one_time() -> None:
    """Damaged stamps can differ by next to nothing; no rate is made of that."""
    time_s = np.concatenate([[0.0, 1e-320], STEADY])
    data = align(flown(time_s), AlignSettings())
    assert data.sources["body_rate"].rate_hz < 1e3
    assert data.sources["body_rate"].n_duplicate == 1
