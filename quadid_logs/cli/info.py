"""``quadid-log info``: what is in a log, and what is missing for `analyze`."""

from __future__ import annotations

import json

from quadid_logs.cli.failure import say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.options import (
    AsJson,
    EndS,
    LogFile,
    LogNumber,
    NoProgress,
    StartS,
    System,
    VehicleFile,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.progress import Progress
from quadid_logs.cli.terminal import wrapped
from quadid_logs.errors import SeveralLogsError


def info(
    log: LogFile,
    start_s: StartS = None,
    end_s: EndS = None,
    system: System = 0,
    log_number: LogNumber = 0,
    vehicle: VehicleFile = None,
    as_json: AsJson = False,
    quiet: NoProgress = False,
) -> int:
    """Say what is in a log, at which true rates, and what is missing for analyze."""
    from quadid_logs.align import check_part, cut
    from quadid_logs.health import health_of
    from quadid_logs.load import load
    from quadid_logs.report.inventory import inventory_lines, inventory_text

    given = vehicle_of(vehicle)
    settings = settings_of(start_s=start_s, end_s=end_s, system=system, log=log_number)
    check_log(log)
    with Progress(log.name, quiet=quiet) as progress:
        progress("reading")
        try:
            prepared = load(log, settings, given)
        except SeveralLogsError as several:
            # One of the file's logs must be chosen to say more.
            if as_json:
                say(json.dumps({"logs": several.logs}))
                return 0
            for text in (str(several), *several.logs):
                say(text)
            return 0
        progress("aligning")
        check_part([prepared], settings.align)
        content, data = prepared.log, cut(prepared, settings.align)
    if as_json:
        say(inventory_text(content, data, health_of(prepared, data)).rstrip("\n"))
        return 0
    for line in inventory_lines(content, data):
        for part in wrapped(line.text, line.hang):
            say(part)
    return 0
