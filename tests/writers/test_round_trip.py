"""A flight that is written and read again is the same flight, to the format's resolution."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.load import read_log

from .conftest import flight, px4_flight, twice

Write = Callable[[FlightLog, str], Path]

#: Half a step of what the format's integers resolve; everything else is a 4-byte float.
HALF_STEP = {
    ".bin": {"output_pwm": 0.5},
    ".ulg": {"rotor_speed": 0.5 * np.pi / 30.0},
    ".tlog": {"output_pwm": 0.5, "rotor_speed": 0.5 * np.pi / 30.0, "battery_voltage": 0.5e-3},
}
#: Half a mG and half a mrad/s of RAW_IMU.
IMU_STEP = {"specific_force": 0.5e-3 * 9.80665, "body_rate": 0.5e-3}
#: What the formats have no message for.
ARDUPILOT_ONLY = ("battery_ratio", "lift_max", "sysid_chirp")
PX4_ONLY = ("motor_thrust", "unallocated_torque")
NOT_IN_TLOG = (*ARDUPILOT_ONLY, *PX4_ONLY, "torque_command", "throttle")

CASES = [
    pytest.param(flight, ".bin", PX4_ONLY, id="ardupilot-bin"),
    pytest.param(px4_flight, ".ulg", ARDUPILOT_ONLY, id="px4-ulg"),
    pytest.param(flight, ".tlog", NOT_IN_TLOG, id="ardupilot-tlog"),
    pytest.param(px4_flight, ".tlog", NOT_IN_TLOG, id="px4-tlog"),
]


def wrapped(name: str, difference: np.ndarray) -> np.ndarray:
    """Angles are the same modulo a turn."""
    return (difference + np.pi) % (2.0 * np.pi) - np.pi if name == "attitude" else difference


def assert_same(found: Signal, expected: Signal, *, half_step: float, clock_s: float) -> None:
    """Compare rows, times and values; a channel that was never used may be padding."""
    n_columns = expected.values.shape[1]
    np.testing.assert_allclose(found.time_s, expected.time_s, rtol=0.0, atol=clock_s)
    difference = wrapped(expected.name, found.values[:, :n_columns] - expected.values)
    scale = np.maximum(np.abs(expected.values), 2.0 * np.pi if expected.name == "attitude" else 0.0)
    assert np.all(np.abs(difference) <= half_step * 1.0001 + 2.5e-7 * scale + 1e-9)
    assert not found.values[:, n_columns:].any()


@pytest.mark.parametrize(("make", "suffix", "left_out"), CASES)
def test_every_series_comes_back(
    written: Write, make: Callable[[], FlightLog], suffix: str, left_out: tuple[str, ...]
) -> None:
    """Each source in its place of preference, with its times and values."""
    log = make()
    read = read_log(written(log, f"a{suffix}"))
    names = set(log.signals) - set(left_out) - {"armed", "landed"}
    assert len(names) >= 7
    for name in names:
        for expected, found in zip(log.signals[name], read.signals[name], strict=False):
            is_raw_imu = suffix == ".tlog" and log.autopilot == "ardupilot" and "IMU" in expected.source
            half_step = IMU_STEP[name] if is_raw_imu else HALF_STEP[suffix].get(name, 0.0)
            # The stamps of a telemetry log are the autopilot's whole milliseconds.
            clock_s = 1.001e-3 if suffix == ".tlog" else 0.51e-6
            assert_same(found, expected, half_step=half_step, clock_s=clock_s)


@pytest.mark.parametrize(("make", "suffix", "left_out"), CASES)
def test_the_rest_of_the_log_comes_back(
    written: Write, make: Callable[[], FlightLog], suffix: str, left_out: tuple[str, ...]
) -> None:
    """Autopilot, vehicle, parameters, mode at each second, and nothing lost."""
    log = make()
    read = read_log(written(log, f"a{suffix}"))
    assert (read.autopilot, read.vehicle_type) == (log.autopilot, "multirotor")
    assert read.corrupt_bytes == 0
    for name, value in log.parameters.items():
        assert read.parameters[name] == pytest.approx(value, rel=1e-7)
    assert len(read.modes) == 2
    assert [mode.time_s for mode in read.modes] == pytest.approx([12.5, 13.5], abs=0.01)
    assert log.texts[0].text in [text.text for text in read.texts]


@pytest.mark.parametrize(("make", "suffix", "left_out"), CASES)
def test_arming_and_landing_come_back(
    written: Write, make: Callable[[], FlightLog], suffix: str, left_out: tuple[str, ...]
) -> None:
    """The state is the same at every quarter of a second; a heartbeat tells it up to a second late."""
    read = read_log(written(make(), f"a{suffix}"))
    late_s = 1.0 if suffix == ".tlog" else 0.0
    for name, edge in (("armed", 13.0), ("landed", 13.25)):
        state = read.signals[name][0]
        early, late = np.searchsorted(state.time_s, [edge - 0.001, edge + late_s + 0.001], side="right") - 1
        after = 1.0 if name == "armed" else 0.0
        assert state.values[late, 0] == after
        # DataFlash has events only: before the first one there is no row.
        assert early < 0 or state.values[early, 0] == 1.0 - after
        assert np.any(np.abs(state.time_s - edge) <= late_s + 1e-6)


@pytest.mark.parametrize("suffix", [".bin", ".ulg"])
def test_two_boots_come_back_in_order(written: Write, suffix: str) -> None:
    """The clock falls once, where the second boot begins."""
    make = flight if suffix == ".bin" else px4_flight
    rate = read_log(written(twice(make()), f"a{suffix}")).signals["body_rate"][0]
    assert np.flatnonzero(np.diff(rate.time_s) < 0).tolist() == [1199]
