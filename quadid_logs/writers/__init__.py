"""Write a FlightLog as the autopilot would have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from quadid_logs.data.log import FlightLog
from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.output import beside_prefix, remove_unfinished

__all__ = ["write_log"]


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
    write = _writer(path.suffix)
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


def _writer(suffix: str) -> Callable[[FlightLog, BinaryIO], None]:
    """Return the function that writes the format of a file name's suffix."""
    # Imported here: one format's writer never costs the time of the others.
    if suffix.lower() == ".bin":
        from quadid_logs.writers.dataflash_writer import write_dataflash

        return write_dataflash
    if suffix.lower() == ".ulg":
        from quadid_logs.writers.ulog_writer import write_ulog

        return write_ulog
    if suffix.lower() == ".tlog":
        from quadid_logs.writers.tlog_writer import write_tlog

        return write_tlog
    if suffix.lower() == ".bbl":
        from quadid_logs.writers.blackbox_writer import write_blackbox

        return write_blackbox
    if suffix.lower() == ".usd":
        from quadid_logs.writers.usd_writer import write_usd

        return write_usd
    raise SettingsError(
        f"No log format has the suffix {suffix!r}.", hint="Use .bin, .ulg, .bbl, .tlog or .usd."
    )
