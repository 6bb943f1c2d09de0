"""Every row of every autopilot's table: a field of 1 must be 1 of its unit, in its column, with its sign.

What is expected is written down here from the vendors' documentation of units, not
taken from the tables. A row without an expectation fails.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from quadid_logs.autopilots.ardupilot.signals import PID_MESSAGES
from quadid_logs.autopilots.ardupilot.signals import SOURCES as ARDUPILOT
from quadid_logs.autopilots.generic.mavlink import SOURCES as MAVLINK
from quadid_logs.autopilots.px4.sdlog2 import SOURCES as SDLOG2
from quadid_logs.autopilots.px4.signals import SOURCES as PX4
from quadid_logs.autopilots.sources import Source
from quadid_logs.data.log import Signal
from quadid_logs.load import read_log
from quadid_logs.vocabulary import AXES
from tests.containers import mavlink_maker, ulog_maker
from tests.containers.dataflash_files import FMT_OF_FMT, fmt, row

DEGREE = math.pi / 180.0
RPM = math.pi / 30.0
MILLI_G = 9.80665e-3
I1, I3 = np.eye(1), np.eye(3)
#: Rows of values that say more than one field at a time.
TURNS = [[math.cos(0.1), *(math.sin(0.1) * axis)] for axis in np.eye(3)]
STATES = [[0.0], [1.0], [2.0]]


class Case(NamedTuple):
    """Rows of a message, field by field, and the signal that they make."""

    rows: Any
    expected: Any


def each(matrix: Any) -> Case:
    """One field after the other is 1; row k of the matrix is what field k makes."""
    return Case(np.eye(len(matrix)), matrix)


def key(source: Source[Any]) -> tuple[str, str, tuple[str, ...]]:
    """Tell a row of a table from the others."""
    return source.signal, source.message, source.fields


def check(
    source: Source[Any], path: Path, expected: Any, *, shown: str | None = None, rtol: float = 2e-7
) -> None:
    """Compare the only source of the signal in a file that is shown so."""
    signals = [
        one
        for one in read_log(path).candidates(source.signal)
        if one.source.startswith(shown or source.message)
    ]
    assert len(signals) == 1, [one.source for one in signals]
    found: Signal = signals[0]
    np.testing.assert_allclose(found.values, np.asarray(expected, dtype=float), rtol=rtol, atol=1e-9)
    assert found.reason.startswith(source.reason)


def _id(source: Source[Any]) -> str:
    return f"{source.signal}-{source.message}-{'-'.join(source.fields)}"[:70]


def dataflash_log(names: dict[str, tuple[str, ...]], rows: list[tuple[str, list[float]]]) -> bytes:
    """Return a log of messages with a time and these columns, integers for what counts sensors and events."""
    counting = {"I", "C", "Instance", "Id", "ArmState"}
    formats = {
        name: "Q" + "".join("B" if label in counting else "f" for label in labels)
        for name, labels in names.items()
    }
    ids = {name: number for number, name in enumerate(names, 1)}
    content = FMT_OF_FMT + b"".join(
        fmt(ids[name], name, formats[name], ",".join(("TimeUS", *labels))) for name, labels in names.items()
    )
    for number, (name, values) in enumerate(rows):
        whole = [int(v) if kind == "B" else v for kind, v in zip(formats[name][1:], values, strict=True)]
        content += row(ids[name], formats[name], 1000 * (number + 1), *whole)
    return content


GYRO, ACCELEROMETER, ANGLES = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ"), ("Roll", "Pitch", "Yaw")
#: In firmware before 3.3 RATE has hundredths of degrees, told by its labels, and commands up to 4500.
OLD = ("Rll", "Pit", "Yaw")
ARDUPILOT_CASES: dict[tuple[str, str, tuple[str, ...]], Case] = {
    ("body_rate", "RATE", ("R", "P", "Y")): each(DEGREE * I3),
    ("body_rate", "RATE", OLD): each(DEGREE / 100.0 * I3),
    ("body_rate", "RATE", ANGLES): each(DEGREE * I3),
    **{("body_rate", name, GYRO): each(I3)
       for name in ("IMU", "IMU2", "IMU3", "GYR", "GYR1", "GYR2", "GYR3")},
    ("body_rate", "SIDD", ("Gx", "Gy", "Gz")): each(DEGREE * I3),
    ("body_rate_setpoint", "RATE", ("RDes", "PDes", "YDes")): each(DEGREE * I3),
    ("body_rate_setpoint", "RATE", ("RllDes", "PitDes", "YawDes")): each(DEGREE / 100.0 * I3),
    ("body_rate_setpoint", "RATE", ("RollDes", "PitchDes", "YawDes")): each(DEGREE * I3),
    **{("attitude", name, ANGLES): each(DEGREE * I3)
       for name in ("ANG", "ATT", "XKF1", "NKF1", "EKF1", "AHR2")},
    **{("velocity", name, ("VN", "VE", "VD")): each(I3) for name in ("XKF1", "NKF1")},
    **{("attitude_setpoint", name, ("DesRoll", "DesPitch", "DesYaw")): each(DEGREE * I3)
       for name in ("ANG", "ATT")},
    ("attitude_setpoint", "ATT", ("RollIn", "PitchIn", "NavYaw")): each(DEGREE * I3),
    ("vibration", "VIBE", ("VibeX", "VibeY", "VibeZ")): each(I3),
    ("accelerometer_clips", "VIBE", ("Clip",)): each(I1),
    ("accelerometer_clips", "VIBE", ("Clip0", "Clip1", "Clip2")): each(I3),
    ("torque_command", "RATE", ("ROut", "POut", "YOut")): each(I3),
    ("torque_command", "RATE", ("RllOut", "PitOut", "YawOut")): each(I3),
    ("torque_command", "RATE", ("RollOut", "PitchOut", "YawOut")): each(I3),
    ("throttle", "RATE", ("AOut",)): each(I1),
    ("throttle", "CTUN", ("ThO",)): each(I1),
    ("throttle", "CTUN", ("ThrOut",)): Case([[1000.0], [500.0], [1.0]], [[1.0], [0.5], [1e-3]]),
    ("throttle", "MOTB", ("ThrOut",)): each(I1),
    **{("specific_force", name, ACCELEROMETER): each(I3)
       for name in ("IMU", "IMU2", "IMU3", "ACC", "ACC1", "ACC2", "ACC3")},
    ("battery_voltage", "BAT", ("Volt",)): each(I1),
    ("battery_voltage", "CURR", ("Volt",)): Case([[1644.0]], [[16.44]]),
    ("battery_ratio", "MOTB", ("BatVolt",)): each(I1),
    ("lift_max", "MOTB", ("LiftMax",)): each(I1),
    ("throttle_limit", "MOTB", ("ThLimit",)): each(I1),
    ("throttle_average_max", "MOTB", ("ThrAvMx",)): each(I1),
    # ISO 2533: 1.225, 1.112 and 1.007 kg/m^3 at 0, 1000 and 2000 m.
    ("air_density_ratio", "BARO", ("AltAMSL",)): Case(
        [[0.0], [1000.0], [2000.0]], np.array([[1.0], [1.11164 / 1.225], [1.00649 / 1.225]])
    ),
    # Pressure over gas constant and temperature, 15 degrees on the ground, 6.5 K less at 1000 m.
    ("air_density_ratio", "BARO", ("Press", "GndTemp", "Alt")): Case(
        [[101325.0, 15.0, 0.0], [89874.6, 15.0, 1000.0]], [[1.0], [1.11164 / 1.225]]
    ),
    ("armed", "STAT", ("Armed",)): each(I1),
    ("sysid_chirp", "SIDD", ("Targ",)): each(I1),
}  # fmt: skip


def pid_rows(values: list[dict[str, float]]) -> bytes:
    """Return loops of PIDR, PIDP, PIDY: in each, one axis has these terms and the others zero."""
    labels = tuple(dict.fromkeys(label for loop in values for label in loop))
    rows = [
        (name, [loop.get(label, 0.0) * (axis == number) for label in labels])
        for loop in values
        for axis in range(3)
        for number, name in enumerate(PID_MESSAGES)
    ]
    return dataflash_log(dict.fromkeys(PID_MESSAGES, labels), rows)


#: What does not come from one message alone: the file, and the values.
ARDUPILOT_FILES: dict[tuple[str, str, tuple[str, ...]], tuple[Callable[[], bytes], Any]] = {
    ("body_rate", "PIDR", ("Act",)): (lambda: pid_rows([{"Act": 1.0}]), I3),
    ("body_rate_setpoint", "PIDR", ("Tar",)): (lambda: pid_rows([{"Tar": 1.0}]), I3),
    ("body_rate_setpoint", "PIDR", ("Des",)): (lambda: pid_rows([{"Des": 1.0}]), I3),
    ("torque_command", "PIDR", ("P",)): (
        lambda: pid_rows([{term: 1.0} for term in ("P", "I", "D", "FF", "DFF")]), np.vstack([I3] * 5)
    ),
    ("output_pwm", "RCOU", ()): (
        lambda: dataflash_log(
            {"RCOU": ("C1", "C2"), "RCO2": ("C15", "C16"), "RCO3": ("C17",)},
            [(name, list(np.eye(5)[k][columns])) for k in range(5)
             for name, columns in (("RCOU", slice(0, 2)), ("RCO2", slice(2, 4)), ("RCO3", slice(4, 5)))],
        ), np.eye(5)
    ),
    ("output_pwm", "MOT", ()): (
        lambda: dataflash_log({"MOT": ("Mot2", "Mot1")}, [("MOT", [1.0, 0.0]), ("MOT", [0.0, 1.0])]),
        [[0.0, 1.0], [1.0, 0.0]],
    ),
    ("rotor_speed", "ESC", ("RPM",)): (
        lambda: dataflash_log(
            {"ESC": ("Instance", "RPM")},
            [("ESC", [esc, rpm]) for rpms in ((1.0, 0.0), (0.0, 1.0)) for esc, rpm in enumerate(rpms)],
        ), RPM * np.eye(2)
    ),
    ("rotor_speed", "ESC1", ("RPM",)): (
        lambda: dataflash_log(
            {"ESC1": ("RPM",), "ESC2": ("RPM",)},
            [("ESC1", [1.0]), ("ESC2", [0.0]), ("ESC1", [0.0]), ("ESC2", [1.0])],
        ), RPM * np.eye(2)
    ),
    ("armed", "EV", ()): (
        lambda: dataflash_log(
            {"EV": ("Id",), "ARM": ("ArmState",)},
            [("EV", [10]), ("EV", [15]), ("EV", [11]), ("ARM", [1]), ("ARM", [0])],
        ), [[1.0], [0.0], [1.0], [0.0]]
    ),
    ("landed", "EV", ()): (
        lambda: dataflash_log({"EV": ("Id",)}, [("EV", [18]), ("EV", [10]), ("EV", [28])]), [[1.0], [0.0]]
    ),
}  # fmt: skip
#: Shown under another name than the first message's.
SHOWN = {("armed", "EV", ()): "ARM", ("rotor_speed", "ESC1", ("RPM",)): "ESC.RPM"}


def ardupilot_log(source: Source[Any]) -> tuple[bytes, Any]:
    """Return a log of a source's message, and the values that it makes."""
    if key(source) in ARDUPILOT_FILES:
        make, expected = ARDUPILOT_FILES[key(source)]
        return make(), expected
    case = ARDUPILOT_CASES[key(source)]
    # RATE's measured rates tell the unit of its targets.
    rates = {"body_rate_setpoint": tuple(label.removesuffix("Des") for label in source.fields)}
    labels = tuple(dict.fromkeys((*source.fields, *rates.get(source.signal, ()))))
    rows = [(source.message, [*values, *[0.0] * (len(labels) - len(values))]) for values in case.rows]
    return dataflash_log({source.message: labels}, rows), case.expected


