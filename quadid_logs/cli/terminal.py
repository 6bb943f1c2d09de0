"""The verdict as a table, for eyes at a terminal; pipes get plain lines."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from typing import TYPE_CHECKING, TextIO

from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.data.result import Result

#: Nobody reads columns that are narrower, and a width of 0 is what some terminals say of themselves.
_FEWEST_COLUMNS = 30
#: On fewer columns a deep indent leaves no room for words.
_FEWEST_FOR_HANG = 60
_COMMAND = re.compile("`[^`]*`")
#: Stands for a space that no line is broken at; no text holds it (`untrusted.printable`).
_UNBROKEN = "\ue000"
_COLOURS = {"usable": "green", "caution": "yellow", "refused": "red"}


def is_terminal(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that can show tables, and lines written anew."""
    return stream.isatty() and os.environ.get("TERM", "") != "dumb"


def wrapped(line: str, hang: int) -> list[str]:
    """Break a line at the terminal's width; a pipe gets it whole, for grep finds only whole lines.

    A command stays in one line, however long: broken in two it could not be pasted.

    Parameters
    ----------
    line : str
        Of words between spaces, commands between backticks.
    hang : int
        By how many columns the lines after the first are indented; on a narrow terminal, by fewer.
    """
    if not is_terminal(sys.stdout):
        return [line]
    columns = max(_FEWEST_COLUMNS, shutil.get_terminal_size().columns)
    return broken(line, columns, hang if columns >= _FEWEST_FOR_HANG else min(hang, 4)) or [""]


def broken(line: str, columns: int, hang: int = 0) -> list[str]:
    """Break a line at some width, but no command.

    Parameters
    ----------
    line : str
        Of words between spaces, commands between backticks.
    hang : int
        By how many columns the lines after the first are indented.
    """
    joined = _COMMAND.sub(lambda match: match[0].replace(" ", _UNBROKEN), line)
    parts = textwrap.wrap(
        joined, columns, subsequent_indent=" " * hang, break_on_hyphens=False, break_long_words=False
    )
    return [part.replace(_UNBROKEN, " ") for part in parts]


def show_result(result: Result) -> None:
    """Print verdicts, gains and next steps as a table; rich leaves colours out where NO_COLOR is set."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from quadid_logs.report.health_view import health_lines
    from quadid_logs.report.next_flight import next_steps
    from quadid_logs.report.text import result_lines
    from quadid_logs.report.verdict import effect_sentence
    from quadid_logs.untrusted import printable

    console = Console(file=sys.stdout, highlight=False, soft_wrap=False)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head in ("axis", "verdict", "what the flight shows"):
        table.add_column(head)
    for axis in AXES:
        verdict = result.diagnosis.axes.get(axis)
        if verdict is None:
            continue
        gain = effect_sentence(result, axis)
        codes = " ".join(printable(code, 20) for code in verdict.reasons)
        words = "\n".join(filter(None, (printable(verdict.sentence, 400), gain, codes)))
        table.add_row(axis, Text(verdict.verdict, style=_COLOURS[verdict.verdict]), Text(words))
    console.print(Text(result_lines(result)[0], style="bold"))
    console.print(table)
    for shown in health_lines(result):
        for line in wrapped(shown.strip(), 2):
            console.print(Text(line), soft_wrap=True)
    for step in next_steps(result):
        for line in wrapped(f"next: {step}", 2):
            console.print(Text(line), soft_wrap=True)
