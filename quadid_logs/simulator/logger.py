"""Logger model: the rates, stamps, delays and losses with which an autopilot logs a flight."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.log import (
    NO_GYRO_FILTER,
    POSITION_VALUES,
    ControllerTerms,
    FlightLog,
    GyroFilter,
    LoggedSystem,
    LogText,
    ModeChange,
    ParameterChange,
    PositionRows,
    Rows,
    Signal,
)
from quadid_logs.maths.rotations import euler_from_quaternion, rotation_matrix
from quadid_logs.simulator.closed_loop import (
    Record,
    Setup,
    before_change,
    change_s,
    generator,
    hover_rad_s_of,
)
from quadid_logs.simulator.control import thrust_of_throttle
from quadid_logs.simulator.effects import with_outliers
from quadid_logs.simulator.faults import ACCELEROMETER_RANGE_M_S2, shaken
from quadid_logs.simulator.position_hold import DIRECTIONS
from quadid_logs.simulator.vendors import (
    ANGLE_LIMIT_DEG,
    POSITION_ROWS,
    SYSID_STREAM,
    Stream,
    Vendor,
    frame_name,
    motor_order,
    parameters,
    pulse_widths,
    start_texts,
    streams_of,
    vendor,
)
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2, MULTIROTOR

_BURST_S: Final = 0.1
#: What the control loop sends to the motors: late in the log by `Effects.torque_late_s`.
_OUTPUTS: Final = ("torque_command", "throttle", "motor_thrust", "output_pwm", "unallocated_torque")
#: The recorded channels of logged terms; PX4 logs the angular acceleration that its D acts on.
_ARDUPILOT_TERMS: Final = {"P": "proportional", "I": "integral", "D": "derivative", "scale": "scale"}
_PX4_TERMS: Final = {"derivative": "slope"}
_BETAFLIGHT_TERMS: Final = {"P": "proportional", "I": "integral", "D": "derivative"}
_TERMS: Final = {"ardupilot": _ARDUPILOT_TERMS, "px4": _PX4_TERMS, "betaflight": _BETAFLIGHT_TERMS}
_CARRIERS: Final = {"ardupilot": "RATE", "px4": "vehicle_angular_velocity", "betaflight": "main"}
#: Channels of Betaflight's outputs, a fraction of those from idle to full, and of the rotors' speeds.
_PER_MOTOR: Final = {"motor_thrust": "actuator", "rotor_speed": "rotor_speed"}
#: What `Effects.outlier_fraction` strikes.
_STRUCK: Final = ("body_rate", "torque_command", "motor_thrust", "rotor_speed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Logging:
    """How a flight is logged.

    Attributes
    ----------
    rate_hz : float
        Of the main messages; each is limited by the control rate.
    boot_s : float
        The autopilot's clock when the simulation begins [s].
    start_s : float
        The log begins this long after the simulation [s]; a late start loses the take-off.
    jitter_s : float
        Standard deviation of the stamps around their samples' times [s].
    drop_fraction : float
        Fraction of the time that is lost in bursts of about 0.1 s.
    clock_jump_s, clock_jump_at : float
        The clock is set by so much [s] at this fraction of the log.
    """

    rate_hz: float = 400.0
    boot_s: float = 31.0
    start_s: float = 0.3
    jitter_s: float = 10e-6
    drop_fraction: float = 0.0
    clock_jump_s: float = 0.0
    clock_jump_at: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _MessageRows:
    """Rows of one message: true time [s], stamp [s], and its signals' values."""

    stream: Stream
    true_s: FloatArray
    stamp_s: FloatArray
    values: Mapping[str, FloatArray]

    def where(self, kept: BoolArray) -> _MessageRows:
        """Return the rows that are kept."""
        return _MessageRows(
            stream=self.stream,
            true_s=self.true_s[kept],
            stamp_s=self.stamp_s[kept],
            values={name: values[kept] for name, values in self.values.items()},
        )


