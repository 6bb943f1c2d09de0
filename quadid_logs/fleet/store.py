"""The store that a run writes into; `files` says what lies where."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleet.files import (
    DESCRIPTION,
    LOST_PREFIX,
    PART,
    REPORTS,
    key_of,
    own_files,
    partition,
    partition_safe,
    rows_by_vehicle,
    write_whole,
)
from quadid_logs.fleet.options import Options
from quadid_logs.fleet.rows import LOST
from quadid_logs.fleet.sources import Source
from quadid_logs.fleet.tasks import Outcome
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__

_FORMAT = 1


@dataclass(frozen=True, slots=True)
class _Entry:
    """What the store holds about one log; `path` is its own file, if it has one."""

    path: Path | None
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
            for part in self.folder.rglob(f".*{PART}"):
                part.unlink(missing_ok=True)
        self.folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"format": _FORMAT, **options.fingerprint()}, indent=1) + "\n"
        write_whole(self.folder / DESCRIPTION, text.encode())
        own = {key_of(path): path for path in own_files(self.folder)}
        for key, row in _stock(self.folder):
            entry = _Entry(own.get(key), row["url"], row["n_bytes"], _is_done(row))
            self._entries[key] = entry
            if entry.done:
                self._by_size.setdefault(entry.n_bytes, []).append(key)

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
                write_whole(self.folder / REPORTS / f"{key}-{flight}.html", gzip.decompress(page))
            write_whole(path, outcome.table)
            self._forget(old, path)
            self._forget(self._entries.pop(_key("", outcome.source.url), None), path)
        except OSError as error:
            raise OutputError(f"{printable(path)} cannot be written: {error.strerror or error}.") from error
        done = outcome.status != LOST
        self._entries[key] = _Entry(path, outcome.source.url, outcome.source.n_bytes, done)
        return True

    def _forget(self, old: _Entry | None, path: Path) -> None:
        """Remove an older file about the same log; elsewhere its rows do not count any more."""
        if old is not None and old.path is not None and old.path != path:
            old.path.unlink(missing_ok=True)


def _key(sha256: str, url: str) -> str:
    """Name a log by its content, or by its place where that was never seen."""
    return sha256 or f"{LOST_PREFIX}{hashlib.sha256(url.encode('utf-8', 'replace')).hexdigest()[:32]}"


def _is_done(row: dict[str, Any]) -> bool:
    return bool(row["status"] != LOST and row["version"] == __version__)


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


def _stock(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield one row per log of the store, and the log's name."""
    for rows in rows_by_vehicle(folder, ["sha256", "url", "n_bytes", "status", "version"]):
        yield from {_key(row["sha256"], row["url"]): row for row in rows}.items()
