"""Where a result comes from, so that it can be made again."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from quadid_logs.version import __version__

#: Characters of a command line with several logs and their folders: nothing of it may be cut off.
LONGEST_COMMAND: Final = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Version, command line, and SHA-256 of the log ("" where it cannot be read any more)."""

    version: str
    command: str
    log_sha256: str


def provenance_of(log_path: str | Path, command: str = "") -> Provenance:
    """Hash the log file and note the version.

    Parameters
    ----------
    log_path : str or Path
    command : str
        The command line as it was given.

    Returns
    -------
    Provenance
    """
    try:
        with Path(log_path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        digest = ""
    return Provenance(version=__version__, command=command, log_sha256=digest)
