"""``quadid-log plan``: what to set and to fly, and what it will give."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.completion import autopilots, axes
from quadid_logs.cli.failure import say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.longest import analyze_longest
from quadid_logs.cli.options import (
    AsJson,
    Band,
    EndS,
    LogNumber,
    OpenPage,
    Quiet,
    StartS,
    System,
    axes_of,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import open_page
from quadid_logs.cli.progress import Progress
from quadid_logs.data.settings import Settings
from quadid_logs.errors import SettingsError
from quadid_logs.output import check_folder_free, new_folder, write_together
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import vehicle_words


def plan(
    autopilot: Annotated[
        str,
        typer.Option(
            "--autopilot",
            metavar="NAME",
            help="Autopilot to plan for [default: that of --like].",
            autocompletion=autopilots,
            show_default=False,
        ),
    ] = "",
    axis: Annotated[
        list[str] | None,
        typer.Option(
            "--axes",
            "--axis",
            metavar="AXIS,...",
            help="Axes to plan for, such as roll,pitch; can be given several times [default: all].",
            autocompletion=axes,
        ),
    ] = None,
    firmware: Annotated[
        str | None,
        typer.Option(
            "--firmware",
            metavar="VERSION",
            help="Version of the autopilot, such as 4.5 [default: a recent one].",
        ),
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(
            "--like",
            metavar="LOG",
            help="Log of the vehicle: the plan is made for its model, air, settings and firmware.",
        ),
    ] = None,
    vehicle: Annotated[
        Path | None, typer.Option("--vehicle", metavar="FILE.toml", help="Simulate this vehicle.")
    ] = None,
    start_s: StartS = None,
    end_s: EndS = None,
    band: Band = None,
    system: System = 0,
    log_number: LogNumber = 0,
    propeller: Annotated[
        float,
        typer.Option(
            "--propeller",
            metavar="INCHES",
            help="Propeller diameter, if no log is given [default: 10].",
            show_default=False,
        ),
    ] = 10.0,
    air: Annotated[
        str,
        typer.Option(
            "--air",
            metavar="AIR",
            help="calm, breeze or wind [default: that of the log; without a log, a breeze].",
            show_default=False,
        ),
    ] = "",
    interval: Annotated[
        float,
        typer.Option(
            "--interval",
            metavar="PERCENT",
            help="Half of the 95 % interval of the control effectiveness to plan for [default: 7.5].",
            show_default=False,
        ),
    ] = 7.5,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the flight card and the parameter files."
        ),
    ] = None,
    as_json: AsJson = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the files of an earlier plan.")] = False,
    open_report: OpenPage = False,
    quiet: Quiet = False,
) -> int:
    """Say what to set and to fly to get an answer, and what a simulated flight of it gives.

    Without -o the card is only printed. --start-s, --end-s, --band, --system and --log belong to --like.
    """
    from quadid_logs.planning import make_plan, parse_version, predict
    from quadid_logs.report.markdown_page import markdown_page
    from quadid_logs.report.plan import (
        CARD_FILE,
        CARD_PAGE,
        card_lines,
        live_files,
        parameter_files,
        plan_text,
    )

    chosen = axes_of(",".join(axis or ()))
    version = None if firmware is None else parse_version(firmware)
    described = vehicle_of(vehicle)
    make = partial(make_plan, vehicle=described, propeller_inch=propeller, air=air, wanted=interval / 100.0)
    settings = settings_of(start_s=start_s, end_s=end_s, band=band, system=system, log=log_number)
    if like is None and settings != Settings():
        raise SettingsError(
            "These options choose a part of a log, and no log is given.", hint="Name it with --like LOG."
        )
    if like is None and not autopilot:
        raise SettingsError(
            "The autopilot is not known.", hint="Name it with --autopilot, or give a flown log with --like."
        )
    if like is None:
        planned = make(autopilot.lower(), chosen, version)
    else:
        check_log(like)
        # A wrong name or axis is said at once, not after a log was analyzed.
        wanted_of = make(autopilot.lower(), chosen, version).autopilot if autopilot else ""
        with Progress("plan", quiet=quiet) as progress:
            progress("analyzing the log")
            known = analyze_longest(like, settings, described)
        flown = known.log
        if wanted_of not in ("", flown.autopilot):
            raise SettingsError(
                f"{printable(like)} is a log of {flown.autopilot}.", hint="Give a log of the same autopilot."
            )
        if not flown.may_be_multirotor:
            raise SettingsError(
                f"{printable(like)} is a log of {vehicle_words(flown.vehicle_type)}.",
                hint="Plans are for multirotors. Give a log of one, or leave --like out.",
            )
        planned = make(flown.autopilot, chosen, version or flown.version, flown.parameters, known=known)
    texts = parameter_files(planned) | live_files(planned)
    files = {name: text.encode() for name, text in texts.items()}
    if output is not None:
        check_folder_free(output, (CARD_FILE, CARD_PAGE, *files), force=force)
    with Progress("plan", quiet=quiet) as progress:
        progress("simulating the flight")
        prediction = predict(planned, described)
    lines = card_lines(planned, prediction)
    if as_json:
        say(plan_text(planned, prediction).rstrip("\n"))
    elif not quiet:
        for line in lines:
            say(line)
    if output is not None:
        files[CARD_FILE] = ("\n".join(lines) + "\n").encode()
        files[CARD_PAGE] = markdown_page("\n".join(lines)).encode()
        with new_folder(output):
            write_together(output, files)
        if not (as_json or quiet):
            say(f"\nWrote {', '.join(sorted(files))} into {printable(output)}")
        if open_report:
            open_page(output / CARD_PAGE)
    return 0
