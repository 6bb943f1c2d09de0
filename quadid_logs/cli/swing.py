"""``quadid-log swing``: the moment of inertia of a vehicle that swings on two strings, by its gyro."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.logs import check_log
from quadid_logs.cli.options import (
    AsJson,
    EndS,
    LogNumber,
    NoProgress,
    StartS,
    System,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import say_outcome
from quadid_logs.cli.progress import Progress
from quadid_logs.errors import SettingsError


def swing(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Log of the gyro while the vehicle swings on its strings.")
    ],
    length_m: Annotated[float, typer.Option("--length", metavar="M", help="Length of each string [m].")],
    distance_m: Annotated[
        float, typer.Option("--distance", metavar="M", help="Distance between the two strings [m].")
    ],
    mass_kg: Annotated[
        float | None,
        typer.Option(
            "--mass", metavar="KG", help="Mass with battery [kg] [default: that of the vehicle file]."
        ),
    ] = None,
    axis: Annotated[
        str,
        typer.Option(
            "--axis",
            metavar="AXIS",
            help="Axis that hangs vertically: roll, pitch or yaw [default: the axis that turns most].",
        ),
    ] = "",
    span_m: Annotated[
        float,
        typer.Option(
            "--span",
            metavar="M",
            help="Largest dimension across that axis [m], to estimate the air that swings along.",
        ),
    ] = 0.0,
    length_error_m: Annotated[
        float, typer.Option("--length-error", metavar="M", help="Possible error of --length (95 %) [m].")
    ] = 0.001,
    distance_error_m: Annotated[
        float, typer.Option("--distance-error", metavar="M", help="Possible error of --distance (95 %) [m].")
    ] = 0.001,
    mass_error_kg: Annotated[
        float | None,
        typer.Option("--mass-error", metavar="KG", help="Possible error of --mass (95 %) [default: 0.5 %]."),
    ] = None,
    vehicle: Annotated[
        Path | None,
        typer.Option(
            "--vehicle",
            metavar="FILE.toml",
            help="Vehicle file with the mass and the moments of the other axes.",
        ),
    ] = None,
    start_s: StartS = None,
    end_s: EndS = None,
    system: System = 0,
    log_number: LogNumber = 0,
    as_json: AsJson = False,
    quiet: NoProgress = False,
) -> int:
    """Measure a moment of inertia: let the vehicle swing on two strings and read its own gyro.

    Hang it by two parallel strings of one length, left and right of its centre of mass, so that the axis to
    measure is vertical. Turn it by 10 degrees, let go, and log the gyro for a minute.

    Exit code 0: measured. 2: the log could not be read, nothing swings in it, or the options make no sense.
    """
    import math

    from quadid_logs.bifilar import Bifilar
    from quadid_logs.bifilar import swing as measure
    from quadid_logs.load import read_log
    from quadid_logs.report.swing import swing_lines, swing_text

    known = vehicle_of(vehicle)
    # The mass that was given, or that of the vehicle file.
    if mass_kg is None and known is not None:
        mass_kg = known.mass_kg
    if mass_kg is None:
        raise SettingsError("The mass is not known.", hint="Give --mass in kg, or mass_kg in --vehicle.")
    hung = Bifilar(
        mass_kg=mass_kg,
        length_m=length_m,
        distance_m=distance_m,
        mass_half_width_kg=math.nan if mass_error_kg is None else mass_error_kg,
        length_half_width_m=length_error_m,
        distance_half_width_m=distance_error_m,
        span_m=span_m,
    )
    settings = settings_of(start_s=start_s, end_s=end_s, system=system, log=log_number)
    check_log(log)
    with Progress(log.name, quiet=quiet) as progress:
        progress("read")
        content = read_log(log, system=settings.system, number=settings.log)
        progress("fit")
        part = settings.align
        found = measure(content, hung, axis, start_s=part.start_s, end_s=part.end_s)
    text, lines = swing_text(content.path, hung, found), swing_lines(content.path, found, known)
    say_outcome(text, lines, code=0, as_json=as_json, quiet=False)
    return 0
