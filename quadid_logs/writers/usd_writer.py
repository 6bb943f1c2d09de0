"""Crazyflie's micro-SD log as its firmware writes it; the layout is told in `containers.usd`.

A torque command is written as the PID controller's; with a thrust in newtons beside it as the Lee
controller's, which commands in newton metres.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from io import BytesIO
from typing import BinaryIO, Final

import numpy as np

from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.vocabulary import GRAVITY_M_S2
from quadid_logs.writers.log_series import Stamps, WriteClock, first, held_at, write_clock
from quadid_logs.writers.records import Column, Field, Records, write_merged

_MAGIC: Final = 0xBC
#: The type of the time, and its unit [us], by version.
_STAMPS: Final = {1: ("<u4", 1000), 2: ("<u8", 1)}
#: Events at a fixed rate have this number and name; those of triggers count from 0.
_FIXED: Final = (0xFFFF, "fixedFrequency")
_DEGREE: Final = 180.0 / math.pi
_COUNTS: Final = 65535.0
_LETTERS: Final = {"<f4": "f", "<u2": "H"}
_FLU, _YAW_LEFT, _SAME = (1.0, -1.0, -1.0), (1.0, 1.0, -1.0), (1.0, 1.0, 1.0)
#: Variables of each signal, factor, sign by axis, type.
_Written = tuple[str, float, tuple[float, ...], str]
_PID: Final[Mapping[str, _Written]] = {
    "body_rate": ("controller.r_roll controller.r_pitch controller.r_yaw", 1.0, _YAW_LEFT, "<f4"),
    "body_rate_setpoint": (
        "controller.rollRate controller.pitchRate controller.yawRate", _DEGREE, _YAW_LEFT, "<f4",
    ),
    "attitude": ("stabilizer.roll stabilizer.pitch stabilizer.yaw", _DEGREE, _YAW_LEFT, "<f4"),
    "torque_command": ("controller.cmd_roll controller.cmd_pitch controller.cmd_yaw", _COUNTS, _SAME, "<f4"),
    "throttle": ("controller.cmd_thrust", _COUNTS, (1.0,), "<f4"),
}  # fmt: skip
_LEE: Final[Mapping[str, _Written]] = {
    "body_rate": ("ctrlLee.omegax ctrlLee.omegay ctrlLee.omegaz", 1.0, _FLU, "<f4"),
    "body_rate_setpoint": ("ctrlLee.omegarx ctrlLee.omegary ctrlLee.omegarz", 1.0, _FLU, "<f4"),
    "attitude": ("ctrlLee.rpyx ctrlLee.rpyy ctrlLee.rpyz", 1.0, _FLU, "<f4"),
    "torque_command": ("ctrlLee.torquex ctrlLee.torquey ctrlLee.torquez", 1.0, _FLU, "<f4"),
    "thrust_n": ("ctrlLee.thrustSi", 1.0, (1.0,), "<f4"),
}
_SENSORS: Final[Mapping[str, _Written]] = {
    "specific_force": ("acc.x acc.y acc.z", 1.0 / GRAVITY_M_S2, _FLU, "<f4"),
    "battery_voltage": ("pm.vbat", 1.0, (1.0,), "<f4"),
    "rotor_speed": ("rpm.m1 rpm.m2 rpm.m3 rpm.m4", 30.0 / math.pi, (1.0,) * 4, "<u2"),
}
#: Bits of ``supervisor.info``.
_ARMED, _FLYING = 1 << 1, 1 << 4


def write_usd(log: FlightLog, file: BinaryIO, *, version: int = 2) -> None:
    """Write a FlightLog as a Crazyflie's micro-SD log.

    Parameters
    ----------
    log : FlightLog
        Any autopilot's; of several sources of a signal the preferred one is written. Parameters, modes and
        texts are left out: the format has no place for them.
    file : binary file
        Open for writing.
    version : int
        1 (times in ms) or 2 (in us).

    Raises
    ------
    OutputError
        If a row has no finite time.
    """
    clock = write_clock(log)
    events = [*_events(log, clock)]
    content = BytesIO()
    content.write(struct.pack("<BHH", _MAGIC, version, len(events)))
    for number, name, _, fields, types in events:
        content.write(struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(fields)))
        content.writelines(f"{field}({_LETTERS[types[field]]})\0".encode() for field in fields)
    write_merged(content, [_records(*event, version=version) for event in events])
    file.write(content.getbuffer())
    file.write(struct.pack("<I", zlib.crc32(content.getbuffer())))


_Event = tuple[int, str, Stamps, dict[str, Field], dict[str, str]]


def _events(log: FlightLog, clock: WriteClock) -> Iterator[_Event]:
    """Yield number, name, times, fields and their types: signals of the same rows are one event."""
    controller = _LEE if log.candidates("thrust_n") else _PID
    groups: dict[int, tuple[Rows, dict[str, tuple[Signal, _Written]]]] = {}
    for name, written in {**controller, **_SENSORS}.items():
        signal = first(log, name)
        if signal is not None and signal.values.shape[1] >= len(written[2]):
            groups.setdefault(id(signal.rows), (signal.rows, {}))[1][name] = signal, written
    ordered = sorted(groups.values(), key=lambda group: -group[0].n_samples)
    for place, (rows, signals) in enumerate(ordered):
        fields: dict[str, Field] = {}
        types: dict[str, str] = {}
        for signal, (names, factor, signs, kind) in signals.values():
            for column, (name, sign) in enumerate(zip(names.split(), signs, strict=True)):
                fields[name] = Column(values=signal.values[:, column], scale=factor * sign)
                types[name] = kind
        stamps = clock.stamps(rows.time_s, rows.position)
        armed, landed = first(log, "armed"), first(log, "landed")
        if place == 0 and armed is not None and landed is not None:
            # The supervisor's state, in the first event only.
            is_armed, is_landed = (held_at(clock, one, stamps.key_us, 1)[:, 0] for one in (armed, landed))
            state = _ARMED * (is_armed > 0.5) + _FLYING * (is_landed < 0.5)
            fields["supervisor.info"], types["supervisor.info"] = np.asarray(state, dtype=np.float64), "<u2"
        number, event = (place - 1, f"trigger{place}") if place else _FIXED
        yield number, event, stamps, fields, types


def _records(
    number: int, _name: str, stamps: Stamps, fields: dict[str, Field], types: dict[str, str], *, version: int
) -> Records:
    """Make the events of a kind; names of numpy's fields hold no dots, by which nested ones are told."""
    stamp, unit_us = _STAMPS[version]
    own = {field: field.replace(".", " ") for field in fields}
    dtype = np.dtype(
        [("number", "<u2"), ("time", stamp), *((own[field], kind) for field, kind in types.items())]
    )
    values: dict[str, Field] = {own[field]: value for field, value in fields.items()}
    values |= {"number": float(number), "time": stamps.time_us // unit_us}
    return Records(dtype=dtype, key_us=stamps.key_us, fields=values)
