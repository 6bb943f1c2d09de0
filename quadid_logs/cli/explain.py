"""``quadid-log explain``: what a finding means and what to do."""

from __future__ import annotations

import difflib
from typing import Annotated

import typer

from quadid_logs.cli.completion import finding_codes
from quadid_logs.cli.failure import say
from quadid_logs.cli.terminal import broken
from quadid_logs.errors import SettingsError
from quadid_logs.untrusted import printable

_WIDTH = 88


def explain(
    code: Annotated[
        str,
        typer.Argument(
            metavar="[CODE]",
            help="Code of a finding, such as QL303 or 303. Without a code, all are listed.",
            autocompletion=finding_codes,
        ),
    ] = "",
) -> int:
    """Explain a finding: what it means and what to fly or set next."""
    from quadid_logs.autopilots import known
    from quadid_logs.data.catalogue import CATALOGUE

    if not code:
        for entry in CATALOGUE.values():
            say(f"{entry.code}  {entry.title}")
        return 0
    asked = code.strip().upper()
    entry_or_none = CATALOGUE.get(asked) or CATALOGUE.get(f"QL{asked}")
    if entry_or_none is None:
        close = difflib.get_close_matches(asked, CATALOGUE, n=1)
        hint = f"Did you mean {close[0]}?" if close else "`quadid-log explain` lists all codes."
        raise SettingsError(f"There is no finding {printable(code, 40)!r}.", hint=hint)
    entry = entry_or_none
    say(f"{entry.code}: {entry.title}")
    remedies = (
        f"{one.title}: {one.advice.remedies[entry.code]}"
        for one in known()
        if entry.code in one.advice.remedies
    )
    for text in (entry.meaning, f"What to do: {entry.advice}" if entry.advice else "", *remedies):
        if text:
            say("")
            for line in broken(text, _WIDTH):
                say(line)
    return 0
