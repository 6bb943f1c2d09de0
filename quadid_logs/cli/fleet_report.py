"""``quadid-log fleet-report``: the store of a fleet as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.failure import say
from quadid_logs.output import check_free, make_folder, write_beside
from quadid_logs.untrusted import printable


def fleet_report(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="A store that quadid-log fleet made.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.html", help="The page.")] = Path(
        "fleet.html"
    ),
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> int:
    """Show every vehicle over its history: what changed when, and which vehicles are outliers.

    One line per change and per outlier goes to stdout.
    Exit code 0: none. 1: some.
    """
    from quadid_logs.fleet.history import read_fleet
    from quadid_logs.fleet.page import fleet_page, headlines

    check_free(output, force=force)
    fleet = read_fleet(store)
    page = fleet_page(fleet, store, output.parent)
    make_folder(output.parent)
    write_beside(output, page.encode("utf-8"))
    lines = headlines(fleet)
    for line in lines:
        say(line)
    n_vehicles = len(fleet.histories)
    say(f"{n_vehicles} vehicle{'' if n_vehicles == 1 else 's'}: {printable(output)}")
    return 1 if lines else 0
