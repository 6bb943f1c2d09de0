"""The endings of log files that can be written, and whose flight one holds unless said otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

#: By ending: the autopilot, named as in `FlightLog.autopilot`.
AUTOPILOT_OF_ENDING: Final[Mapping[str, str]] = MappingProxyType(
    {".bin": "ardupilot", ".ulg": "px4", ".bbl": "betaflight", ".tlog": "ardupilot", ".usd": "crazyflie"}
)
