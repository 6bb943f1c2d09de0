"""Motors, vibration and battery are judged by what was put into the flight."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.torque import TorqueModel
from quadid_logs.health.battery import find_battery
from quadid_logs.health.motors import find_motors
from quadid_logs.health.oscillation import _lowest_rotor_hz
from quadid_logs.health.records import in_flight
from quadid_logs.health.vibration import find_vibration
from tests.health.flights import coloured, grid, series

#: X: front right, back left, front left, back right.
POSITION = 0.7 * np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
QUAD = TorqueModel(position=POSITION, spin=np.array([1.0, 1.0, -1.0, -1.0]), channels=(1, 2, 3, 4))


def outputs(means: tuple[float, ...], spread: float = 0.05) -> np.ndarray:
    """Return outputs around their means."""
    t = grid(50.0)
    return t, np.asarray(means) + spread / 0.3 * coloured(4, t.size, 50.0, columns=len(means))


@pytest.mark.parametrize(
    ("means", "level", "hardest"),
    [
        ((0.50, 0.52, 0.49, 0.51), "normal", "motor 2 (back left)"),
        ((0.50, 0.50, 0.61, 0.51), "high", "motor 3 (front left)"),
        ((0.70, 0.50, 0.50, 0.52), "severe", "motor 1 (front right)"),
    ],
)
def test_the_corner_that_works_hardest_is_named(means: tuple[float, ...], level: str, hardest: str) -> None:
    """With how much more it works than the one that works least."""
    t, values = outputs(means)
    motors = find_motors(series("motor_thrust", t, values), QUAD, ((t[0], t[-1]),))
    assert motors is not None
    assert motors.level == level
    assert motors.names[motors.hardest] == hardest
    assert motors.spread.value == pytest.approx(max(means) - min(means), abs=0.005)


@pytest.mark.parametrize(
    ("means", "way"),
    [
        ((0.30, 0.34, 0.61, 0.62), "turn clockwise work"),
        ((0.62, 0.61, 0.34, 0.30), "turn counter-clockwise work"),
        # A weak rotor, and a load at the back.
        ((0.70, 0.50, 0.50, 0.52), ""),
        ((0.40, 0.60, 0.40, 0.60), ""),
    ],
)
def test_a_yaw_torque_is_told_by_all_rotors_of_a_way_of_turning(means: tuple[float, ...], way: str) -> None:
    """A twisted arm: no battery that is moved mends that."""
    t, values = outputs(means)
    motors = find_motors(series("motor_thrust", t, values), QUAD, ((t[0], t[-1]),))
    assert motors is not None
    assert ("yaw torque" in motors.sentence) == bool(way)
    assert way in motors.sentence


def test_a_yaw_torque_is_told_in_pulses_as_they_were_sent() -> None:
    """Between 1100 and 1900 us a tenth of the range is 80 us."""
    t, values = outputs((0.40, 0.40, 0.52, 0.52), spread=0.02)
    torque = TorqueModel(
        position=POSITION,
        spin=QUAD.spin,
        channels=(1, 2, 3, 4),
        output_range_us=(np.full(4, 1100.0), np.full(4, 1900.0)),
    )
    motors = find_motors(series("output_pwm", t, 1100.0 + 800.0 * values), torque, ((t[0], t[-1]),))
    assert motors is not None
    assert "µs harder" in motors.sentence


def test_vibration_of_a_simulator_is_small_and_not_zero() -> None:
    """It was told as below 0.0 m/s²."""
    t = grid(10.0)
    found = find_vibration(
        {"vibration_level": series("vibration_level", t, np.full((t.size, 1), 0.0123))}, (), ((t[0], t[-1]),)
    )
    assert found is not None
    assert "below 0.0123 m/s²" in found.sentence


def test_pulses_are_taken_by_channel_and_range() -> None:
    """Motors on channels 9 to 12 between 1120 and 1880 us: half of that range is 1500."""
    t, values = outputs((0.5, 0.5, 0.5, 0.58))
    pulses = np.full((t.size, 14), 1500.0)
    pulses[:, 8:12] = 1120.0 + 760.0 * values
    torque = TorqueModel(
        position=POSITION,
        spin=QUAD.spin,
        channels=(9, 10, 11, 12),
        output_range_us=(np.full(4, 1120.0), np.full(4, 1880.0)),
    )
    motors = find_motors(series("output_pwm", t, pulses), torque, ((t[0], t[-1]),))
    assert motors is not None
    assert motors.mean == pytest.approx([0.5, 0.5, 0.5, 0.58], abs=0.01)
    assert motors.names[motors.hardest] == "motor 4 (back right)"
    # 8 % of this range are 61 us, below the 75 that are normal of pulses.
    assert motors.level == "normal"
    assert motors.spread.value == pytest.approx(61.0, abs=3.0)
    assert motors.spread.unit == "us"


def test_pulses_of_unknown_range_are_compared_and_not_held_against_limits() -> None:
    """150 us apart and more is severe; what is left above nobody knows."""
    t, values = outputs((0.5, 0.5, 0.5, 0.7))
    motors = find_motors(series("output_pwm", t, 1000.0 + 1000.0 * values), QUAD, ((t[0], t[-1]),))
    assert motors is not None
    assert motors.level == "severe"
    assert motors.unit == "us"
    assert motors.headroom is None
    assert motors.at_high is None


@pytest.mark.parametrize(("share", "told"), [(0.3, True), (0.0, False)])
def test_a_motor_at_idle_is_told_as_one_at_full(share: float, told: bool) -> None:
    """Of a flight with a motor at idle in four fifths of it, only the reserve at the top was told."""
    t, values = outputs((0.3, 0.3, 0.3, 0.3), spread=0.02)
    values[: int(share * t.size), 1] = 0.0
    motors = find_motors(series("motor_thrust", t, values), QUAD, ((t[0], t[-1]),))
    assert motors is not None
    assert ("lower limit in 30 % of the flight" in motors.sentence) == told


def test_the_share_of_time_at_the_limit_is_that_of_the_flight() -> None:
    """One motor at full output in a tenth of the flight."""
    t, values = outputs((0.5, 0.5, 0.5, 0.5))
    values[: t.size // 10, 0] = 1.0
    motors = find_motors(series("motor_thrust", t, values), QUAD, ((t[0], t[-1]),))
    assert motors is not None
    assert motors.at_high is not None
    assert motors.at_high.value == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize(("share", "level"), [(0.02, "normal"), (0.17, "high")])
def test_motors_that_are_at_full_output_for_long_are_not_normal_however_alike(
    share: float, level: str
) -> None:
    """A quad that flew 26 % of its flight 5 degrees off its set-points had "normal" motors."""
    t, values = outputs((0.5, 0.5, 0.5, 0.5), spread=0.02)
    values[: int(share * t.size)] = 1.0
    motors = find_motors(series("motor_thrust", t, values), QUAD, ((t[0], t[-1]),))
    assert motors is not None
    assert motors.level == level
    assert ("more than the normal 10 %" in motors.sentence) == (level == "high")


@pytest.mark.parametrize(("rms", "level"), [(12.0, "normal"), (45.0, "high"), (80.0, "severe")])
def test_vibration_is_judged_by_what_99_percent_stay_below(rms: float, level: str) -> None:
    """ArduPilot's own measure, in m/s^2."""
    t = grid(10.0)
    values = np.column_stack([np.full(t.size, 2.0), np.full(t.size, 3.0), np.full(t.size, rms)])
    values[:3, 0] = 400.0  # a bump on the ground
    found = find_vibration({"vibration": series("vibration", t, values)}, (), ((t[0], t[-1]),))
    assert found is not None
    assert found.level == level
    assert found.figure.value == pytest.approx(rms)


