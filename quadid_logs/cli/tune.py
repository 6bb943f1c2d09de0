"""``quadid-log tune``: the next gains to fly, or why not."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.failure import report_problem, say
from quadid_logs.cli.logs import check_log
from quadid_logs.cli.longest import analyze_each, analyze_longest
from quadid_logs.cli.options import (
    Band,
    EndS,
    LogNumber,
    OpenPage,
    Quiet,
    StartS,
    System,
    VehicleFile,
    settings_of,
    vehicle_of,
)
from quadid_logs.cli.outcome import open_page
from quadid_logs.cli.progress import Progress
from quadid_logs.commands import named
from quadid_logs.errors import SettingsError
from quadid_logs.sentences import listed
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.data.off_nominal import Ranges
    from quadid_logs.data.result import EarlierFlight, Result
    from quadid_logs.data.tuning import Limits, Tuning

_DEFAULT_FOLDER = Path("quadid-tune")
_HIGHEST_DB, _HIGHEST_DEG = 40.0, 90.0


def tune(
    context: typer.Context,
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Log of a flight with the gains that are set now.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Folder for the results; each log gets its own folder in it [default: quadid-tune].",
        ),
    ] = None,
    earlier: Annotated[
        list[Path] | None,
        typer.Option(
            "--earlier",
            metavar="LOG",
            help=(
                "Log of an earlier flight of the same vehicle, which narrows the intervals. Can be given "
                "several times."
            ),
        ),
    ] = None,
    vehicle: VehicleFile = None,
    start_s: StartS = None,
    end_s: EndS = None,
    band: Band = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON to stdout.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the files of an earlier run on this log.")
    ] = False,
    gain_margin_db: Annotated[
        float, typer.Option("--gain-margin-db", metavar="X", help="Gain margin to keep [dB].")
    ] = 6.0,
    phase_margin_deg: Annotated[
        float, typer.Option("--phase-margin-deg", metavar="X", help="Phase margin to keep [deg].")
    ] = 45.0,
    apart: Annotated[
        bool,
        typer.Option(
            "--apart/--together", help="Change P, I, D and angle gain each by itself, or all by one factor."
        ),
    ] = True,
    filters: Annotated[
        bool,
        typer.Option(
            "--filters",
            help="Experimental: change filters and notches together with the gains, if that helps.",
        ),
    ] = False,
    mass_range: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--mass-range",
            metavar="LOW HIGH",
            help="Range of factors on mass and inertia over which the limits are checked [default: 0.8 1.2].",
        ),
    ] = None,
    density_range: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--density-range",
            metavar="LOW HIGH",
            help="Range of factors on air density over which the limits are checked [default: 0.82 1.1].",
        ),
    ] = None,
    propeller_range: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--propeller-range",
            metavar="LOW HIGH",
            help=(
                "Range of factors on propeller diameter over which the limits are checked [default: 1 1.07]."
            ),
        ),
    ] = None,
    system: System = 0,
    log_number: LogNumber = 0,
    open_report: OpenPage = False,
    quiet: Quiet = False,
) -> int:
    """Recommend the gains of the next flight, with the margins that they promise, or say why not.

    Writes into DIR/<log>: tune.html, tune.json, promise.json for `check`, and, where a gain changes, a
    parameter file with the next gains and one with those that flew, which is never replaced. Exit code 0:
    gains to load, or to keep. 1: no advice on at least one axis. 2: the log could not be read.
    """
    from quadid_logs.earlier import with_earlier
    from quadid_logs.report.provenance import provenance_of
    from quadid_logs.report.tune_folder import (
        JSON_FILE,
        check_tune_folder,
        tune_folder,
        tuning_files,
        write_tuning,
    )
    from quadid_logs.report.tune_page import PAGE_FILE
    from quadid_logs.tuning import recommend

    limits = _limits(gain_margin_db, phase_margin_deg)
    ranges = _ranges(mass_range, density_range, propeller_range)
    for one in (log, *(earlier or ())):
        check_log(one)
    provenance = provenance_of(log, str(context.obj or ""))
    folder = tune_folder(output or _DEFAULT_FOLDER, log, provenance.log_sha256, log_number)
    check_tune_folder(folder, force=force)
    described = vehicle_of(vehicle)
    settings = settings_of(start_s=start_s, end_s=end_s, band=band, system=system, log=log_number)
    own = settings_of(band=band, system=system)
    before = analyze_each([(one, own) for one in earlier or ()], described, published=False, quiet=quiet)
    with Progress(log.name, quiet=quiet) as progress:
        result = analyze_longest(log, settings, described, published=False, progress=progress)
        result = with_earlier(result, before)
        progress("tune")
        tuning = recommend(result, limits, apart=apart, filters=filters, ranges=ranges)
        files = tuning_files(result, tuning, provenance, folder=folder.name)
    removed = write_tuning(folder, files)
    if as_json:
        say(files[JSON_FILE].rstrip("\n"))
    elif not quiet:
        _show(result, tuning, folder, tuple(sorted(files)), removed)
    elif tuning.refused:
        report_problem(f"{printable(log.name)}: no advice on {listed(tuning.refused)}")
    if open_report:
        open_page(folder / PAGE_FILE)
    return 1 if tuning.refused else 0


def _limits(gain_db: float, phase_deg: float) -> Limits:
    """Return the limits, the disk margin with them in the proportion of the defaults."""
    from quadid_logs.data.tuning import GOOD, Limits

    for name, value, highest in (
        ("--gain-margin-db", gain_db, _HIGHEST_DB),
        ("--phase-margin-deg", phase_deg, _HIGHEST_DEG),
    ):
        if not (math.isfinite(value) and 0.0 < value <= highest):
            hint = f"Give a value above 0, up to {highest:g}."
            raise SettingsError(f"{name} {value:g} is not a possible margin.", hint=hint)
    if (gain_db, phase_deg) == GOOD[:2]:
        return GOOD
    # Who asks for less of gain and phase does not want the disk of the defaults, which is both at once.
    factor = 10.0 ** (gain_db / 20.0)
    of_gain, of_phase = 2.0 * (factor - 1.0) / (factor + 1.0), 2.0 * math.tan(0.5 * math.radians(phase_deg))
    return Limits(gain_db, phase_deg, min(GOOD.disk * max(gain_db / GOOD.gain_db, 1.0), of_gain, of_phase))


def _ranges(*given: tuple[float, float] | None) -> Ranges:
    """Return the ranges of mass, density and propeller, the defaults where none is given."""
    from quadid_logs.data.off_nominal import OFF_NOMINAL, Ranges, checked

    return checked(Ranges(*(one or default for one, default in zip(given, OFF_NOMINAL, strict=True))))


def _show(
    result: Result, tuning: Tuning, folder: Path, written: tuple[str, ...], removed: tuple[str, ...]
) -> None:
    from quadid_logs.report.commands import on_next_log
    from quadid_logs.report.promise_file import PROMISE_FILE
    from quadid_logs.report.tune_view import tune_view

    view = tune_view(result, tuning)
    say(view.headline)
    # What is said of each axis, once where it is the same of several.
    axes_of: dict[tuple[str, ...], list[str]] = {}
    for axis in view.axes:
        gains = (
            f"{gain.name} {gain.now} -> {gain.next}{f' (target {gain.target})' if gain.target else ''}"
            for gain in axis.gains
        )
        said = (f"{axis.sentence} {axis.promise}".rstrip(), *gains)
        said += tuple(filter(None, (axis.off_nominal, axis.filter_note, axis.warning)))
        axes_of.setdefault(said, []).append(axis.axis)
    for (sentence, *details), axes in axes_of.items():
        say(f"  {listed(axes)}: {sentence}")
        for detail in details:
            say(f"    {detail}")
    for one in result.earlier:
        say(f"  {printable(Path(one.path).name)} {_earlier_words(result, one)}")
    if tuning.refused:
        for step in view.steps:
            say(f"  next: {step}")
    say(f"  written to {printable(folder)}: {', '.join(written)}")
    if PROMISE_FILE in written:
        check = on_next_log(result, "check", "--promise", named(str(folder)))
        say(f"  after the next flight: `{check}`")
    if removed:
        say(f"  removed files of an earlier run: {', '.join(printable(folder / name) for name in removed)}")


def _earlier_words(result: Result, earlier: EarlierFlight) -> str:
    """Say what an earlier flight tells, and of which axes this one tells nothing."""
    loops = {} if result.closed_loop is None else result.closed_loop.axes
    alone = [axis for axis in earlier.axes if loops[axis].by_earlier]
    narrowed = [axis for axis in earlier.axes if axis not in alone]
    parts = [f"narrows {listed(narrowed)}"] if narrowed else []
    if alone:
        parts.append(f"gives {listed(alone)}, of which this flight shows too little")
    return " and ".join(parts) or "narrows nothing"