def log_flights(records: tuple[Record, ...], logging: Logging) -> FlightLog:
    """Log one or several flights into one `FlightLog`.

    Each further flight begins where the one before ended. Rows stand in the
    order of their true time, whatever the clock says; `Rows.position` is
    that order, and the signals of one message have one common `Rows` object.

    Parameters
    ----------
    records : tuple of Record
        Of the flights in order, all of one vehicle and autopilot.
    logging : Logging
        Rates, clock and losses of the logger.

    Returns
    -------
    FlightLog
        Without a path: `writers.write_log` makes a file of it.

    Raises
    ------
    SimulationError
        If the setup names an autopilot that is not simulated.
    """
    setup = records[0].setup
    kind = vendor(setup.autopilot)
    offsets = np.cumsum([0.0, *(record.time_s.size / setup.loop_hz for record in records)])
    fast = logging.rate_hz > kind.default_rate_hz
    streams = kind.streams if fast else _default_streams(kind)
    if kind.name == "ardupilot" and np.any(setup.reference.torque):
        streams = (*streams, SYSID_STREAM)
    if not setup.effects.setpoints_logged:
        # Leave out a signal, and a message that holds nothing else.
        left = [
            dataclasses.replace(
                stream, signals=tuple(pair for pair in stream.signals if pair[0] != "body_rate_setpoint")
            )
            for stream in streams
        ]
        streams = tuple(stream for stream in left if stream.signals)
    streams = streams_of(setup, streams)
    messages = [_collect(stream, records, offsets, logging) for stream in streams]
    messages += _events(records, offsets, logging)
    kept, n_dropped = _drop(messages, setup, logging, float(offsets[-1]))
    # Give all rows of all messages a number in the order of true time, 1 first.
    times = [rows.true_s for rows in kept]
    message = np.concatenate([np.full(time.size, i) for i, time in enumerate(times)])
    order = np.lexsort((message, np.concatenate(times)))
    rank = np.empty(order.size, dtype=np.int64)
    rank[order] = np.arange(1, order.size + 1)
    positions = np.split(rank, np.cumsum([time.size for time in times])[:-1])
    file_s = np.sort(np.concatenate([rows.true_s for rows in kept]))
    return FlightLog(
        path="",
        format=kind.log_format,
        autopilot=kind.name,
        n_bytes=0,
        signals=_signals(kept, positions, setup),
        firmware=kind.firmware,
        vehicle_type=MULTIROTOR,
        frame=frame_name(setup),
        parameters=parameters(setup, rate_hz=logging.rate_hz),
        parameter_changes=_parameter_changes(records, offsets, logging, file_s),
        controller_terms=_controller_terms(kept, positions, records) if fast and kind.terms else (),
        position_control=tuple(_position_control(kept, positions)),
        modes=_modes(records, offsets, logging, file_s),
        texts=tuple(
            LogText(time_s=logging.boot_s + logging.start_s, position=0, text=text)
            for text in start_texts(setup)
        ),
        n_dropped=n_dropped,
        systems=(
            LoggedSystem(
                system_id=1,
                component_id=1,
                autopilot=kind.name,
                vehicle_type=MULTIROTOR,
                n_messages=sum(rows.true_s.size for rows in kept),
                chosen=True,
            ),
        ),
    )


def _default_streams(kind: Vendor) -> tuple[Stream, ...]:
    """Without changed log settings, attitude, IMU and motors come at their own, lower rates."""
    slower = {
        "ANG": ("ATT", 10.0),
        "IMU": ("IMU", 25.0),
        "vehicle_attitude": ("vehicle_attitude", 20.0),
        "actuator_motors": ("actuator_motors", 10.0),
        "vehicle_rates_setpoint": ("vehicle_rates_setpoint", 50.0),
    }
    found = []
    for stream in kind.streams:
        message, rate_hz = slower.get(stream.message, (stream.message, stream.rate_hz))
        found.append(dataclasses.replace(stream, message=message, rate_hz=rate_hz))
    return tuple(found)


