"""ArduPilot's messages as a `FlightLog`; shared by the binary and the text reader."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.autopilots.ardupilot.clock import TIME_LABELS, LogClock, own_time
from quadid_logs.autopilots.ardupilot.identity import (
    VehicleIdentity,
    identify_vehicle,
    mode_name,
    parameter_table,
)
from quadid_logs.autopilots.ardupilot.signals import MAIN_TYPES, PID_TYPES, SIGNAL_LABELS, SignalBuilder
from quadid_logs.autopilots.gyro_filter import ardupilot_gyro_filter, with_gyro_filter
from quadid_logs.autopilots.utc import gps_utc_s, utc_offset_s
from quadid_logs.containers.message_table import MessageSource, MessageTable, damaged_numbers_pass
from quadid_logs.data.log import FlightLog, LogText, MessageCount, ModeChange, Signal, whole_number

#: Their PIDR, PIDP and PIDY steer surfaces and work in degrees.
_OTHER_PIDS: Final = frozenset({"fixed-wing", "vtol"})
_DESCRIPTIONS: Final = frozenset({"PARM", "MSG", "MODE", "VER", "DSF", "PM", "GPS"})
_LABELS: Final = frozenset({"Name", "Value", "Message", "Mode", "BU", "FWS", "Dp", "LogDrop", "GWk", "GMS"})
#: ArduCopter/defines.h: MASK_LOG_ATTITUDE_FAST logs at the loop rate, MASK_LOG_ATTITUDE_MED at 10 Hz.
_FAST_ATTITUDE: Final = 1
_MEDIUM_ATTITUDE: Final = 2
_MEDIUM_HZ: Final = 10.0
#: AP_InertialSensor logs IMU from get_gyro(), behind the filters; only GYR (raw samples) and SIDD
#: come from before them.
_FILTERED_GYROS: Final = ("RATE", "IMU")


@damaged_numbers_pass()
def flight_log(source: MessageSource, *, log_format: str, preamble: tuple[str, ...] = ()) -> FlightLog:
    """Turn an ArduPilot log's messages into canonical signals and descriptions.

    Parameters
    ----------
    source : MessageSource
        The opened file.
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
    wanted = MAIN_TYPES | _DESCRIPTIONS | (frozenset() if "RATE" in source.counts else PID_TYPES)
    tables = source.read_messages(wanted, SIGNAL_LABELS | TIME_LABELS | _LABELS)
    samples = source.first_and_last()
    clock = LogClock(tables.values())
    parameters = _parameters(tables.get("PARM"))
    texts = _texts(tables.get("MSG"), clock)
    identity = _identity(
        tables.get("VER"), [*preamble, *(text.text for text in texts)], parameters, source.n_motors
    )
    if identity.vehicle_type in _OTHER_PIDS:
        tables = {name: table for name, table in tables.items() if name not in PID_TYPES}
    numbers = {name: table.numbers() for name, table in tables.items()}
    builder = SignalBuilder(numbers, clock, identity.version)
    return FlightLog(
        path=source.path,
        format=log_format,
        autopilot="ardupilot",
        n_bytes=source.n_bytes,
        signals=with_gyro_filter(
            _with_nominal_rates(builder.build(), parameters),
            ardupilot_gyro_filter(parameters),
            _FILTERED_GYROS,
        ),
        firmware=identity.firmware,
        vehicle_type=identity.vehicle_type,
        frame=identity.frame,
        hardware_id=identity.hardware_id,
        parameters=parameters,
        modes=_modes(tables.get("MODE"), clock, identity.vehicle_type),
        texts=texts,
        lost=source.lost,
        n_dropped=_dropped(tables),
        counts=_counts(source.counts, samples),
        has_time=clock.has_time,
        utc_offset_s=_utc_offset_s(tables.get("GPS"), clock),
        remarks=_remarks(tables, clock, builder),
    )


def _identity(
    version: MessageTable | None, texts: list[str], parameters: Mapping[str, float], n_motors: int
) -> VehicleIdentity:
    """Tell what flew from VER, texts and parameters."""
    build_type = None
    if version is not None and version.has_numbers("BU"):
        build_type = int(version.integers("BU")[-1])
    if version is not None and version.has_text("FWS"):
        texts = [str(version.columns["FWS"][-1]), *texts]
    return identify_vehicle(texts, parameters, build_type=build_type, n_motors=n_motors)


