"""PX4's topics in canonical signals: which field, which unit, which sign, and in which order of preference.

Field meanings: PX4-Autopilot/msg/*.msg of the versions 1.6 to 1.17. PX4 works in
FRD and NED like we do; only thrust points the other way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.columns import attitude_columns, used_columns
from quadid_logs.autopilots.generic.mav_type import airframe_words, frame_words, vehicle_type_of
from quadid_logs.autopilots.gyro_filter import px4_gyro_filter, with_gyro_filter
from quadid_logs.autopilots.utc import utc_offset_s
from quadid_logs.containers.ulog import TopicTable, UlogContent
from quadid_logs.data.log import FlightLog, LogText, ModeChange, Rows, Signal, whole_number

_MAX_SAMPLE_AGE_US: Final = 100_000
"""A sample is published within milliseconds: a `timestamp_sample` further off is not filled in."""
_RPM: Final = 2.0 * np.pi / 60.0

Build = Callable[[TopicTable], FloatArray | None]


class _Source(NamedTuple):
    """A topic that gives a signal: `fields` for the reader, `build` makes the columns (None: has none)."""

    signal: str
    topic: str
    fields: str
    build: Build
    reason: str


def _columns(table: TopicTable, *names: str) -> FloatArray | None:
    """Stack the named columns, as ``q[1]``, ``roll`` or a whole array ``xyz``; None if one is missing."""
    found = []
    for name in names:
        field, _, index = name.partition("[")
        if field not in table.fields:
            return None
        values = table.rows[field]
        if index:
            k = int(index.rstrip("]"))
            if values.ndim != 2 or k >= values.shape[1]:
                return None
            values = values[:, k]
        if values.dtype.names is not None:
            return None
        found.append(values.reshape(len(values), -1))
    with np.errstate(invalid="ignore"):  # damaged bytes can be signalling NaN
        return np.concatenate(found, axis=1, dtype=np.float64)


def _take(*names: str, scale: float = 1.0) -> Build:
    """Return a builder that stacks fields."""

    def build(table: TopicTable) -> FloatArray | None:
        values = _columns(table, *names)
        return None if values is None else values * scale if scale != 1.0 else values

    return build


def _attitude(table: TopicTable) -> FloatArray | None:
    """Euler 3-2-1 angles of the quaternion w, x, y, z (body FRD to Earth NED); NaN where it is zero."""
    quaternion = _columns(table, "q[0]", "q[1]", "q[2]", "q[3]")
    return None if quaternion is None else attitude_columns(quaternion)


def _motors(table: TopicTable) -> FloatArray | None:
    """Thrust per motor up to the last motor in use; NaN means stopped and stays NaN."""
    control = _columns(table, "control")
    return None if control is None else used_columns(control, np.isfinite(control))


def _outputs(table: TopicTable) -> FloatArray | None:
    """Pulse widths up to the last channel in use; None where the outputs are no pulse widths."""
    output = _columns(table, "output")
    if output is None:
        return None
    used = used_columns(output, output > 0.0)
    pulse = (used >= 800.0) & (used <= 2200.0)
    # CAN escs and simulators use 0..8191 or -1..1 in the same field.
    return used if used.size and pulse.any() and not (used > 2200.0).any() else None


def _rotor_speed(table: TopicTable) -> FloatArray | None:
    """Speed per ESC; None where it never moves, as with ESCs that do not measure it."""
    if "esc" not in table.fields or "esc_rpm" not in (table.rows["esc"].dtype.names or ()):
        return None
    rpm = np.abs(table.rows["esc"]["esc_rpm"].astype(np.float64)).reshape(len(table.rows), -1)
    used = used_columns(rpm, rpm > 0.0)
    return used * _RPM if used.size and np.ptp(used, axis=0).any() else None


def _armed(table: TopicTable) -> FloatArray | None:
    """ARMING_STATE_ARMED is 2 in every version."""
    state = _columns(table, "arming_state")
    return None if state is None else (state == 2.0).astype(np.float64)


def _injected_rate(table: TopicTable) -> FloatArray | None:
    """Sum the axes: the autotune moves one at a time."""
    rates = _columns(table, "rate_sp")
    return None if rates is None else np.nan_to_num(rates).sum(axis=1, keepdims=True)


_SOURCES: Final = (
    _Source("body_rate", "vehicle_angular_velocity", "xyz", _take("xyz"),
            "the rate controller's own input: calibrated, bias removed, filtered (IMU_GYRO_CUTOFF)"),
    _Source("body_rate", "vehicle_attitude", "rollspeed, pitchspeed, yawspeed",
            _take("rollspeed", "pitchspeed", "yawspeed"),
            "the estimator's bias-corrected rates (PX4 up to 1.9)"),
    _Source("body_rate", "sensor_combined", "gyro_rad", _take("gyro_rad"),
            "the gyro's mean over its integration time, bias not removed"),
    _Source("body_rate_setpoint", "vehicle_rates_setpoint", "roll, pitch, yaw", _take("roll", "pitch", "yaw"),
            "what the rate controller was asked for"),
    _Source("sysid_chirp", "autotune_attitude_control_status", "rate_sp", _injected_rate,
            "rate that the autotune adds to the set-point of one axis after the other"),
    _Source("attitude", "vehicle_attitude", "q", _attitude, "the estimator's attitude"),
    _Source("torque_command", "vehicle_torque_setpoint", "xyz", _take("xyz"),
            "the rate controller's output before allocation"),
    _Source("torque_command", "actuator_controls_0", "control[0..2]",
            _take("control[0]", "control[1]", "control[2]"),
            "the rate controller's output before the mixer (PX4 up to 1.13)"),
    _Source("throttle", "vehicle_thrust_setpoint", "-xyz[2]", _take("xyz[2]", scale=-1.0),
            "collective thrust setpoint before allocation"),
    _Source("throttle", "actuator_controls_0", "control[3]", _take("control[3]"),
            "collective thrust before the mixer (PX4 up to 1.13)"),
    _Source("throttle", "vehicle_rates_setpoint", "-thrust_body[2]", _take("thrust_body[2]", scale=-1.0),
            "thrust asked of the rate controller"),
    _Source("motor_thrust", "actuator_motors", "control", _motors,
            "allocated thrust per motor, before THR_MDL_FAC; contains saturation"),
    _Source("output_pwm", "actuator_outputs", "output", _outputs, "what the output driver sent"),
    _Source("rotor_speed", "esc_status", "esc[].esc_rpm", _rotor_speed, "reported by the ESCs"),
    _Source("unallocated_torque", "control_allocator_status", "unallocated_torque",
            _take("unallocated_torque"), "torque that the control allocation could not realise"),
    _Source("specific_force", "sensor_combined", "accelerometer_m_s2", _take("accelerometer_m_s2"),
            "the accelerometer's mean over its integration time"),
    _Source("specific_force", "vehicle_acceleration", "xyz", _take("xyz"), "bias removed, filtered"),
    _Source("battery_voltage", "battery_status", "voltage_v", _take("voltage_v"), "measured"),
    _Source("armed", "vehicle_status", "arming_state == 2", _armed, "the commander's arming state"),
    _Source("armed", "actuator_armed", "armed", _take("armed"), "what the output drivers obey"),
    _Source("landed", "vehicle_land_detected", "landed", _take("landed"), "the land detector"),
)  # fmt: skip

#: Receivers, with the time of day; the second since 1.14.
_RECEIVERS: Final = ("vehicle_gps_position", "sensor_gps")
TOPICS: Final = frozenset(source.topic for source in _SOURCES) | {*_RECEIVERS}

_NAV_STATES: Final = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL",
    6: "POSITION_SLOW", 8: "ALTITUDE_CRUISE", 10: "ACRO", 12: "DESCEND", 13: "TERMINATION", 14: "OFFBOARD",
    15: "STABILIZED", 17: "AUTO_TAKEOFF", 18: "AUTO_LAND", 19: "AUTO_FOLLOW_TARGET", 20: "AUTO_PRECLAND",
    21: "ORBIT", 22: "AUTO_VTOL_TAKEOFF", 23: "EXTERNAL1", 24: "EXTERNAL2", 25: "EXTERNAL3", 26: "EXTERNAL4",
    27: "EXTERNAL5", 28: "EXTERNAL6", 29: "EXTERNAL7", 30: "EXTERNAL8",
}  # fmt: skip
#: The same numbers meant something else before 1.14 (msg/vehicle_status.msg).
_OLD_NAV_STATES: Final = {
    6: "AUTO_RCRECOVER", 7: "AUTO_RTGS", 8: "AUTO_LANDENGFAIL", 9: "AUTO_LANDGPSFAIL", 16: "RATTITUDE",
}  # fmt: skip
_RENUMBERED_AT: Final = (1, 14)

#: CA_AIRFRAME of src/modules/control_allocator/module.yaml.
_BY_CA_AIRFRAME: Final = {
    0: "multirotor", 1: "fixed-wing", 2: "vtol", 3: "vtol", 4: "vtol", 5: "rover", 6: "rover",
    7: "submarine", 8: "multirotor", 10: "helicopter", 11: "helicopter", 12: "helicopter", 13: "rover",
}  # fmt: skip
#: VEHICLE_TYPE_* of msg/VehicleStatus.msg, since 1.10.
_BY_STATUS: Final = {1: "multirotor", 2: "fixed-wing", 3: "rover"}


def flight_log(path: str, content: UlogContent, *, system: int = 0) -> FlightLog:
    """Turn the topics of a ULog file into canonical signals.

    Parameters
    ----------
    path : str
        As the user gave it.
    content : UlogContent
        With at least the rows of `TOPICS`.
    system : int
        Only used to say that it has no effect.

    Returns
    -------
    FlightLog
    """
    known = content.definitions
    return FlightLog(
        path=path,
        format="ulog",
        autopilot="px4" if known.information.get("sys_name", "PX4") == "PX4" else "other",
        n_bytes=content.n_bytes,
        signals=with_gyro_filter(
            _signals(content), px4_gyro_filter(known.parameters), ("vehicle_angular_velocity",)
        ),
        firmware=_firmware(content),
        vehicle_type=_vehicle_type(content),
        frame=_frame(content),
        hardware_id=str(known.information.get("sys_uuid", "")),
        parameters=dict(known.parameters),
        modes=_modes(content),
        texts=tuple(
            LogText(time_s=text.timestamp_us / 1e6, position=text.offset, text=text.text)
            for text in known.texts
        ),
        lost=content.lost,
        n_dropped=len(known.dropouts),
        counts=content.counts,
        utc_offset_s=_utc_offset_s(content),
        remarks=_remarks(content, system),
    )


def _utc_offset_s(content: UlogContent) -> float:
    """Return UTC minus the log's clock [s] as the receivers tell it."""
    for key, table in content.topics.items():
        if key[0] in _RECEIVERS and (utc_us := _columns(table, "time_utc_usec")) is not None:
            log_s = sample_time_s(table)
            if log_s is not None and math.isfinite(found := utc_offset_s(utc_us[:, 0] / 1e6, log_s)):
                return found
    return float("nan")


