"""MAVLink messages in canonical signals: which field, which unit, and in which order of preference.

Field meanings and units: common.xml and ardupilotmega.xml of
https://github.com/mavlink/mavlink. MAVLink uses FRD and NED like we do.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.autopilots.generic.mav_type import frame_words, vehicle_type_of
from quadid_logs.autopilots.modes import ardupilot_modes, mode_changes
from quadid_logs.autopilots.sources import (
    RPM,
    Built,
    Part,
    Source,
    attitude,
    build_signals,
    messages_of,
    plain,
    used_columns,
)
from quadid_logs.autopilots.utc import utc_offset_s
from quadid_logs.containers.mavlink_dialect import enum_names
from quadid_logs.containers.tlog import MessageRows, TlogContent, read_content
from quadid_logs.data.log import FlightLog, LoggedSystem, LogText, ModeChange, Rows, Signal
from quadid_logs.sentences import some
from quadid_logs.vocabulary import GRAVITY_M_S2

#: MAV_AUTOPILOT.
_ARDUPILOT: Final = 3
_PX4: Final = 12
_NAMES: Final = {_ARDUPILOT: "ardupilot", _PX4: "px4"}
_MILLI_G: Final = GRAVITY_M_S2 / 1000.0
_ARMED: Final = 128
_NOT_MEASURED: Final = 65_535.0
_ON_GROUND: Final = 1


@dataclass(frozen=True, slots=True)
class MavlinkSource(Source["MessagePart"]):
    """A row of the table; ``sent_by`` is the MAV_AUTOPILOT that alone means it so, 0 for all."""

    sent_by: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessagePart(Part[MessageRows]):
    """The rows of a message, and the other messages."""

    log: TlogContent


_Row: TypeAlias = Source[MessagePart]


def _sensor(part: MessagePart, source: _Row) -> FloatArray | None:
    """Stack fields; None where all are zero, as for a sensor that is not there."""
    values = plain(part, source)
    return values if values is not None and values.any() else None


def _outputs(part: MessagePart, source: _Row) -> FloatArray | None:
    """Pulse widths of the main port, up to the last channel in use."""
    output = plain(part, source)
    if output is None:
        return None
    output[part.table.rows["port"] != 0] = np.nan
    return used_columns(output, output > 0.0)


def _armed(part: MessagePart, source: _Row) -> FloatArray:
    """MAV_MODE_FLAG_SAFETY_ARMED of base_mode."""
    return (part.table.rows["base_mode"] & _ARMED > 0).astype(np.float64)[:, np.newaxis]


def _landed(part: MessagePart, source: _Row) -> FloatArray:
    """MAV_LANDED_STATE: 0 undefined, 1 on ground, 2 in air, 3 taking off, 4 landing."""
    state = part.table.rows["landed_state"]
    return np.where(state > 0, (state == _ON_GROUND).astype(np.float64), np.nan)[:, np.newaxis]


def _battery(part: MessagePart, source: _Row) -> FloatArray | None:
    """Millivolt to volt; None where it is never measured."""
    millivolt = part.table.rows["voltage_battery"].astype(np.float64)
    measured = (millivolt > 0.0) & (millivolt < _NOT_MEASURED)
    return np.where(measured, millivolt * source.scale, np.nan)[:, np.newaxis] if measured.any() else None


def _controls(part: MessagePart, source: _Row) -> FloatArray | None:
    """Roll, pitch, yaw of the flight controls, group 0."""
    rows = part.table.rows
    own = rows["group_mlx"] == 0
    values = np.where(own[:, np.newaxis], rows["controls"][:, :3].astype(np.float64), np.nan)
    return values if own.any() else None


def _pid_torque(part: MessagePart, source: _Row) -> Built | None:
    """Sum the rate controllers' parts per axis: ArduPilot's RATE.ROut is FF + P + I + D.

    One message an axis (1 roll, 2 pitch, 3 yaw); a row is complete with the
    last pitch and yaw before the next roll.
    """
    rows, position = part.table.rows, part.table.position
    total = np.sum([rows[term].astype(np.float64) for term in source.fields], axis=0)
    axes = [np.flatnonzero(rows["axis"] == axis) for axis in (1, 2, 3)]
    if not all(len(axis) for axis in axes):
        return None
    roll = position[axes[0]]
    columns = [_following(total[axis], position[axis], roll) for axis in axes]
    return Built(np.column_stack(columns), rows=Rows(part.log.clock.at(roll), roll))


def _following(values: FloatArray, position: IntArray, wanted: IntArray) -> FloatArray:
    """Return the first value at or behind each wanted place in the file, NaN behind the last one."""
    found = np.searchsorted(position, wanted)
    return np.where(found < len(values), values[np.minimum(found, len(values) - 1)], np.nan)


def _rotor_speed(part: MessagePart, source: _Row) -> Built | None:
    """Put the groups of four ESCs side by side; None where no speed ever moves."""
    groups = [
        part.log.messages[name] for name in (source.message, *source.beside) if name in part.log.messages
    ]
    columns = []
    for group in groups:
        speed = group.rows["rpm"].astype(np.float64) * source.scale
        columns += [_following(one, group.position, part.rows.position) for one in speed.T]
    speeds = np.column_stack(columns)
    used = used_columns(speeds, speeds > 0.0)
    if used is None or not (np.nanmax(used, axis=0) > np.nanmin(used, axis=0)).any():
        return None
    return Built(used, source=f"{source.message}.rpm" + (" ..." if len(groups) > 1 else ""))


_GYRO: Final = ("xgyro", "ygyro", "zgyro")
_ACCELERATION: Final = ("xacc", "yacc", "zacc")
_RATES: Final = ("rollspeed", "pitchspeed", "yawspeed")
_ANGLES: Final = ("roll", "pitch", "yaw")
_QUATERNION: Final = ("q1", "q2", "q3", "q4")
_SERVOS: Final = tuple(f"servo{k}_raw" for k in range(1, 17))
_ESCS: Final = tuple(f"ESC_TELEMETRY_{k}_TO_{k + 3}" for k in (1, 5, 9, 13))
_S: Final = MavlinkSource

SOURCES: Final = (
    _S("body_rate", "ATTITUDE", _RATES,
           "the autopilot's filtered body rates, logged together with its attitude"),
    _S("body_rate", "ATTITUDE_QUATERNION", _RATES, "the autopilot's filtered body rates"),
    _S("body_rate", "HIGHRES_IMU", _GYRO, "gyro", _sensor),
    _S("body_rate", "SCALED_IMU", _GYRO, "gyro in mrad/s", _sensor, 1e-3),
    _S("body_rate", "RAW_IMU", _GYRO, "first gyro; ArduPilot sends mrad/s here", _sensor, 1e-3,
       sent_by=_ARDUPILOT),
    _S("body_rate", "SCALED_IMU2", _GYRO, "second gyro", _sensor, 1e-3),
    _S("body_rate", "SCALED_IMU3", _GYRO, "third gyro", _sensor, 1e-3),
    _S("body_rate_setpoint", "ATTITUDE_TARGET", ("body_roll_rate", "body_pitch_rate", "body_yaw_rate"),
       "the rate controller's set-point"),
    _S("attitude", "ATTITUDE", _ANGLES, "the autopilot's attitude"),
    _S("attitude", "ATTITUDE_QUATERNION", _QUATERNION, "the autopilot's attitude", attitude, label="q1..q4"),
    _S("torque_command", "ACTUATOR_CONTROL_TARGET", ("controls", "group_mlx"),
       "the rate controller's output before the mixer", _controls, label="controls[0..2]"),
    _S("output_pwm", "SERVO_OUTPUT_RAW", _SERVOS, "the outputs that the driver sent", _outputs,
       label="servoN_raw"),
    _S("throttle", "VFR_HUD", ("throttle",), "in percent, for display", scale=0.01),
    _S("specific_force", "HIGHRES_IMU", _ACCELERATION, "accelerometer", _sensor),
    _S("specific_force", "SCALED_IMU", _ACCELERATION, "accelerometer in mG", _sensor, _MILLI_G),
    _S("specific_force", "RAW_IMU", _ACCELERATION, "first accelerometer; ArduPilot sends mG here", _sensor,
       _MILLI_G, sent_by=_ARDUPILOT),
    _S("battery_voltage", "SYS_STATUS", ("voltage_battery",), "measured", _battery, 1e-3),
    _S("armed", "HEARTBEAT", ("base_mode",), "once a second", _armed, label="base_mode & 128"),
    _S("landed", "EXTENDED_SYS_STATE", ("landed_state",), "the land detector", _landed,
       label="landed_state == 1"),
    # Behind the others: a sum, and not of all messages.
    _S("torque_command", "PID_TUNING", ("FF", "P", "I", "D"),
       "sum of the rate controller's terms (GCS_PID_MASK 7)", _pid_torque, label="FF + P + I + D"),
    _S("rotor_speed", _ESCS[0], ("rpm",), "reported by the ESCs", _rotor_speed, RPM, beside=_ESCS[1:]),
)  # fmt: skip
MESSAGES: Final = messages_of(SOURCES) | {"PARAM_VALUE", "STATUSTEXT", "AUTOPILOT_VERSION", "SYSTEM_TIME"}

#: PX4's src/modules/commander/px4_custom_mode.h.
_PX4_MAIN: Final = {
    1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED",
    8: "RATTITUDE", 10: "TERMINATION", 11: "ALTITUDE_CRUISE",
}  # fmt: skip
_PX4_AUTO: Final = {
    1: "AUTO_READY", 2: "AUTO_TAKEOFF", 3: "AUTO_LOITER", 4: "AUTO_MISSION", 5: "AUTO_RTL", 6: "AUTO_LAND",
    8: "AUTO_FOLLOW_TARGET", 9: "AUTO_PRECLAND", 10: "AUTO_VTOL_TAKEOFF",
}  # fmt: skip
#: MAV_TYPE_FIXED_WING, and one of those that hover, too.
_FIXED_WING: Final = 1
_VTOL: Final = 22
_FIRMWARE: Final = re.compile(r"^(?:Ardu|APM:|Rover |Blimp |AntennaTracker|PX4 )\S*.*\d")
_FRAME: Final = re.compile(r"^Frame: (.+)$")
#: MAV_PARAM_TYPE of integers up to 32 bits; PX4 sends their bytes, ArduPilot their value.
_INTEGER_TYPES: Final = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}


def read(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a telemetry log into canonical signals.

    Parameters
    ----------
    system : int
        System id; 0 chooses the autopilot with most messages.

    Raises
    ------
    EmptyLogError
        If there is no packet with a right checksum.
    SettingsError
        If the file holds no system of that id.
    """
    content = read_content(path, MESSAGES, system=system)
    chosen, texts, parameters = content.chosen, _texts(content), _parameters(content)
    stated = [match[1] for text in texts if (match := _FRAME.match(text.text))]
    message = content.messages.get("SYSTEM_TIME")
    # ArduPlane may call a plane that hovers fixed-wing, too.
    hovers = parameters.get("Q_ENABLE", 0.0) > 0.0
    # Name who speaks in the file.
    autopilots, types = enum_names("MAV_AUTOPILOT", "MAV_AUTOPILOT_"), enum_names("MAV_TYPE", "MAV_TYPE_")

    def vehicle(mav_type: int) -> str:
        known = vehicle_type_of(mav_type)
        return types.get(mav_type, known).lower() if known == "unknown" else known

    # Say what was decided or assumed.
    remarks = []
    chosen = content.chosen
    others = [f"{one.system_id}/{one.component_id}" for one in content.senders if one is not chosen]
    if others:
        remarks.append(
            f"System {chosen.system_id}, component {chosen.component_id} was read. The file also holds "
            f"messages of {some(others, content.n_senders - 1)}. --system chooses another one."
        )
    if content.on_host_clock:
        remarks.append(
            "No message carries the autopilot's time. The recording computer's time stamps are used, which "
            "can be wrong."
        )
    if content.n_unknown:
        remarks.append(f"{content.n_unknown} packets are of a type that no known dialect defines.")
    return FlightLog(
        path=str(path),
        format="tlog",
        autopilot=_NAMES.get(chosen.autopilot, "other"),
        n_bytes=content.n_bytes,
        signals=_signals(content),
        firmware=_firmware(content, texts),
        vehicle_type=vehicle_type_of(_VTOL if hovers and chosen.mav_type == _FIXED_WING else chosen.mav_type),
        vehicle_name=f"system {chosen.system_id}",
        frame=stated[-1] if stated else frame_words(content.chosen.mav_type),
        parameters=parameters,
        modes=_modes(content),
        texts=texts,
        lost=content.lost,
        systems=tuple(
            LoggedSystem(
                system_id=one.system_id,
                component_id=one.component_id,
                autopilot=autopilots.get(one.autopilot, "unknown").lower(),
                vehicle_type=vehicle(one.mav_type),
                n_messages=one.n_messages,
                chosen=one is content.chosen,
            )
            for one in content.senders
        ),
        n_systems=content.n_senders,
        counts=content.counts,
        utc_offset_s=math.nan
        if message is None
        else utc_offset_s(message.rows["time_unix_usec"].astype(np.float64) / 1e6, content.time_s(message)),
        remarks=tuple(remarks),
    )


