"""The store: a folder of Parquet files, one per log, in a folder per vehicle.

::

    STORE/fleet.json                              how it was made
    STORE/vehicle=quad-07/<sha256>-<version>.parquet
    STORE/reports/<sha256>-<flight>.html

A file appears by being renamed, whole, so that a run can be killed at any
moment. Only one run may write into a store.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleet.options import Options
from quadid_logs.fleet.rows import LOST, schema
from quadid_logs.fleet.sources import Source
from quadid_logs.fleet.tasks import Outcome
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__

if TYPE_CHECKING:
    import pyarrow.dataset as pads

DESCRIPTION, REPORTS = "fleet.json", "reports"
_FORMAT = 1
_PART = ".part"
#: Longest name of a folder [bytes]: file systems allow 255.
_LONGEST = 120


@dataclass(frozen=True, slots=True)
class _Entry:
    """What the store holds about one file."""

    path: Path
    url: str
    n_bytes: int
    done: bool


class Store:
    """A store that one run writes into."""

    def __init__(self, folder: Path, options: Options, *, resume: bool) -> None:
        """Open a store, or make it.

        Raises
        ------
        OutputError
            If the folder holds something and `resume` is not set, or cannot be written.
        SettingsError
            If it was made with other options.
        """
        self.folder = folder
        self._entries: dict[str, _Entry] = {}
        self._by_size: dict[int, list[str]] = {}
        try:
            self._open(options, resume=resume)
        except OSError as error:
            raise OutputError(f"{printable(folder)} cannot be written: {error.strerror or error}.") from error

    def _open(self, options: Options, *, resume: bool) -> None:
        """Check or write the description, remove what a killed run left, take stock."""
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            if not (self.folder / DESCRIPTION).is_file():
                raise OutputError(
                    f"{printable(self.folder)} exists and is no store.", hint="Choose another -o."
                )
            if not resume:
                raise OutputError(
                    f"{printable(self.folder)} exists already.", hint="Add --resume to add what is missing."
                )
            check_options(self.folder, options)
            for part in self.folder.rglob(f".*{_PART}"):
                part.unlink(missing_ok=True)
        self.folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"format": _FORMAT, **options.fingerprint()}, indent=1) + "\n"
        _write(self.folder / DESCRIPTION, text.encode())
        for row in _stock(self.folder):
            entry = _Entry(Path(row["__filename"]), row["url"], row["n_bytes"], _is_done(row))
            self._entries[_key(row["sha256"], row["url"])] = entry
            if entry.done:
                self._by_size.setdefault(entry.n_bytes, []).append(row["sha256"])

    def known(self, source: Source) -> tuple[str, ...]:
        """Return the hashes that a file of this size may have so that nothing is left to do."""
        return tuple(self._by_size.get(source.n_bytes, ()))

    def take(self, outcome: Outcome) -> bool:
        """Write the rows of a log, in the place of whatever the store held about it.

        Of two files with the same content the first by name stays, in whatever
        order they come, so that every run ends with the same store.

        Returns
        -------
        bool
            False if the content is known under a later name: analyze it again, for the first.
        """
        key = _key(outcome.sha256, outcome.source.url)
        old = self._entries.get(key)
        if outcome.is_known:
            return old is None or old.url <= outcome.source.url
        if old is not None and old.done and old.url < outcome.source.url:
            return True
        path = self.folder / partition(outcome.vehicle) / f"{key}-{partition_safe(__version__)}.parquet"
        try:
            for flight, page in outcome.reports.items():
                _write(self.folder / REPORTS / f"{key}-{flight}.html", gzip.decompress(page))
            _write(path, outcome.table)
            self._forget(old, path)
            self._forget(self._entries.pop(_key("", outcome.source.url), None), path)
        except OSError as error:
            raise OutputError(f"{printable(path)} cannot be written: {error.strerror or error}.") from error
        done = outcome.status != LOST
        self._entries[key] = _Entry(path, outcome.source.url, outcome.source.n_bytes, done)
        return True

    def _forget(self, old: _Entry | None, path: Path) -> None:
        """Remove an older file about the same log."""
        if old is not None and old.path != path:
            old.path.unlink(missing_ok=True)


def _key(sha256: str, url: str) -> str:
    """Name a log by its content, or by its place where that was never seen."""
    return sha256 or f"lost-{hashlib.sha256(url.encode('utf-8', 'replace')).hexdigest()[:32]}"


def _is_done(row: dict[str, Any]) -> bool:
    return bool(row["status"] != LOST and row["version"] == __version__)


def partition(vehicle: str) -> str:
    r"""Return the folder of a vehicle; a hostile name leads nowhere else.

    >>> partition("../../etc\x00/x")
    'vehicle=%2E%2E%2F%2E%2E%2Fetc%00%2Fx'
    """
    return f"vehicle={partition_safe(vehicle)}"


def partition_safe(name: str) -> str:
    """Escape all but letters, digits, ``_``, ``-`` and single inner dots; a hash ends what is too long."""
    escaped = re.sub(
        rb"[^A-Za-z0-9_.-]|\.(?=\.)|^\.|(?<=\.)\.|\.$",
        lambda match: b"".join(b"%%%02X" % byte for byte in match[0]),
        name.encode("utf-8", "replace"),
    ).decode()
    if len(escaped) <= _LONGEST:
        return escaped or "%"
    return f"{escaped[: _LONGEST - 17]}-{hashlib.sha256(name.encode('utf-8', 'replace')).hexdigest()[:16]}"


def _write(path: Path, content: bytes) -> None:
    """Write a file beside its place, through to the disk, and rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}{_PART}")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def check_store(folder: Path) -> None:
    """Refuse what is no store.

    Raises
    ------
    SettingsError
    """
    if not (folder / DESCRIPTION).is_file():
        raise SettingsError(
            f"{printable(folder)} is no store of a fleet.",
            hint="Make one with: quadid-log fleet LOGS -o STORE",
        )


