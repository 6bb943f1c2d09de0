"""``quadid-log compare``: whether the vehicle changed from one flight to the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.longest import analyze_each
from quadid_logs.cli.options import (
    AsJson,
    Band,
    EndS,
    Force,
    OpenPage,
    Quiet,
    StartS,
    System,
    VehicleFile,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import open_page, say_outcome, write_outcome
from quadid_logs.output import check_folder_free

_JSON, _PAGE = "compare.json", "compare.html"
_PNG, _LOOP_PNG = "compare.png", "compare-loop.png"
_FILES = (_JSON, _PAGE, _PNG, _LOOP_PNG)


def compare(
    before: Annotated[Path, typer.Argument(metavar="BEFORE", help="Log of the flight before the change.")],
    after: Annotated[Path, typer.Argument(metavar="AFTER", help="Log of the flight after the change.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help=f"Folder for {_PAGE}, {_JSON} and PNG files."),
    ] = None,
    vehicle: VehicleFile = None,
    start_s: StartS = None,
    end_s: EndS = None,
    band: Band = None,
    log_numbers: Annotated[
        tuple[int, int],
        typer.Option(
            "--logs",
            metavar="N M",
            help="If the files hold several logs: the number in BEFORE, then in AFTER.",
        ),
    ] = (0, 0),
    system: System = 0,
    as_json: AsJson = False,
    force: Force = False,
    open_report: OpenPage = False,
    quiet: Quiet = False,
) -> int:
    """Tell whether B, A or the lag changed by more than the two flights leave open.

    Fly the same manoeuvre both times: yaw answers more strongly at more throttle.

    Exit code 0: compared on every axis, no change. 1: changed. 2: a log could
    not be read. 3: no change seen, but an axis could not be compared.
    """
    from quadid_logs.comparison import EXIT_CODES
    from quadid_logs.comparison import compare as compare_results
    from quadid_logs.report.comparison import comparison_lines, comparison_text

    if output is not None:
        check_folder_free(output, _FILES, force=force)
    described = vehicle_of(vehicle)
    settings = settings_of(start_s=start_s, end_s=end_s, band=band, system=system)
    logs = [
        (log, replace(settings, log=number)) for log, number in zip((before, after), log_numbers, strict=True)
    ]
    first, second = analyze_each(logs, described, quiet=quiet)
    comparison = compare_results(first, second)
    text = comparison_text(first, second, comparison)
    written = ""
    if output is not None:
        from quadid_logs.figures import Figure
        from quadid_logs.figures.comparison_chart import comparison_figure
        from quadid_logs.figures.loop_comparison import loop_comparison_figure
        from quadid_logs.report.comparison_page import comparison_page

        # Page and JSON and, where something was compared, the figures.
        drawn = {_PNG: comparison_figure(comparison), _LOOP_PNG: loop_comparison_figure(first, second)}
        figures = {name: each for name, each in drawn.items() if isinstance(each, Figure)}
        page = comparison_page(first, second, comparison, list(figures.values()))
        written = write_outcome(output, {_PAGE: page.encode(), _JSON: text.encode("ascii")}, figures, _FILES)
    code = EXIT_CODES[comparison.verdict]
    lines = comparison_lines(first, second, comparison)
    say_outcome(text, lines, written, code=code, as_json=as_json, quiet=quiet)
    if output is not None and open_report:
        open_page(output / _PAGE)
    return code
