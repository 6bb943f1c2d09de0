"""What pyulog reads from our ULog files."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog, LogText

from .conftest import START_S, flight, px4_flight, series, twice

Write = Callable[[FlightLog, str], Path]

#: Topic, array field, canonical signal, factor to SI.
FIELDS = [
    ("vehicle_angular_velocity", "xyz", "body_rate"),
    ("vehicle_torque_setpoint", "xyz", "torque_command"),
    ("actuator_motors", "control", "motor_thrust"),
    ("actuator_outputs", "output", "output_pwm"),
    ("sensor_combined", "gyro_rad", "body_rate"),
    ("sensor_combined", "accelerometer_m_s2", "specific_force"),
    ("control_allocator_status", "unallocated_torque", "unallocated_torque"),
]


def read(path: Path) -> Any:
    """Read with pyulog."""
    from pyulog import ULog

    return ULog(str(path))


def array(log: Any, topic: str, field: str, n: int) -> np.ndarray:
    """Return the first elements of an array field as columns."""
    data = log.get_dataset(topic).data
    return np.column_stack([data[f"{field}[{i}]"] for i in range(n)]).astype(float)


@pytest.mark.parametrize(("topic", "field", "signal"), FIELDS)
def test_pyulog_finds_the_series_that_went_in(written: Write, topic: str, field: str, signal: str) -> None:
    """Values agree to the resolution of a 4-byte float."""
    log = px4_flight()
    values = log.signals[signal][0].values
    found = array(read(written(log, "a.ulg")), topic, field, values.shape[1])
    np.testing.assert_allclose(found, values, rtol=2e-7, atol=1e-9)


def test_the_sample_time_is_kept_beside_the_time_of_publication(written: Write) -> None:
    """timestamp_sample is the signal's time; timestamp is later, as on real hardware."""
    log = px4_flight()
    data = read(written(log, "a.ulg")).get_dataset("vehicle_torque_setpoint").data
    np.testing.assert_array_equal(
        data["timestamp_sample"], np.rint(log.signals["torque_command"][0].time_s * 1e6)
    )
    assert np.all(data["timestamp"] > data["timestamp_sample"])


def test_set_points_and_thrust_arrive_under_px4_s_signs(written: Write) -> None:
    """Thrust is upwards, so negative on the body's z axis."""
    log = px4_flight()
    found = read(written(log, "a.ulg"))
    thrust = array(found, "vehicle_thrust_setpoint", "xyz", 3)
    np.testing.assert_allclose(-thrust[:, 2], log.signals["throttle"][0].values[:, 0], rtol=2e-7)
    assert not thrust[:, :2].any()
    data = found.get_dataset("vehicle_rates_setpoint").data
    wanted = np.column_stack([data[name] for name in ("roll", "pitch", "yaw")])
    np.testing.assert_allclose(wanted, log.signals["body_rate_setpoint"][0].values, rtol=2e-7, atol=1e-9)


