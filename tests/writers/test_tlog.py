"""What pymavlink reads from our telemetry logs."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog, LogText

from .conftest import START_S, flight, px4_flight, series, twice

Write = Callable[[FlightLog, str], Path]
Rows = dict[str, list[Any]]


_READ: dict[bytes, Rows] = {}


def rows(path: Path) -> Rows:
    """Read all messages with mavutil, of the same bytes once."""
    from pymavlink import mavutil

    content = path.read_bytes()
    if content not in _READ:
        connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        found = _READ[content] = defaultdict(list)
        while (message := connection.recv_msg()) is not None:
            found[message.get_type()].append(message)
        connection.close()
    return _READ[content]


def column(messages: list[Any], *names: str) -> np.ndarray:
    """Return fields as columns."""
    return np.array([[getattr(message, name) for name in names] for message in messages], dtype=float)


def test_attitude_and_rates_arrive_together(written: Write) -> None:
    """ATTITUDE has 4-byte floats and the autopilot's whole milliseconds."""
    log = flight()
    found = rows(written(log, "a.tlog"))["ATTITUDE"]
    attitude, rate = log.signals["attitude"][0], log.signals["body_rate"][0]
    np.testing.assert_allclose(column(found, "roll", "pitch", "yaw"), attitude.values, rtol=2e-7, atol=1e-9)
    np.testing.assert_allclose(
        column(found, "rollspeed", "pitchspeed", "yawspeed"), rate.values, rtol=2e-7, atol=1e-9
    )
    boot_ms = column(found, "time_boot_ms")[:, 0]
    assert np.all(rate.time_s * 1e3 - boot_ms < 1.0 + 1e-6)
    assert np.all(rate.time_s * 1e3 - boot_ms > -1e-6)


def test_a_faster_attitude_does_not_repeat_rates(written: Write) -> None:
    """ATTITUDE stands at the rates' times: a repeated rate would look like a measured one."""
    log = flight()
    slow = series("body_rate", rate_hz=100.0, n_columns=3, source="RATE.R,P,Y")
    found = rows(written(replace(log, signals={**log.signals, "body_rate": (slow,)}), "a.tlog"))["ATTITUDE"]
    np.testing.assert_allclose(column(found, "rollspeed")[:, 0], slow.values[:, 0], rtol=2e-7, atol=1e-9)
    angles = log.signals["attitude"][0].values[::4, 0]
    np.testing.assert_allclose(column(found, "roll")[:, 0], angles, rtol=2e-7, atol=1e-9)


def test_ardupilot_s_imu_is_in_thousandths(written: Write) -> None:
    """RAW_IMU agrees to half a mrad/s and half a mG."""
    log = flight()
    found = rows(written(log, "a.tlog"))["RAW_IMU"]
    gyro = column(found, "xgyro", "ygyro", "zgyro") * 1e-3
    np.testing.assert_allclose(gyro, log.signals["body_rate"][1].values, atol=0.5001e-3)
    force = column(found, "xacc", "yacc", "zacc") * 9.80665e-3
    np.testing.assert_allclose(force, log.signals["specific_force"][0].values, atol=4.91e-3)


def test_px4_s_imu_is_in_si_units(written: Write) -> None:
    """HIGHRES_IMU agrees to the resolution of a 4-byte float, with microseconds."""
    log = px4_flight()
    found = rows(written(log, "a.tlog"))
    assert not found["RAW_IMU"]
    gyro = column(found["HIGHRES_IMU"], "xgyro", "ygyro", "zgyro")
    np.testing.assert_allclose(gyro, log.signals["body_rate"][1].values, rtol=2e-7, atol=1e-9)
    times = column(found["HIGHRES_IMU"], "time_usec")[:, 0]
    np.testing.assert_array_equal(times, np.rint(log.signals["body_rate"][1].time_s * 1e6))


def test_set_points_outputs_speeds_and_voltage_arrive(written: Write) -> None:
    """Each to the resolution of its field."""
    log = flight()
    found = rows(written(log, "a.tlog"))
    target = found["ATTITUDE_TARGET"]
    np.testing.assert_allclose(
        column(target, "body_roll_rate", "body_pitch_rate", "body_yaw_rate"),
        log.signals["body_rate_setpoint"][0].values,
        rtol=2e-7,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        column(target, "thrust"), log.signals["throttle"][0].values, rtol=2e-7, atol=1e-9
    )
    servo = column(found["SERVO_OUTPUT_RAW"], *(f"servo{i}_raw" for i in range(1, 5)))
    np.testing.assert_array_equal(servo, np.rint(log.signals["output_pwm"][0].values))
    rpm = np.array([message.rpm for message in found["ESC_TELEMETRY_1_TO_4"]])
    np.testing.assert_array_equal(rpm, np.rint(log.signals["rotor_speed"][0].values * 30.0 / math.pi))
    millivolts = column(found["SYS_STATUS"], "voltage_battery")
    np.testing.assert_array_equal(millivolts, np.rint(log.signals["battery_voltage"][0].values * 1e3))


