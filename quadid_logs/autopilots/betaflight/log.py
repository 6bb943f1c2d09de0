"""Betaflight's Blackbox as a `FlightLog`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.filters import measured_filter, settings_filter
from quadid_logs.autopilots.betaflight.signals import FIELDS, SOURCES, Facts
from quadid_logs.autopilots.sources import Part, Source, build_signals, stacked
from quadid_logs.containers.blackbox import BlackboxContent, FrameTable, read_content
from quadid_logs.containers.content import mean_rate_hz
from quadid_logs.data.log import FlightLog, GyroFilter, MessageCount, Rows, Signal
from quadid_logs.errors import EmptyLogError, UnknownFormatError
from quadid_logs.vocabulary import MULTIROTOR

#: "Betaflight 2025.12.2 (79065c96b) STM32F7X2"; firmware of the same family writes its own name there.
_REVISION: Final = re.compile(r"\s*(\w{1,20})\s+(\d\S{0,30})(.{0,80})")
_NUMBER: Final = re.compile(r"-?\d{1,10}(?:\.\d{1,10})?$")
_KINDS: Final = {"I": "main", "S": "slow", "H": "GPS home", "G": "GPS"}
_WORD: Final = 1 << 32


def read(path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
    """Read a Blackbox log into canonical signals.

    Parameters
    ----------
    path : str or Path
    system : int
        Has no effect: a Blackbox log holds one vehicle.
    number : int
        Which log of the file, from 1; 0 takes the only one that holds frames.

    Returns
    -------
    FlightLog

    Raises
    ------
    UnknownFormatError
        If the header is damaged, or the log is of another firmware.
    EmptyLogError
        If the log holds no frame that can be read.
    SettingsError, SeveralLogsError
        If there is no such log, or several and none was chosen.
    """
    content = read_content(path, FIELDS, number=number)
    header = content.header
    firmware = _firmware(path, header.texts.get("Firmware revision", ""))
    main = content.tables["I"]
    if not len(main.position):
        raise EmptyLogError(
            f"{path} begins as a Blackbox log, but holds no frame that can be read.",
            hint="The copter was disarmed at once, or the file is cut off; choose another log.",
        )
    settings = settings_of(header.texts)
    time_s = _time_s(main)
    return FlightLog(
        path=str(path),
        format="blackbox",
        autopilot="betaflight",
        n_bytes=content.n_bytes,
        signals=_signals(content, settings, time_s),
        firmware=firmware,
        vehicle_type=MULTIROTOR,
        vehicle_name=header.texts.get("Craft name", "").strip(),
        hardware_id=header.texts.get("DeviceUID", "").strip(),
        parameters=settings,
        lost=content.lost,
        counts=_counts(content, time_s),
        utc_offset_s=_utc_offset_s(header.texts.get("Log start datetime", ""), time_s),
        remarks=_remarks(content, system),
    )


def _firmware(path: str | Path, revision: str) -> str:
    """Return name and version; firmware whose fields and mixer differ is refused by its name."""
    match = _REVISION.match(revision)
    if match is None or match[1] != "Betaflight":
        name = match[1] if match else "an unknown firmware"
        raise UnknownFormatError(
            f"{path} is a Blackbox log of {name}, not of Betaflight.",
            hint="Its fields have other scales and signs: export them to a table in SI units.",
        )
    return f"{match[1]} v{match[2]}{match[3]}".strip()


def settings_of(texts: Mapping[str, str]) -> dict[str, float]:
    """Return the numbers of a header; those of a list by name and place, as ``rollPID[0]``.

    Parameters
    ----------
    texts : mapping of str to str

    Returns
    -------
    dict of str to float
    """
    found: dict[str, float] = {}
    for name, text in texts.items():
        if name.startswith("Field "):
            continue
        cells = [cell.strip() for cell in text.split(",")]
        if all(map(_NUMBER.match, cells)):
            names = [name] if len(cells) == 1 else [f"{name}[{k}]" for k in range(len(cells))]
            found |= dict(zip(names, map(float, cells), strict=True))
    return found


def _time_s(main: FrameTable) -> FloatArray:
    """Return the time of each frame [s]; the firmware's clock of 32 bits begins anew every 71 minutes."""
    time_us = main.columns["time"].astype(np.int32).view(np.uint32).astype(np.int64)
    turns = np.cumsum(np.diff(time_us, prepend=time_us[:1]) < -(_WORD // 2))
    return np.asarray((time_us + turns * _WORD) / 1e6)


def _signals(
    content: BlackboxContent, settings: Mapping[str, float], time_s: FloatArray
) -> dict[str, tuple[Signal, ...]]:
    """Make the signals of the main frames, whose fields are gone afterwards."""
    main = content.tables["I"]
    part = Part(name="main", table=main, rows=Rows(time_s, main.position), log=Facts.of(content.header))
    known = _measured_filter(main, time_s) or settings_filter(settings, _rotor_hz(part))

    def parts_of(source: Source[Part[FrameTable]]) -> Iterator[Part[FrameTable]]:
        """Yield the frames, and forget the fields that the signal was made of: none makes two."""
        yield part
        for field in (*source.fields, *source.optional):
            main.let_go(field)

    return build_signals(SOURCES, parts_of, gyro_filter=known)


def _measured_filter(main: FrameTable, time_s: FloatArray) -> GyroFilter | None:
    """Compare the gyro before and behind its filters, where both are logged."""
    filtered, unfiltered = (
        stacked(main, [f"{name}[{axis}]" for axis in range(3)], dtype=np.float32)
        for name in ("gyroADC", "gyroUnfilt")
    )
    if filtered is None or unfiltered is None or len(time_s) < 2:
        return None
    return measured_filter(filtered, unfiltered, float(np.median(np.diff(time_s))))


def _rotor_hz(part: Part[FrameTable]) -> float:
    """Return the mean speed of the rotors [Hz], NaN where it is not logged."""
    speed = next(source for source in SOURCES if source.signal == "rotor_speed")
    values = speed.build(part, speed)
    return float(np.mean(values)) / (2.0 * math.pi) if isinstance(values, np.ndarray) else math.nan


def _counts(content: BlackboxContent, time_s: FloatArray) -> tuple[MessageCount, ...]:
    """List the kinds of frames; only the main ones have a time."""
    return tuple(
        MessageCount(
            name=_KINDS[letter],
            count=len(table.position),
            rate_hz=mean_rate_hz(len(time_s), time_s) if letter == "I" else math.nan,
        )
        for letter, table in content.tables.items()
    )


def _utc_offset_s(start: str, time_s: FloatArray) -> float:
    """Return UTC minus the log's clock [s]; the year is 0 where the clock was never set."""
    try:
        began = datetime.fromisoformat(start.strip())
    except ValueError:
        return math.nan
    return began.timestamp() - float(time_s[0]) if began.year > 2001 and began.tzinfo else math.nan


def _remarks(content: BlackboxContent, system: int) -> tuple[str, ...]:
    """Say what was decided or assumed."""
    remarks = []
    if len(content.starts) > 1:
        remarks.append(f"The file holds {len(content.starts)} logs; this is log {content.number}.")
    if system:
        remarks.append("A Blackbox log holds one vehicle: the chosen system was not needed.")
    return tuple(remarks)