def test_the_sensor_that_shakes_most_is_shown() -> None:
    """Three sensors of one board measured 10, 13 and 12 m/s^2: the first was shown."""
    t = grid(10.0)
    sensors = [series("vibration", t, np.full((t.size, 3), size)) for size in (10.0, 13.0, 12.0)]
    found = find_vibration({"vibration": sensors[0]}, (), ((t[0], t[-1]),), {"vibration": sensors})
    assert found is not None
    assert found.figure.value == pytest.approx(13.0)


def test_the_vibration_of_a_logged_acceleration_has_no_norm() -> None:
    """What 5 Hz and slower motion is not; a number without a judgement."""
    t = grid(200.0)
    rng = np.random.default_rng(1)
    values = 3.0 * rng.standard_normal((t.size, 3)) + 5.0 * np.sin(2.0 * np.pi * 0.5 * t)[:, None]
    found = find_vibration({"specific_force": series("specific_force", t, values)}, (), ((t[0], t[-1]),))
    assert found is not None
    assert found.level == "fact"
    # The worst hundredth of blocks of a hundred samples lies 2.3 / sqrt(200) above.
    assert found.figure.value == pytest.approx(3.0 * (1.0 + 2.3 / np.sqrt(200.0)), rel=0.06)


def test_clips_are_those_of_the_flight() -> None:
    """A counter that had 700 before take-off and 950 after landing, 130 of them in flight."""
    t = grid(10.0)
    counts = np.interp(t, [t[0] + 10.0, t[0] + 20.0], [700.0, 830.0])
    counts[t > t[0] + 55.0] = 950.0
    flight = (t[0] + 5.0, t[0] + 50.0)
    vibration = {"vibration": series("vibration", t, np.ones((t.size, 3)))}
    found = find_vibration(vibration, (series("accelerometer_clips", t, counts[:, None]),), (flight,))
    assert found is not None
    assert found.clips is not None
    assert found.clips.value == pytest.approx(130.0, abs=2.0)
    assert found.level == "high"