@pytest.mark.parametrize("source", ARDUPILOT, ids=_id)
def test_an_ardupilot_field_of_one_is_one_of_its_unit(source: Source[Any], tmp_path: Path) -> None:
    """AP_Logger/LogStructure.h: degrees, radians per second, m/s^2, microseconds, rpm."""
    content, expected = ardupilot_log(source)
    (tmp_path / "log").write_bytes(content)
    # ArduPilot's gas constant of air is 0.07 % above that of the standard's tables.
    rtol = 1e-3 if source.signal == "air_density_ratio" else 2e-7
    check(source, tmp_path / "log", expected, shown=SHOWN.get(key(source)), rtol=rtol)


def test_old_commands_are_divided_by_their_full_scale(tmp_path: Path) -> None:
    """A RATE whose rates are in hundredths of degrees has commands up to 4500."""
    path = tmp_path / "log"
    labels = (*OLD, "RllOut", "PitOut", "YawOut")
    path.write_bytes(dataflash_log({"RATE": labels}, [("RATE", list(row)) for row in np.eye(6)]))
    (command,) = read_log(path).candidates("torque_command")
    np.testing.assert_allclose(command.values, np.vstack([0.0 * I3, I3 / 4500.0]))


SDLOG2_CASES: dict[tuple[str, str, tuple[str, ...]], Case] = {
    ("body_rate", "ATT", ("RollRate", "PitchRate", "YawRate")): each(I3),
    **{("body_rate", name, ("GyroX", "GyroY", "GyroZ")): each(I3) for name in ("IMU", "IMU1", "IMU2")},
    ("body_rate_setpoint", "ARSP", ("RollRateSP", "PitchRateSP", "YawRateSP")): each(I3),
    ("attitude", "ATT", ANGLES): each(I3),
    ("attitude_setpoint", "ATSP", ("RollSP", "PitchSP", "YawSP")): each(I3),
    ("torque_command", "ATTC", ANGLES): each(I3),
    ("throttle", "ATTC", ("Thrust",)): each(I1),
    ("output_pwm", "OUT0", tuple(f"Out{k}" for k in range(8))): each(np.eye(8)),
    ("output_pwm", "OUT1", tuple(f"Out{k}" for k in range(8))): each(np.eye(8)),
    ("specific_force", "IMU", ACCELEROMETER): each(I3),
    ("specific_force", "IMU1", ACCELEROMETER): each(I3),
    ("battery_voltage", "BATT", ("V",)): each(I1),
    # ARMING_STATE of v1.4: init, standby, armed, armed with an error, standby with an error.
    ("armed", "STAT", ("ArmS",)): Case(
        [[0.0], [1.0], [2.0], [3.0], [4.0]], [[0.0], [0.0], [1.0], [1.0], [0.0]]
    ),
    ("landed", "STAT", ("Landed",)): each(I1),
}