def _signals(content: TlogContent) -> dict[str, tuple[Signal, ...]]:
    """Build every source of every canonical signal, in order of preference."""
    parts = {
        name: MessagePart(
            name=name, table=message, rows=Rows(content.time_s(message), message.position), log=content
        )
        for name, message in content.messages.items()
    }

    def parts_of(source: _Row) -> Iterable[MessagePart]:
        sent_by = source.sent_by if isinstance(source, MavlinkSource) else 0
        is_meant = sent_by in (0, content.chosen.autopilot)
        return [parts[source.message]] if is_meant and source.message in parts else []

    with np.errstate(invalid="ignore"):  # any four bytes can be a signalling NaN
        return build_signals(SOURCES, parts_of, separator=", ")


def _text(raw: bytes) -> str:
    """Decode a text field, which ends at the first zero byte if it has one."""
    return raw.split(b"\0", 1)[0].decode("utf-8", errors="replace")


def _texts(content: TlogContent) -> tuple[LogText, ...]:
    """Return the status texts; long ones come in chunks and are put together."""
    message = content.messages.get("STATUSTEXT")
    if message is None:
        return ()
    texts: list[LogText] = []
    last_id = 0
    parts = zip(
        content.time_s(message).tolist(),
        message.position.tolist(),
        message.rows["text"].tolist(),
        message.rows["id"].tolist(),
        message.rows["chunk_seq"].tolist(),
        strict=True,
    )
    for time_s, position, raw, text_id, chunk in parts:
        if text_id and chunk and text_id == last_id and texts:
            before = texts.pop()
            texts.append(
                LogText(time_s=before.time_s, position=before.position, text=before.text + _text(raw))
            )
        else:
            texts.append(LogText(time_s=time_s, position=position, text=_text(raw)))
        last_id = text_id
    return tuple(texts)