def check_options(folder: Path, options: Options) -> None:
    """Refuse to mix numbers that were made differently.

    Raises
    ------
    SettingsError
    """
    try:
        made = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    except ValueError as error:
        raise SettingsError(
            f"{printable(folder / DESCRIPTION)} is damaged.", hint="Choose another -o."
        ) from error
    for name, value in options.fingerprint().items():
        if made.get(name) != value:
            raise SettingsError(
                f"The store was made with another {name}: {printable(made.get(name))!r}, not {value!r}.",
                hint="Give the same options, or choose another -o.",
            )


def dataset(folder: Path) -> pads.Dataset:
    """Return the rows of a store, not yet read.

    Raises
    ------
    SettingsError
        If the folder is no store.
    """
    import pyarrow.dataset as pads

    files = [str(path) for files in files_by_vehicle(folder) for path in files]
    return pads.dataset(files, schema=schema(), format="parquet")


def files_by_vehicle(folder: Path) -> Iterator[list[Path]]:
    """Yield the files of one vehicle after the other.

    Raises
    ------
    SettingsError
        If the folder is no store.
    """
    check_store(folder)
    for vehicle in sorted(folder.glob("vehicle=*")):
        yield sorted(path for path in vehicle.glob("*.parquet") if not path.name.startswith("."))


def rows_of(files: Iterable[Path], columns: Iterable[str]) -> list[dict[str, Any]]:
    """Read some columns of some files of a store."""
    import pyarrow.dataset as pads

    read = pads.dataset([str(path) for path in files], schema=schema(), format="parquet")
    rows: list[dict[str, Any]] = read.to_table(columns=list(columns)).to_pylist()
    return rows


def _stock(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield one row per file of the store."""
    columns = ["__filename", "sha256", "url", "n_bytes", "status", "version"]
    for files in files_by_vehicle(folder):
        yield from {row["__filename"]: row for row in rows_of(files, columns)}.values()