def _collect(
    stream: Stream, records: tuple[Record, ...], offsets: FloatArray, logging: Logging
) -> _MessageRows:
    """Take every n-th control period of all flights."""
    true, sampled, parts = [], [], []
    for record, offset in zip(records, offsets[:-1], strict=True):
        setup = record.setup
        rate = min(stream.rate_hz or logging.rate_hz, setup.loop_hz)
        index = np.arange(0, record.time_s.size, max(round(setup.loop_hz / rate), 1))
        late = np.maximum(index - round(stream.latency_s * setup.loop_hz), 0)
        true.append(offset + record.time_s[index])
        sampled.append(_values(stream, record, late))
        parts.append(index)
    time = np.concatenate(true)
    columns = {name: np.concatenate([part[name] for part in sampled]) for name, _ in stream.signals}
    inside = time >= logging.start_s
    for values in columns.values():
        inside &= np.isfinite(values).all(axis=1)
    stamps = _stamp(time, records[0].setup, logging, float(offsets[-1]))
    return _MessageRows(stream=stream, true_s=time, stamp_s=stamps, values=columns).where(inside)


def _stamp(time_s: FloatArray, setup: Setup, logging: Logging, end_s: float) -> FloatArray:
    """Put the autopilot's clock on the true times: whole microseconds, jitter, a jump."""
    n = round(end_s * setup.loop_hz) + 1
    jitter = logging.jitter_s * generator(setup, "stamps").standard_normal(n)
    stamps = logging.boot_s + time_s + jitter[np.round(time_s * setup.loop_hz).astype(np.int64)]
    stamps = stamps + logging.clock_jump_s * (time_s >= logging.clock_jump_at * end_s)
    return np.asarray(np.round(stamps * 1e6) / 1e6, dtype=np.float64)


def _values(stream: Stream, record: Record, index: IntArray) -> dict[str, FloatArray]:
    """Values of the stream's signals at control periods, as the effects let them reach the log."""
    setup = record.setup
    late = np.maximum(index - round(setup.effects.torque_late_s * setup.loop_hz), 0)
    values = {
        name: _signal_values(name, record, late if name in _OUTPUTS else index) for name, _ in stream.signals
    }
    fraction = setup.effects.outlier_fraction
    return values | {
        name: with_outliers(values[name], fraction, generator(setup, f"outliers of {stream.message} {name}"))
        for name in values
        if name in _STRUCK and fraction
    }


def _signal_values(name: str, record: Record, index: IntArray) -> FloatArray:
    """One canonical signal from the recorded channels, in single precision like every log."""
    setup, channels = record.setup, record.channels
    direct = {
        "body_rate": "gyro_filtered",
        "body_rate_setpoint": "setpoint",
        "torque_command": "command",
        "throttle": "throttle",
        "rotor_speed": "rotor_speed",
        "motor_thrust": "thrust_fraction",
        "battery_ratio": "voltage_filtered",
        "attitude_setpoint": "attitude_target",
        POSITION_ROWS: POSITION_ROWS,
    }
    if name in direct:
        values = channels[direct[name]][index]
        if setup.autopilot == "betaflight" and name in _PER_MOTOR:
            # Outputs from idle, which is none, to full, in Betaflight's order of motors.
            values = channels[_PER_MOTOR[name]][index][:, motor_order(setup)]
    elif name == "stick":
        # What asks for angles up to the limit.
        tilt_rad = setup.reference.tilt_rad
        values = _in_flight(record, tilt_rad / np.radians(ANGLE_LIMIT_DEG), outside=0.0)[index]
    elif name == "body_rate_raw" and setup.autopilot == "betaflight":
        values = channels["gyro"][index]
    elif name == "body_rate_raw":
        raw = "gyro" if setup.autopilot == "px4" else "gyro_filtered"
        values = channels[raw][index] + 0.9 * np.array(setup.noise.gyro_bias_rad_s)
    elif name == "attitude":
        values = euler_from_quaternion(channels["attitude"][index])
    elif name == "specific_force":
        values = _specific_force(record, index)
    elif name == "output_pwm":
        values = _pulse_width(record, index)
    elif name == "sysid_chirp":
        # The torque that the test mode adds in the next loop; outside the manoeuvre it is not logged.
        torque = setup.reference.torque.sum(axis=1, keepdims=True)
        values = _in_flight(record, torque, outside=np.nan, loops_earlier=1)[index]
    elif name == "lift_max":
        values = thrust_of_throttle(channels["voltage_filtered"][index], setup.firmware_expo)
    elif name == "battery_voltage":
        values = channels["voltage"][index] * setup.airframe.battery.full_v
    else:
        values = channels["command"][index] - channels["achieved"][index]
    return values.astype(np.float32).astype(np.float64)