@pytest.mark.parametrize("source", SDLOG2, ids=_id)
def test_an_sdlog2_field_of_one_is_one_of_its_unit(source: Source[Any], tmp_path: Path) -> None:
    """sdlog2_messages.h: SI throughout."""
    case, form = SDLOG2_CASES[key(source)], "f" * len(source.fields)
    content = (
        FMT_OF_FMT + fmt(1, "TIME", "Q", "StartTime") + fmt(2, source.message, form, ",".join(source.fields))
    )
    for number, values in enumerate(case.rows):
        content += row(1, "Q", 1000 * (number + 1)) + row(2, form, *values)
    (tmp_path / "log").write_bytes(content)
    check(source, tmp_path / "log", case.expected)


#: Format of the topic's fields, what is written, and what it makes.
PX4_CASES: dict[tuple[str, str, tuple[str, ...]], tuple[str, Case]] = {
    ("body_rate", "vehicle_angular_velocity", ("xyz",)): ("float[3] xyz", each(I3)),
    ("body_rate", "vehicle_attitude", ("rollspeed", "pitchspeed", "yawspeed")): (
        "float rollspeed;float pitchspeed;float yawspeed", each(I3)),
    ("body_rate", "sensor_combined", ("gyro_rad",)): ("float[3] gyro_rad", each(I3)),
    ("body_rate_setpoint", "vehicle_rates_setpoint", ("roll", "pitch", "yaw")): (
        "float roll;float pitch;float yaw", each(I3)),
    ("sysid_chirp", "autotune_attitude_control_status", ("rate_sp",)): (
        "float[3] rate_sp", each(np.ones((3, 1)))),
    ("attitude", "vehicle_attitude", ("q[0]", "q[1]", "q[2]", "q[3]")): ("float[4] q", Case(TURNS, 0.2 * I3)),
    ("velocity", "vehicle_local_position", ("vx", "vy", "vz")): ("float vx;float vy;float vz", each(I3)),
    ("attitude_setpoint", "vehicle_attitude_setpoint", ("roll_body", "pitch_body", "yaw_body")): (
        "float roll_body;float pitch_body;float yaw_body", each(I3)),
    ("attitude_setpoint", "vehicle_attitude_setpoint", ("q_d[0]", "q_d[1]", "q_d[2]", "q_d[3]")): (
        "float[4] q_d", Case(TURNS, 0.2 * I3)),
    ("vibration_level", "vehicle_imu_status", ("accel_vibration_metric",)): (
        "float accel_vibration_metric", each(I1)),
    ("accelerometer_clips", "vehicle_imu_status", tuple(f"accel_clipping[{k}]" for k in range(3))): (
        "float[3] accel_clipping", each(I3)),
    # One sample in each row of 32 places, a thousand counts of a milliradian per second.
    ("gyro_samples", "sensor_gyro_fifo", ("x", "y", "z", "dt", "scale", "samples")): (
        "float[32] x;float[32] y;float[32] z;float dt;float scale;float samples",
        Case([[*1000.0 * np.eye(96)[32 * k], 1000.0, 1e-3, 1.0] for k in range(3)], I3)),
    ("torque_command", "vehicle_torque_setpoint", ("xyz",)): ("float[3] xyz", each(I3)),
    ("torque_command", "actuator_controls_0", ("control[0]", "control[1]", "control[2]")): (
        "float[8] control", each(np.eye(8, 3))),
    ("throttle", "vehicle_thrust_setpoint", ("xyz[2]",)): ("float[3] xyz", each([[0.0], [0.0], [-1.0]])),
    ("throttle", "actuator_controls_0", ("control[3]",)): ("float[8] control", each(np.eye(8)[:, 3:4])),
    ("throttle", "vehicle_rates_setpoint", ("thrust_body[2]",)): (
        "float[3] thrust_body", each([[0.0], [0.0], [-1.0]])),
    ("motor_thrust", "actuator_motors", ("control",)): ("float[12] control", each(np.eye(12))),
    ("output_pwm", "actuator_outputs", ("output",)): (
        "float[4] output", Case(1000.0 + np.eye(4), 1000.0 + np.eye(4))),
    ("unallocated_torque", "control_allocator_status", ("unallocated_torque",)): (
        "float[3] unallocated_torque", each(I3)),
    ("specific_force", "sensor_combined", ("accelerometer_m_s2",)): ("float[3] accelerometer_m_s2", each(I3)),
    ("specific_force", "vehicle_acceleration", ("xyz",)): ("float[3] xyz", each(I3)),
    ("battery_voltage", "battery_status", ("voltage_v",)): ("float voltage_v", each(I1)),
    # ARMING_STATE_ARMED is 2.
    ("armed", "vehicle_status", ("arming_state",)): (
        "float arming_state", Case(STATES, [[0.0], [0.0], [1.0]])),
    ("armed", "actuator_armed", ("armed",)): ("float armed", each(I1)),
    ("landed", "vehicle_land_detected", ("landed",)): ("float landed", each(I1)),
}  # fmt: skip


