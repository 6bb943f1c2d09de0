"""MAVLink messages in canonical signals."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog
from quadid_logs.load import read_log
from quadid_logs.vocabulary import SIGNALS
from tests.containers import mavlink_maker as make


def log_of(folder: Path, sender: make.Sender, *packets: bytes, autopilot: int = make.ARDUPILOT) -> FlightLog:
    """Write and read a log of one system with attitudes for a clock."""
    path = folder / "log"
    path.write_bytes(
        sender.heartbeat(autopilot=autopilot) + sender.attitude(0) + b"".join(packets) + sender.attitude(1)
    )
    return read_log(path)


def sources(log: FlightLog, name: str) -> list[str]:
    """Return the messages that a signal comes from."""
    return [signal.source.partition(".")[0] for signal in log.candidates(name)]


def test_gyro_and_accelerometer_are_scaled_to_si(tmp_path: Path) -> None:
    """Milliradians per second and thousandths of g."""
    sender = make.Sender()
    log = log_of(
        tmp_path, sender, sender.stamped("RAW_IMU", time_usec=1_001_000, xgyro=500, ygyro=-250, zacc=-1000)
    )
    raw = log.candidates("body_rate")[1]
    assert raw.source.startswith("RAW_IMU")
    np.testing.assert_allclose(raw.values, [[0.5, -0.25, 0.0]])
    np.testing.assert_allclose(log.candidates("specific_force")[0].values, [[0.0, 0.0, -9.80665]])


def test_raw_imu_of_another_autopilot_is_not_taken(tmp_path: Path) -> None:
    """Only ArduPilot sends physical units in RAW_IMU."""
    sender = make.Sender()
    raw = sender.stamped("RAW_IMU", time_usec=1_001_000, xgyro=500)
    assert "RAW_IMU" not in sources(log_of(tmp_path, sender, raw, autopilot=make.PX4), "body_rate")


def test_a_sensor_that_is_not_there_gives_no_source(tmp_path: Path) -> None:
    """ArduPilot sends zeros for an IMU that it lacks."""
    sender = make.Sender()
    log = log_of(tmp_path, sender, sender.stamped("SCALED_IMU3", time_boot_ms=1005))
    assert sources(log, "body_rate") == ["ATTITUDE"]


def test_outputs_have_one_column_per_channel_in_use(tmp_path: Path) -> None:
    """Channels behind the last one that ever moves off zero are left out."""
    sender = make.Sender()
    outputs = sender.stamped("SERVO_OUTPUT_RAW", time_usec=1_001_000, servo1_raw=1100, servo3_raw=1300)
    assert log_of(tmp_path, sender, outputs).candidates("output_pwm")[0].values.tolist() == [
        [1100.0, 0.0, 1300.0]
    ]


def test_the_parts_of_three_rate_controllers_make_a_torque_command(tmp_path: Path) -> None:
    """FF + P + I + D of roll, pitch and yaw; two axes alone make none."""
    sender = make.Sender()

    def parts(axis: int, value: float) -> bytes:
        return sender.stamped("PID_TUNING", axis=axis, FF=value, P=value, I=value, D=value)

    log = log_of(tmp_path, sender, parts(1, 0.1), parts(2, 0.2), parts(3, -0.05))
    np.testing.assert_allclose(log.candidates("torque_command")[0].values, [[0.4, 0.8, -0.2]], rtol=1e-6)
    assert log_of(tmp_path, sender, parts(1, 0.1), parts(2, 0.2)).candidates("torque_command") == ()


def test_groups_of_escs_stand_side_by_side(tmp_path: Path) -> None:
    """Eight rotors come in two messages."""
    sender = make.Sender()
    packets = []
    for rpm in (60, 120):
        packets.append(sender.stamped("ESC_TELEMETRY_1_TO_4", rpm=[rpm] * 4))
        packets.append(sender.stamped("ESC_TELEMETRY_5_TO_8", rpm=[2 * rpm] * 4))
    speed = log_of(tmp_path, sender, *packets).candidates("rotor_speed")[0].values
    np.testing.assert_allclose(speed, 2 * np.pi * np.array([[1.0] * 4 + [2.0] * 4, [2.0] * 4 + [4.0] * 4]))


def test_esc_messages_that_are_always_zero_are_no_measurement(tmp_path: Path) -> None:
    """ESC messages exist in every flight; rpm may not."""
    sender = make.Sender()
    packets = [sender.stamped("ESC_TELEMETRY_1_TO_4", rpm=[0] * 4, voltage=[1] * 4)] * 2
    assert log_of(tmp_path, sender, *packets).candidates("rotor_speed") == ()


def test_the_land_detector_keeps_what_it_does_not_know(tmp_path: Path) -> None:
    """Undefined is neither landed nor in flight."""
    sender = make.Sender()
    packets = [sender.stamped("EXTENDED_SYS_STATE", landed_state=state) for state in (0, 1, 2)]
    values = log_of(tmp_path, sender, *packets).candidates("landed")[0].values.ravel()
    np.testing.assert_array_equal(values, [np.nan, 1.0, 0.0])


def test_integer_parameters_are_decoded_as_each_autopilot_sends_them(tmp_path: Path) -> None:
    """PX4 sends the bytes of an integer, ArduPilot its value."""
    sender = make.Sender()
    as_bytes = struct.unpack("<f", struct.pack("<i", 25))[0]
    px4 = sender.stamped("PARAM_VALUE", param_id=b"SDLOG_PROFILE", param_value=as_bytes, param_type=6)
    ardupilot = sender.stamped("PARAM_VALUE", param_id=b"FRAME_CLASS", param_value=1.0, param_type=2)
    assert log_of(tmp_path, sender, px4, autopilot=make.PX4).parameters == {"SDLOG_PROFILE": 25.0}
    assert log_of(tmp_path, sender, ardupilot).parameters == {"FRAME_CLASS": 1.0}


def test_long_texts_are_put_together_and_name_firmware_and_frame(tmp_path: Path) -> None:
    """Texts come in chunks of 50 characters."""
    sender = make.Sender()
    long = b"A" * 50
    log = log_of(
        tmp_path,
        sender,
        sender.stamped("STATUSTEXT", severity=6, text=b"ArduCopter V4.7.0-dev (abcdef12)"),
        sender.stamped("STATUSTEXT", severity=6, text=b"Frame: QUAD/X"),
        sender.stamped("STATUSTEXT", severity=6, text=long, id=5, chunk_seq=0),
        sender.stamped("STATUSTEXT", severity=6, text=b"end", id=5, chunk_seq=1),
    )
    assert [text.text for text in log.texts][2:] == ["A" * 50 + "end"]
    assert (log.firmware, log.frame) == ("ArduCopter V4.7.0-dev (abcdef12)", "QUAD/X")


def test_modes_have_the_names_of_their_autopilot(tmp_path: Path) -> None:
    """ArduPilot numbers modes, PX4 packs main and sub mode."""
    sender = make.Sender()
    copter = log_of(tmp_path, sender, sender.heartbeat(mode=5))
    assert [mode.name for mode in copter.modes] == ["STABILIZE", "LOITER"]
    path = tmp_path / "px4"
    states = [sender.heartbeat(autopilot=make.PX4, mode=mode) for mode in (3 << 16, 4 << 16 | 5 << 24)]
    path.write_bytes(sender.attitude(0) + b"".join(states))
    assert [mode.name for mode in read_log(path).modes] == ["POSCTL", "AUTO_RTL"]


@pytest.mark.parametrize(("hovers", "vehicle_type"), [(1.0, "vtol"), (0.0, "fixed-wing")])
def test_a_plane_that_hovers_is_told_by_its_parameters(
    tmp_path: Path, hovers: float, vehicle_type: str
) -> None:
    """ArduPlane's heartbeat says fixed wing of both."""
    sender = make.Sender()
    packets = [
        sender.heartbeat(kind=1),
        sender.stamped("PARAM_VALUE", param_id=b"Q_ENABLE", param_value=hovers, param_type=2),
    ]
    path = tmp_path / "log"
    path.write_bytes(b"".join(packets) + sender.attitude(0) + sender.attitude(1))
    assert read_log(path).vehicle_type == vehicle_type


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "vehicle_type"),
    [
        ("firmware/ac47_quadx_doublets.tlog", "multirotor"),
        ("real/ac32dev-quad-handrotated-52s.tlog", "multirotor"),
        ("damaged/sitl-flightlogs-bad-packets-4MB.tlog", "boat"),
    ],
)
def test_vehicles_of_the_corpus_are_recognised(corpus: Path, name: str, vehicle_type: str) -> None:
    """The heartbeat names the vehicle; every signal has a canonical name and a reason."""
    log = read_log(corpus / name)
    assert (log.autopilot, log.vehicle_type) == ("ardupilot", vehicle_type)
    assert set(log.signals) <= set(SIGNALS)
    assert all(signal.reason for signals in log.signals.values() for signal in signals)


def test_a_battery_that_is_not_measured_has_no_voltage(tmp_path: Path) -> None:
    """65535 mV says so, zero as well; between, it is measured."""
    sender = make.Sender()
    packets = [sender.stamped("SYS_STATUS", voltage_battery=value) for value in (65_535, 15_200, 0)]
    (battery,) = log_of(tmp_path, sender, *packets).candidates("battery_voltage")
    np.testing.assert_allclose(battery.values[:, 0], [np.nan, 15.2, np.nan])


def test_the_version_is_read_from_its_bytes(tmp_path: Path) -> None:
    """Major, minor and patch, ahead of the kind of release."""
    sender = make.Sender()
    packed = sender.stamped("AUTOPILOT_VERSION", flight_sw_version=(1 << 24) + (255 << 16) + (3 << 8) + 192)
    assert log_of(tmp_path, sender, packed).firmware == "v1.255.3"
