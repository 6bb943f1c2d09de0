"""The folder of a server: uploaded logs, the queue, the results, and a fleet's store of all flights.

::

    STORE/serve.lock                 held by the server that runs; says where it listens
    STORE/serve.sqlite               table entries: the queue and what became of it
    STORE/secret                     what cookies are made with
    STORE/uploads/                   not yet complete
    STORE/logs/<id>                  complete; the name is the content's hash, never one from outside
    STORE/work/<number>/             results that are being written
    STORE/results/<id>/              complete
    STORE/history/                   a fleet's store: `quadid-log fleet-report STORE/history` reads it

A result is moved into its place before the queue says that it is done, and
what the queue does not know is deleted at the next start: killed at any
moment, a server finds each log either waiting or with one complete result.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import sqlite3
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.store import Store as History
from quadid_logs.fleets.tasks import Outcome
from quadid_logs.output import check_no_link, make_folder
from quadid_logs.serve.entries import Entry, Kind, State
from quadid_logs.serve.jobs import Done
from quadid_logs.serve.lock import FolderLock
from quadid_logs.untrusted import printable

DATABASE: Final = "serve.sqlite"
#: The parts of the folder; what they hold and the table does not is deleted at the start.
UPLOADS, LOGS, WORK, RESULTS, HISTORY = "uploads", "logs", "work", "results", "history"
_SECRET: Final = "secret"  # noqa: S105 - the name of a file
_FORMAT: Final = "1"
_COLUMNS: Final = (
    "id", "kind", "name", "logs", "options", "n_bytes", "added_s", "state", "error", "summary", "n_begun",
)  # fmt: skip
_TABLE: Final = f"CREATE TABLE entries ({', '.join(_COLUMNS)}, PRIMARY KEY (id))"
#: What the owner calls a vehicle, by what its logs say.
_NAMES: Final = "CREATE TABLE IF NOT EXISTS names (found TEXT PRIMARY KEY, name TEXT NOT NULL)"
_UPSERT: Final = f"INSERT OR REPLACE INTO entries VALUES ({', '.join('?' * len(_COLUMNS))})"  # noqa: S608 - no values
#: A log that was begun so often and ended its server each time is not begun again by itself.
MOST_BEGUN: Final = 3


class ServeStore:
    """The folder of the one server that runs on it; a context manager. Any thread may call it."""

    def __init__(self, folder: Path, address: str = "") -> None:
        """Open the folder, or make it, and take up what a killed server left.

        Parameters
        ----------
        address : str
            Where the server listens, for whoever is refused.

        Raises
        ------
        SettingsError
            If another server has it, or it is damaged.
        OutputError
            If it is something else's, or cannot be written.
        """
        # Refuse a folder that holds something else: parts of it would be deleted.
        check_no_link(folder)
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{printable(folder)} is a file.", hint="Choose another --store.")
        if folder.is_dir() and any(folder.iterdir()) and not (folder / DATABASE).is_file():
            names = {path.name for path in folder.iterdir()}
            if not names <= {"serve.lock", UPLOADS, LOGS, WORK, RESULTS}:  # killed at its very first start
                raise OutputError(
                    f"{printable(folder)} exists and is not a store of `quadid-log serve`.",
                    hint="Choose another --store.",
                )
        self.folder = folder
        make_folder(folder)
        with _writing(folder):
            folder.chmod(0o700)
        self._guard = threading.RLock()
        self._lock = FolderLock(folder, address)
        try:
            with _writing(folder):
                for part in (UPLOADS, LOGS, WORK, RESULTS):
                    make_folder(self.folder / part)
                self._database = sqlite3.connect(
                    self.folder / DATABASE, isolation_level=None, check_same_thread=False
                )
                # What is deleted is overwritten, and no journal stays beside the file.
                self._database.execute("PRAGMA secure_delete = ON")
                if not self._database.execute("SELECT name FROM sqlite_master").fetchall():
                    self._database.execute(_TABLE)
                    self._database.execute(f"PRAGMA user_version = {_FORMAT}")
                self._database.execute(_NAMES)
                if str(self._database.execute("PRAGMA user_version").fetchone()[0]) != _FORMAT:
                    raise SettingsError(
                        f"{printable(self.folder)} was made by another version.",
                        hint="Choose another --store.",
                    )
                # Delete what is not complete, and put back into the queue what was running.
                entries = self.entries()
                for entry in entries.values():
                    if entry.state is State.RUNNING:
                        # Its server ended while it was being done.
                        if entry.n_begun < MOST_BEGUN:
                            resumed = replace(entry, state=State.QUEUED)
                        else:
                            reason = f"The server ended {entry.n_begun} times during this analysis."
                            resumed = replace(entry, state=State.FAILED, error=reason)
                        self.put(resumed)
                logs = {log for entry in entries.values() for log in entry.logs}
                done = {entry.id for entry in entries.values() if entry.state is State.DONE}
                for part, kept in ((UPLOADS, set()), (WORK, set()), (LOGS, logs), (RESULTS, done)):
                    for path in (self.folder / part).iterdir():
                        if path.name not in kept:
                            _delete(path)
                _make_private(self.folder)
        except BaseException:
            self._lock.release()
            raise

    def __enter__(self) -> ServeStore:
        return self

    def __exit__(self, *_error: object) -> None:
        with self._guard:
            self._database.close()
        self._lock.release()

    def secret(self) -> bytes:
        """Return 32 random bytes that no other user can read, the same at every start."""
        path = self.folder / _SECRET
        with _writing(self.folder):
            with contextlib.suppress(FileExistsError):
                file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                with os.fdopen(file, "wb") as opened:
                    opened.write(secrets.token_bytes(32))
            found = path.read_bytes()
        if len(found) != 32:
            raise SettingsError(f"{printable(path)} is damaged.", hint="Delete it, and start again.")
        return found

    def entries(self) -> dict[str, Entry]:
        """Return all entries by id, in the order in which they came."""
        with self._guard:
            rows = self._database.execute(
                f"SELECT {', '.join(_COLUMNS)} FROM entries ORDER BY added_s, id"  # noqa: S608 - our own names
            ).fetchall()
        return {row[0]: _decoded(dict(zip(_COLUMNS, row, strict=True))) for row in rows}

    def put(self, entry: Entry) -> None:
        """Write an entry in the place of what was known of it."""
        fields = (getattr(entry, name) for name in _COLUMNS)
        values = [json.dumps(one) if isinstance(one, (tuple, Mapping)) else one for one in fields]
        with self._guard, _writing(self.folder):
            self._database.execute(_UPSERT, values)

    def keep(self, entry: Entry, folder: Path, outcome: Outcome | None) -> None:
        """Take a complete result: into its place, into the history, and at last into the table.

        Parameters
        ----------
        folder : Path
            Where the result was written.
        outcome : Outcome or None
            What the history is to hold of it.
        """
        with self._guard, _writing(self.folder):
            _delete(self.result(entry.id))
            _make_private(folder)
            folder.replace(self.result(entry.id))
            if outcome is not None:
                with self._history() as history:
                    history.take(outcome)
                _make_private(self.history)
            self.put(entry)

    def named(self, done: Done) -> Done:
        """Return a result with the name that the owner gave the vehicle, if any."""
        found = done.summary.get("vehicle")
        name = ""
        if isinstance(found, str):
            with self._guard, _writing(self.folder):
                row = self._database.execute("SELECT name FROM names WHERE found = ?", (found,)).fetchone()
            name = str(row[0]) if row else ""
        if not name:
            return done
        outcome = done.outcome
        if outcome is not None:
            outcome = replace(outcome, rows=[{**row, "vehicle": name} for row in outcome.rows])
        return replace(done, summary={**done.summary, "vehicle": name}, outcome=outcome)

    def rename(self, vehicle: str, name: str) -> None:
        """Call a vehicle otherwise from now on, also in its history and for the logs to come."""
        with self._guard, _writing(self.folder):
            self._database.execute("UPDATE names SET name = ? WHERE name = ?", (name, vehicle))
            self._database.execute("INSERT OR REPLACE INTO names VALUES (?, ?)", (vehicle, name))
            if self.history.exists():
                with self._history() as history:
                    history.rename(vehicle, name)

    def forget(self, entry: Entry) -> None:
        """Delete everything about an entry: of a log its content, results and rows of the history, too."""
        with self._guard, _writing(self.folder):
            self._database.execute("DELETE FROM entries WHERE id = ?", (entry.id,))
            _delete(self.result(entry.id))
            if entry.kind is Kind.ANALYZE:
                _delete(self.log(entry.id))
                if (self.folder / HISTORY).exists():
                    with self._history() as history:
                        history.forget(entry.id)

    @property
    def history(self) -> Path:
        """The fleet's store; may not exist yet."""
        return self.folder / HISTORY

    def log(self, sha256: str) -> Path:
        """Return where a log lies."""
        return self.folder / LOGS / sha256

    def result(self, entry_id: str) -> Path:
        """Return the folder of a result."""
        return self.folder / RESULTS / entry_id

    def new_work(self) -> Path:
        """Make a folder to write a result into."""
        path = self.folder / WORK / secrets.token_hex(8)
        with _writing(self.folder):
            path.mkdir(mode=0o700)
        return path

    def new_upload(self) -> Path:
        """Return the path of a file to write an upload into."""
        return self.folder / UPLOADS / secrets.token_hex(8)

    def free_bytes(self) -> int:
        """Return how much the disk still takes."""
        return shutil.disk_usage(self.folder).free

    def _history(self) -> History:
        return History(self.history, Options(), resume=True)