def ulog(name: str, fields: str, rows: list[bytes], formats: bytes = b"") -> bytes:
    """Return a log of one topic."""
    content = ulog_maker.header() + formats
    content += ulog_maker.message("F", f"{name}:uint64_t timestamp;{fields};".encode())
    content += ulog_maker.subscription(1, name)
    for number, body in enumerate(rows):
        content += ulog_maker.message("D", struct.pack("<HQ", 1, 1000 * (number + 1)) + body)
    return content


@pytest.mark.parametrize("source", PX4, ids=_id)
def test_a_px4_field_of_one_is_one_of_its_unit(source: Source[Any], tmp_path: Path) -> None:
    """msg/*.msg: SI throughout, thrust along the body's z axis, ESC speeds in rpm."""
    path = tmp_path / "log"
    if source.signal == "rotor_speed":
        report = ulog_maker.message("F", b"esc_report:uint64_t timestamp;int32_t esc_rpm;")
        rows = [struct.pack("<QiQi", 0, first, 0, second) for first, second in np.eye(2, dtype=int)]
        path.write_bytes(ulog(source.message, "esc_report[2] esc", rows, report))
        check(source, path, RPM * np.eye(2))
        return
    fields, case = PX4_CASES[key(source)]
    rows = [struct.pack(f"<{len(values)}f", *values) for values in case.rows]
    path.write_bytes(ulog(source.message, fields, rows))
    check(source, path, case.expected)


