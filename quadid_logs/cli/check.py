"""``quadid-log check``: whether the next flight kept what `tune` promised of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.logs import check_log
from quadid_logs.cli.longest import analyze_longest
from quadid_logs.cli.options import (
    Band,
    EndS,
    LogNumber,
    Quiet,
    StartS,
    System,
    VehicleFile,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import say_outcome
from quadid_logs.cli.progress import Progress

#: Contract with scripts: see `check`.
_EXIT_CODES = {"kept": 0, "broken": 1, "not comparable": 3}


def check(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log of the flight with the recommended gains.")],
    promise: Annotated[
        Path,
        typer.Option(
            "--promise",
            metavar="FILE",
            help="promise.json of the previous flight, or the folder that holds it.",
        ),
    ],
    vehicle: VehicleFile = None,
    start_s: StartS = None,
    end_s: EndS = None,
    band: Band = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON to stdout.")] = False,
    system: System = 0,
    log_number: LogNumber = 0,
    quiet: Quiet = False,
) -> int:
    """Tell whether a flight kept what `tune` promised of it: keep the gains, go on, or go back.

    Exit code 0: kept. 1: broken: an axis is worse than promised, or other gains or another vehicle flew. 2:
    log or promise could not be read. 3: not comparable: another autopilot, frame or flight controller, or the
    log does not tell the margins.
    """
    from quadid_logs.promise import check as check_promise
    from quadid_logs.report.check_view import check_lines, check_text
    from quadid_logs.report.promise_file import read_promise
    from quadid_logs.report.provenance import provenance_of

    promised = read_promise(promise)
    check_log(log)
    described = vehicle_of(vehicle)
    settings = settings_of(start_s=start_s, end_s=end_s, band=band, system=system, log=log_number)
    with Progress(log.name, quiet=quiet) as progress:
        after = analyze_longest(log, settings, described, progress=progress)
        progress("check")
        found = check_promise(promised, after, provenance_of(log).log_sha256)
    code = _EXIT_CODES[found.outcome.value]
    text, lines = check_text(promised, after, found), check_lines(promised, after, found)
    say_outcome(text, lines, code=code, as_json=as_json, quiet=quiet)
    return code
