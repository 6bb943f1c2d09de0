"""``quadid-log predict``: body rates some steps ahead in one flight, by what other flights show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.logs import check_log, expanded
from quadid_logs.cli.options import (
    AsJson,
    EndS,
    Quiet,
    StartS,
    System,
    VehicleFile,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import say_outcome
from quadid_logs.cli.progress import Progress, parts
from quadid_logs.errors import SettingsError


def predict(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help="Two or more flights of one vehicle to fit."),
    ],
    on: Annotated[
        list[Path],
        typer.Option(
            "--on",
            metavar="LOG",
            help="Flight to predict, which is not fitted. Can be given several times.",
        ),
    ],
    steps: Annotated[str, typer.Option("--steps", metavar="N,N", help="Horizons in samples.")] = "1,10,50",
    sets: Annotated[
        str,
        typer.Option(
            "--sets",
            metavar="NAME,NAME",
            help="Set of each LOG, in order. Put flights of one trajectory into one set.",
        ),
    ] = "",
    vehicle: VehicleFile = None,
    start_s: StartS = None,
    end_s: EndS = None,
    sample_rate_hz: Annotated[
        float,
        typer.Option(
            "--sample-rate-hz", metavar="HZ", help="Resample to this rate; 0: chosen from the logs."
        ),
    ] = 0.0,
    system: System = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Predict the body rates of a flight some steps ahead, with intervals, by other flights of the vehicle.

    Every sample starts a prediction, which is given the torque up to the end of its horizon. The error is
    compared with that of constant rates.

    Exit code 0: predicted. 2: a log could not be read or lacks a signal, or the options make no sense.
    """
    from quadid_logs.align import cut
    from quadid_logs.identify.horizons import fit_predictor
    from quadid_logs.load import load
    from quadid_logs.report.horizons import prediction_lines, predictions_text

    logs = list(expanded(logs))
    described = vehicle_of(vehicle)
    settings = settings_of(start_s=start_s, end_s=end_s, sample_rate_hz=sample_rate_hz, system=system)
    wanted = _numbers(steps)
    for log in (*logs, *on):
        check_log(log)
    flights = []
    for log, part in zip((*logs, *on), parts([*logs, *on]), strict=True):
        with Progress(log.name, quiet=quiet, part=part) as progress:
            progress("read")
            flights.append(cut(load(log, settings, described), settings.align))
    ahead = fit_predictor(flights[: len(logs)], wanted, sets.split(",") if sets else None)
    found = {str(log): ahead.predict(flight) for log, flight in zip(on, flights[len(logs) :], strict=True)}
    lines = [line for path, predictions in found.items() for line in prediction_lines(path, predictions)]
    say_outcome(predictions_text(ahead, found), lines, code=0, as_json=as_json, quiet=False)
    return 0


def _numbers(steps: str) -> tuple[int, ...]:
    """Return the horizons."""
    try:
        return tuple(int(each) for each in steps.split(","))
    except ValueError as error:
        raise SettingsError(f"--steps {steps}: not whole numbers.", hint="As in --steps 1,10,50.") from error