GYRO_FIELDS, ACC_FIELDS = ("xgyro", "ygyro", "zgyro"), ("xacc", "yacc", "zacc")
SPEEDS = ("rollspeed", "pitchspeed", "yawspeed")
BODY_RATES = ("body_roll_rate", "body_pitch_rate", "body_yaw_rate")
SERVOS = tuple(f"servo{k}_raw" for k in range(1, 17))
MAVLINK_CASES: dict[tuple[str, str, tuple[str, ...]], Case] = {
    ("body_rate", "ATTITUDE", SPEEDS): each(I3),
    ("body_rate", "ATTITUDE_QUATERNION", SPEEDS): each(I3),
    ("body_rate", "HIGHRES_IMU", GYRO_FIELDS): each(I3),
    **{("body_rate", name, GYRO_FIELDS): each(1e-3 * I3)
       for name in ("SCALED_IMU", "RAW_IMU", "SCALED_IMU2", "SCALED_IMU3")},
    ("body_rate_setpoint", "ATTITUDE_TARGET", BODY_RATES): each(I3),
    ("attitude", "ATTITUDE", ("roll", "pitch", "yaw")): each(I3),
    ("attitude", "ATTITUDE_QUATERNION", ("q1", "q2", "q3", "q4")): Case(TURNS, 0.2 * I3),
    ("output_pwm", "SERVO_OUTPUT_RAW", SERVOS): each(np.eye(16)),
    ("throttle", "VFR_HUD", ("throttle",)): each(0.01 * I1),
    ("specific_force", "HIGHRES_IMU", ACC_FIELDS): each(I3),
    ("specific_force", "SCALED_IMU", ACC_FIELDS): each(MILLI_G * I3),
    ("specific_force", "RAW_IMU", ACC_FIELDS): each(MILLI_G * I3),
    ("battery_voltage", "SYS_STATUS", ("voltage_battery",)): each(1e-3 * I1),
    # MAV_MODE_FLAG_SAFETY_ARMED is 128.
    ("armed", "HEARTBEAT", ("base_mode",)): Case([[127.0], [128.0]], [[0.0], [1.0]]),
    # MAV_LANDED_STATE: undefined, on ground, in air.
    ("landed", "EXTENDED_SYS_STATE", ("landed_state",)): Case(STATES, [[math.nan], [1.0], [0.0]]),
}  # fmt: skip


