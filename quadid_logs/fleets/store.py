"""The store: one SQLite file with the table ``fleet``, and the reports beside it.

::

    STORE/fleet.sqlite                 tables fleet (one row per log, flight and axis) and made_with
    STORE/reports/<sha256>-<flight>.html

What a log gives is one transaction, so that a run can be killed at any moment;
in SQLite's write-ahead mode [1]_ whoever reads meanwhile sees the last of them
and neither waits nor lets the run wait.

References
----------
.. [1] https://www.sqlite.org/wal.html
"""

from __future__ import annotations

import contextlib
import gzip
import json
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from datetime import datetime
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import ADDED, ANALYZED, COLUMNS, LOST, ForeignRowError, decode, schema
from quadid_logs.fleets.tasks import Outcome
from quadid_logs.output import check_no_link, make_folder, new_folder, write_together
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__

if TYPE_CHECKING:
    import pyarrow as pa

DATABASE: Final = "fleet.sqlite"
REPORTS: Final = "reports"
_FORMAT: Final = "4"
#: Stores of this format lack columns, which are added: what was not stored then is null.
_EARLIER: Final = "3"
_TABLES: Final = (
    "CREATE TABLE made_with (name TEXT PRIMARY KEY, value TEXT)",
    f"CREATE TABLE fleet ({', '.join(f'{name} {kind}' for name, kind in COLUMNS.items())})",
    *(f"CREATE INDEX fleet_{name} ON fleet ({name})" for name in ("sha256", "url", "n_bytes")),
)
_INSERT: Final = f"INSERT INTO fleet ({', '.join(COLUMNS)}) VALUES ({', '.join('?' * len(COLUMNS))})"  # noqa: S608 - no values in it
#: A log is known by its content, or by its place where the content was never seen.
_REMOVE: Final = "DELETE FROM fleet WHERE (sha256 = ? AND sha256 <> '') OR (sha256 = '' AND url = ?)"
#: How long another run's transaction is waited for [s]; it takes milliseconds.
_PATIENCE_S: Final = 60.0
#: Rows that become Arrow's at once: Python's own numbers take ten times the memory.
_BATCH: Final = 10_000


class SetAside(NamedTuple):
    """A row that is not ours, by its url as far as it has one, and why: a damaged page, another program."""

    url: str
    reason: str