def sample_time_s(table: TopicTable) -> FloatArray | None:
    """Return when each row was sampled [s]; None where the topic has no time.

    `timestamp_sample` where it is filled in (not zero, at most 0.1 s from
    `timestamp`), else `timestamp`, the time of publication.
    """
    if not table.has("timestamp", "u"):
        return None
    published = table.rows["timestamp"].astype(np.float64)
    if not table.has("timestamp_sample", "u"):
        return published / 1e6
    sampled = table.rows["timestamp_sample"].astype(np.float64)
    plausible = (sampled > 0.0) & (np.abs(published - sampled) <= _MAX_SAMPLE_AGE_US)
    return np.where(plausible, sampled, published) / 1e6


def _signals(content: UlogContent) -> dict[str, tuple[Signal, ...]]:
    """Build every source of every canonical signal, in order of preference."""
    found: dict[str, list[Signal]] = {}
    for source in _SOURCES:
        instances = [table for key, table in content.topics.items() if key[0] == source.topic]
        built = [signal for table in instances if (signal := _signal(source, table)) is not None]
        found.setdefault(source.signal, []).extend(built)
    if "output_pwm" in found:
        # Several drivers publish outputs; the motors are on the one that moves most.
        found["output_pwm"].sort(key=_liveliness, reverse=True)
    return {name: tuple(signals) for name, signals in found.items() if signals}


