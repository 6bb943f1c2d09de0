"""Find the logs that the command line names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path

from quadid_logs.commands import command, named
from quadid_logs.errors import LogNotFoundError
from quadid_logs.untrusted import printable

_WILDCARDS = frozenset("*?[")


def expanded(logs: Iterable[Path]) -> tuple[Path, ...]:
    """Return the logs with every pattern replaced by the files that it matches, in order of their names.

    Most shells do this themselves; Windows' do not. A file whose name merely
    looks like a pattern is taken as it is.

    Raises
    ------
    LogNotFoundError
        If a pattern matches nothing.
    """
    found: list[Path] = []
    for log in logs:
        if not _WILDCARDS & set(log.name) or log.exists():
            found.append(log)
            continue
        matches = sorted(path for path in log.parent.glob(log.name) if path.is_file())
        if not matches:
            raise LogNotFoundError(
                f"No file matches {printable(log)}.", hint="Check the folder and the file ending."
            )
        found += matches
    return tuple(found)


def check_log(log: Path) -> None:
    """Refuse a log that is not there, and name the file that was probably meant.

    Raises
    ------
    LogNotFoundError
    """
    if log.is_dir():
        raise LogNotFoundError(
            f"{printable(log)} is a folder.",
            hint=(
                "Name the logs in it, or analyze all of them with "
                f"`{command('fleet', named(str(log)), '-o', 'STORE')}`."
            ),
        )
    if log.exists():
        return
    siblings = [path.name for path in log.parent.iterdir()] if log.parent.is_dir() else []
    near = difflib.get_close_matches(log.name, siblings, n=1)
    hint = f"Did you mean {printable(log.parent / near[0])}?" if near else "Check the path."
    raise LogNotFoundError(f"There is no file {printable(log)}.", hint=hint)