def test_counters_beside_a_vibration_that_was_not_measured_prove_no_clipping() -> None:
    """A board whose vibration is logged as zeros counts no clips either: that it never clipped is made up."""
    t = grid(200.0)
    signals = {
        "vibration": series("vibration", t, np.zeros((t.size, 3))),
        "specific_force": series("specific_force", t, np.random.default_rng(1).standard_normal((t.size, 3))),
    }
    clips = (series("accelerometer_clips", t, np.zeros((t.size, 1))),)
    found = find_vibration(signals, clips, ((t[0], t[-1]),))
    assert found is not None
    assert found.clips is None
    assert "clipped" not in found.sentence


@pytest.mark.parametrize(
    ("start", "end", "cells", "level"),
    [
        (16.6, 14.6, 4, "normal"),
        (12.4, 10.2, 3, "high"),
        (25.0, 19.5, 6, "severe"),
        (9.9, 9.2, 0, "fact"),
        # Flown with one cell; no two have so little.
        (3.4, 3.1, 1, "severe"),
    ],
)
def test_a_battery_is_judged_by_its_cells(start: float, end: float, cells: int, level: str) -> None:
    """3.5 V for each is enough, below 3.3 V it is empty; where the cells cannot be counted, no judgement."""
    t = grid(10.0)
    found = find_battery(
        series("battery_voltage", t, np.linspace(start, end, t.size)[:, None]), None, ((t[0], t[-1]),)
    )
    assert found is not None
    assert found.n_cells == cells
    assert found.level == level
    assert found.lowest_v.value == pytest.approx(end, abs=0.1)


@pytest.mark.parametrize(
    ("start", "stated", "cells"),
    [(13.9, 4, 4), (13.9, 0, 0), (12.4, 4, 3), (50.0, 12, 12), (9.9, 3, 3), (4.2, 12, 1), (14.6, 3, 4)],
)
def test_stated_cells_count_where_the_voltage_shows_no_other_number(
    start: float, stated: int, cells: int
) -> None:
    """An empty battery of four cells has 13.9 V, a full one of three 12.4 V though the default says four."""
    t = grid(10.0)
    volts = series("battery_voltage", t, np.linspace(start, start - 0.5, t.size)[:, None])
    found = find_battery(volts, None, ((t[0], t[-1]),), stated)
    assert found is not None
    assert found.n_cells == cells


def test_a_voltage_of_no_battery_that_never_falls_is_not_called_one() -> None:
    """A board on its own supply measured 6.0 V for four minutes of flight."""
    t = grid(10.0)
    volts = 5.99 + 0.02 * np.random.default_rng(3).standard_normal((t.size, 1))
    throttle = series("throttle", t, 0.5 + 0.1 * np.sin(t)[:, None])
    assert find_battery(series("battery_voltage", t, volts), throttle, ((t[0], t[-1]),)) is None


def test_the_sag_is_told_from_the_discharge() -> None:
    """0.3 V for each tenth of the throttle, while the throttle rises because the battery empties."""
    t = grid(10.0)
    rng = np.random.default_rng(0)
    throttle = 0.5 + 0.1 * (t - t[0]) / 60.0 + 0.05 * rng.standard_normal(t.size)
    volts = 16.4 - 1.5 * (t - t[0]) / 60.0 - 3.0 * (throttle - 0.5) + 0.02 * rng.standard_normal(t.size)
    found = find_battery(
        series("battery_voltage", t, volts[:, None]),
        series("throttle", t, throttle[:, None]),
        ((t[0], t[-1]),),
    )
    assert found is not None
    assert found.sag_v is not None
    assert found.sag_v.value == pytest.approx(0.3, abs=0.02)
    assert found.sag_v.ci95 is not None
    assert found.sag_v.ci95[0] <= 0.3 <= found.sag_v.ci95[1]


def test_many_short_flights_are_looked_at_without_a_copy_of_the_log_for_each() -> None:
    """Speeds in single precision became a log in double precision a flight: 1.3 GB of one of 40 MB."""
    t = grid(1000.0)
    speeds = series("rotor_speed", t, np.full((t.size, 4), 600.0))
    speeds = replace(speeds, stored=speeds.stored.astype(np.float32))
    flights = [(10.0 + 0.5 * number, 10.3 + 0.5 * number) for number in range(100)]
    tracemalloc.start()
    lowest_hz, record = _lowest_rotor_hz(speeds, flights), in_flight(speeds, flights)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert lowest_hz == pytest.approx(600.0 / (2.0 * np.pi))
    assert record.values.dtype == np.float64
    assert peak < 8 * speeds.values.nbytes
