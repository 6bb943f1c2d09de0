"""PX4's ULog as a `FlightLog`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.instants import instants
from quadid_logs.autopilots.modes import mode_changes
from quadid_logs.autopilots.px4.filters import ROTORS, parameter_filter
from quadid_logs.autopilots.px4.identity import (
    describe_frame,
    firmware_words,
    mode_names,
    n_cells,
    vehicle_type,
    version_of,
)
from quadid_logs.autopilots.px4.outer import TOPICS, position_rows
from quadid_logs.autopilots.px4.signals import INTEGRATORS, SOURCES, controller_terms, sample_time_s, signals
from quadid_logs.autopilots.sources import messages_of, stacked
from quadid_logs.autopilots.utc import utc_offset_s
from quadid_logs.containers.content import time_before
from quadid_logs.containers.ulog import UlogContent, read_content
from quadid_logs.counting import counted
from quadid_logs.data.log import FlightLog, LogText, ModeChange, ParameterChange, Signal
from quadid_logs.errors import EmptyLogError
from quadid_logs.sentences import listed

#: Receivers, with the time of day; the second since 1.14.
_RECEIVERS: Final = ("vehicle_gps_position", "sensor_gps")
_STATUS: Final = ("is_vtol", "system_type", "vehicle_type")
#: Topics that are named where none is known.
_NAMED: Final = 4


def read(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a ULog file into canonical signals.

    Raises
    ------
    EmptyLogError
        If the file holds no data message that can be read, or no topic that PX4 writes of a flight.
    """
    content = read_content(path, messages_of(SOURCES) | {*_RECEIVERS, INTEGRATORS} | TOPICS)
    if not content.counts:
        raise EmptyLogError(
            f"{path} begins like a ULog, but holds no readable data message.",
            hint="The file was cut off or its definitions are damaged. Copy it from the SD card again.",
        )
    if not content.topics:
        largest = sorted(content.counts, key=lambda one: -one.count)
        names = [*dict.fromkeys(one.name for one in largest)][:_NAMED]
        raise EmptyLogError(
            f"{path} holds no PX4 topic of a flight, only {listed(names)}.",
            hint=(
                "Another program wrote it, or it is not the log of a flight. Use another log, or export a "
                "table."
            ),
        )
    known = content.definitions
    found, seen = _signals(content)
    table = content.topics.get(("vehicle_status", 0))
    return FlightLog(
        path=str(path),
        format="ulog",
        autopilot="px4" if known.information.get("sys_name", "PX4") == "PX4" else "other",
        n_bytes=content.n_bytes,
        signals=found,
        followed=seen,
        firmware=firmware_words(known.information),
        vehicle_type=vehicle_type(
            known.parameters,
            {}
            if table is None
            else {field: int(table.rows[field][-1]) for field in _STATUS if table.has(field)},
        ),
        frame=describe_frame(known.parameters),
        # Every simulated vehicle has the same one.
        hardware_id="" if _is_simulated(content) else str(known.information.get("sys_uuid", "")),
        parameters=dict(known.parameters),
        parameter_changes=_parameter_changes(content),
        controller_terms=controller_terms(content.topics),
        position_control=position_rows(content.topics),
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
        n_cells=n_cells(known.parameters),
    )


def _signals(content: UlogContent) -> tuple[dict[str, tuple[Signal, ...]], dict[str, FloatArray]]:
    """Return the signals, and what the notches of the gyro may follow."""
    parameters = content.definitions.parameters
    known = parameter_filter(parameters)
    found = signals(content.topics, known)
    speed = next(iter(found.get("rotor_speed", ())), None)
    rows = np.zeros((0, 0)) if speed is None else instants(speed.values / (2.0 * math.pi))
    seen = {ROTORS: rows} if rows.size else {}
    tracked = parameter_filter(parameters, seen)
    # Only a log whose notches moved is gone through once more.
    return (found if tracked == known else signals(content.topics, tracked)), seen


def _utc_offset_s(content: UlogContent) -> float:
    """Return UTC minus the log's clock [s] as the receivers tell it."""
    for key, table in content.topics.items():
        if key[0] in _RECEIVERS and (utc_us := stacked(table, ("time_utc_usec",))) is not None:
            log_s = sample_time_s(table)
            if log_s is not None and math.isfinite(found := utc_offset_s(utc_us[:, 0] / 1e6, log_s)):
                return found
    return math.nan


def _parameter_changes(content: UlogContent) -> tuple[ParameterChange, ...]:
    """Return what was written with another value, at the time of the row before it in the file."""
    writes = [one for one in content.definitions.parameter_writes if one.value != one.before]
    if not writes or not content.topics:
        return ()
    longest = max(content.topics.values(), key=lambda table: len(table.position))
    known_s = sample_time_s(longest)
    if known_s is None:
        return ()
    positions = np.array([one.offset for one in writes], np.int64)
    times = time_before(positions, longest.position, known_s)
    return tuple(
        ParameterChange(time_s=time_s, position=one.offset, name=one.name, value=one.value, before=one.before)
        for one, time_s in zip(writes, times.tolist(), strict=True)
    )


def _modes(content: UlogContent) -> tuple[ModeChange, ...]:
    """Return where nav_state changes."""
    table = content.topics.get(("vehicle_status", 0))
    if table is None or not table.has("nav_state"):
        return ()
    time_s, names = sample_time_s(table), mode_names(version_of(content.definitions.information))
    if time_s is None:
        return ()
    return mode_changes(table.rows["nav_state"], time_s, table.position, names.get)


def _is_simulated(content: UlogContent) -> bool:
    return content.definitions.information.get("ver_hw") == "PX4_SITL"


def _remarks(content: UlogContent, system: int) -> tuple[str, ...]:
    """Say what was decided or assumed."""
    known = content.definitions
    remarks = []
    if known.dropouts:
        total_s = sum(dropout.duration_ms for dropout in known.dropouts) * 1e-3
        remarks.append(
            f"The logger reports {counted(len(known.dropouts), 'dropout')}, {total_s:.2f} s in total."
        )
    if known.parameter_writes:
        remarks.append(
            counted(len(known.parameter_writes), "parameter was", "parameters were")
            + " written while logging; the last value is used."
        )
    if content.n_joined:
        remarks.append(f"The file holds {content.n_joined + 1} logs joined together.")
    if content.n_unknown:
        remarks.append(
            counted(content.n_unknown, "message belongs", "messages belong")
            + " to no announced topic or is of unknown type."
        )
    if known.unknown_flags:
        remarks.append("The log says that it needs a newer reader. It was read anyway.")
    if _is_simulated(content) and ("esc_status", 0) in content.topics:
        remarks.append("This is a simulated flight: rotor speeds are derived from the commands.")
    if system:
        remarks.append("A ULog holds one vehicle, so --system has no effect.")
    return tuple(remarks)
