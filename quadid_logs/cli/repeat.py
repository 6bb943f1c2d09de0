"""``quadid-log repeat``: whether several flights of one vehicle agree, and which one does not."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.logs import expanded
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
from quadid_logs.errors import SettingsError
from quadid_logs.output import check_folder_free

_JSON, _PAGE = "repeat.json", "repeat.html"
_PNG = {"funnel": "repeat-funnel.png", "flights": "repeat-flights.png"}
_FILES = (_JSON, _PAGE, *_PNG.values())
#: Contract with scripts: see `repeat`.
_EXIT_CODES = {"agree": 0, "differ": 1, "not comparable": 3}


def repeat(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Two or more flights of one vehicle in one state.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help=f"Folder for {_PAGE}, {_JSON} and PNG files."),
    ] = None,
    vehicle: VehicleFile = None,
    start_s: StartS = None,
    end_s: EndS = None,
    band: Band = None,
    system: System = 0,
    as_json: AsJson = False,
    force: Force = False,
    open_report: OpenPage = False,
    quiet: Quiet = False,
) -> int:
    """Tell whether several flights of one vehicle agree, by how much they differ, and which is the outlier.

    Each flight is analyzed by itself, and predicted from the others.

    Exit code 0: compared on every axis, they agree. 1: two flights differ, or a log is of another vehicle.
    2: a log could not be read, or the options make no sense. 3: no difference seen, but on an axis fewer than
    two flights tell the effectiveness.
    """
    from quadid_logs.repetition import repeat as repeat_results
    from quadid_logs.report.repetition import repetition_lines, repetition_text

    logs = list(expanded(logs))
    if len(logs) < 2:
        raise SettingsError(
            "One flight cannot be compared with itself.", hint="Name two logs or more of one vehicle."
        )
    if output is not None:
        check_folder_free(output, _FILES, force=force)
    described = vehicle_of(vehicle)
    settings = settings_of(start_s=start_s, end_s=end_s, band=band, system=system)
    found = repeat_results(analyze_each([(log, settings) for log in logs], described, quiet=quiet))
    text = repetition_text(found)
    written = ""
    if output is not None:
        from quadid_logs.figures import Figure
        from quadid_logs.figures.repetition_chart import repetition_figures
        from quadid_logs.report.repetition_page import repetition_page

        # Page and JSON and, where flights tell something, the figures.
        figures = [each for each in repetition_figures(found) if isinstance(each, Figure)]
        files = {_PAGE: repetition_page(found, figures).encode(), _JSON: text.encode("ascii")}
        written = write_outcome(output, files, {_PNG[each.key]: each for each in figures}, _FILES)
    code = _EXIT_CODES[found.verdict]
    lines = repetition_lines(found)
    say_outcome(text, lines, written, code=code, as_json=as_json, quiet=quiet)
    if output is not None and open_report:
        open_page(output / _PAGE)
    return code
