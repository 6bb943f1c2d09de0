"""SQL over a store: DuckDB in memory, with a copy of the store as its only table."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from quadid_logs.errors import SettingsError
from quadid_logs.extra import load
from quadid_logs.fleets.store import SetAside, read_table
from quadid_logs.untrusted import printable

#: No file, no network, no extension, no spilling to disk, and no way to change that.
_LOCKS = (
    "SET temp_directory = ''",
    "SET autoinstall_known_extensions = false",
    "SET autoload_known_extensions = false",
    "SET enable_external_access = false",
    "SET lock_configuration = true",
)
_BATCH = 1000
_COLUMNS_HINT = 'Columns: `quadid-log query STORE "DESCRIBE fleet"`'


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Names of the columns, the rows as they come, and what was set aside of the store (see `SetAside`)."""

    columns: tuple[str, ...]
    rows: Iterator[tuple[Any, ...]]
    set_aside: tuple[SetAside, ...] = ()


def ask(folder: Path, sql: str) -> Answer:
    """Run one SQL statement over a store; its table is called ``fleet``.

    The rows are copied to it first, and its own file system is closed: a
    statement can read nothing else and write nothing.

    Raises
    ------
    SettingsError
        If the folder is no store, or the statement fails.
    """
    duckdb = load("duckdb", "fleet")
    load("pytz", "fleet")  # DuckDB makes times with a zone by it
    set_aside: list[SetAside] = []
    connection = duckdb.connect(":memory:")
    connection.register("fleet", read_table(folder, set_aside.append))
    for lock in _LOCKS:
        connection.execute(lock)
    try:
        cursor = connection.execute(sql)
        if cursor is None or cursor.description is None:
            raise SettingsError("There is no statement in the query.", hint=_COLUMNS_HINT)
        columns = tuple(str(column[0]) for column in cursor.description)
        return Answer(columns=columns, rows=_rows(cursor, duckdb.Error), set_aside=tuple(set_aside))
    except duckdb.Error as error:
        raise _refusal(error) from error


def _rows(cursor: Any, failure: type[Exception]) -> Iterator[tuple[Any, ...]]:
    """Yield rows, in batches so that a large answer is never in memory as a whole."""
    try:
        while batch := cursor.fetchmany(_BATCH):
            yield from batch
    except failure as error:
        raise _refusal(error) from error


def _refusal(error: Exception) -> SettingsError:
    """Return the reason in one line, without the kind that DuckDB puts before it.

    Below it are the query again and a caret under some place of it.
    """
    reason = re.split(r"\n\s*LINE \d+:|\n\n", str(error).strip())[0]
    reason = " ".join(re.sub(r"^[A-Z]\w+ Error: ", "", reason).split())
    return SettingsError(f"The query failed: {printable(reason).rstrip('.')}.", hint=_COLUMNS_HINT)
