"""Options that several verbs take: spelt, described and read in one place."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.completion import axes
from quadid_logs.errors import SettingsError
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.data.settings import Settings
    from quadid_logs.data.vehicle import Vehicle

StartS = Annotated[
    float | None,
    typer.Option(
        "--start-s",
        metavar="S",
        help="Leave out everything before this time on the log's clock, which `info` shows [s].",
    ),
]
EndS = Annotated[
    float | None,
    typer.Option("--end-s", metavar="S", help="Leave out everything after this time on the log's clock [s]."),
]
Band = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--band", metavar="LOW HIGH", help="Fit from LOW to HIGH [Hz] [default: chosen from the log]."
    ),
]
System = Annotated[
    int, typer.Option("--system", metavar="ID", help="MAVLink system to read; 0: chosen from the log.")
]
LogNumber = Annotated[
    int,
    typer.Option(
        "--log", metavar="N", help="Number of the log, if the file holds several; `info` lists them."
    ),
]
LogFile = Annotated[
    Path, typer.Argument(metavar="LOG", help="Flight log. The content decides its format, not its name.")
]
StoreFolder = Annotated[Path, typer.Argument(metavar="STORE", help="Store that `quadid-log fleet` made.")]
SampleRateHz = Annotated[
    float,
    typer.Option("--sample-rate-hz", metavar="HZ", help="Resample to this rate; 0: chosen from the log."),
]
VehicleFile = Annotated[
    Path | None, typer.Option("--vehicle", metavar="FILE.toml", help="Mass, arms, thrust of the vehicle.")
]
AxisNames = Annotated[
    str,
    typer.Option(
        "--axes",
        metavar="AXIS,...",
        help=(
            "Axes that decide the exit code, such as roll,pitch [default: those that a "
            "system-identification mode swept, or all]."
        ),
        autocompletion=axes,
    ),
]
OpenPage = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ForceFile = Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")]
Force = Annotated[bool, typer.Option("--force", help="Replace the files of an earlier run.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print problems only.")]
NoProgress = Annotated[bool, typer.Option("-q", "--quiet", help="Print only the result, no progress.")]


def settings_of(
    *,
    start_s: float | None = None,
    end_s: float | None = None,
    sample_rate_hz: float = 0.0,
    band: tuple[float, float] | None = None,
    structure: str = "",
    window: int = 0,
    stride: int = 0,
    system: int = 0,
    log: int = 0,
) -> Settings:
    """Return the settings that the options ask for; those that are left out have their defaults.

    Raises
    ------
    SettingsError
        If one is out of its range.
    """
    from quadid_logs.data.settings import AlignSettings, IdentifySettings, Settings, in_band

    return Settings(
        system=system,
        log=log,
        align=AlignSettings(
            start_s=-math.inf if start_s is None else start_s,
            end_s=math.inf if end_s is None else end_s,
            sample_rate_hz=sample_rate_hz,
        ),
        identify=in_band(band, IdentifySettings(structure=structure, window=window, stride=stride)),
    )


def vehicle_of(file: Path | None) -> Vehicle | None:
    """Return what a vehicle file tells; None without one.

    Raises
    ------
    VehicleFileError
        If it cannot be read, or makes no sense.
    """
    if file is None:
        return None
    from quadid_logs.vehicle_file import read_vehicle

    return read_vehicle(file)


def axes_of(text: str) -> tuple[str, ...]:
    """Return the axes that a text names between commas.

    Raises
    ------
    SettingsError
        If one is no axis.
    """
    names = [name.strip().lower() for name in text.split(",")] if text.strip() else []
    for name in names:
        if name not in AXES:
            raise SettingsError(
                f"There is no axis {printable(name, 40)!r}.", hint="Give one or more of roll,pitch,yaw."
            )
    return tuple(axis for axis in AXES if axis in names)
