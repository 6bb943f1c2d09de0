"""Of a file that holds several logs, the longest one where none was chosen."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from quadid_logs.cli.failure import report_problem
from quadid_logs.errors import SeveralLogsError
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from quadid_logs.data.settings import Settings

_T = TypeVar("_T")


def of_longest(log: Path, settings: Settings, read: Callable[[Settings], _T]) -> _T:
    """Read a log; of a file that holds several the longest, and say so.

    Parameters
    ----------
    log : Path
    settings : Settings
        With the log that was chosen, if one was.
    read : callable
        What reads it by settings.

    Returns
    -------
    object
        What ``read`` returns.
    """
    try:
        return read(settings)
    except SeveralLogsError as several:
        report_problem(
            f"{printable(log.name)} holds {len(several.logs)} logs. The longest one, log {several.longest} "
            f"({several.durations_s[several.longest]:.1f} s), is analyzed. Choose another one with --log N: "
            "info lists them."
        )
        settings = replace(settings, log=several.longest)
    return read(settings)