def _fields_of(message: str, names: tuple[str, ...], values: Any) -> dict[str, object]:
    """Return the fields with values of the types that the message has."""
    kind = next(one for one in mavlink_maker.dialect.mavlink_map.values() if one.msgname == message)
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    return {
        name: float(value) if types[name] == "float" else int(value)
        for name, value in zip(names, values, strict=True)
    }


def mavlink_rows(source: Source[Any]) -> tuple[list[dict[str, object]], Any]:
    """Return the fields of each message, and what they make."""
    if source.message == "PID_TUNING":
        rows = [
            {"axis": axis, term: float(axis == turned)}
            for term in source.fields
            for turned in (1, 2, 3)
            for axis in (1, 2, 3)
        ]
        return rows, np.vstack([I3] * 4)
    if source.message == "ACTUATOR_CONTROL_TARGET":
        return [{"controls": list(values)} for values in np.eye(8)], np.eye(8, 3)
    if source.signal == "rotor_speed":
        return [{"rpm": list(values)} for values in np.eye(4, dtype=int).tolist()], RPM * np.eye(4)
    case = MAVLINK_CASES[key(source)]
    return [_fields_of(source.message, source.fields, values) for values in case.rows], case.expected


@pytest.mark.parametrize("source", MAVLINK, ids=_id)
def test_a_mavlink_field_of_one_is_one_of_its_unit(source: Source[Any], tmp_path: Path) -> None:
    """common.xml: rad/s or mrad/s, m/s^2 or mG, mV, percent, us, rpm."""
    sender = mavlink_maker.Sender()
    rows, expected = mavlink_rows(source)
    start = b"" if source.message == "HEARTBEAT" else sender.heartbeat()
    autopilot = {"autopilot": 3, "type": 2} if source.message == "HEARTBEAT" else {}
    (tmp_path / "log").write_bytes(
        start + b"".join(sender.stamped(source.message, **autopilot, **fields) for fields in rows)
    )
    check(source, tmp_path / "log", expected)


