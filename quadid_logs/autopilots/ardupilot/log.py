"""ArduPilot's logs, bytes or text, as a `FlightLog`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.autopilots.ardupilot import batches
from quadid_logs.autopilots.ardupilot.clock import TIME_LABELS, LogClock, own_time
from quadid_logs.autopilots.ardupilot.filters import parameter_filter
from quadid_logs.autopilots.ardupilot.followed import LABELS as FOLLOWED_LABELS
from quadid_logs.autopilots.ardupilot.followed import MESSAGES, followed
from quadid_logs.autopilots.ardupilot.identity import identify_vehicle, mode_name
from quadid_logs.autopilots.ardupilot.outer import POSITION_LABELS, POSITION_MESSAGES, position_rows
from quadid_logs.autopilots.ardupilot.signals import (
    LABELS,
    PID_MESSAGES,
    SCALE_MESSAGE,
    SOURCES,
    TERM_LABELS,
    Messages,
    RateScale,
    controller_terms,
    messages_to_read,
)
from quadid_logs.autopilots.sources import build_signals
from quadid_logs.autopilots.utc import gps_utc_s, utc_offset_s
from quadid_logs.containers import dataflash, dataflash_text
from quadid_logs.containers.content import message_counts
from quadid_logs.containers.message_table import MessageSource, MessageTable, damaged_numbers_pass
from quadid_logs.data.log import FlightLog, LogText, ModeChange, ParameterChange, whole_number
from quadid_logs.vocabulary import AXES

#: Their PIDR, PIDP and PIDY steer surfaces and work in degrees.
_OTHER_PIDS: Final = frozenset({"fixed-wing", "vtol"})
_PIDS: Final = frozenset(PID_MESSAGES)
_DESCRIPTIONS: Final = frozenset({"PARM", "MSG", "MODE", "VER", "DSF", "PM", "GPS"})
_LABELS: Final = frozenset({"Name", "Value", "Message", "Mode", "BU", "FWS", "Dp", "LogDrop", "GWk", "GMS"})
#: SID_AXIS that moves roll, pitch, yaw, roll, ...: input, recovered angle, rate, mixer (mode_systemid.cpp).
_SWEEPS: Final = range(1, 13)
#: ArduCopter/defines.h: MASK_LOG_ATTITUDE_FAST logs at the loop rate, MASK_LOG_ATTITUDE_MED at 10 Hz.
_FAST_ATTITUDE: Final = 1
_MEDIUM_ATTITUDE: Final = 2
_MEDIUM_HZ: Final = 10.0


def read_binary(path: str | Path, *, system: int = 0) -> FlightLog:  # one vehicle per file
    """Read a DataFlash binary log.

    Raises
    ------
    LogNotFoundError, EmptyLogError, UnknownFormatError
        As `dataflash.DataFlashFile.open` and `dataflash.check_not_empty`.
    """
    with dataflash.DataFlashFile.open(path) as file:
        dataflash.check_not_empty(file)
        return flight_log(file, log_format="dataflash")


def read_text(path: str | Path, *, system: int = 0) -> FlightLog:  # one vehicle per file
    """Read a DataFlash text log.

    Raises
    ------
    LogNotFoundError, EmptyLogError, UnknownFormatError
        As `dataflash_text.TextLog.open` and `dataflash_text.check_not_empty`.
    """
    log = dataflash_text.TextLog.open(path)
    dataflash_text.check_not_empty(log)
    return flight_log(log, log_format="dataflash-text", preamble=log.preamble)


@damaged_numbers_pass()
def flight_log(source: MessageSource, *, log_format: str, preamble: tuple[str, ...] = ()) -> FlightLog:
    """Turn an ArduPilot log's messages into canonical signals and descriptions.

    Parameters
    ----------
    log_format : str
        "dataflash" or "dataflash-text".
    preamble : tuple of str
        Lines before the first definition (text logs of old firmware).

    Returns
    -------
    FlightLog
        Signals in SI units and body axes FRD. Rows stand in file order; times
        are as logged, NaN where the log has none.
    """
    wanted = messages_to_read(source.counts) | _DESCRIPTIONS | _PIDS | MESSAGES | {SCALE_MESSAGE}
    tables = source.read_messages(wanted, LABELS | _LABELS | TERM_LABELS | FOLLOWED_LABELS)
    batched = source.read_messages(batches.MESSAGES & source.counts.keys(), batches.LABELS)
    positions = source.read_messages(POSITION_MESSAGES & source.counts.keys(), POSITION_LABELS | TIME_LABELS)
    clock = LogClock(tables.values())
    parameters = tables["PARM"].named_values("Name", "Value") if "PARM" in tables else {}
    texts = _texts(tables.get("MSG"), clock)
    version = tables.get("VER")
    told = [*preamble, *(text.text for text in texts)]
    build_type = None
    if version is not None and version.has_numbers("BU"):
        build_type = int(version.integers("BU")[-1])
    if version is not None and version.has_text("FWS"):
        told = [str(version.columns["FWS"][-1]), *told]
    # The old message MOT has a column for each motor.
    n_motors = next((len(each.columns) for each in source.definitions if each.name == "MOT"), 0)
    identity = identify_vehicle(told, parameters, build_type=build_type, n_motors=n_motors)
    pids = {name: table for name, table in tables.items() if name in _PIDS | {SCALE_MESSAGE}}
    tables.pop(SCALE_MESSAGE, None)
    if identity.vehicle_type in _OTHER_PIDS or "RATE" in source.counts:
        tables = {name: table for name, table in tables.items() if name not in _PIDS}
    messages = Messages(tables, clock, identity.version)
    # The rate that LOG_BITMASK promises for RATE and ANG, NaN where it promises none.
    bits = whole_number(parameters.get("LOG_BITMASK"))
    attitude_hz = (
        parameters.get("SCHED_LOOP_RATE", math.nan)
        if bits & _FAST_ATTITUDE
        else (_MEDIUM_HZ if bits & _MEDIUM_ATTITUDE else math.nan)
    )
    movers = build_signals(
        [one for one in SOURCES if one.signal in ("throttle", "rotor_speed")], messages.parts
    )
    seen = followed(tables, movers)
    gyro_filter = parameter_filter(parameters, seen, identity.version)
    samples = batches.gyro_batches(batched, parameters, gyro_filter)
    log = FlightLog(
        path=source.path,
        format=log_format,
        autopilot="ardupilot",
        n_bytes=source.n_bytes,
        signals=build_signals(
            SOURCES,
            messages.parts,
            gyro_filter=gyro_filter,
            nominal_rate_hz={"RATE": attitude_hz, "ANG": attitude_hz},
        )
        | ({"gyro_samples": samples} if samples else {}),
        firmware=identity.firmware,
        vehicle_type=identity.vehicle_type,
        frame=identity.frame,
        hardware_id=identity.hardware_id,
        parameters=parameters,
        parameter_changes=_parameter_changes(tables.get("PARM"), clock),
        controller_terms=controller_terms(pids, clock),
        position_control=position_rows(
            positions, {name: clock.rows(table) for name, table in positions.items()}
        ),
        followed=seen,
        modes=_modes(tables.get("MODE"), clock, identity.vehicle_type),
        texts=texts,
        lost=source.lost,
        n_dropped=_dropped(tables),
        counts=message_counts(
            source.counts, {name: own_time(table) for name, table in source.first_and_last().items()}
        ),
        has_time=clock.has_time,
        is_nominal_time=clock.is_nominal,
        utc_offset_s=_utc_offset_s(tables.get("GPS"), clock),
        remarks=_remarks(tables, clock, messages.rate_scale),
    )
    # The axes on which System ID mode injected a chirp, also one after the other in a flight.
    chirp = next(iter(log.candidates("sysid_chirp")), None)
    if chirp is None:
        return log
    injecting = chirp.rows.position[np.abs(chirp.values[:, 0]) > 0.0]
    changes = [one.position for one in log.parameter_changes if one.name == "SID_AXIS"]
    places = injecting[np.unique(np.searchsorted(changes, injecting), return_index=True)[1]]
    numbers = {whole_number(log.parameters_at(place).get("SID_AXIS")) for place in places.tolist()}
    swept_axes = tuple(axis for column, axis in enumerate(AXES) if numbers & {*_SWEEPS[column::3]})
    return replace(log, swept_axes=swept_axes)


def _parameter_changes(table: MessageTable | None, clock: LogClock) -> tuple[ParameterChange, ...]:
    """Return where PARM gives a parameter another value than it had."""
    if table is None or not (table.has_text("Name") and table.has_numbers("Value")):
        return ()
    rows, known = clock.rows(table), dict[str, float]()
    found = []
    values = table.columns["Value"].astype(np.float64).tolist()
    for number, (name, value) in enumerate(zip(table.columns["Name"].tolist(), values, strict=True)):
        before = known.setdefault(name, value)
        if value != before:
            time_s, position = float(rows.time_s[number]), int(rows.position[number])
            found.append(
                ParameterChange(time_s=time_s, position=position, name=name, value=value, before=before)
            )
            known[name] = value
    return tuple(found)


def _texts(table: MessageTable | None, clock: LogClock) -> tuple[LogText, ...]:
    """Return the autopilot's messages, line by line."""
    if table is None or not table.has_text("Message"):
        return ()
    rows = clock.rows(table)
    return tuple(
        LogText(time_s=time_s, position=position, text=str(text))
        for time_s, position, text in zip(
            rows.time_s.tolist(), rows.position.tolist(), table.columns["Message"].tolist(), strict=True
        )
    )


