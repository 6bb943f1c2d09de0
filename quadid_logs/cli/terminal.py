"""The verdict as a table, for eyes at a terminal; pipes get plain lines."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, TextIO

from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.data.result import Result

_COLOURS = {"usable": "green", "caution": "yellow", "refused": "red"}


def is_terminal(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that can show tables, and lines written anew."""
    return stream.isatty() and os.environ.get("TERM", "") != "dumb"


def show_result(result: Result) -> None:
    """Print verdicts, gains and next steps as a table; rich leaves colours out where NO_COLOR is set."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from quadid_logs.report.next_flight import next_steps
    from quadid_logs.report.text import result_lines
    from quadid_logs.report.verdict import effect_sentence
    from quadid_logs.untrusted import printable

    console = Console(file=sys.stdout, highlight=False, soft_wrap=False)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head in ("axis", "verdict", "what the flight says"):
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
    for step in next_steps(result):
        console.print(Text(f"next: {step}"))