def _in_flight(
    record: Record, manoeuvre: FloatArray, *, outside: float, loops_earlier: int = 0
) -> FloatArray:
    """Return a manoeuvre's values (n, n_columns) as part of the whole flight's (n_steps, n_columns)."""
    setup = record.setup
    values = np.full((record.time_s.size, manoeuvre.shape[1]), outside)
    begin = round(setup.schedule.manoeuvre_s * setup.loop_hz) - loops_earlier
    values[begin : begin + len(manoeuvre)] = manoeuvre
    return values


def _specific_force(record: Record, index: IntArray) -> FloatArray:
    """Accelerometer in body axes: everything but gravity, with noise [m/s^2]."""
    setup = record.setup
    felt = record.channels["acceleration"][index] - np.array([0.0, 0.0, GRAVITY_M_S2])
    body = np.einsum("nij,ni->nj", rotation_matrix(record.channels["attitude"][index]), felt)
    sigma = setup.noise.accelerometer_m_s2_per_rthz * np.sqrt(0.5 * setup.loop_hz)
    noise = generator(setup, "accelerometer").standard_normal((record.time_s.size, 3))
    felt = body + sigma * noise[index]
    hover_rad_s, step_s = hover_rad_s_of(setup.airframe), 1.0 / setup.loop_hz
    felt = felt + shaken(setup.effects, record.channels["rotor_speed"], hover_rad_s, step_s)[index]
    return np.asarray(np.clip(felt, -ACCELEROMETER_RANGE_M_S2, ACCELEROMETER_RANGE_M_S2), dtype=np.float64)


def _pulse_width(record: Record, index: IntArray) -> FloatArray:
    """Whole microseconds per channel: spinning, idling when armed, or off."""
    setup = record.setup
    low, high, idle = pulse_widths(setup)
    time = record.time_s[index]
    spinning = (time >= setup.schedule.take_off_s) & (time < setup.schedule.disarm_s)
    pwm = np.where(spinning[:, np.newaxis], low + (high - low) * record.channels["actuator"][index], idle)
    # Say when the motors are armed: from arming to disarming.
    pulses = np.where(
        ((time >= setup.schedule.arm_s) & (time < setup.schedule.disarm_s))[:, np.newaxis], pwm, 1000.0
    )
    return np.asarray(np.round(pulses), dtype=np.float64)


