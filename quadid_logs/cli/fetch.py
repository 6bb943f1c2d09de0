"""``quadid-log fetch``: logs from the vehicle, or from its card."""

from __future__ import annotations

import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.failure import report_problem, say
from quadid_logs.cli.progress import Progress
from quadid_logs.cli.terminal import is_terminal
from quadid_logs.errors import LinkError, QuadidError, SettingsError
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.link.fetch import Logs, RemoteLog


def fetch(
    context: typer.Context,
    address: Annotated[
        str,
        typer.Argument(
            metavar="ADDRESS",
            help="Serial port (/dev/ttyACM0, COM3@115200), udp:14550, udpout:HOST:PORT, tcp:HOST:PORT, or "
            "the folder of a mounted card.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the logs.")
    ] = Path("logs"),
    as_list: Annotated[bool, typer.Option("--list", help="List the logs and fetch none.")] = False,
    last: Annotated[bool, typer.Option("--last", help="Fetch the last log: the default.")] = False,
    number: Annotated[int, typer.Option("-n", metavar="N", min=1, help="Fetch the last N logs.")] = 1,
    every: Annotated[bool, typer.Option("--all", help="Fetch all logs.")] = False,
    since: Annotated[
        str, typer.Option("--since", metavar="YYYY-MM-DD", help="Fetch the logs from this day (UTC) on.")
    ] = "",
    analyze: Annotated[
        bool, typer.Option("--analyze", help="Analyze the fetched logs, as `analyze` does.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files of the same name.")] = False,
) -> int:
    """Fetch logs from a disarmed vehicle, or from its card; an interrupted fetch goes on where it stopped.

    Exit code 0: fetched. 2: no vehicle, no log, or a file that did not arrive
    whole. With --analyze, the exit code of analyze.
    """
    if sum((as_list, last or number > 1, every, bool(since))) > 1:
        raise SettingsError(
            "Only one of --list, --last (or -n), --all and --since can be given.", hint="Give one of them."
        )
    day = _day(since)
    from quadid_logs.link.fetch import Logs

    with Logs(address) as logs:
        if as_list:
            for log in logs.logs:
                made = "" if log.time is None else f"{log.time:%Y-%m-%d}"
                say(f"{log.size / 1e6:9.2f} MB  {made:10}  {printable(log.name)}")
            return 0
        chosen = logs.logs if every else logs.logs[-number:] if day is None else logs.since(day)
        if not chosen:
            report_problem(f"there is no log from {since} or later.")
            return 0
        # A log that fails costs itself, but a link that fails twice in a row is gone.
        fetched: list[Path] = []
        broken = False
        for each_log in chosen:
            try:
                fetched.append(_fetch(logs, each_log, output, force=force))
                broken = False
            except QuadidError as error:
                if len(chosen) == 1 or (broken and isinstance(error, LinkError)):
                    raise
                broken = isinstance(error, LinkError)
                report_problem(f"{printable(each_log.name)} was not fetched. {error}")
    failed = 0 if len(fetched) == len(chosen) else 2
    if not analyze or not fetched:
        return failed
    from quadid_logs.cli.analyze import analyze as run

    return max(run(context, fetched, force=force), failed)


def _day(text: str) -> datetime | None:
    """Return the day that an option names."""
    try:
        return datetime.strptime(text, "%Y-%m-%d").replace(tzinfo=UTC) if text else None
    except ValueError:
        raise SettingsError(f"{printable(text, 40)} is not a date.", hint="Write it as 2026-05-31.") from None


def _fetch(logs: Logs, log: RemoteLog, folder: Path, *, force: bool) -> Path:
    """Fetch one log, say how far it is, and where it is."""
    pause_s = 0.5 if is_terminal(sys.stderr) else 10.0
    said_s = time.monotonic()
    with Progress(log.name) as progress:
        progress("fetching")

        def tell(done: int) -> None:
            nonlocal said_s
            if time.monotonic() - said_s > pause_s:
                said_s = time.monotonic()
                progress(f"{done / 1e6:.1f} of {log.size / 1e6:.1f} MB")

        fetched = logs.fetch(log, folder, force=force, tell=tell)
    say(f"{printable(fetched.path)}{'  (checksum compared)' if fetched.checked else ''}")
    return fetched.path
