"""Write a FlightLog as the autopilot would have."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Final

from quadid_logs.data.log import FlightLog
from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.output import beside_prefix, remove_unfinished

__all__ = ["AUTOPILOT_OF_ENDING", "write_log"]

#: By ending that can be written: whose flight the file holds unless said otherwise, named as in
#: `FlightLog.autopilot`.
AUTOPILOT_OF_ENDING: Final[Mapping[str, str]] = MappingProxyType(
    {".bin": "ardupilot", ".ulg": "px4", ".bbl": "betaflight", ".tlog": "ardupilot", ".usd": "crazyflie"}
)
#: By ending: the module and its function.
_WRITERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        ".bin": "dataflash_writer:write_dataflash",
        ".ulg": "ulog_writer:write_ulog",
        ".bbl": "blackbox_writer:write_blackbox",
        ".tlog": "tlog_writer:write_tlog",
        ".usd": "usd_writer:write_usd",
    }
)


def write_log(log: FlightLog, path: Path) -> None:
    """Write a log in the format that the suffix names.

    The bytes depend on the FlightLog alone. They are written beside the
    target and renamed, so that an interrupted run leaves no half a log; an
    existing file is replaced.

    Parameters
    ----------
    log : FlightLog
        What to write. Series that the format has no message for are left out.
    path : Path
        Ends in ``.bin`` (ArduPilot DataFlash), ``.ulg`` (PX4 ULog), ``.bbl`` (Betaflight Blackbox),
        ``.tlog`` (MAVLink) or ``.usd`` (Crazyflie micro-SD, which has no suffix on the card).

    Raises
    ------
    SettingsError
        If the suffix is none of them.
    OutputError
        If the file cannot be written, or a row has no finite time.
    """
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise SettingsError(
            f"No log format has the suffix {path.suffix!r}.",
            hint="Use .bin, .ulg, .bbl, .tlog or .usd.",
        )
    module, function = writer.split(":")
    # Imported here: one format's writer never costs the time of the others.
    write = getattr(import_module(f"{__name__}.{module}"), function)
    remove_unfinished(path.parent)
    beside = path.with_name(f"{beside_prefix()}{path.name}")
    try:
        with beside.open("wb") as file:
            write(log, file)
        beside.replace(path)
    except OSError as error:
        raise OutputError(
            f"{path} cannot be written: {error.strerror or error}.",
            hint="Check that the folder exists, is writable and has room.",
        ) from error
    finally:
        beside.unlink(missing_ok=True)