def _events(records: tuple[Record, ...], offsets: FloatArray, logging: Logging) -> list[_MessageRows]:
    """Rows where the log begins, and where the vehicle arms, takes off, lands and disarms."""
    setup = records[0].setup
    if setup.autopilot == "betaflight":
        return []
    armed, landed = [(0.0, 0.0)], [(0.0, 1.0)]
    for record, offset in zip(records, offsets[:-1].tolist(), strict=True):
        schedule = record.setup.schedule
        airborne_s = record.time_s[record.channels["height"][:, 0] > 0.05]
        armed += [(offset + schedule.arm_s, 1.0), (offset + schedule.disarm_s, 0.0)]
        if airborne_s.size:
            landed += [(offset + float(airborne_s[0]), 0.0), (offset + float(airborne_s[-1]), 1.0)]
    names = (("actuator_armed", "armed"), ("vehicle_land_detected", "landed"))
    if setup.autopilot == "ardupilot":
        names = (("ARM", "ArmState"), ("EV", "Id"))
    found = []
    for (message, field), signal, events in zip(names, ("armed", "landed"), (armed, landed), strict=True):
        # Log the state in which the log finds the vehicle, and every change from then on.
        stream = Stream(message=message, signals=((signal, field),))
        before = [state for time, state in events if time <= logging.start_s]
        kept = [(logging.start_s, before[-1]), *(event for event in events if event[0] > logging.start_s)]
        time, values = np.array(kept).T
        time = np.round(time * setup.loop_hz) / setup.loop_hz
        found.append(
            _MessageRows(
                stream=stream,
                true_s=time,
                stamp_s=_stamp(time, setup, logging, float(offsets[-1])),
                values={stream.signals[0][0]: values[:, np.newaxis]},
            )
        )
    return found


def _drop(
    messages: list[_MessageRows], setup: Setup, logging: Logging, end_s: float
) -> tuple[list[_MessageRows], int]:
    """Lose all rows of random short bursts, and count them; events are never lost."""
    if logging.drop_fraction <= 0.0:
        return messages, 0
    rng = generator(setup, "drops")
    bursts = rng.exponential(_BURST_S, round(logging.drop_fraction * end_s / _BURST_S) + 1)
    begins = rng.uniform(0.0, end_s, bursts.size)
    kept, n_dropped = [], 0
    for rows in messages:
        lost = np.zeros(rows.true_s.size, dtype=np.bool_)
        if len(rows.true_s) > 16:
            for begin, length in zip(begins, bursts, strict=True):
                lost |= (rows.true_s >= begin) & (rows.true_s < begin + length)
        n_dropped += int(lost.sum())
        kept.append(rows.where(~lost))
    return kept, n_dropped


def _signals(
    messages: list[_MessageRows], positions: list[IntArray], setup: Setup
) -> dict[str, tuple[Signal, ...]]:
    """Signals by canonical name, in the order of the vendor's messages."""
    kind = vendor(setup.autopilot)
    found: dict[str, tuple[Signal, ...]] = {}
    for rows, position in zip(messages, positions, strict=True):
        instance = "[0]" if rows.stream.message == "IMU" else ""
        shared = Rows(rows.stamp_s, position)
        for raw_name, fields in rows.stream.signals:
            if raw_name == POSITION_ROWS:
                continue
            name = "body_rate" if raw_name == "body_rate_raw" else raw_name
            signal = Signal(
                name=name,
                rows=shared,
                values=rows.values[raw_name],
                source=f"{rows.stream.message}{instance}.{fields}",
                reason=f"as {kind.firmware} logs it",
                # A file says this by its parameter, and is read so.
                gyro_filter=GyroFilter(setup.gyro_filter_hz) if raw_name == "body_rate" else NO_GYRO_FILTER,
            )
            found[name] = (*found.get(name, ()), signal)
    return found


def _parameter_changes(
    records: tuple[Record, ...], offsets: FloatArray, logging: Logging, row_s: FloatArray
) -> tuple[ParameterChange, ...]:
    """Gains that somebody changed in flight; at the end of it they are set back."""
    setup = records[0].setup
    later = parameters(setup, rate_hz=logging.rate_hz)
    first = parameters(dataclasses.replace(setup, tuning=before_change(setup)), rate_hz=logging.rate_hz)
    found = []
    for record, offset in zip(records, offsets[:-1].tolist(), strict=True):
        flown = record.setup
        moments = ((change_s(flown), first, later), (flown.schedule.end_s, later, first))
        for moment_s, old, new in moments[: 1 if record is records[-1] else 2]:
            time_s = np.array([round((offset + moment_s) * setup.loop_hz) / setup.loop_hz])
            stamp_s = float(_stamp(time_s, setup, logging, float(offsets[-1]))[0])
            position = int(np.searchsorted(row_s, time_s)[0]) + 1
            found += [
                ParameterChange(
                    time_s=stamp_s, position=position, name=name, value=new[name], before=old[name]
                )
                for name in later
                if new[name] != old[name]
            ]
    return tuple(found)


