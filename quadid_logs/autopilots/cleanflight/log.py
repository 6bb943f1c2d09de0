"""Cleanflight's Blackbox as a `FlightLog`.

Source: ``blackbox.c``, ``pid.c`` and ``mixer.c`` of April 2016. The gyro is in counts of the sensor, and PID
sums, throttle and outputs are in microseconds. The header holds neither rates nor gains: what a stick asks
for follows from what P is made of. Version 2 was made of Betaflight's code of 2017, whose header it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from quadid_logs.arrays import BoolArray
from quadid_logs.autopilots.betaflight.dialect import Dialect, Version, common_settings, fields_of
from quadid_logs.autopilots.betaflight.log import read_dialect
from quadid_logs.autopilots.betaflight.signals import SOURCES, Facts
from quadid_logs.containers.blackbox import FrameTable
from quadid_logs.containers.blackbox_header import Header
from quadid_logs.data.log import FlightLog

#: Betaflight of the same year.
_SECOND: Final = (3, 2)


def read(path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
    """Read a Blackbox log of Cleanflight into canonical signals; as `read_dialect` of Betaflight's."""
    return read_dialect(DIALECT, path, system=system, number=number)


def _settings(settings: Mapping[str, float], version: Version | None) -> dict[str, float]:
    return common_settings(settings, None if version is None else _SECOND)


def _facts(
    header: Header,
    settings: Mapping[str, float],
    version: Version | None,
    main: FrameTable,
    levels: BoolArray,
) -> Facts:
    return Facts.of(header, settings, None if version is None else _SECOND, main, levels)


DIALECT: Final = Dialect(
    autopilot="cleanflight",
    name="Cleanflight",
    sources=SOURCES,
    fields=fields_of(SOURCES),
    settings=_settings,
    facts=_facts,
)