@pytest.mark.parametrize(
    ("make", "autopilot", "modes"), [(flight, 3, [0, 2]), (px4_flight, 12, [458752, 131072])]
)
def test_the_heartbeat_tells_autopilot_mode_and_arming(
    written: Write, make: Callable[[], FlightLog], autopilot: int, modes: list[int]
) -> None:
    """Once a second: type quadrotor, the mode in the autopilot's own numbers, the armed flag."""
    found = rows(written(make(), "a.tlog"))["HEARTBEAT"]
    assert {(message.type, message.autopilot) for message in found} == {(2, autopilot)}
    assert [message.custom_mode for message in found] == [modes[0], modes[1], modes[1]]
    assert [bool(message.base_mode & 128) for message in found] == [False, True, True]


def test_the_landed_state_arrives(written: Write) -> None:
    """EXTENDED_SYS_STATE: on ground, in air, on ground."""
    found = rows(written(flight(), "a.tlog"))["EXTENDED_SYS_STATE"]
    assert [message.landed_state for message in found] == [1, 2, 1]


def test_ardupilot_s_parameters_are_floats(written: Write) -> None:
    """Every parameter with the number of all."""
    log = flight()
    found = rows(written(log, "a.tlog"))["PARAM_VALUE"]
    assert {message.param_id: message.param_value for message in found} == pytest.approx(
        dict(log.parameters), rel=1e-7
    )
    assert {message.param_count for message in found} == {4}


def test_px4_s_integer_parameters_are_sent_by_their_bytes(written: Write) -> None:
    """As PX4's MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE says."""
    found = {m.param_id: m for m in rows(written(px4_flight(), "a.tlog"))["PARAM_VALUE"]}
    count = found["CA_ROTOR_COUNT"]
    assert count.param_type == 6
    assert struct.unpack("<i", struct.pack("<f", count.param_value)) == (4,)
    assert found["CA_ROTOR0_PX"].param_value == 1.0


def test_a_long_text_is_sent_in_chunks(written: Write) -> None:
    """All chunks have one id and are numbered; together they are the text."""
    text = "PreArm: " + "a very long reason, " * 6
    texts = (LogText(time_s=START_S + 1.0, position=0, text=text),)
    found = rows(written(flight(texts=texts), "a.tlog"))["STATUSTEXT"]
    assert [message.chunk_seq for message in found] == [0, 1, 2]
    assert len({message.id for message in found}) == 1
    assert "".join(message.text for message in found) == text


def test_more_than_16_outputs_use_a_second_port(written: Write) -> None:
    """Port 1 carries the channels from 17 on."""
    outputs = series("output_pwm", rate_hz=10.0, n_columns=18, source="SERVO_OUTPUT_RAW")
    found = rows(written(flight(signals={"output_pwm": (outputs,)}), "a.tlog"))["SERVO_OUTPUT_RAW"]
    second = [message for message in found if message.port == 1]
    np.testing.assert_array_equal(column(second, "servo2_raw")[:, 0], np.rint(outputs.values[:, 17]))


def test_host_stamps_never_fall_not_even_at_a_reboot(written: Write) -> None:
    """The ground station's clock goes on while time_boot_ms starts again."""
    path = written(twice(flight()), "a.tlog")
    found = rows(path)
    boot_ms = column(found["ATTITUDE"], "time_boot_ms")[:, 0]
    stamps = [message._timestamp for message in found["ATTITUDE"]]
    assert np.count_nonzero(np.diff(boot_ms) < 0) == 1
    assert np.all(np.diff(stamps) > 0)


@pytest.mark.parametrize("make", [flight, px4_flight])
def test_every_frame_is_intact(written: Write, make: Callable[[], FlightLog]) -> None:
    """No byte is left over, no checksum is wrong, no sequence number is missing."""
    from pymavlink import mavutil

    connection = mavutil.mavlink_connection(str(written(make(), "a.tlog")), dialect="ardupilotmega")
    kinds, sequence = set(), []
    while (message := connection.recv_msg()) is not None:
        kinds.add(message.get_type())
        sequence.append(message.get_seq())
    connection.close()
    assert "BAD_DATA" not in kinds
    assert len(kinds) >= 10
    assert sequence == [number % 256 for number in range(len(sequence))]


def test_mavlogdump_has_no_complaint(written: Write) -> None:
    """The tool prints every message and nothing on stderr."""
    path = written(flight(), "a.tlog")
    tool = Path(sys.executable).with_name("mavlogdump.py")
    done = subprocess.run([sys.executable, str(tool), str(path)], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.count(" ATTITUDE {") == 1200
