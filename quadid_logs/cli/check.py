"""``quadid-log check``: whether the next flight kept what `tune` promised of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.failure import say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.progress import Progress

#: Contract with scripts: see `check`.
_EXIT_CODES = {"kept": 0, "broken": 1, "not comparable": 3}


def check(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The flight with the recommended gains.")],
    promise: Annotated[
        Path,
        typer.Option(
            "--promise",
            metavar="FILE",
            help="promise.json of the flight before, or the folder that holds it.",
        ),
    ],
    vehicle: Annotated[
        Path | None, typer.Option("--vehicle", metavar="FILE.toml", help="Mass, arms, thrust of the vehicle.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON to stdout.")] = False,
    system: Annotated[
        int, typer.Option("--system", metavar="ID", help="MAVLink system to check; 0 chooses.")
    ] = 0,
    log_number: Annotated[
        int,
        typer.Option("--log", metavar="N", help="Which log of a file that holds several; info lists them."),
    ] = 0,
) -> int:
    """Tell whether a flight kept what `tune` promised of it: keep the gains, go on, or go back.

    Exit code 0: kept. 1: broken: an axis is worse than promised, or other gains or another vehicle flew. 2:
    log or promise could not be read. 3: not comparable: another autopilot, frame or flight controller, or the
    log does not tell the margins.
    """
    from quadid_logs.data.settings import Settings
    from quadid_logs.pipeline import analyze
    from quadid_logs.promise import check as check_promise
    from quadid_logs.report.check_view import check_lines, check_text
    from quadid_logs.report.promise_file import read_promise
    from quadid_logs.report.provenance import provenance_of
    from quadid_logs.vehicle_file import read_vehicle

    promised = read_promise(promise)
    check_log(log)
    described = None if vehicle is None else read_vehicle(vehicle)
    with Progress(log.name) as progress:
        after = analyze(log, Settings(log=log_number, system=system), vehicle=described, progress=progress)
        progress("check")
        found = check_promise(promised, after, provenance_of(log).log_sha256)
    if as_json:
        say(check_text(promised, after, found).rstrip("\n"))
    else:
        for line in check_lines(promised, after, found):
            say(line)
    return _EXIT_CODES[found.outcome.value]
