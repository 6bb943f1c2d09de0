"""``quadid-log query``: SQL over the store of a fleet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from itertools import chain, islice
from numbers import Number
from typing import TYPE_CHECKING, Annotated, Any

import typer

from quadid_logs.cli.failure import report_problem, say
from quadid_logs.cli.options import StoreFolder
from quadid_logs.errors import SettingsError
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.fleets.sql import Answer
    from quadid_logs.fleets.store import SetAside

#: Rows of a table that are laid out together: a column is as wide as the widest of them.
_PAGE = 1000
_WIDEST = 60
#: Rows set aside that are named one by one.
_MOST_NAMED = 5
#: More than any column of ours holds.
_LONGEST_CELL = 32_000
#: What a spreadsheet takes for the begin of a formula.
_FORMULA = ("=", "+", "-", "@")


def query(
    store: StoreFolder,
    sql: Annotated[str, typer.Argument(metavar="SQL", help='SQL query; the table is called "fleet".')],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for each row.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print comma-separated values.")] = False,
) -> int:
    """Ask the store: "SELECT vehicle, avg(gain) FROM fleet WHERE axis = 'roll' GROUP BY vehicle".

    "DESCRIBE fleet" lists the columns. The store cannot be changed, and no
    other file read.
    """
    from quadid_logs.fleets.sql import ask

    if as_json and as_csv:
        raise SettingsError("Only one of --json and --csv can be given.", hint="Give one of them.")
    answer = ask(store, sql)
    report_set_aside(answer.set_aside)
    write = _json_lines if as_json else _csv_lines if as_csv else _table_lines
    for line in write(answer):
        say(line)
    return 0


def report_set_aside(rows: Sequence[SetAside]) -> None:
    """Name the rows of a store that are not ours, so that nobody takes the rest for the whole."""
    for row in rows[:_MOST_NAMED]:
        report_problem(f"a row of the store is skipped: {row.reason} ({row.url})")
    if len(rows) > _MOST_NAMED:
        report_problem(f"{len(rows) - _MOST_NAMED} more rows of the store are skipped")


def _json_lines(answer: Answer) -> Iterator[str]:
    """Yield one object per row; dates and the like as text."""
    from quadid_logs.report.strict_json import strict_text

    for row in answer.rows:
        yield strict_text(dict(zip(answer.columns, row, strict=True)), compact=True).rstrip("\n")


def _csv_lines(answer: Answer) -> Iterator[str]:
    """Yield lines with the separators quoted."""
    for row in chain([answer.columns], answer.rows):
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(map(_cell, row))
        yield line.getvalue()


def _cell(value: Any) -> Any:
    """Return a value for a cell: a text without control characters, and none that is run as a formula."""
    if value is None:
        return ""
    if isinstance(value, Number):
        return value
    text = printable(value, _LONGEST_CELL)
    return f"'{text}" if text.startswith(_FORMULA) else text


def _table_lines(answer: Answer) -> Iterator[str]:
    """Yield columns side by side, numbers to the right."""
    names = [printable(name, _WIDEST) for name in answer.columns]
    while page := list(islice(answer.rows, _PAGE)):
        texts = [[_shown(value) for value in row] for row in page]
        right = [all(isinstance(row[k], (int, float, type(None))) for row in page) for k in range(len(names))]
        widths = [max(map(len, column)) for column in zip(names, *texts, strict=True)]
        for row in (names, *texts):
            cells = (
                text.rjust(width) if to_right else text.ljust(width)
                for text, width, to_right in zip(row, widths, right, strict=True)
            )
            yield "  ".join(cells).rstrip()


def _shown(value: Any) -> str:
    """Show a value: five digits of a number, nothing for null, no control characters of a text."""
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else printable(value, _WIDEST)
