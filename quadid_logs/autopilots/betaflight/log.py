"""Betaflight's Blackbox as a `FlightLog`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.dialect import BETAFLIGHT, Dialect, firmware_of, settings_of
from quadid_logs.autopilots.betaflight.filters import measured_filter, settings_filter
from quadid_logs.autopilots.betaflight.flight_modes import SELF_LEVELLING, flight_modes
from quadid_logs.autopilots.betaflight.signals import Facts, cuts_terms
from quadid_logs.autopilots.betaflight.terms import controller_terms
from quadid_logs.autopilots.modes import in_modes
from quadid_logs.autopilots.sources import Part, Source, build_signals, stacked
from quadid_logs.containers.blackbox import BlackboxContent, FrameTable, read_content
from quadid_logs.containers.content import mean_rate_hz
from quadid_logs.data.log import (
    FlightLog,
    MessageCount,
    Rows,
    Signal,
)
from quadid_logs.errors import EmptyLogError, UnknownFormatError
from quadid_logs.vocabulary import AXES, MULTIROTOR

_KNOWN: Final = ("Betaflight", "Cleanflight", "INAV")
_OTHERS: Final = {
    "Rotorflight": "That firmware flies helicopters: their torque does not come from motor thrusts.",
    "Indiflight": (
        "That firmware controls accelerations by inversion (INDI): its logs hold no PID sums. Export a table "
        "in SI units with its own tools (indiflightSupport)."
    ),
}
_KINDS: Final = {"I": "main", "S": "slow", "H": "GPS home", "G": "GPS"}
_WORD: Final = 1 << 32
#: Bytes of a number of variable length, at most.
_LONGEST_NUMBER: Final = 5

#: Target of the firmware that flies a simulated vehicle, the last word of its revision.
_SIMULATOR: Final = " SITL"


def read(path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
    """Read a Blackbox log of Betaflight into canonical signals; as `read_dialect`."""
    return read_dialect(BETAFLIGHT, path, system=system, number=number)


def read_dialect(dialect: Dialect, path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
    """Read a Blackbox log into canonical signals.

    Parameters
    ----------
    system : int
        Has no effect: a Blackbox log holds one vehicle.
    number : int
        Which log of the file, from 1; 0 takes the only one that holds frames.

    Raises
    ------
    UnknownFormatError
        If the header is damaged, or the log is of another firmware.
    EmptyLogError
        If the log holds no frame that can be read.
    SettingsError, SeveralLogsError
        If there is no such log, or several and none was chosen.
    """
    content = read_content(
        path, dialect.fields_of, number=number, accept=partial(_refuse_others, path, dialect)
    )
    header = content.header
    main = content.tables["I"]
    if not len(main.position):
        # More than the longest frame that the header describes is no log that ended at once.
        n_unread = sum(part.n_bytes for part in content.lost)
        if n_unread > _LONGEST_NUMBER * len(header.layouts["I"].names):
            why = "Its data are not written as its header says: the file is damaged. Download it again."
        else:
            why = "The vehicle was disarmed at once, or the file is cut off. Choose another log."
        raise EmptyLogError(
            f"{path} begins like a Blackbox log, but holds no readable frame.",
            hint=why,
        )
    firmware = firmware_of(header.texts)
    settings = dialect.settings(settings_of(header.texts), firmware.version)
    # The firmware's clock of 32 bits begins anew every 71 minutes.
    time_us = main.columns["time"].astype(np.int32).view(np.uint32).astype(np.int64)
    turns = np.cumsum(np.diff(time_us, prepend=time_us[:1]) < -(_WORD // 2))
    rows = Rows(np.asarray((time_us + turns * _WORD) / 1e6), main.position)
    modes = flight_modes(content.tables.get("S"), rows)
    levels = in_modes(modes, SELF_LEVELLING, rows.time_s)
    facts = dialect.facts(header, settings, firmware.version, main, levels)
    terms = controller_terms(main, rows, cut=cuts_terms(header.texts))
    # The processor's id; every simulated vehicle has the same, which tells nothing.
    is_simulated = header.texts.get("Firmware revision", "").rstrip().endswith(_SIMULATOR)
    # What the vehicle is by its motors; builds for wings log S terms.
    fields = header.layouts["I"].names
    if any(field.startswith("axisS[") for field in fields):
        vehicle_type = "fixed-wing" if "motor[0]" in fields else "unknown"
    elif "motor[2]" in fields or "eRPM[2]" in fields:  # outputs can be left out, and the rotors still report
        vehicle_type = MULTIROTOR
    else:
        vehicle_type = "fixed-wing" if "motor[0]" in fields and "motor[1]" not in fields else "unknown"
    # The axes that the chirp mode swept: since 2026.6 the second debug field, -1 outside of a run.
    debug = stacked(main, ("debug[1]", "debug[2]", "debug[3]"), dtype=np.float32)
    numbers = debug[:, 0] if debug is not None and debug.any() else np.zeros(0)
    swept_axes = tuple(axis for number, axis in enumerate(AXES) if (numbers == number).any())
    signals = _signals(dialect, content, settings, rows, facts)
    remarks = []
    if len(content.starts) > 1:
        remarks.append(f"The file holds {len(content.starts)} logs. This is log {content.number}.")
    if system:
        remarks.append("A Blackbox log holds one vehicle, so --system has no effect.")
    if not facts.has_set_points and facts.levels.any():
        remarks.append(
            "In angle and horizon mode the sticks command angles: rate set-points are not known there."
        )
    return FlightLog(
        path=str(path),
        format="blackbox",
        autopilot=dialect.autopilot,
        n_bytes=content.n_bytes,
        signals=signals,
        swept_axes=swept_axes if "sysid_chirp" in signals else (),
        firmware=firmware.title,
        vehicle_type=vehicle_type,
        vehicle_name=header.texts.get("Craft name", "").strip(),
        hardware_id="" if is_simulated else header.texts.get("DeviceUID", "").strip(),
        parameters=settings,
        lost=content.lost,
        controller_terms=terms,
        modes=modes,
        counts=tuple(
            MessageCount(
                name=_KINDS[letter],
                count=len(table.position),
                rate_hz=mean_rate_hz(len(rows.time_s), rows.time_s) if letter == "I" else math.nan,
            )
            for letter, table in content.tables.items()
        ),
        utc_offset_s=_utc_offset_s(header.texts.get("Log start datetime", ""), rows.time_s),
        remarks=tuple(remarks),
    )


def _refuse_others(path: str | Path, dialect: Dialect, texts: Mapping[str, str]) -> None:
    """Refuse, by its name, firmware whose fields and mixer differ."""
    name = firmware_of(texts).name
    if name == dialect.name:
        return
    if not name:
        raise UnknownFormatError(
            f"{path} is a Blackbox log whose header names no firmware.",
            hint=(
                "If the file was cut off, fetch it again from the vehicle. Otherwise export a table in SI "
                "units."
            ),
        )
    hint = _OTHERS.get(name, "Its fields may have other scales and signs. Export a table in SI units.")
    if name in _KNOWN:
        hint = "The first log of the file is from another firmware. Split the file."
    raise UnknownFormatError(f"{path} is a Blackbox log of {name}, not of {dialect.name}.", hint=hint)


def _signals(
    dialect: Dialect, content: BlackboxContent, settings: Mapping[str, float], rows: Rows, facts: Facts
) -> dict[str, tuple[Signal, ...]]:
    """Make the signals of the main frames, whose fields are gone afterwards."""
    main = content.tables["I"]
    part = Part(name="main", table=main, rows=rows, log=facts)
    filtered, unfiltered = (
        stacked(main, [f"{name}[{axis}]" for axis in range(3)], dtype=np.float32)
        for name in ("gyroADC", "debug" if facts.debug_is_gyro else dialect.unfiltered)
    )
    known = None
    if filtered is not None and unfiltered is not None and len(rows.time_s) > 1:
        known = measured_filter(filtered, unfiltered, float(np.median(np.diff(rows.time_s))))
    if known is None:
        speed = next((source for source in dialect.sources if source.signal == "rotor_speed"), None)
        values = None if speed is None else speed.build(part, speed)
        rotors_hz = (
            values.mean(axis=0, dtype=np.float64) / (2.0 * math.pi) if isinstance(values, np.ndarray) else ()
        )
        known = settings_filter(settings, [float(one) for one in rotors_hz])
    uses = Counter(field for source in dialect.sources for field in (*source.fields, *source.optional))

    def parts_of(source: Source[Part[FrameTable]]) -> Iterator[Part[FrameTable]]:
        """Yield the frames, and forget the fields that no other signal is made of."""
        yield part
        for field in (*source.fields, *source.optional):
            uses[field] -= 1
            if not uses[field]:
                main.let_go(field)

    return build_signals(dialect.sources, parts_of, gyro_filter=known)


def _utc_offset_s(start: str, time_s: FloatArray) -> float:
    """Return UTC minus the log's clock [s]; the year is 0 where the clock was never set."""
    try:
        began = datetime.fromisoformat(start.strip())
    except ValueError:
        return math.nan
    return began.timestamp() - float(time_s[0]) if began.year > 2001 and began.tzinfo else math.nan
