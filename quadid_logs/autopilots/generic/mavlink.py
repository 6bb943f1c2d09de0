"""MAVLink messages in canonical signals: which field, which unit, and in which order of preference.

Field meanings and units: common.xml and ardupilotmega.xml of
https://github.com/mavlink/mavlink. MAVLink uses FRD and NED like we do.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.autopilots.columns import attitude_columns, used_columns
from quadid_logs.autopilots.generic.mav_type import frame_words, vehicle_type_of
from quadid_logs.autopilots.utc import utc_offset_s
from quadid_logs.containers.mavlink_dialect import enum_names
from quadid_logs.containers.tlog import MessageRows, TlogContent
from quadid_logs.data.log import FlightLog, LogText, ModeChange, Rows, Signal

_ARDUPILOT: Final = 3
_PX4: Final = 12
_MILLI_G: Final = 9.80665e-3
_RPM: Final = 2.0 * np.pi / 60.0
_ARMED: Final = 128
_NOT_MEASURED: Final = 65_535.0
_ON_GROUND: Final = 1

Build = Callable[[AnyArray], FloatArray | None]


class _Source(NamedTuple):
    """A message that gives a signal; `build` makes the columns from its rows (None: never in use)."""

    signal: str
    message: str
    fields: str
    build: Build
    reason: str
    only_autopilot: int | None = None


def _take(*names: str, scale: float = 1.0) -> Build:
    """Return a builder that stacks fields."""

    def build(rows: AnyArray) -> FloatArray:
        return scale * np.column_stack([rows[name].astype(np.float64) for name in names])

    return build


def _sensor(*names: str, scale: float = 1.0) -> Build:
    """Return a builder that stacks fields; None where all are zero, as for a sensor that is not there."""

    def build(rows: AnyArray) -> FloatArray | None:
        values = scale * np.column_stack([rows[name].astype(np.float64) for name in names])
        return values if values.any() else None

    return build


def _attitude(rows: AnyArray) -> FloatArray:
    """Euler 3-2-1 angles of the quaternion w, x, y, z; NaN where it is zero."""
    quaternion = np.column_stack([rows[name].astype(np.float64) for name in ("q1", "q2", "q3", "q4")])
    return attitude_columns(quaternion)


def _outputs(rows: AnyArray) -> FloatArray | None:
    """Pulse widths of the main port, up to the last channel in use."""
    names = [f"servo{k}_raw" for k in range(1, 17)]
    output = np.column_stack([rows[name].astype(np.float64) for name in names])
    output[rows["port"] != 0] = np.nan
    used = used_columns(output, output > 0.0)
    return used if used.size else None


def _armed(rows: AnyArray) -> FloatArray:
    """MAV_MODE_FLAG_SAFETY_ARMED of base_mode."""
    return (rows["base_mode"] & _ARMED > 0).astype(np.float64)[:, np.newaxis]


def _landed(rows: AnyArray) -> FloatArray:
    """MAV_LANDED_STATE: 0 undefined, 1 on ground, 2 in air, 3 taking off, 4 landing."""
    state = rows["landed_state"]
    return np.where(state > 0, (state == _ON_GROUND).astype(np.float64), np.nan)[:, np.newaxis]


def _battery(rows: AnyArray) -> FloatArray | None:
    """Millivolt to volt; None where it is never measured."""
    millivolt = rows["voltage_battery"].astype(np.float64)
    measured = (millivolt > 0.0) & (millivolt < _NOT_MEASURED)
    return np.where(measured, millivolt * 1e-3, np.nan)[:, np.newaxis] if measured.any() else None


def _controls(rows: AnyArray) -> FloatArray | None:
    """Roll, pitch, yaw of the flight controls, group 0."""
    own = rows["group_mlx"] == 0
    values = np.where(own[:, np.newaxis], rows["controls"][:, :3].astype(np.float64), np.nan)
    return values if own.any() else None


_GYRO: Final = ("xgyro", "ygyro", "zgyro")
_ACCELERATION: Final = ("xacc", "yacc", "zacc")
_RATES: Final = ("rollspeed", "pitchspeed", "yawspeed")

_SOURCES: Final = (
    _Source("body_rate", "ATTITUDE", "rollspeed, pitchspeed, yawspeed", _take(*_RATES),
            "the autopilot's filtered body rates, in step with its attitude"),
    _Source("body_rate", "ATTITUDE_QUATERNION", "rollspeed, pitchspeed, yawspeed", _take(*_RATES),
            "the autopilot's filtered body rates"),
    _Source("body_rate", "HIGHRES_IMU", "xgyro, ygyro, zgyro", _sensor(*_GYRO), "gyro"),
    _Source("body_rate", "SCALED_IMU", "xgyro, ygyro, zgyro", _sensor(*_GYRO, scale=1e-3), "gyro in mrad/s"),
    _Source("body_rate", "RAW_IMU", "xgyro, ygyro, zgyro", _sensor(*_GYRO, scale=1e-3),
            "first gyro; ArduPilot sends mrad/s here", _ARDUPILOT),
    _Source("body_rate", "SCALED_IMU2", "xgyro, ygyro, zgyro", _sensor(*_GYRO, scale=1e-3), "second gyro"),
    _Source("body_rate", "SCALED_IMU3", "xgyro, ygyro, zgyro", _sensor(*_GYRO, scale=1e-3), "third gyro"),
    _Source("body_rate_setpoint", "ATTITUDE_TARGET", "body_roll_rate, body_pitch_rate, body_yaw_rate",
            _take("body_roll_rate", "body_pitch_rate", "body_yaw_rate"),
            "what the rate controller was asked for"),
    _Source("attitude", "ATTITUDE", "roll, pitch, yaw", _take("roll", "pitch", "yaw"),
            "the autopilot's attitude"),
    _Source("attitude", "ATTITUDE_QUATERNION", "q1..q4", _attitude, "the autopilot's attitude"),
    _Source("torque_command", "ACTUATOR_CONTROL_TARGET", "controls[0..2]", _controls,
            "the rate controller's output before the mixer"),
    _Source("output_pwm", "SERVO_OUTPUT_RAW", "servoN_raw", _outputs, "what the output driver sent"),
    _Source("throttle", "VFR_HUD", "throttle", _take("throttle", scale=0.01), "in percent, for display"),
    _Source("specific_force", "HIGHRES_IMU", "xacc, yacc, zacc", _sensor(*_ACCELERATION), "accelerometer"),
    _Source("specific_force", "SCALED_IMU", "xacc, yacc, zacc", _sensor(*_ACCELERATION, scale=_MILLI_G),
            "accelerometer in mG"),
    _Source("specific_force", "RAW_IMU", "xacc, yacc, zacc", _sensor(*_ACCELERATION, scale=_MILLI_G),
            "first accelerometer; ArduPilot sends mG here", _ARDUPILOT),
    _Source("battery_voltage", "SYS_STATUS", "voltage_battery", _battery, "measured"),
    _Source("armed", "HEARTBEAT", "base_mode & 128", _armed, "once a second"),
    _Source("landed", "EXTENDED_SYS_STATE", "landed_state == 1", _landed, "the land detector"),
)  # fmt: skip

_ESC_GROUPS: Final = (
    "ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "ESC_TELEMETRY_9_TO_12", "ESC_TELEMETRY_13_TO_16",
)  # fmt: skip
MESSAGES: Final = frozenset(
    {source.message for source in _SOURCES}
    | {*_ESC_GROUPS, "PID_TUNING", "PARAM_VALUE", "STATUSTEXT", "AUTOPILOT_VERSION", "SYSTEM_TIME"}
)

#: ArduPilot's mode enumeration by vehicle; `vehicle_type_of` knows no others that fly it.
_MODE_ENUMS: Final = {
    "multirotor": "COPTER_MODE", "helicopter": "COPTER_MODE", "fixed-wing": "PLANE_MODE",
    "vtol": "PLANE_MODE", "rover": "ROVER_MODE", "boat": "ROVER_MODE",
    "submarine": "SUB_MODE", "tracker": "TRACKER_MODE",
}  # fmt: skip
#: PX4's src/modules/commander/px4_custom_mode.h.
_PX4_MAIN: Final = {
    1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED",
    8: "RATTITUDE", 10: "TERMINATION", 11: "ALTITUDE_CRUISE",
}  # fmt: skip
_PX4_AUTO: Final = {
    1: "AUTO_READY", 2: "AUTO_TAKEOFF", 3: "AUTO_LOITER", 4: "AUTO_MISSION", 5: "AUTO_RTL", 6: "AUTO_LAND",
    8: "AUTO_FOLLOW_TARGET", 9: "AUTO_PRECLAND", 10: "AUTO_VTOL_TAKEOFF",
}  # fmt: skip
_FIRMWARE: Final = re.compile(r"^(?:Ardu|APM:|Rover |Blimp |AntennaTracker|PX4 )\S*.*\d")
_FRAME: Final = re.compile(r"^Frame: (.+)$")
#: MAV_PARAM_TYPE of integers up to 32 bits; PX4 sends their bytes, ArduPilot their value.
_INTEGER_TYPES: Final = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}


def flight_log(path: str, content: TlogContent) -> FlightLog:
    """Turn the messages of one system into canonical signals.

    Parameters
    ----------
    path : str
        As the user gave it.
    content : TlogContent
        With the messages of `MESSAGES`.

    Returns
    -------
    FlightLog
    """
    with np.errstate(invalid="ignore"):  # any four bytes can be a signalling NaN
        signals, parameters = _signals(content), _parameters(content)
    texts = _texts(content)
    chosen = next(one for one in content.systems if one.chosen)
    autopilot = {_ARDUPILOT: "ardupilot", _PX4: "px4"}.get(content.autopilot_id, "other")
    return FlightLog(
        path=path,
        format="tlog",
        autopilot=autopilot,
        n_bytes=content.n_bytes,
        signals=signals,
        firmware=_firmware(content, texts),
        vehicle_type=vehicle_type_of(content.mav_type),
        vehicle_name=f"system {chosen.system_id}",
        frame=_frame(content, texts),
        parameters=parameters,
        modes=_modes(content),
        texts=texts,
        lost=content.lost,
        systems=content.systems,
        counts=content.counts,
        utc_offset_s=_utc_offset_s(content),
        remarks=_remarks(content),
    )


def _signals(content: TlogContent) -> dict[str, tuple[Signal, ...]]:
    """Build every source of every canonical signal, in order of preference."""
    found: dict[str, list[Signal]] = {}
    for source in _SOURCES:
        message = content.messages.get(source.message)
        if message is None or source.only_autopilot not in (None, content.autopilot_id):
            continue
        values = source.build(message.rows)
        if values is not None:
            found.setdefault(source.signal, []).append(
                Signal(
                    name=source.signal,
                    rows=Rows(content.time_s(message), message.position),
                    values=values,
                    source=f"{source.message}.{source.fields}",
                    reason=source.reason,
                )
            )
    for signal in (_pid_torque(content), _rotor_speed(content)):
        if signal is not None:
            found.setdefault(signal.name, []).append(signal)
    return {name: tuple(signals) for name, signals in found.items()}


def _pid_torque(content: TlogContent) -> Signal | None:
    """Sum the rate controllers' parts per axis: ArduPilot's RATE.ROut is FF + P + I + D.

    One message an axis (1 roll, 2 pitch, 3 yaw); a row is complete with the
    last pitch and yaw before the next roll.
    """
    message = content.messages.get("PID_TUNING")
    if message is None:
        return None
    rows, position = message.rows, message.position
    total = np.sum([rows[part].astype(np.float64) for part in ("FF", "P", "I", "D")], axis=0)
    axes = [np.flatnonzero(rows["axis"] == axis) for axis in (1, 2, 3)]
    if not all(len(axis) for axis in axes):
        return None
    roll = axes[0]
    columns = [_following(total[axis], position[axis], position[roll]) for axis in axes]
    return Signal(
        name="torque_command",
        rows=Rows(content.clock.at(position[roll]), position[roll]),
        values=np.column_stack(columns),
        source="PID_TUNING.FF + P + I + D",
        reason="sum of the rate controllers' parts (GCS_PID_MASK 7)",
    )


def _following(values: FloatArray, position: IntArray, wanted: IntArray) -> FloatArray:
    """Return the first value at or behind each wanted place in the file, NaN behind the last one."""
    found = np.searchsorted(position, wanted)
    return np.where(found < len(values), values[np.minimum(found, len(values) - 1)], np.nan)


def _rotor_speed(content: TlogContent) -> Signal | None:
    """Put the groups of four ESCs side by side; None where no speed ever moves."""
    groups = [content.messages[name] for name in _ESC_GROUPS if name in content.messages]
    if not groups or _ESC_GROUPS[0] not in content.messages:
        return None
    first = groups[0]
    columns = []
    for group in groups:
        speed = group.rows["rpm"].astype(np.float64) * _RPM
        columns += [_following(speed[:, k], group.position, first.position) for k in range(speed.shape[1])]
    speeds = np.column_stack(columns)
    used = used_columns(speeds, speeds > 0.0)
    if not used.size or not (np.nanmax(used, axis=0) > np.nanmin(used, axis=0)).any():
        return None
    return Signal(
        name="rotor_speed",
        rows=Rows(content.time_s(first), first.position),
        values=used,
        source="ESC_TELEMETRY_1_TO_4.rpm" + (" ..." if len(groups) > 1 else ""),
        reason="reported by the ESCs",
    )


def _utc_offset_s(content: TlogContent) -> float:
    """Return UTC minus the boot clock [s] as the autopilot tells it."""
    message = content.messages.get("SYSTEM_TIME")
    if message is None:
        return float("nan")
    return utc_offset_s(message.rows["time_unix_usec"].astype(np.float64) / 1e6, content.time_s(message))


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
        if content.autopilot_id == _PX4 and kind in _INTEGER_TYPES:
            parameters[_text(name)] = float(np.frombuffer(value.tobytes(), _INTEGER_TYPES[kind])[0])
        else:
            parameters[_text(name)] = float(value)
    return parameters


def _modes(content: TlogContent) -> tuple[ModeChange, ...]:
    """Return where the heartbeat's mode changes."""
    message: MessageRows | None = content.messages.get("HEARTBEAT")
    if message is None:
        return ()
    mode, time_s = message.rows["custom_mode"], content.time_s(message)
    enum = _MODE_ENUMS.get(vehicle_type_of(content.mav_type), "")
    names = enum_names(enum, f"{enum}_") if content.autopilot_id == _ARDUPILOT else {}
    changes = np.flatnonzero(np.append(True, mode[1:] != mode[:-1]))
    return tuple(
        ModeChange(
            time_s=float(time_s[k]),
            position=int(message.position[k]),
            name=_px4_mode(int(mode[k]))
            if content.autopilot_id == _PX4
            else names.get(int(mode[k]), f"mode {int(mode[k])}"),
        )
        for k in changes.tolist()
    )


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


def _frame(content: TlogContent, texts: tuple[LogText, ...]) -> str:
    """Return the frame as the firmware states it in a text, else the words of the MAV_TYPE."""
    stated = [match[1] for text in texts if (match := _FRAME.match(text.text))]
    return stated[-1] if stated else frame_words(content.mav_type)


def _remarks(content: TlogContent) -> tuple[str, ...]:
    """Say what was decided or assumed."""
    remarks = []
    chosen = next(one for one in content.systems if one.chosen)
    others = [f"{one.system_id}/{one.component_id}" for one in content.systems if not one.chosen]
    if others:
        remarks.append(
            f"System {chosen.system_id}, component {chosen.component_id} was read; "
            f"{', '.join(others)} also speak in the file (--system chooses)."
        )
    if content.on_host_clock:
        remarks.append(
            "No message carries the autopilot's time: the host's stamps are used, which can be wrong."
        )
    if content.n_unknown:
        remarks.append(f"{content.n_unknown} packets are of a type that no known dialect has.")
    return tuple(remarks)