def test_further_groups_of_escs_stand_beside_the_first(tmp_path: Path) -> None:
    """ESC_TELEMETRY_5_TO_8 has the rotors 5 to 8."""
    sender = mavlink_maker.Sender()
    packets = [
        sender.stamped(
            f"ESC_TELEMETRY_{k}_TO_{k + 3}", rpm=[round(60 * value) for value in values[k - 1 : k + 3]]
        )
        for values in np.eye(8)
        for k in (1, 5)
    ]
    (tmp_path / "log").write_bytes(sender.heartbeat() + b"".join(packets))
    (speed,) = read_log(tmp_path / "log").candidates("rotor_speed")
    np.testing.assert_allclose(speed.values, 2.0 * math.pi * np.eye(8))


@pytest.mark.parametrize(
    ("unit", "count"), [("deg/s", DEGREE), ("centidegrees/s", DEGREE / 100.0), ("rad/s", 1.0)]
)
def test_the_unit_of_rate_is_told_by_the_gyro(unit: str, count: float, tmp_path: Path) -> None:
    """Where the log does not state it; by what it is called in the reason, and by its size."""
    time_s = np.linspace(0.0, 20.0, 400)
    turn = np.column_stack([np.sin(time_s), np.cos(2.0 * time_s), np.sin(3.0 * time_s)])
    rows = [(name, list(values)) for gyro in turn for name, values in (("RATE", gyro / count), ("IMU", gyro))]
    path = tmp_path / "log"
    path.write_bytes(dataflash_log({"RATE": ("R", "P", "Y"), "IMU": GYRO}, rows))
    rate = next(one for one in read_log(path).candidates("body_rate") if one.source.startswith("RATE"))
    np.testing.assert_allclose(rate.values, turn, atol=1e-5)
    assert f"logged in {unit} (compared with the gyro)" in rate.reason


def test_a_voltage_that_is_zero_at_times_is_measured(tmp_path: Path) -> None:
    """Where it always is zero, nothing measures it."""
    path = tmp_path / "log"
    for volts, n_sources in (((0.0, 12.5, 12.0), 1), ((0.0, 0.0, 0.0), 0)):
        path.write_bytes(dataflash_log({"BAT": ("Volt",)}, [("BAT", [volt]) for volt in volts]))
        found = read_log(path).candidates("battery_voltage")
        assert len(found) == n_sources
        assert all(one.values[:, 0].tolist() == list(volts) for one in found)


def test_scales_of_the_gains_are_read_by_axis(tmp_path: Path) -> None:
    """ATSC beside RATE: factors on P and D of roll, pitch and yaw."""
    labels = ("AngPScX", "AngPScY", "AngPScZ", "PDScX", "PDScY", "PDScZ")
    path = tmp_path / "scaled.bin"
    path.write_bytes(dataflash_log({"ATSC": labels}, [("ATSC", [1.5, 1.5, 1.0, 1.2, 1.3, 1.0])]))
    found = {one.axis: one.values["gain_scale"].tolist() for one in read_log(path).controller_terms}
    assert found == {axis: pytest.approx([value]) for axis, value in zip(AXES, (1.2, 1.3, 1.0), strict=True)}