def _modes(table: MessageTable | None, clock: LogClock, vehicle_type: str) -> tuple[ModeChange, ...]:
    """Return the flight modes by name."""
    if table is None or not (table.has_numbers("Mode") or table.has_text("Mode")):
        return ()
    rows = clock.rows(table)
    return tuple(
        ModeChange(time_s=time_s, position=position, name=mode_name(mode, vehicle_type))
        for time_s, position, mode in zip(
            rows.time_s.tolist(), rows.position.tolist(), table.columns["Mode"].tolist(), strict=True
        )
    )


def _utc_offset_s(gps: MessageTable | None, clock: LogClock) -> float:
    """Return UTC minus the log's clock [s] as the receiver tells it; until 3.2 the labels were others."""
    if gps is None or not gps.has_numbers("GWk", "GMS"):
        return math.nan
    week, time_ms = (gps.columns[label].astype(np.float64) for label in ("GWk", "GMS"))
    return utc_offset_s(gps_utc_s(week, time_ms / 1e3), clock.rows(gps).time_s)


def _dropped(tables: Mapping[str, MessageTable]) -> int:
    """Count the messages that the logger could not write: DSF.Dp counts up, PM.LogDrop per period."""
    status, performance = tables.get("DSF"), tables.get("PM")
    if status is not None and status.has_numbers("Dp"):
        counter = status.integers("Dp")
        # A reboot resets the counter.
        return int(max(counter[0], 0) + np.clip(np.diff(counter), 0, None).sum())
    if performance is not None and performance.has_numbers("LogDrop"):
        return int(np.clip(performance.integers("LogDrop"), 0, None).sum())
    return 0


def _remarks(
    tables: Mapping[str, MessageTable], clock: LogClock, rate_scale: RateScale | None
) -> tuple[str, ...]:
    """Say in words what had to be decided or assumed."""
    remarks = []
    without = sorted(
        name for name in ("EV", "MODE", "MSG") if name in tables and own_time(tables[name]) is None
    )
    if not clock.has_time:
        remarks.append("The rows of this log carry no time: firmware before 3.1 did not log it.")
        if clock.is_nominal:
            remarks.append(
                "Charts count ten rows of CTUN or ATT as one second, the rate of that firmware. Nothing is "
                "identified from such times."
            )
    elif without:
        remarks.append(
            f"Rows of {', '.join(without)} carry no time. They take the time of the row before them in the "
            "file."
        )
    if rate_scale is not None and not rate_scale.is_stated:
        remarks.append(f"RATE is taken as {rate_scale.unit}: {rate_scale.evidence}.")
    return tuple(remarks)
