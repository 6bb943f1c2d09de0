"""Open any flight log: the content decides the format, never the name of the file.

This package is the only place that knows vendors' names. Each format is a
module with ``is_mine(head)`` and ``read(path, system=0)``.
"""

from __future__ import annotations

import importlib
import struct
from pathlib import Path
from typing import Final, Protocol, cast

import numpy as np

from quadid_logs.containers.foreign import explain_foreign
from quadid_logs.data.log import FlightLog
from quadid_logs.errors import EmptyLogError, LogNotFoundError, UnknownFormatError

#: In the order in which they are asked: sdlog2 shares the magic bytes of
#: dataflash, and the text formats come last because they are the least strict.
_FORMATS: Final = (
    "containers.ulog",
    "autopilots.px4.sdlog2",
    "containers.dataflash",
    "containers.tlog",
    "containers.dataflash_text",
    "containers.table",
)
_HEAD_BYTES: Final = 1 << 16


class _Reader(Protocol):
    """What every module of a format offers."""

    def is_mine(self, head: bytes) -> bool:
        """Tell whether a file that begins with `head` is of this format."""

    def read(self, path: str | Path, *, system: int = 0) -> FlightLog:
        """Read the file."""


def read_log(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a flight log of any known format.

    Parameters
    ----------
    path : str or Path
        DataFlash binary or text, PX4 ULog or sdlog2, MAVLink telemetry, CSV or
        Parquet table; the content decides.
    system : int
        MAVLink system to read from a telemetry log; 0 chooses the autopilot.

    Returns
    -------
    FlightLog
        Signals under canonical names in file order, and what was lost.

    Raises
    ------
    LogNotFoundError
        If there is no readable regular file at the path.
    EmptyLogError
        If the file is empty, or holds nothing usable.
    UnknownFormatError
        If the content is no log that we know; the hint says what it looks like.
    SettingsError
        If `system` is not in the file.
    """
    head = _read_head(Path(path))
    if not head:
        raise EmptyLogError(
            f"{path} is empty (0 bytes).",
            hint="Download the log again; logs are only complete after disarming.",
        )
    for name in _FORMATS:
        reader = cast("_Reader", importlib.import_module(f"quadid_logs.{name}"))
        if reader.is_mine(head):
            return _read_with(reader, path, system)
    raise UnknownFormatError(f"{path} is no flight log that we know.", hint=explain_foreign(head))


def _read_head(path: Path) -> bytes:
    """Return the file's first bytes."""
    try:
        if path.exists() and not path.is_file():
            kind = "a directory" if path.is_dir() else "no regular file"
            raise LogNotFoundError(f"{path} is {kind}.", hint="Give the path of one log file.")
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except FileNotFoundError as error:
        raise LogNotFoundError(f"There is no file {path}.", hint="Check the path.") from error
    except (OSError, ValueError) as error:
        # ValueError: a path with a null character.
        raise LogNotFoundError(
            f"{path} cannot be read: {error}.", hint="Check path and permissions."
        ) from error


def _read_with(reader: _Reader, path: str | Path, system: int) -> FlightLog:
    """Read, and turn what damage can make of the bytes into one clear error."""
    try:
        # Damaged numbers may be signalling NaN or near overflow: they pass on as NaN or infinity, silently.
        with np.errstate(invalid="ignore", over="ignore"):
            return reader.read(path, system=system)
    except OSError as error:
        raise LogNotFoundError(
            f"{path} cannot be read: {error}.", hint="Check the disk and try again."
        ) from error
    except (struct.error, UnicodeError, IndexError, KeyError, OverflowError) as error:
        raise UnknownFormatError(
            f"{path} is damaged in a way that stops the reader ({type(error).__name__}: {error}).",
            hint="Please report it with the log.",
        ) from error