def test_the_attitude_is_the_same_rotation(written: Write) -> None:
    """The quaternion turns back into the Euler angles (Diebel 2006, eq. 290)."""
    log = px4_flight()
    w, x, y, z = array(read(written(log, "a.ulg")), "vehicle_attitude", "q", 4).T
    euler = np.column_stack(
        (
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(2 * (w * y - z * x)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        )
    )
    np.testing.assert_allclose(euler, log.signals["attitude"][0].values, atol=1e-6)


def test_unused_motors_are_nan(written: Write) -> None:
    """As PX4 marks motors that the airframe does not have."""
    control = array(read(written(px4_flight(), "a.ulg")), "actuator_motors", "control", 12)
    assert np.isnan(control[:, 4:]).all()
    assert not np.isnan(control[:, :4]).any()


def test_rotor_speeds_are_whole_revolutions_per_minute(written: Write) -> None:
    """esc_status has one report per motor and says how many there are."""
    log = px4_flight()
    data = read(written(log, "a.ulg")).get_dataset("esc_status").data
    found = np.column_stack([data[f"esc[{i}].esc_rpm"] for i in range(4)])
    np.testing.assert_array_equal(found, np.rint(log.signals["rotor_speed"][0].values * 30.0 / np.pi))
    assert set(data["esc_count"]) == {4}
    assert not data["esc[4].esc_rpm"].any()


def test_states_arrive_at_their_times(written: Write) -> None:
    """Arming, landing and mode, each with the row's own time."""
    found = read(written(px4_flight(), "a.ulg"))
    armed = found.get_dataset("actuator_armed").data
    assert list(zip(armed["timestamp"], armed["armed"], strict=True)) == [
        (12_500_000, 0),
        (13_000_000, 1),
        (15_250_000, 0),
    ]
    landed = found.get_dataset("vehicle_land_detected").data
    assert list(zip(landed["timestamp"], landed["landed"], strict=True)) == [
        (12_500_000, 1),
        (13_250_000, 0),
        (15_000_000, 1),
    ]
    status = found.get_dataset("vehicle_status").data
    assert list(status["nav_state"]) == [15, 15, 15, 1, 1]
    assert list(status["arming_state"]) == [1, 1, 2, 2, 1]


def test_parameters_keep_their_types(written: Write) -> None:
    """Integer parameters are integers, the others 4-byte floats."""
    found = read(written(px4_flight(), "a.ulg")).initial_parameters
    assert found == {
        "CA_ROTOR_COUNT": 4,
        "CA_ROTOR0_PX": 1.0,
        "MC_BAT_SCALE_EN": 0,
        "SYS_AUTOSTART": -1,
    }
    assert isinstance(found["CA_ROTOR_COUNT"], int)
    assert isinstance(found["CA_ROTOR0_PX"], float)


def test_texts_and_version_arrive(written: Write) -> None:
    """Logged messages with level info; the release as PX4 packs it."""
    texts = (LogText(time_s=START_S + 1.0, position=0, text="[commander] Takeoff detected"),)
    found = read(written(px4_flight(texts=texts), "a.ulg"))
    assert [(m.message, m.timestamp, m.log_level_str()) for m in found.logged_messages] == [
        ("[commander] Takeoff detected", 13_500_000, "INFO")
    ]
    assert found.get_version_info_str() == "v1.17.2"
    assert found.msg_info_dict["sys_name"] == "PX4"


def test_more_than_16_outputs_use_a_second_instance(written: Write) -> None:
    """Each instance of actuator_outputs has 16 channels."""
    outputs = series("output_pwm", rate_hz=10.0, n_columns=18, source="actuator_outputs.output")
    found = read(written(px4_flight(signals={"output_pwm": (outputs,)}), "a.ulg"))
    second = found.get_dataset("actuator_outputs", 1).data
    np.testing.assert_allclose(second["output[1]"], outputs.values[:, 17], rtol=2e-7)
    assert set(second["noutputs"]) == {2}


def test_sync_messages_stand_every_half_second(written: Write) -> None:
    """A reader finds its way again after damage."""
    content = written(px4_flight(), "a.ulg").read_bytes()
    assert content.count(bytes.fromhex("080053") + bytes.fromhex("2f731320250cbb12")) == 6


def test_a_clock_that_starts_again_keeps_the_rows_in_order(written: Write) -> None:
    """The second boot follows the first one in every topic."""
    found = read(written(twice(px4_flight()), "a.ulg"))
    for topic in ("vehicle_angular_velocity", "actuator_outputs", "vehicle_status"):
        times = found.get_dataset(topic).data["timestamp"].astype(np.int64)
        assert np.count_nonzero(np.diff(times) < 0) == 1


@pytest.mark.parametrize("make", [flight, px4_flight])
def test_ulog_info_has_no_complaint(written: Write, make: Callable[[], FlightLog]) -> None:
    """The tool finds no dropout, no corruption and nothing for stderr."""
    path = written(make(), "a.ulg")
    tool = Path(sys.executable).with_name("ulog_info")
    done = subprocess.run([str(tool), str(path)], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert "No Dropouts" in done.stdout
    assert not read(path).file_corruption


def test_formats_equal_the_firmware_s(written: Write, corpus: Path) -> None:
    """Every topic's fields are those of PX4 main."""
    ours = read(written(px4_flight(), "a.ulg")).message_formats
    theirs = read(corpus / "firmware" / "px4_quad_multisine.ulg").message_formats
    assert ours
    for name, found in ours.items():
        assert found.fields == theirs[name].fields


def test_a_torque_is_achieved_where_next_to_nothing_is_unallocated(written: Write) -> None:
    """A squared norm below 1e-6, and only there."""
    log = px4_flight()
    torque = log.signals["unallocated_torque"][0]
    values = np.where(np.arange(torque.n_samples)[:, np.newaxis] % 2, 0.1, 1e-4) * np.ones(3)
    changed = replace(log, signals={**log.signals, "unallocated_torque": (replace(torque, values=values),)})
    data = read(written(changed, "a.ulg")).get_dataset("control_allocator_status").data
    np.testing.assert_array_equal(data["torque_setpoint_achieved"], 1 - np.arange(torque.n_samples) % 2)
