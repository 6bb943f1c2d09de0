"""``quadid-log fleet-report``: the store of a fleet as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.failure import say
from quadid_logs.cli.fleet import NOTHING_USABLE
from quadid_logs.cli.options import ForceFile, StoreFolder
from quadid_logs.cli.query import report_set_aside
from quadid_logs.output import check_free, new_folder, write_beside
from quadid_logs.untrusted import printable

#: Exit code: the last flights of a vehicle differ, and it takes more to call that a change.
_UNDECIDED = 3


def fleet_report(
    store: StoreFolder,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.html", help="The page.")] = Path(
        "fleet.html"
    ),
    force: ForceFile = False,
) -> int:
    """Show every vehicle over its history: what changed when, and which vehicles are outliers.

    The first line on stdout says how many axes are usable, and what blocks the
    others; then comes one line per change, outlier and open question.

    Exit code 0: none. 1: a vehicle changed or is an outlier, or its flights are
    not one vehicle. 3: none, but the last flights of a vehicle differ, and one or
    two more must decide. 4: no axis is usable, so that nothing could be compared.
    """
    from quadid_logs.fleets.coverage import coverage_words
    from quadid_logs.fleets.history import read_fleet
    from quadid_logs.fleets.page import fleet_page, headlines

    check_free(output, force=force)
    fleet = read_fleet(store)
    report_set_aside(fleet.set_aside)
    page = fleet_page(fleet, store, output.parent)
    with new_folder(output.parent):
        write_beside(output, page.encode("utf-8"))
    say(coverage_words(fleet.coverage))
    for line in headlines(fleet):
        say(line)
    n_vehicles = len(fleet.histories)
    say(f"{n_vehicles} vehicle{'' if n_vehicles == 1 else 's'}: {printable(output)}")
    if any(history.changes or history.scatter or history.outliers for history in fleet.histories):
        return 1
    if any(history.open_change for history in fleet.histories):
        return _UNDECIDED
    return NOTHING_USABLE if fleet.coverage.is_empty else 0
