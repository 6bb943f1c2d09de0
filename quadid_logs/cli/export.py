"""``quadid-log export``: the aligned series as a table, or the model for another program."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.failure import say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.progress import Progress
from quadid_logs.output import check_free, new_folder, write_beside
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.data.settings import Settings
    from quadid_logs.data.vehicle import Vehicle


def export(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Flight log, told by its content.")],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="The ending says the format: .csv, .parquet, .mat; with --model .mat, .py, .sdf, .json.",
        ),
    ],
    model: Annotated[
        bool,
        typer.Option(
            "--model",
            help="Export the model: MATLAB, python-control, Gazebo's inertia (.sdf), SITL's frame (.json).",
        ),
    ] = False,
    vehicle: Annotated[
        Path | None,
        typer.Option("--vehicle", metavar="FILE.toml", help="Mass, arms, thrust: for N m and kg m^2."),
    ] = None,
    sample_rate_hz: Annotated[
        float, typer.Option("--sample-rate-hz", metavar="HZ", help="Resample to this rate; 0 chooses.")
    ] = 0.0,
    system: Annotated[
        int, typer.Option("--system", metavar="ID", help="MAVLink system to export; 0 chooses.")
    ] = 0,
    log_number: Annotated[
        int,
        typer.Option("--log", metavar="N", help="Which log of a file that holds several; info lists them."),
    ] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> int:
    """Write the aligned series that analyze works on, or the model for another program."""
    from quadid_logs.align import cut
    from quadid_logs.counting import counted
    from quadid_logs.data.settings import AlignSettings, Settings
    from quadid_logs.load import load
    from quadid_logs.report.series_file import check_table_path, write_table
    from quadid_logs.vehicle_file import read_vehicle

    given = None if vehicle is None else read_vehicle(vehicle)
    settings = Settings(system=system, log=log_number, align=AlignSettings(sample_rate_hz=sample_rate_hz))
    if model:
        return _export_model(log, output, settings, given, force=force)
    check_table_path(output, force=force)
    check_log(log)
    with Progress(log.name) as progress:
        progress("reading")
        prepared = load(log, settings, given)
        progress("aligning")
        data = cut(prepared, settings.align)
        progress("writing")
        n_rows = write_table(data, output, force=force)
    say(f"Wrote {counted(n_rows, 'row')} to {printable(output)}")
    return 0


def _export_model(
    log: Path, output: Path, settings: Settings, vehicle: Vehicle | None, *, force: bool
) -> int:
    """Write the recommended model; 1 if it holds an axis that must not be trusted."""
    from quadid_logs.pipeline import analyze
    from quadid_logs.report.model_files import check_model_format, model_bytes

    check_model_format(output)
    check_free(output, force=force)
    check_log(log)
    with Progress(log.name) as progress:
        result = analyze(log, settings, vehicle=vehicle, progress=progress)
    content = model_bytes(result, output.suffix.lower())
    with new_folder(output.parent):
        write_beside(output, content)
    say(f"Wrote the model to {printable(output)}")
    return 0 if result.diagnosis.usable else 1
