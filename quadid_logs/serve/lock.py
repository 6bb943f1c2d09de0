"""One server per folder: a lock that ends with its process, however that ends."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.untrusted import printable

_FILE: Final = "serve.lock"


class FolderLock:
    """Held from its making to `release`, or to the end of the process."""

    def __init__(self, folder: Path, address: str) -> None:
        """Take the lock.

        Parameters
        ----------
        address : str
            Of the server, written into the file for whoever is refused.

        Raises
        ------
        SettingsError
            If another process holds it.
        OutputError
            If the file cannot be written.
        """
        path = folder / _FILE
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise OutputError(f"{printable(path)} cannot be written: {error.strerror}.") from error
        if not _taken(self._file):
            holder = os.pread(self._file, 200, 0).decode("utf-8", "replace") if hasattr(os, "pread") else ""
            os.close(self._file)
            raise SettingsError(
                f"Another server uses {printable(folder)}{f': {printable(holder)}' if holder else ''}.",
                hint="Use that server, end it, or choose another --store.",
            )
        os.ftruncate(self._file, 0)
        os.write(self._file, f"{address} (process {os.getpid()})".encode())

    def release(self) -> None:
        """Give the lock back."""
        os.close(self._file)


def _taken(file: int) -> bool:
    """Try to take the lock of an open file."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
