"""``quadid-log fleet``: many logs of many vehicles into a store."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.failure import report_problem, say
from quadid_logs.cli.options import Band, Quiet, vehicle_of
from quadid_logs.cli.progress import span_words
from quadid_logs.cli.terminal import is_terminal
from quadid_logs.counting import counted
from quadid_logs.errors import SettingsError
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.fleets.run import Tally


#: A week: who wants more wants no limit, and timers of processes have one of their own [minutes].
_LONGEST_MIN = 10_080.0
#: Exit code: all done, and no axis in the store is usable.
NOTHING_USABLE = 4


def fleet(
    places: Annotated[
        list[str],
        typer.Argument(
            metavar="PATH_OR_URL...", help="Logs: files, folders, patterns or URLs (s3://bucket/folder)."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="STORE", help="Folder of the store with the results.")
    ],
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", help="Local processes; 0: one per core.")
    ] = 0,
    scheduler: Annotated[
        str,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="Address of a Dask scheduler, such as tcp://host:8786."
        ),
    ] = "",
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Continue a run: skip logs that the store holds, try lost logs again."),
    ] = False,
    vehicle_from: Annotated[
        str,
        typer.Option(
            "--vehicle-from", metavar="REGEX", help="Pattern that finds the vehicle's name in path or URL."
        ),
    ] = "",
    model_from: Annotated[
        str,
        typer.Option(
            "--model-from", metavar="REGEX", help="Pattern that finds the model's name in path or URL."
        ),
    ] = "",
    vehicle: Annotated[
        Path | None,
        typer.Option("--vehicle", metavar="FILE.toml", help="Mass, arms, thrust of all vehicles."),
    ] = None,
    structure: Annotated[
        str,
        typer.Option(
            "--structure",
            metavar="NAME",
            help="Recommend this structure for all logs, so that they can be compared.",
        ),
    ] = "damped",
    band: Band = None,
    reports: Annotated[
        bool, typer.Option("--reports", help="Also keep the report of every flight (6 MB each).")
    ] = False,
    margins: Annotated[
        bool, typer.Option("--margins", help="Also store stability margins and flown gains (slower).")
    ] = False,
    max_mb: Annotated[
        float, typer.Option("--max-mb", metavar="MB", help="Largest file that is downloaded.")
    ] = 4000.0,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout", metavar="MINUTES", help="Longest time for one log; after that it counts as lost."
        ),
    ] = 30.0,
    quiet: Quiet = False,
) -> int:
    """Analyze all logs, one row per log, flight and axis, on this machine's cores or on a cluster.

    A log that cannot be read is a row with its reason. The first line says how
    many axes in the store are usable, and what blocks the others.

    Exit code 0: all done. 1: some logs are lost, for they could not be fetched,
    took too long or killed their process; --resume tries them again. 4: all
    done, but no axis in the store is usable.
    """
    from quadid_logs.fleets.coverage import coverage_of, coverage_words
    from quadid_logs.fleets.engine import Cluster
    from quadid_logs.fleets.log_files import find_logs
    from quadid_logs.fleets.naming import NamingRules
    from quadid_logs.fleets.options import Options
    from quadid_logs.fleets.run import LOST, run_fleet
    from quadid_logs.fleets.store import count_verdicts

    if workers < 0 or not max_mb > 0.0 or not 0.0 < timeout <= _LONGEST_MIN:
        raise SettingsError(
            f"--workers and --max-mb cannot be negative. --timeout is {_LONGEST_MIN:g} at most.",
            hint="Leave them out.",
        )
    options = Options(
        structure=structure,
        band_hz=band,
        vehicle=vehicle_of(vehicle),
        vehicle_file="" if vehicle is None else vehicle.read_text(encoding="utf-8"),
        rules=NamingRules(vehicle_from=vehicle_from, model_from=model_from),
        reports=reports,
        margins=margins,
        max_bytes=int(max_mb * 1e6),
        timeout_s=60.0 * timeout,
    )
    _ = options.settings  # checks structure and band before the work
    progress = FleetProgress(quiet=quiet)
    tally = run_fleet(
        find_logs(places),
        output,
        options,
        Cluster(scheduler=scheduler, workers=workers),
        resume=resume,
        progress=progress,
        notice=progress.notice,
    )
    progress.end()
    coverage = coverage_of(count_verdicts(output))
    if not quiet:
        say(coverage_words(coverage))
        from quadid_logs.fleets.run import ANALYZED, KNOWN, LOST, UNREADABLE

        words = {ANALYZED: "analyzed", UNREADABLE: "unreadable", LOST: "lost", KNOWN: "already there"}
        parts = [f"{tally.counts[key]} {word}" for key, word in words.items() if tally.counts[key]]
        rate = f"{tally.rate_hz:.2g} logs/s" if tally.rate_hz else ""
        summary = f"{counted(tally.n_logs, 'log')}: {', '.join(filter(None, (*parts, rate)))}"
        say(f"{summary} -> {printable(output)}")
    if tally.counts[LOST]:
        return 1
    return NOTHING_USABLE if coverage.is_empty else 0


class FleetProgress:
    """How far, how fast and how long still: one line on a terminal, now and then one in a pipe."""

    _PERIOD_S = 0.2
    _PIPE_PERIOD_S = 10.0

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._terminal = is_terminal(sys.stderr)
        self._next_s = 0.0
        self._dashboard = ""

    def __call__(self, tally: Tally) -> None:
        """Show the tally, if the last time is a while ago."""
        if tally.dashboard and tally.dashboard != self._dashboard:
            self._dashboard = tally.dashboard
            self._write(f"dashboard while this runs: {printable(tally.dashboard)}", stays=True)
        now = time.monotonic()
        if now >= self._next_s and tally.n_done:
            self._next_s = now + (self._PERIOD_S if self._terminal else self._PIPE_PERIOD_S)
            left = span_words(tally.left_s)
            self._write(
                f"{tally.n_done} of {counted(tally.n_logs, 'log')}, {tally.rate_hz:.2g}/s, {left} left"
            )

    def notice(self, text: str) -> None:
        """Say what happened to the cluster."""
        self.end()
        report_problem(text)

    def end(self) -> None:
        """Wipe the line."""
        if self._terminal and not self._quiet:
            sys.stderr.write("\r\x1b[2K")
            sys.stderr.flush()

    def _write(self, text: str, *, stays: bool = False) -> None:
        if self._quiet:
            return
        end = "" if self._terminal and not stays else "\n"
        sys.stderr.write(f"\r\x1b[2K{text}{end}" if self._terminal else f"{text}\n")
        sys.stderr.flush()