def _signal(source: _Source, table: TopicTable) -> Signal | None:
    """Build one source from one topic instance; None where it lacks the fields or is never in use."""
    time_s, values = sample_time_s(table), source.build(table)
    if time_s is None or values is None or not values.shape[1]:
        return None
    instance = f"[{table.multi_id}]" if table.multi_id else ""
    return Signal(
        name=source.signal,
        rows=Rows(time_s, table.position),
        values=values,
        source=f"{source.topic}{instance}.{source.fields}",
        reason=source.reason,
    )


def _liveliness(signal: Signal) -> float:
    """Return how much a signal moves in all, in its own unit; 0 where damaged numbers hide it."""
    movement = float(np.std(signal.values, axis=0).sum())
    return movement if np.isfinite(movement) else 0.0


def _version(content: UlogContent) -> tuple[int, int, int, int] | None:
    """Return major, minor, patch and type of ver_sw_release (src/lib/version/version.c)."""
    release = content.definitions.information.get("ver_sw_release")
    if not isinstance(release, int) or release <= 0:
        return None
    return release >> 24 & 0xFF, release >> 16 & 0xFF, release >> 8 & 0xFF, release & 0xFF


def _firmware(content: UlogContent) -> str:
    """Return name, version and git hash as far as they are logged."""
    information = content.definitions.information
    words = [str(information.get("sys_name", "PX4"))]
    version = _version(content)
    if version is not None:
        major, minor, patch, kind = version
        suffix = {0: "-dev", 1: "-alpha", 2: "-beta", 3: "-rc"}[kind // 64] if kind != 255 else ""
        words.append(f"v{major}.{minor}.{patch}{suffix}")
    if information.get("ver_sw"):
        words.append(f"({str(information['ver_sw'])[:8]})")
    return " ".join(words)


def _last(content: UlogContent, topic: str, field: str) -> int | None:
    """Return the last value of an integer field of a topic's first instance."""
    table = content.topics.get((topic, 0))
    if table is None or not table.has(field):
        return None
    return int(table.rows[field][-1])


def _vehicle_type(content: UlogContent) -> str:
    """Ask what says most first: VTOL flag, MAV_TYPE, control allocation, status."""
    parameters = content.definitions.parameters
    if _last(content, "vehicle_status", "is_vtol"):
        return "vtol"
    mav_types = (
        whole_number(parameters.get("MAV_TYPE")),
        _last(content, "vehicle_status", "system_type") or 0,
    )
    answers = [vehicle_type_of(mav_type) for mav_type in mav_types]
    if "CA_AIRFRAME" in parameters and parameters.get("CA_ROTOR_COUNT", 0):
        answers.append(_BY_CA_AIRFRAME.get(whole_number(parameters["CA_AIRFRAME"], -1), "unknown"))
    answers.append(_BY_STATUS.get(_last(content, "vehicle_status", "vehicle_type") or 0, "unknown"))
    return next((answer for answer in answers if answer != "unknown"), "unknown")


def _frame(content: UlogContent) -> str:
    """Say rotors and geometry in words, from CA_ROTOR*, else from airframe number and MAV_TYPE."""
    parameters = content.definitions.parameters
    n_rotors = whole_number(parameters.get("CA_ROTOR_COUNT"))
    airframe = whole_number(parameters.get("SYS_AUTOSTART"))
    words = [airframe_words(airframe) or frame_words(whole_number(parameters.get("MAV_TYPE")))]
    if airframe:
        words.append(f"airframe {airframe}")
    if 0 < n_rotors <= 12:
        words.append(f"{n_rotors} rotors{_layout(parameters, n_rotors)} in CA_ROTOR*")
    return ", ".join(word for word in words if word)


def _layout(parameters: dict[str, float], n_rotors: int) -> str:
    """Tell whether the rotors stand in pairs above each other, or on the axes, by CA_ROTORn_PX and _PY."""
    names = [(f"CA_ROTOR{k}_PX", f"CA_ROTOR{k}_PY") for k in range(n_rotors)]
    if not all(name in parameters for pair in names for name in pair):
        return ""
    x, y = (np.array([parameters[pair[k]] for pair in names]) for k in range(2))
    reach = float(np.hypot(x, y).max())
    if not np.isfinite(reach) or reach <= 0.0:
        return ""
    places = np.unique(np.round(np.column_stack([x, y]) / reach, 2), axis=0)
    coaxial = ", coaxial pairs" if 2 * len(places) == n_rotors else ""
    ahead = np.abs(places[:, 1]) < 0.05
    return f"{coaxial}, one straight ahead" if (ahead & (places[:, 0] > 0.5)).any() else coaxial


def _modes(content: UlogContent) -> tuple[ModeChange, ...]:
    """Return where nav_state changes."""
    table = content.topics.get(("vehicle_status", 0))
    if table is None or not table.has("nav_state"):
        return ()
    time_s, state = sample_time_s(table), table.rows["nav_state"]
    if time_s is None:
        return ()
    version = _version(content)
    is_old = version is not None and version[:2] < _RENUMBERED_AT
    names = _NAV_STATES | _OLD_NAV_STATES if is_old else _NAV_STATES
    changes = np.flatnonzero(np.append(True, state[1:] != state[:-1]))
    return tuple(
        ModeChange(
            time_s=float(time_s[k]),
            position=int(table.position[k]),
            name=names.get(int(state[k]), f"mode {int(state[k])}"),
        )
        for k in changes.tolist()
    )


def _remarks(content: UlogContent, system: int) -> tuple[str, ...]:
    """Say what was decided or assumed."""
    known = content.definitions
    remarks = []
    if known.dropouts:
        total_s = sum(dropout.duration_ms for dropout in known.dropouts) * 1e-3
        remarks.append(f"The logger reports {len(known.dropouts)} dropouts of {total_s:.2f} s in all.")
    if known.n_changed_parameters:
        remarks.append(
            f"{known.n_changed_parameters} parameters were written while logging; the last value is used."
        )
    if content.n_joined:
        remarks.append(f"The file holds {content.n_joined + 1} logs joined together.")
    if content.n_unknown:
        remarks.append(f"{content.n_unknown} messages belong to no announced topic or are of unknown type.")
    if known.unknown_flags:
        remarks.append("The log says that it needs a newer reader; it was read all the same.")
    if known.information.get("ver_hw") == "PX4_SITL" and ("esc_status", 0) in content.topics:
        remarks.append("This is a simulated flight: rotor speeds are derived from the commands.")
    if system:
        remarks.append("A ULog holds one vehicle: the chosen system was not needed.")
    return tuple(remarks)
