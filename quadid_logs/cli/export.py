"""``quadid-log export``: the aligned series as a table, or the model for another program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.failure import report_problem, say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.longest import analyze_longest
from quadid_logs.cli.options import (
    EndS,
    ForceFile,
    LogFile,
    LogNumber,
    Quiet,
    SampleRateHz,
    StartS,
    System,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.progress import Progress
from quadid_logs.output import check_free, new_folder, write_beside
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.data.settings import Settings
    from quadid_logs.data.vehicle import Vehicle


def export(
    log: LogFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help=(
                "File to write. Its ending chooses the format: .csv, .parquet, .mat; with --model .mat, "
                ".py, .sdf, .json."
            ),
        ),
    ],
    model: Annotated[
        bool,
        typer.Option(
            "--model",
            help=(
                "Export the model for MATLAB (.mat), python-control (.py), Gazebo (.sdf, inertia) or SITL "
                "(.json, frame)."
            ),
        ),
    ] = False,
    vehicle: Annotated[
        Path | None,
        typer.Option(
            "--vehicle", metavar="FILE.toml", help="Mass, arms, thrust: gives results in N m and kg m^2."
        ),
    ] = None,
    start_s: StartS = None,
    end_s: EndS = None,
    band: Annotated[
        tuple[float, float] | None,
        typer.Option("--band", metavar="LOW HIGH", help="With --model: fit from LOW to HIGH [Hz]."),
    ] = None,
    sample_rate_hz: SampleRateHz = 0.0,
    system: System = 0,
    log_number: LogNumber = 0,
    force: ForceFile = False,
    quiet: Quiet = False,
) -> int:
    """Write the aligned series that analyze works on, or the model for another program."""
    from quadid_logs.align import check_part, cut
    from quadid_logs.counting import counted
    from quadid_logs.load import load
    from quadid_logs.report.series_file import check_table_path, write_table

    given = vehicle_of(vehicle)
    settings = settings_of(
        start_s=start_s,
        end_s=end_s,
        sample_rate_hz=sample_rate_hz,
        band=band,
        system=system,
        log=log_number,
    )
    if model:
        return _export_model(log, output, settings, given, force=force, quiet=quiet)
    check_table_path(output, force=force)
    check_log(log)
    with Progress(log.name, quiet=quiet) as progress:
        progress("reading")
        prepared = load(log, settings, given)
        progress("aligning")
        check_part([prepared], settings.align)
        data = cut(prepared, settings.align)
        progress("writing")
        n_rows = write_table(data, output, force=force)
    if not quiet:
        say(f"Wrote {counted(n_rows, 'row')} to {printable(output)}")
    return 0


def _export_model(
    log: Path, output: Path, settings: Settings, vehicle: Vehicle | None, *, force: bool, quiet: bool
) -> int:
    """Write the recommended model; 1 if it holds an axis that must not be trusted."""
    from quadid_logs.report.commands import on_log
    from quadid_logs.report.model_files import check_model_format, model_bytes
    from quadid_logs.report.verdict import refused_names
    from quadid_logs.sentences import listed

    check_model_format(output)
    check_free(output, force=force)
    check_log(log)
    with Progress(log.name, quiet=quiet) as progress:
        result = analyze_longest(log, settings, vehicle, progress=progress)
    content = model_bytes(result, output.suffix.lower())
    with new_folder(output.parent):
        write_beside(output, content)
    if not quiet:
        say(f"Wrote the model to {printable(output)}")
    refused = refused_names(result)
    if refused:
        report_problem(
            f"Do not trust {listed(refused)} of this model: `{on_log(result, 'analyze')}` says why."
        )
    return 1 if refused else 0
