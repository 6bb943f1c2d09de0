"""``quadid-log analyze``: logs in, verdicts on stdout, reports into a folder."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.completion import structures
from quadid_logs.cli.failure import exit_code_of, report_problem, say
from quadid_logs.cli.logs import check_log, expanded
from quadid_logs.cli.longest import analyze_longest
from quadid_logs.cli.options import (
    AxisNames,
    Band,
    EndS,
    Force,
    LogNumber,
    SampleRateHz,
    StartS,
    System,
    VehicleFile,
    axes_of,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import open_page
from quadid_logs.cli.progress import Part, Progress, parts
from quadid_logs.cli.terminal import is_terminal, show_result
from quadid_logs.output import check_free, write_beside
from quadid_logs.sentences import listed
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.data.result import Result
    from quadid_logs.data.settings import Settings
    from quadid_logs.data.vehicle import Vehicle
    from quadid_logs.report.folder import PngChoice
    from quadid_logs.report.index import IndexRow

_POOLED_FOLDER = "pooled"
_DEFAULT_FOLDER = Path("quadid-report")
#: Not imported from the report: that would import numpy for --help.
INDEX_FILE = "index.html"
_REPORT_FILE = "report.html"


class _Png(Enum):
    """What ``--png`` takes."""

    summary = "summary"
    all = "all"
    none = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wish:
    """What the options ask for, the same for every log."""

    settings: Settings
    vehicle: Vehicle | None
    force: bool
    as_json: bool
    drawings: bool
    png: PngChoice
    files: bool
    one_line: bool
    axes: tuple[str, ...]
    quiet: bool
    command: str


def analyze(
    context: typer.Context,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Recognised by their content.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the reports [default: quadid-report]."
        ),
    ] = None,
    vehicle: VehicleFile = None,
    structure: Annotated[
        str,
        typer.Option(
            "--structure",
            metavar="NAME",
            help="Recommend this structure, even if another one fits better.",
            autocompletion=structures,
        ),
    ] = "",
    start_s: StartS = None,
    end_s: EndS = None,
    sample_rate_hz: SampleRateHz = 0.0,
    window: Annotated[
        int, typer.Option("--window", metavar="N", help="Samples per window; 0: as many as unknowns.")
    ] = 0,
    stride: Annotated[
        int,
        typer.Option(
            "--stride", metavar="N", help="Samples from one window to the next; 0: every sample starts one."
        ),
    ] = 0,
    band: Band = None,
    system: System = 0,
    log_number: LogNumber = 0,
    axes: AxisNames = "",
    pool: Annotated[bool, typer.Option("--pool", help="Fit one model to all logs.")] = False,
    force: Force = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json to stdout.")] = False,
    png: Annotated[
        _Png,
        typer.Option(
            "--png",
            help="Figures to write as PNG: a summary, all, or none. report.html always holds all of them.",
        ),
    ] = _Png.summary,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write neither HTML nor PNG.")] = False,
    open_report: Annotated[
        bool,
        typer.Option("--open", help="Open the report in the browser, or the index page of several reports."),
    ] = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Print only problems, refused axes among them.")
    ] = False,
) -> int:
    """Identify the rotational model of each log and write a report; several logs get an index page too.

    Exit code 0: usable. 1: at least one axis must not be trusted, of those that --axes names, or that the
    log's system-identification mode swept. 2: a log could not be read, or the options make no sense.
    """
    from quadid_logs.report import report_folders

    logs = list(expanded(logs))
    wish = _Wish(
        settings=settings_of(
            start_s=start_s,
            end_s=end_s,
            sample_rate_hz=sample_rate_hz,
            band=band,
            structure=structure,
            window=window,
            stride=stride,
            system=system,
            log=log_number,
        ),
        vehicle=vehicle_of(vehicle),
        force=force,
        as_json=as_json,
        drawings=not no_report,
        png=png.value,
        # A script that takes the result from stdout and wants no report needs no folder either.
        files=not (as_json and no_report and output is None),
        one_line=len(logs) > 1 and not pool,
        axes=axes_of(axes),
        quiet=quiet,
        command=str(context.obj or ""),
    )
    parent = output or _DEFAULT_FOLDER
    rows: dict[Path, IndexRow] = {}
    if pool and len(logs) > 1:
        pooled = parent / _POOLED_FOLDER
        code = exit_code_of(partial(_analyze_one, logs, pooled, parts(logs[:1])[0], wish, rows))
        if open_report and rows and wish.files and wish.drawings:
            open_page(pooled / _REPORT_FILE)
        return code
    with_index = wish.one_line and wish.files and wish.drawings
    if with_index:
        check_free(parent / INDEX_FILE, force=force)
    folders = report_folders(logs, parent, log_number)
    codes = [
        exit_code_of(partial(_analyze_one, [log], folder, part, wish, rows))
        for log, folder, part in zip(logs, folders, parts(logs), strict=True)
    ]
    if with_index and rows:
        from quadid_logs.report.index import IndexRow, index_page

        # A line for each log, those that could not be read too.
        lines = [
            rows.get(folder)
            or IndexRow(name=printable(log, 160), summary="could not be read: see the message of the command")
            for log, folder in zip(logs, folders, strict=True)
        ]
        write_beside(parent / INDEX_FILE, index_page(lines).encode())
        if not (quiet or as_json):
            say(f"index: {printable(parent / INDEX_FILE)}")
    if open_report and rows and wish.files and wish.drawings:
        open_page(parent / INDEX_FILE if with_index else folders[0] / _REPORT_FILE)
    return max(codes)


def _analyze_one(logs: list[Path], folder: Path, part: Part, wish: _Wish, rows: dict[Path, IndexRow]) -> int:
    """Analyze one log (or several as one), write its files, say its verdict, note its row of the index."""
    from quadid_logs.report import check_folder, write_report
    from quadid_logs.report.index import index_row

    for log in logs:
        check_log(log)
    if wish.files:
        check_folder(folder, force=wish.force)
    with Progress(logs[0].name, quiet=wish.quiet, part=part) as progress:
        result = _result_of(logs, wish, progress)
        if wish.files:
            if wish.drawings:
                progress("writing the report")
            result = write_report(
                result,
                folder,
                force=wish.force,
                drawings=wish.drawings,
                png=wish.png,
                command=wish.command,
            )
    rows[folder] = index_row(result, folder.name)
    if wish.as_json or not wish.quiet:
        _say_result(result, folder, wish)
    is_refused = bool(_refused(result) & {*_judged(result, wish)})
    if wish.quiet and not wish.as_json and is_refused:
        from quadid_logs.report.text import one_line

        report_problem(one_line(result))
    return 1 if is_refused else 0


def _judged(result: Result, wish: _Wish) -> tuple[str, ...]:
    """Return the axes that the exit code is for; logs that are pooled may have swept other axes each."""
    return wish.axes or (() if result.pooled else result.log.swept_axes) or AXES


def _refused(result: Result) -> set[str]:
    return {axis for axis, verdict in result.verdict.items() if verdict == "refused"}


def _result_of(logs: list[Path], wish: _Wish, progress: Progress) -> Result:
    """Analyze one log, or several as one."""
    from quadid_logs.pipeline import analyze

    if len(logs) > 1:
        return analyze(logs, wish.settings, vehicle=wish.vehicle, progress=progress)
    return analyze_longest(logs[0], wish.settings, wish.vehicle, progress=progress)


def _say_result(result: Result, folder: Path, wish: _Wish) -> None:
    """Print the result as the options ask for."""
    from quadid_logs.report import json_text, provenance_of

    if wish.as_json:
        provenance = provenance_of(result.log.path, wish.command)
        say(json_text(result, provenance, compact=wish.one_line).rstrip("\n"))
        return
    from quadid_logs.report.text import one_line, result_lines

    written = printable(folder / ("report.html" if wish.drawings else "result.json"))
    if wish.one_line:
        say(f"{one_line(result)} -> {written}")
        return
    if is_terminal(sys.stdout):
        show_result(result)
    else:
        for line in result_lines(result):
            say(line)
    judged = _judged(result, wish)
    if not wish.axes and _refused(result) - {*judged}:
        say(
            f"  The flight swept {listed(judged)}: the exit code is judged on that alone. --axes chooses "
            "other axes."
        )
    say(f"  {'report' if wish.drawings else 'result'}: {written}")