def _decoded(row: Mapping[str, Any]) -> Entry:
    """Return an entry as it was put.

    Raises
    ------
    SettingsError
        If it is none of ours.
    """
    try:
        return Entry(
            **{
                **row,
                "kind": Kind(row["kind"]),
                "state": State(row["state"]),
                "logs": tuple(json.loads(row["logs"])),
                "options": json.loads(row["options"]),
                "summary": json.loads(row["summary"]),
            }
        )
    except (ValueError, TypeError) as error:
        raise SettingsError("The store's queue is damaged.", hint="Choose another --store.") from error


def _make_private(top: Path) -> None:
    """Let only the owner read a folder and all in it, also where somebody opens the store's own folder.

    What a link points to is not ours.
    """
    top.chmod(0o700)
    for folder, folders, files in os.walk(top):
        for names, mode in ((folders, 0o700), (files, 0o600)):
            for path in (Path(folder, name) for name in names):
                if not path.is_symlink():
                    path.chmod(mode)


def _delete(path: Path) -> None:
    """Delete a file or a folder; a link goes, what it points to stays."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Turn what disk and database say into one clear line."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise OutputError(f"{printable(folder)} cannot be written: {error}.") from error
    except sqlite3.DatabaseError as error:
        raise SettingsError(
            f"{printable(folder / DATABASE)} is damaged: {error}.", hint="Choose another --store."
        ) from error
    except OSError as error:
        raise OutputError(f"{printable(folder)} cannot be written: {error.strerror or error}.") from error
