"""DataFlash .bin as ArduCopter writes it.

What the FlightLog does not hold is written as a quiet NaN, as ArduPilot does
with values that it does not have; integer fields are then zero.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise
from typing import BinaryIO

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.writers.dataflash_formats import (
    BATCHES,
    HEADER,
    MESSAGES,
    MULTIPLIERS,
    POSITION_LABELS,
    POSITIONS,
    UNITS,
)
from quadid_logs.writers.flight_modes import find_mode
from quadid_logs.writers.log_series import (
    Stamps,
    WriteClock,
    changes,
    clip_text,
    controller_rate,
    event_stamps,
    first,
    held_at,
    imu_rates,
    write_clock,
)
from quadid_logs.writers.records import RPM, Column, Field, Records, write_merged

DEG = 180.0 / math.pi
#: ArduCopter/defines.h, `LogEvent`.
ARMED, DISARMED, LAND_COMPLETE, NOT_LANDED = 10, 11, 18, 28
#: Rate of ATT whatever the bitmask (ArduCopter/Copter.cpp, `ten_hz_logging_loop`) [µs].
ATT_PERIOD_US = 100_000
#: INS_LOG_BAT_CNT, samples in a row, and what is a pause, in sample periods.
BATCH_SAMPLES, BATCH_ROW, BATCH_GAP = 1024, 32, 1.5
#: What a batch's samples are multiplied by: 2000 deg/s are the largest number.
GYRO_MUL = math.floor(32767.0 / math.radians(2000.0))
#: The version that the message definitions are taken from.
DEFAULT_FIRMWARE = "ArduCopter V4.7.0-dev (90700977)"
#: By axis.
PIDS = {"roll": "PIDR", "pitch": "PIDP", "yaw": "PIDY"}
#: Labels of PSCN and its likes, by what `PositionRows` calls it.
_POSITION_VALUES = {
    "TP": "position_target",
    "P": "position",
    "DV": "velocity_forward",
    "TV": "velocity_target",
    "V": "velocity",
    "DA": "acceleration_forward",
    "TA": "acceleration_target",
}
#: VER.BU: AP_Vehicle_Type.
BUILDS = {"ArduRover": 1, "ArduCopter": 2, "ArduPlane": 3, "ArduSub": 7}


def write_dataflash(log: FlightLog, file: BinaryIO) -> None:
    """Write a FlightLog as DataFlash binary.

    RATE stands at the times of `body_rate` or of `torque_command`, whichever
    has more rows; the other series in it hold their last value.

    Parameters
    ----------
    log : FlightLog
        Any autopilot's; only what ArduCopter logs is written.
    file : binary file
        Open for writing.

    Raises
    ------
    OutputError
        If a row has no finite time.
    """
    clock = write_clock(log)
    streams = [
        *_rate(log, clock),
        *_pids(log, clock),
        *_imu(log, clock),
        *_batches(log, clock),
        *_attitude(log, clock),
        *_positions(log, clock),
        *_outputs(log, clock),
        *_battery(log, clock),
        *_rotor_speed(log, clock),
        *_chirp(log, clock),
        *_events(log, clock),
    ]
    start_us = min((int(stream.key_us[0]) for stream in streams if stream.key_us.size), default=0)
    # Write what ArduPilot puts in front: definitions, version, parameters.
    moment = np.array([start_us], dtype=np.int64)
    stamps = Stamps(time_us=moment, key_us=moment)
    held_back = {*(() if log.candidates("gyro_samples") else BATCHES)}
    held_back |= set() if log.position_control else set(POSITIONS.values())
    names = [name for name in MESSAGES if name not in held_back]
    for name, fields in chain(_definitions(names), _settings(log)):
        file.write(_records(name, stamps, fields).encode(0, 1).tobytes())
    write_merged(file, streams)


def _records(name: str, stamps: Stamps, fields: Mapping[str, Field]) -> Records:
    """Make the rows of one message type."""
    message = MESSAGES[name]
    every_row: dict[str, Field] = {"header": HEADER, "number": message.number}
    if name != "FMT":
        every_row["TimeUS"] = stamps.time_us
    return Records(dtype=message.dtype, key_us=stamps.key_us, fields=every_row | dict(fields))


def _rate(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """RATE: the rate controller's input and output."""
    rate, torque = controller_rate(log), first(log, "torque_command")
    present = [signal for signal in (rate, torque) if signal is not None and signal.n_samples]
    if not present:
        return
    stamps = clock.of(max(present, key=lambda signal: signal.n_samples))
    measured = held_at(clock, rate, stamps.key_us, 3)
    wanted = held_at(clock, first(log, "body_rate_setpoint"), stamps.key_us, 3)
    torque_out = held_at(clock, torque, stamps.key_us, 3)
    fields: dict[str, Field] = {"ADes": math.nan, "A": math.nan, "AOutSlew": math.nan}
    for axis, letter in enumerate("RPY"):
        fields[f"{letter}Des"] = Column(values=wanted[:, axis], scale=DEG)
        fields[letter] = Column(values=measured[:, axis], scale=DEG)
        fields[f"{letter}Out"] = torque_out[:, axis]
    fields["AOut"] = held_at(clock, first(log, "throttle"), stamps.key_us, 1)[:, 0]
    yield _records("RATE", stamps, fields)