def _parameters(content: TlogContent) -> dict[str, float]:
    """Return the last value of each parameter."""
    message = content.messages.get("PARAM_VALUE")
    if message is None:
        return {}
    rows = message.rows
    parameters = {}
    for name, value, kind in zip(
        rows["param_id"].tolist(), rows["param_value"], rows["param_type"].tolist(), strict=True
    ):
        if content.chosen.autopilot == _PX4 and kind in _INTEGER_TYPES:
            parameters[_text(name)] = float(np.frombuffer(value.tobytes(), _INTEGER_TYPES[kind])[0])
        else:
            parameters[_text(name)] = float(value)
    return parameters


def _modes(content: TlogContent) -> tuple[ModeChange, ...]:
    """Return where the heartbeat's mode changes."""
    message: MessageRows | None = content.messages.get("HEARTBEAT")
    if message is None:
        return ()
    kind = vehicle_type_of(content.chosen.mav_type)
    names = ardupilot_modes(kind) if content.chosen.autopilot == _ARDUPILOT else {}
    name_of = _px4_mode if content.chosen.autopilot == _PX4 else names.get
    return mode_changes(message.rows["custom_mode"], content.time_s(message), message.position, name_of)


def _px4_mode(custom_mode: int) -> str:
    """Return the name of PX4's main mode (third byte), in automatic mode of its sub-mode (fourth byte)."""
    main = custom_mode >> 16 & 0xFF
    name = _PX4_MAIN.get(main, f"mode {main}")
    return _PX4_AUTO.get(custom_mode >> 24 & 0xFF, name) if name == "AUTO" else name


def _firmware(content: TlogContent, texts: tuple[LogText, ...]) -> str:
    """Return what the firmware calls itself in a text, else the numbers of AUTOPILOT_VERSION."""
    named = [text.text for text in texts if _FIRMWARE.match(text.text)]
    if named:
        return named[-1]
    message = content.messages.get("AUTOPILOT_VERSION")
    version = int(message.rows["flight_sw_version"][-1]) if message is not None else 0
    return f"v{version >> 24 & 0xFF}.{version >> 16 & 0xFF}.{version >> 8 & 0xFF}" if version else ""