def _parameters(table: MessageTable | None) -> dict[str, float]:
    """Return the last value of each parameter."""
    if table is None or not (table.has_text("Name") and table.has_numbers("Value")):
        return {}
    return parameter_table(table.columns["Name"].tolist(), table.columns["Value"].tolist())


def _texts(table: MessageTable | None, clock: LogClock) -> tuple[LogText, ...]:
    """Return the autopilot's messages, line by line."""
    if table is None or not table.has_text("Message"):
        return ()
    rows = zip(
        clock.times(table).tolist(),
        table.position.tolist(),
        table.columns["Message"].tolist(),
        strict=True,
    )
    return tuple(LogText(time_s=time, position=position, text=str(text)) for time, position, text in rows)


def _utc_offset_s(gps: MessageTable | None, clock: LogClock) -> float:
    """Return UTC minus the log's clock [s] as the receiver tells it; until 3.2 the labels were others."""
    if gps is None or not gps.has_numbers("GWk", "GMS"):
        return float("nan")
    week, time_ms = (gps.columns[label].astype(np.float64) for label in ("GWk", "GMS"))
    return utc_offset_s(gps_utc_s(week, time_ms / 1e3), clock.times(gps))


def _modes(table: MessageTable | None, clock: LogClock, vehicle_type: str) -> tuple[ModeChange, ...]:
    """Return the flight modes by name."""
    if table is None or not (table.has_numbers("Mode") or table.has_text("Mode")):
        return ()
    rows = zip(
        clock.times(table).tolist(), table.position.tolist(), table.columns["Mode"].tolist(), strict=True
    )
    return tuple(
        ModeChange(time_s=time, position=position, name=mode_name(mode, vehicle_type))
        for time, position, mode in rows
    )


def _dropped(tables: Mapping[str, MessageTable]) -> int:
    """Count the messages that the logger could not write: DSF.Dp counts up, PM.LogDrop per period."""
    status = tables.get("DSF")
    if status is not None and status.has_numbers("Dp"):
        counter = status.integers("Dp")
        return int(
            max(counter[0], 0) + np.clip(np.diff(counter), 0, None).sum()
        )  # a reboot resets the counter
    performance = tables.get("PM")
    if performance is not None and performance.has_numbers("LogDrop"):
        return int(np.clip(performance.integers("LogDrop"), 0, None).sum())
    return 0


def _counts(counts: Mapping[str, int], samples: Mapping[str, MessageTable]) -> tuple[MessageCount, ...]:
    """Return rows and mean rate of every message type, from its first and last time."""
    result = []
    for name, count in sorted(counts.items()):
        rate_hz = float("nan")
        table = samples.get(name)
        time = own_time(table) if table is not None else None
        if time is not None and count > 1 and time[-1] > time[0]:
            rate_hz = (count - 1) / float(time[-1] - time[0])
        result.append(MessageCount(name=name, count=count, rate_hz=rate_hz))
    return tuple(result)


def _with_nominal_rates(
    signals: Mapping[str, tuple[Signal, ...]], parameters: Mapping[str, float]
) -> dict[str, tuple[Signal, ...]]:
    """Add the rate that LOG_BITMASK promises for RATE and ANG."""
    bits = whole_number(parameters.get("LOG_BITMASK"))
    rate_hz = float("nan")
    if bits & _FAST_ATTITUDE:
        rate_hz = parameters.get("SCHED_LOOP_RATE", rate_hz)
    elif bits & _MEDIUM_ATTITUDE:
        rate_hz = _MEDIUM_HZ
    return {
        name: tuple(
            replace(each, nominal_rate_hz=rate_hz) if each.source.startswith(("RATE.", "ANG.")) else each
            for each in sources
        )
        for name, sources in signals.items()
    }


def _remarks(tables: Mapping[str, MessageTable], clock: LogClock, builder: SignalBuilder) -> tuple[str, ...]:
    """Say in words what had to be decided or assumed."""
    remarks = []
    if not clock.has_time:
        remarks.append("The rows of this log carry no time: firmware before 3.1 did not log it.")
    elif without := sorted(
        name for name in ("EV", "MODE", "MSG") if name in tables and own_time(tables[name]) is None
    ):
        remarks.append(
            f"{', '.join(without)} carry no time; they take that of the row before them in the file."
        )
    scale = builder.rate_scale
    if scale is not None and scale.evidence != "the log states the unit":
        remarks.append(f"RATE is taken as {scale.unit}: {scale.evidence}.")
    return tuple(remarks)
