"""Crazyflie's micro-SD logs as a `FlightLog`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.autopilots.crazyflie.signals import GYRO_FILTER, SOURCES
from quadid_logs.autopilots.sources import Part, build_signals, stacked
from quadid_logs.containers.content import mean_rate_hz
from quadid_logs.containers.usd import EventTable, read_usd
from quadid_logs.data.log import FlightLog, MessageCount, Rows
from quadid_logs.vocabulary import MULTIROTOR

#: By controller, what it commands; the firmware runs one of them, and the variables of the others rest.
_CONTROLLERS: Final = {
    "Lee": ("ctrlLee.torquex", "ctrlLee.torquey"),
    "PID": ("controller.cmd_roll", "controller.cmd_pitch"),
    "Mellinger": ("ctrlMel.cmd_roll", "ctrlMel.cmd_pitch"),
    "INDI": ("ctrlINDI.cmd_roll", "ctrlINDI.cmd_pitch"),
}


def read(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a micro-SD log of a Crazyflie into canonical signals.

    Returns
    -------
    FlightLog
        The remarks say which controller flew.

    Raises
    ------
    UnknownFormatError, EmptyLogError, LogError, OSError
        As `read_usd`.
    """
    content = read_usd(path)
    # Events with many rows first: where two hold the same variables, the faster one is preferred.
    tables = sorted(content.tables.values(), key=lambda table: -len(table.position))
    parts = [Part(name=table.name, table=table, rows=Rows(table.time_s, table.position)) for table in tables]
    # Say what was decided or assumed.
    remarks = []
    flown = controllers_of(list(content.tables.values()))
    if flown:
        remarks.append(f"The {' and the '.join(flown)} controller flew: its variables change in flight.")
    else:
        remarks.append("The log does not show which controller flew.")
    if system:
        remarks.append("A micro-SD log holds one vehicle, so --system has no effect.")
    return FlightLog(
        path=str(path),
        format="usd",
        autopilot="crazyflie",
        n_bytes=content.n_bytes,
        signals=build_signals(SOURCES, lambda _: parts, gyro_filter=GYRO_FILTER),
        vehicle_type=MULTIROTOR,
        lost=content.lost,
        checksum_wrong=content.checksum_wrong,
        counts=tuple(
            MessageCount(
                name=table.name,
                count=len(table.position),
                rate_hz=mean_rate_hz(len(table.position), table.time_s),
            )
            for table in tables
        ),
        remarks=tuple(remarks),
    )


def controllers_of(tables: list[EventTable]) -> list[str]:
    """Return the controllers whose commands move."""
    logged = {name: [stacked(table, fields) for table in tables] for name, fields in _CONTROLLERS.items()}
    return [
        name
        for name, found in logged.items()
        if any(values is not None and np.any(values != values[:1]) for values in found)
    ]