class Store:
    """A store that a run writes into; a context manager."""

    def __init__(self, folder: Path, options: Options, *, resume: bool) -> None:
        """Open a store, or make it.

        Parameters
        ----------
        options : Options
            What the store is made with; must be the same for all runs into it.
        resume : bool
            Add to a store that exists.

        Raises
        ------
        OutputError
            If the folder holds something and `resume` is not set, or cannot be written.
        SettingsError
            If it was made with other options, or is damaged.
        """
        check_no_link(folder)
        self.folder = folder
        exists = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
        if exists:
            # Refuse a folder of something else, and a store that nobody wants to go on with.
            if not (folder / DATABASE).is_file():
                raise OutputError(
                    f"{printable(folder)} exists and is not a fleet store.", hint="Choose another -o."
                )
            if not resume:
                raise OutputError(
                    f"{printable(folder)} exists already.",
                    hint="Add --resume to analyze the logs that are missing.",
                )
        with new_folder(folder), self._writing():
            self._database = sqlite3.connect(folder / DATABASE, timeout=_PATIENCE_S, isolation_level=None)
            try:
                self._open(options)
            except BaseException:
                self._database.close()
                if not exists:  # a full disk must not leave a store of nothing
                    for path in folder.glob(f"{DATABASE}*"):
                        path.unlink()
                raise

    def _open(self, options: Options) -> None:
        """Make the tables, or check what they were made with."""
        self._database.execute("PRAGMA journal_mode = WAL")
        wanted = {"format": _FORMAT, **options.fingerprint()}
        with self._transaction():
            if not self._database.execute("SELECT name FROM sqlite_master").fetchall():
                for table in _TABLES:
                    self._database.execute(table)
                self._database.executemany("INSERT INTO made_with VALUES (?, ?)", wanted.items())
            made = dict(self._database.execute("SELECT name, value FROM made_with"))
            if made.get("format") == _EARLIER:
                for name in sorted(ADDED - _columns(self._database)):
                    self._database.execute(f"ALTER TABLE fleet ADD COLUMN {name} {COLUMNS[name]}")
                self._database.execute("UPDATE made_with SET value = ? WHERE name = 'format'", (_FORMAT,))
                made["format"] = _FORMAT
        for name, value in wanted.items():
            # What a store of an earlier version does not name was not given.
            before = made.get(name, "")
            if before != value:
                raise SettingsError(
                    f"The store was made with another {name}: {printable(before)!r}, not {value!r}.",
                    hint="Give the same options, or choose another -o.",
                )

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave one plain file, which can be read where nothing can be written."""
        with contextlib.suppress(sqlite3.Error):  # somebody reads: the next run will do it
            self._database.execute("PRAGMA journal_mode = DELETE")
        self._database.close()

    def known(self, file: LogFile) -> tuple[str, ...]:
        """Return the hashes that a file of this size may have so that nothing is left to do."""
        found = self._database.execute(
            "SELECT DISTINCT sha256 FROM fleet WHERE n_bytes = ? AND status <> ? AND version = ?",
            (file.n_bytes, LOST, __version__),
        )
        return tuple(sha256 for (sha256,) in found)

    def take(self, outcome: Outcome) -> bool:
        """Write the rows of a log, in the place of whatever the store held about it.

        Of two files with the same content the first by name stays, in whatever
        order they come, so that every run ends with the same store.

        Returns
        -------
        bool
            False if the content is known under a later name: analyze it again, for the first.

        Raises
        ------
        OutputError
            If the store cannot be written.
        """
        url = outcome.file.name
        with self._writing(), self._transaction():
            # The name under which the store has a content, "" if none, and whether that may stay.
            found = self._database.execute(
                "SELECT url, version FROM fleet WHERE sha256 = ? AND sha256 <> ''", (outcome.sha256,)
            ).fetchone()
            held, is_done = (found[0], found[1] == __version__) if found else ("", False)
            if outcome.is_known:
                return not held or held <= url
            if not is_done or held >= url:
                # Write the pages beside the table, before the rows that point to them.
                pages = {
                    f"{outcome.sha256}-{flight}.html": gzip.decompress(page)
                    for flight, page in outcome.reports.items()
                }
                if pages:
                    make_folder(self.folder / REPORTS)
                    write_together(self.folder / REPORTS, pages)
                self._database.execute(_REMOVE, (outcome.sha256, url))
                self._database.executemany(_INSERT, map(_stored, outcome.rows))
        return True

    def forget(self, sha256: str) -> None:
        """Delete everything that the store holds about a log, so that no byte of it is left in the file.

        Parameters
        ----------
        sha256 : str
            Of its content.

        Raises
        ------
        OutputError
            If the store cannot be written.
        """
        with self._writing():
            # Deleted rows otherwise stay readable in pages that SQLite keeps for later.
            self._database.execute("PRAGMA secure_delete = ON")
            with self._transaction():
                self._database.execute("DELETE FROM fleet WHERE sha256 = ?", (sha256,))
            self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        for page in (self.folder / REPORTS).glob(f"{sha256}-*.html"):
            page.unlink(missing_ok=True)

    def rename(self, vehicle: str, name: str) -> None:
        """Give a vehicle another name.

        Raises
        ------
        OutputError
            If the store cannot be written.
        """
        with self._writing(), self._transaction():
            self._database.execute("UPDATE fleet SET vehicle = ? WHERE vehicle = ?", (name, vehicle))

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Do all of it or nothing."""
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            if self._database.in_transaction:  # a full disk has ended it already
                self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn what the database says into one clear line."""
        path = printable(self.folder / DATABASE)
        try:
            yield
        except sqlite3.OperationalError as error:
            raise OutputError(f"{path} cannot be written: {error}.") from error
        except sqlite3.DatabaseError as error:
            raise SettingsError(f"{path} is damaged: {error}.", hint="Choose another -o.") from error


def _stored(row: Mapping[str, Any]) -> list[Any]:
    """Return a row as SQLite keeps it: times as ISO 8601, lists as JSON."""
    values = [row.get(name) for name in COLUMNS]
    return [
        value.isoformat()
        if isinstance(value, datetime)
        else json.dumps(value)
        if isinstance(value, list)
        else value
        for value in values
    ]


def _ignore(_row: SetAside) -> None:
    """Take no notice of a row that is set aside."""


def read_rows(
    folder: Path, columns: Sequence[str], set_aside: Callable[[SetAside], None] = _ignore
) -> Iterator[dict[str, Any]]:
    """Yield some columns of all rows, vehicle by vehicle, each row as the worker made it.

    Parameters
    ----------
    folder : Path
        The store; a run may write into it meanwhile.
    columns : sequence of str
        Of `COLUMNS`.
    set_aside : callable
        Called with every row that is left out, because a value in any column cannot be ours.

    Raises
    ------
    SettingsError
        If the folder is no store, or is damaged.
    """
    for row in _checked_rows(folder, set_aside):
        yield {name: row[name] for name in columns}


def _checked_rows(folder: Path, set_aside: Callable[[SetAside], None]) -> Iterator[dict[str, Any]]:
    """Yield all rows, decoded, but those that are not ours."""
    with _reading(folder) as database:
        there = _columns(database)
        wanted = ", ".join(f"NULL AS {name}" if name in ADDED - there else name for name in COLUMNS)
        for values in database.execute(
            f"SELECT {wanted} FROM fleet ORDER BY vehicle, sha256, rowid"  # noqa: S608 - our own names
        ):
            row = dict(zip(COLUMNS, values, strict=True))
            try:
                decode(row)
            except ForeignRowError as error:
                set_aside(SetAside(printable(row["url"], 200), str(error)))
            else:
                yield row


def count_verdicts(folder: Path) -> Iterator[tuple[str, tuple[str, ...], int]]:
    """Yield verdict, reasons and number of the analyzed axes.

    Parameters
    ----------
    folder : Path
        The store; a run may write into it meanwhile.

    Raises
    ------
    SettingsError
        If the folder is no store, or is damaged.
    """
    with _reading(folder) as database:
        for verdict, reasons, count in database.execute(
            "SELECT verdict, reasons, count(*) FROM fleet WHERE status = ? GROUP BY verdict, reasons",
            (ANALYZED,),
        ):
            with contextlib.suppress(ValueError, TypeError, RecursionError):
                yield str(verdict), tuple(map(str, json.loads(reasons))), count


def read_table(folder: Path, set_aside: Callable[[SetAside], None] = _ignore) -> pa.Table:
    """Return all rows as Arrow's table.

    Parameters
    ----------
    folder : Path
        The store; a run may write into it meanwhile.
    set_aside : callable
        As for `read_rows`.

    Raises
    ------
    SettingsError
        If the folder is no store, or is damaged.
    """
    import pyarrow as pa

    fields, batches = schema(), []
    rows = _checked_rows(folder, set_aside)
    while part := list(islice(rows, _BATCH)):
        batches.append(pa.RecordBatch.from_pylist(part, fields))
    return pa.Table.from_batches(batches, fields)


def _columns(database: sqlite3.Connection) -> frozenset[str]:
    """Return which columns a store has; an earlier version has fewer."""
    return frozenset(name for (name,) in database.execute("SELECT name FROM pragma_table_info('fleet')"))


@contextmanager
def _reading(folder: Path) -> Iterator[sqlite3.Connection]:
    """Open a store that is not to be changed."""
    path = folder / DATABASE
    if not path.is_file():
        raise SettingsError(
            f"{printable(folder)} is not a fleet store.",
            hint="Make one with `quadid-log fleet LOGS -o STORE`.",
        )
    try:
        with closing(
            sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=_PATIENCE_S)
        ) as database:
            # Whatever the database holds.
            database.text_factory = lambda content: content.decode("utf-8", "replace")
            yield database
    except sqlite3.DatabaseError as error:
        raise SettingsError(
            f"{printable(path)} cannot be read: {error}.",
            hint="Resume the run with --resume, or copy the whole folder again.",
        ) from error
