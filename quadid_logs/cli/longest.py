"""Analyze a log; of a file that holds several, the longest one where none was chosen."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from quadid_logs.cli.failure import report_problem
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.progress import Progress, parts
from quadid_logs.errors import SeveralLogsError
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from quadid_logs.data.result import Result
    from quadid_logs.data.settings import Settings
    from quadid_logs.data.vehicle import Vehicle


def analyze_longest(
    log: Path,
    settings: Settings,
    vehicle: Vehicle | None = None,
    *,
    published: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Result:
    """Analyze a log as `pipeline.analyze`; of a file that holds several the longest, and say so.

    Parameters
    ----------
    settings : Settings
        With the log that was chosen, if one was.
    """
    from quadid_logs.pipeline import analyze

    try:
        return analyze(log, settings, vehicle=vehicle, published=published, progress=progress)
    except SeveralLogsError as several:
        report_problem(
            f"{printable(log.name)} holds {len(several.logs)} logs. The longest one, log {several.longest} "
            f"({several.durations_s[several.longest]:.1f} s), is analyzed. Choose another one with --log N: "
            "info lists them."
        )
        settings = replace(settings, log=several.longest)
    return analyze(log, settings, vehicle=vehicle, published=published, progress=progress)


def analyze_each(
    logs: Sequence[tuple[Path, Settings]],
    vehicle: Vehicle | None,
    *,
    published: bool = True,
    quiet: bool = False,
) -> list[Result]:
    """Analyze several logs as `analyze_longest` one, and show how far all of them are."""
    for log, _ in logs:
        check_log(log)
    found = []
    for (log, settings), part in zip(logs, parts([log for log, _ in logs]), strict=True):
        with Progress(log.name, quiet=quiet, part=part) as progress:
            found.append(analyze_longest(log, settings, vehicle, published=published, progress=progress))
    return found