def _controller_terms(
    messages: list[_MessageRows], positions: list[IntArray], records: tuple[Record, ...]
) -> tuple[ControllerTerms, ...]:
    """Terms of the rate controllers in the rows of the message that holds the rates."""
    setup = records[0].setup
    autopilot = setup.autopilot
    pairs = zip(messages, positions, strict=True)
    rows, position = next(
        (rows, place) for rows, place in pairs if rows.stream.message == _CARRIERS[autopilot]
    )
    index = np.round(rows.true_s * setup.loop_hz).astype(np.int64)
    found: dict[str, FloatArray] = {}
    for term, channel in _TERMS[autopilot].items():
        values = np.concatenate([one.channels[channel] for one in records])[index]
        found[term] = values.astype(np.float32).astype(np.float64)
    if autopilot == "betaflight":
        # What the command has beside the PID's terms, as torque that is injected.
        found["FF"] = rows.values["torque_command"] - sum(found.values())
    elif autopilot == "ardupilot":
        # The mixer's limits are those of the loop before.
        limited = np.concatenate([one.channels["limited"] for one in records])
        found["limited"] = np.repeat(limited[np.maximum(index - 1, 0)], 3, axis=1)
        found["FF"] = np.zeros((index.size, 3))
    shared = Rows(rows.stamp_s, position)
    return tuple(
        ControllerTerms(
            axis=axis, rows=shared, values={term: values[:, number] for term, values in found.items()}
        )
        for number, axis in enumerate(AXES)
    )


def _position_control(messages: list[_MessageRows], positions: list[IntArray]) -> Iterator[PositionRows]:
    """Yield what position controllers were given and gave."""
    for rows, position in zip(messages, positions, strict=True):
        if POSITION_ROWS not in rows.values:
            continue
        columns = rows.values[POSITION_ROWS].T.reshape(len(DIRECTIONS), len(POSITION_VALUES), -1)
        shared = Rows(rows.stamp_s, position)
        for direction, found in zip(DIRECTIONS, columns, strict=True):
            yield PositionRows(
                direction=direction, rows=shared, values=dict(zip(POSITION_VALUES, found, strict=True))
            )


def _modes(
    records: tuple[Record, ...], offsets: FloatArray, logging: Logging, row_s: FloatArray
) -> tuple[ModeChange, ...]:
    """Flight mode from the beginning, the test mode during torque injection, then landing."""
    setup = records[0].setup
    kind = vendor(setup.autopilot)
    changes: list[tuple[float, str]] = []
    for record, offset in zip(records, offsets[:-1].tolist(), strict=True):
        flown = record.setup
        mode, landing = kind.flight_mode if flown.position is None else kind.position_mode, kind.landing_mode
        if kind.angle_mode and flown.reference.asks_for_angles:
            mode = landing = kind.angle_mode
        changes.append((max(offset, logging.start_s), mode))
        if np.any(flown.reference.torque):
            changes.append((offset + flown.schedule.manoeuvre_s, kind.sysid_mode))
        changes.append((offset + flown.schedule.land_s, landing))
    times = np.round(np.array([time for time, _ in changes]) * setup.loop_hz) / setup.loop_hz
    stamps = _stamp(times, setup, logging, float(offsets[-1]))
    positions = np.searchsorted(row_s, times) + 1
    return tuple(
        ModeChange(time_s=stamp, position=position, name=name)
        for stamp, position, (_, name) in zip(stamps.tolist(), positions.tolist(), changes, strict=True)
    )
