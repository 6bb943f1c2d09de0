"""``quadid-log export``: the aligned series as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.failure import say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.progress import Progress


def export(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Flight log, told by its content.")],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="FILE.(csv|parquet|mat)", help="The ending says the format."),
    ],
    sample_rate_hz: Annotated[
        float, typer.Option("--sample-rate-hz", metavar="HZ", help="Resample to this rate; 0 chooses.")
    ] = 0.0,
    system: Annotated[
        int, typer.Option("--system", metavar="ID", help="MAVLink system to export; 0 chooses.")
    ] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> int:
    """Write the aligned series that analyze works on to CSV, Parquet or MATLAB."""
    from quadid_logs.align import align
    from quadid_logs.data.settings import Settings
    from quadid_logs.readers import read_log
    from quadid_logs.report.table import check_table_path, write_table
    from quadid_logs.untrusted import printable

    check_table_path(output, force=force)
    settings = Settings(system=system, sample_rate_hz=sample_rate_hz)
    check_log(log)
    with Progress(log.name) as progress:
        progress("reading")
        content = read_log(log, system=system)
        progress("aligning")
        data = align(content, settings)
        progress("writing")
        n_rows = write_table(data, output, force=force)
    say(f"Wrote {n_rows} rows to {printable(output)}")
    return 0