def _pids(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """PIDR, PIDP, PIDY: the terms of the rate controllers, where all of them are known."""
    for terms in log.controller_terms:
        values = terms.values
        if not {"P", "I", "D", "FF"} <= set(values):
            continue
        fields: dict[str, Field] = dict.fromkeys(("Tar", "Act", "Err", "DFF", "SRate"), math.nan)
        fields |= {term: values[term] for term in ("P", "I", "D", "FF")}
        fields["DFF"] = 0.0
        fields["Dmod"] = values.get("scale", 1.0)
        fields["Flags"] = values.get("limited", 0.0)
        stamps = clock.stamps(terms.rows.time_s, terms.rows.position)
        yield _records(PIDS[terms.axis], stamps, fields)


def _vector(prefix: str, values: FloatArray, *, scale: float = 1.0) -> dict[str, Field]:
    """Name the fields of a vector's components, such as GyrX, GyrY, GyrZ."""
    return {
        f"{prefix}{letter}": Column(values=values[:, axis], scale=scale) for axis, letter in enumerate("XYZ")
    }


def _imu(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """IMU per instance; accelerometers without a gyro become ACC."""
    rates, forces = imu_rates(log), log.candidates("specific_force")
    for instance, rate in enumerate(rates):
        stamps = clock.of(rate)
        force = held_at(clock, forces[instance] if instance < len(forces) else None, stamps.key_us, 3)
        # Rows per second, 0 for a single row.
        span_us = int(stamps.key_us[-1] - stamps.key_us[0]) if stamps.key_us.size else 0
        hertz = (stamps.key_us.size - 1) * 1e6 / span_us if span_us else 0.0
        fields = _vector("Gyr", rate.values) | _vector("Acc", force)
        state = {"I": instance, "T": math.nan, "GH": 1, "AH": 1, "GHz": hertz, "AHz": hertz}
        yield _records("IMU", stamps, fields | state)
    for instance, force_signal in enumerate(forces[len(rates) :], start=len(rates)):
        stamps = clock.of(force_signal)
        yield _records(
            "ACC",
            stamps,
            _vector("Acc", force_signal.values) | {"I": instance, "SampleUS": stamps.time_us},
        )


def _batches(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """ISBH and ISBD: what each gyro measured, in batches of whole rows, each behind its last sample."""
    headers: list[dict[str, float]] = []
    heads, rows, samples, keys = [], [], [], []
    for instance, signal in enumerate(log.candidates("gyro_samples")):
        stamps = clock.of(signal)
        steps_us = np.diff(stamps.time_us)
        period_us = float(np.median(steps_us))
        ends = [*(np.flatnonzero(steps_us > BATCH_GAP * period_us) + 1).tolist(), stamps.time_us.size]
        for start, end in pairwise([0, *ends]):
            for first_row in range(start, end - BATCH_ROW + 1, BATCH_SAMPLES):
                n_rows = min(BATCH_SAMPLES, end - first_row) // BATCH_ROW
                whole = slice(first_row, first_row + n_rows * BATCH_ROW)
                # Batches of several gyros that end at one time follow each other.
                key_us = int(stamps.key_us[whole.stop - 1]) + instance
                heads.append(key_us)
                keys += [key_us] * n_rows
                rows += [(len(headers) % 65536, number) for number in range(n_rows)]
                samples.append(signal.values[whole].reshape(n_rows, BATCH_ROW, 3))
                headers.append(
                    {"N": len(headers) % 65536, "instance": instance, "smp_cnt": n_rows * BATCH_ROW}
                    | {"SampleUS": int(stamps.time_us[first_row]), "smp_rate": 1e6 / period_us}
                )
    if not headers:
        return
    order = np.argsort(heads, kind="stable")
    moments = np.asarray(heads, dtype=np.int64)[order]
    columns: dict[str, Field] = {
        name: np.array([headers[number][name] for number in order.tolist()]) for name in headers[0]
    }
    yield _records("ISBH", Stamps(time_us=moments, key_us=moments), columns | {"type": 1, "mul": GYRO_MUL})
    order = np.argsort(keys, kind="stable")
    moments = np.asarray(keys, dtype=np.int64)[order]
    values, numbers = np.concatenate(samples)[order], np.asarray(rows)[order]
    axes = {axis: Column(values=values[:, :, n], scale=GYRO_MUL) for n, axis in enumerate("xyz")}
    numbered: dict[str, Field] = {"N": numbers[:, 0], "seqno": numbers[:, 1]}
    yield _records("ISBD", Stamps(time_us=moments, key_us=moments), numbered | axes)


def _attitude(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """ATT at 10 Hz, and ANG with every row where there are more."""
    attitude = first(log, "attitude")
    if attitude is None:
        return
    stamps = clock.of(attitude)
    tenths = stamps.key_us // ATT_PERIOD_US
    tenth_rows = np.flatnonzero(np.diff(tenths, prepend=tenths[0] - 1))
    if tenth_rows.size < stamps.key_us.size:
        period_s = np.diff(stamps.key_us, prepend=stamps.key_us[0]) * 1e-6
        target = _targets(log, clock, stamps)
        yield _records("ANG", stamps, _angles(attitude.values) | target | {"Dt": period_s})
    few = Stamps(time_us=stamps.time_us[tenth_rows], key_us=stamps.key_us[tenth_rows])
    target = _targets(log, clock, few)
    yield _records("ATT", few, _angles(attitude.values[tenth_rows]) | target | {"AEKF": 3})


def _targets(log: FlightLog, clock: WriteClock, stamps: Stamps) -> dict[str, Field]:
    """Return the angles of the attitude controller's target, NaN where it is unknown."""
    target = first(log, "attitude_setpoint")
    if target is None:
        return dict.fromkeys(("DesRoll", "DesPitch", "DesYaw"), math.nan)
    return _angles(held_at(clock, target, stamps.key_us, 3), prefix="Des")


def _angles(attitude_rad: FloatArray, prefix: str = "") -> dict[str, Field]:
    """Return angles in degrees, yaw as a heading from 0 to 360."""
    heading_rad = np.mod(attitude_rad[:, 2], 2.0 * math.pi)
    return {
        f"{prefix}Roll": Column(values=attitude_rad[:, 0], scale=DEG),
        f"{prefix}Pitch": Column(values=attitude_rad[:, 1], scale=DEG),
        f"{prefix}Yaw": Column(values=heading_rad, scale=DEG),
    }


def _positions(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """PSCN, PSCE, PSCD: what position controllers were given and gave."""
    for rows in log.position_control:
        name = POSITIONS[rows.direction]
        fields: dict[str, Field] = {f"{label}{name[-1]}": math.nan for label in POSITION_LABELS}
        for label, value in _POSITION_VALUES.items():
            if value in rows.values:
                fields[f"{label}{name[-1]}"] = rows.values[value]
        yield _records(name, clock.stamps(rows.rows.time_s, rows.rows.position), fields)


def _outputs(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """RCOU, and RCO2 and RCO3 where there are more than 14 channels."""
    outputs = first(log, "output_pwm")
    if outputs is None:
        return
    stamps = clock.of(outputs)
    n_channels = outputs.values.shape[1]
    for name, first_channel, last_channel in (("RCOU", 0, 14), ("RCO2", 14, 18), ("RCO3", 18, 32)):
        channels = range(first_channel, min(last_channel, n_channels))
        if channels:
            yield _records(name, stamps, {f"C{i + 1}": outputs.values[:, i] for i in channels})


def _battery(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """MOTB, the thrust compensation's state, and BAT."""
    ratio, lift = first(log, "battery_ratio"), first(log, "lift_max")
    base = ratio or lift
    if base is not None:
        stamps = clock.of(base)
        fields: dict[str, Field] = {
            "LiftMax": held_at(clock, lift, stamps.key_us, 1)[:, 0],
            "BatVolt": held_at(clock, ratio, stamps.key_us, 1)[:, 0],
            "ThLimit": 1.0,
            "ThrAvMx": math.nan,
            "ThrOut": held_at(clock, first(log, "throttle"), stamps.key_us, 1)[:, 0],
            # Bit 1: no motor has failed (AP_MotorsMulticopter.cpp, Log_Write).
            "FailFlags": 2,
        }
        yield _records("MOTB", stamps, fields)
    voltage = first(log, "battery_voltage")
    if voltage is not None:
        unknown: dict[str, Field] = dict.fromkeys(("VoltR", "Curr", "CurrTot", "EnrgTot", "Res"), math.nan)
        known: dict[str, Field] = {"Volt": voltage.values[:, 0], "RemPct": 255, "H": 1}
        yield _records("BAT", clock.of(voltage), unknown | known)


def _rotor_speed(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """ESC, one instance per rotor."""
    speed = first(log, "rotor_speed")
    if speed is None:
        return
    stamps = clock.of(speed)
    for instance in range(speed.values.shape[1]):
        rpm = Column(values=speed.values[:, instance], scale=RPM)
        unknown: dict[str, Field] = dict.fromkeys(("Volt", "Curr", "CTot"), math.nan)
        yield _records("ESC", stamps, unknown | {"Instance": instance, "RPM": rpm, "RawRPM": rpm})


def _chirp(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """SIDD: a system-ID mode's excitation beside the unfiltered IMU."""
    chirp = first(log, "sysid_chirp")
    if chirp is None:
        return
    stamps = clock.of(chirp)
    rate = next(iter(imu_rates(log)), None)
    gyro = held_at(clock, rate, stamps.key_us, 3)
    force = held_at(clock, first(log, "specific_force"), stamps.key_us, 3)
    fields: dict[str, Field] = {
        "Time": (stamps.key_us - stamps.key_us[0]) * 1e-6,
        "Targ": chirp.values[:, 0],
        "F": math.nan,
    }
    for axis, letter in enumerate("xyz"):
        fields[f"G{letter}"] = Column(values=gyro[:, axis], scale=DEG)
        fields[f"A{letter}"] = force[:, axis]
    yield _records("SIDD", stamps, fields)


def _events(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """ARM and EV where the state changes, MODE, PARM, MSG."""
    yield from _switches(clock, first(log, "armed"), before=0.0, on=ARMED, off=DISARMED, arm=True)
    yield from _switches(clock, first(log, "landed"), before=1.0, on=LAND_COMPLETE, off=NOT_LANDED, arm=False)
    if log.modes:
        numbers = np.array([find_mode(mode.name).ardupilot for mode in log.modes])
        yield _records("MODE", event_stamps(clock, log.modes), {"Mode": numbers, "ModeNum": numbers})
    if log.parameter_changes:
        names = np.array([clip_text(change.name, 16) for change in log.parameter_changes])
        fields: dict[str, Field] = {"Name": names, "Default": math.nan}
        fields["Value"] = np.array([change.value for change in log.parameter_changes])
        yield _records("PARM", event_stamps(clock, log.parameter_changes), fields)
    if log.texts:
        texts = np.array([clip_text(text.text, 64) for text in log.texts])
        yield _records("MSG", event_stamps(clock, log.texts), {"Message": texts})


def _switches(
    clock: WriteClock, signal: Signal | None, *, before: float, on: int, off: int, arm: bool
) -> Iterator[Records]:
    """EV, and for arming ARM, at the rows at which a two-valued signal changes."""
    if signal is None:
        return
    rows: IntArray = changes(signal.values[:, 0], before=before)
    if not rows.size:
        return
    every = clock.of(signal)
    stamps = Stamps(time_us=every.time_us[rows], key_us=every.key_us[rows])
    state = (signal.values[rows, 0] > 0.5).astype(np.int64)
    if arm:
        yield _records("ARM", stamps, {"ArmState": state})
    yield _records("EV", stamps, {"Id": np.where(state, on, off)})


def firmware_line(log: FlightLog) -> str:
    """Return the version as ArduPilot announces it, the default where the log is another firmware's."""
    return log.firmware if re.match(r"Ardu[A-Z]\w+ V\d+\.\d+", log.firmware) else DEFAULT_FIRMWARE


def _definitions(names: Sequence[str]) -> Iterator[tuple[str, dict[str, Field]]]:
    """FMT of every type, then what their units and multipliers mean."""
    messages = [MESSAGES[name] for name in names]
    for message in messages:
        yield (
            "FMT",
            {
                "Type": message.number,
                "Length": message.dtype.itemsize,
                "Name": message.name.encode(),
                "Format": message.format.encode(),
                "Columns": message.columns.encode(),
            },
        )
    for letter, unit in UNITS.items():
        yield "UNIT", {"Id": ord(letter), "Label": unit.encode()}
    for letter, factor in MULTIPLIERS.items():
        yield "MULT", {"Id": ord(letter), "Mult": factor}
    for message in messages:
        ids: dict[str, Field] = {"UnitIds": message.units.encode(), "MultIds": message.multipliers.encode()}
        yield "FMTU", {"FmtType": message.number} | ids


def _settings(log: FlightLog) -> Iterator[tuple[str, dict[str, Field]]]:
    """MSG with firmware and frame unless the log's texts tell them, VER, PARM."""
    firmware = firmware_line(log)
    if not any(text.text.startswith("Ardu") for text in log.texts):
        yield "MSG", {"Message": clip_text(firmware, 64)}
        if log.frame:
            yield "MSG", {"Message": clip_text(f"Frame: {log.frame}", 64)}
    # VER: the version's parts, board type 3 (simulated).
    found = re.match(r"(\w+) V(\d+)\.(\d+)(?:\.(\d+))?", firmware)
    build, *numbers = found.groups(default="0") if found else ("", "0", "0", "0")
    major, minor, patch = (min(int(number), 255) for number in numbers)
    yield (
        "VER",
        {
            "BT": 3,
            "BST": 65535,
            "Maj": major,
            "Min": minor,
            "Pat": patch,
            "FWS": clip_text(firmware, 64),
            "BU": BUILDS.get(build, 0),
        },
    )
    for name, value in ({"FORMAT_VERSION": 120.0} | log.parameters_at(-1)).items():
        yield "PARM", {"Name": clip_text(name, 16), "Value": value, "Default": math.nan}
