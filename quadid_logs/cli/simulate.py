"""``quadid-log simulate``: a flight whose truth is known, as a log file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadid_logs.cli.completion import autopilots, scenarios
from quadid_logs.cli.failure import say
from quadid_logs.cli.options import Quiet, vehicle_of
from quadid_logs.cli.progress import Progress
from quadid_logs.errors import SettingsError
from quadid_logs.output import check_free, check_no_link, new_folder, write_beside
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.simulator import Simulation


def simulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO", help="Scenario, by a name that --list shows.", autocompletion=scenarios
        ),
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.(bin|ulg|bbl|tlog|usd)",
            help="File to write. Its ending chooses the format.",
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            "--seed", metavar="N", help="Seed of the random numbers: another seed is another flight."
        ),
    ] = 0,
    duration_s: Annotated[
        float | None, typer.Option("--duration-s", metavar="S", help="Length of the log [s].")
    ] = None,
    rate_hz: Annotated[
        float | None, typer.Option("--rate-hz", metavar="HZ", help="Rate of the main messages [Hz].")
    ] = None,
    vehicle: Annotated[
        Path | None,
        typer.Option("--vehicle", metavar="FILE.toml", help="Fly the vehicle of this file instead."),
    ] = None,
    autopilot: Annotated[
        str,
        typer.Option(
            "--autopilot",
            metavar="NAME",
            help="Autopilot whose log is written [default: by the ending].",
            autocompletion=autopilots,
        ),
    ] = "",
    list_scenarios: Annotated[bool, typer.Option("--list", help="List the scenarios and stop.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the files if they exist.")] = False,
    quiet: Quiet = False,
) -> int:
    """Fly a simulated vehicle and write the log that its autopilot would have written.

    What is true about the flight goes into FILE.truth.json beside the log.
    """
    from quadid_logs.simulator import SCENARIOS
    from quadid_logs.simulator import simulate as fly_scenario
    from quadid_logs.writers import AUTOPILOT_OF_ENDING

    if list_scenarios:
        for one in SCENARIOS.values():
            say(f"{one.name:20}  {one.sentence}")
        return 0
    if not scenario or output is None:
        raise SettingsError(
            "The scenario or the output file is missing.",
            hint="Give SCENARIO -o FILE. --list shows the scenarios.",
        )
    # Refuse before the work what could not be written after it.
    if seed < 0:
        raise SettingsError(f"The seed {seed} is negative.", hint="Give 0 or more.")
    if output.suffix.lower() not in AUTOPILOT_OF_ENDING:
        raise SettingsError(
            f"The name {printable(output.name, 80)!r} does not show the format.",
            hint=f"Let it end in {', '.join(AUTOPILOT_OF_ENDING)}.",
        )
    for path in (output, truth_path(output)):
        check_no_link(path)
    check_free(output, truth_path(output), force=force)
    with Progress(scenario, quiet=quiet) as progress:
        progress("simulating")
        simulation = fly_scenario(
            scenario,
            seed=seed,
            duration_s=duration_s,
            rate_hz=rate_hz,
            vehicle=vehicle_of(vehicle),
            autopilot=autopilot or AUTOPILOT_OF_ENDING[output.suffix.lower()],
        )
        progress("writing")
        write_simulation(simulation, output)
    if not quiet:
        size_mb = output.stat().st_size / 1e6
        say(f"Wrote {printable(output)} ({size_mb:.1f} MB) and {printable(truth_path(output).name)}")
    return 0


def truth_path(log: Path) -> Path:
    """Return where the truth about a log is written: flight.bin has flight.truth.json."""
    return log.with_suffix(".truth.json")


def write_simulation(simulation: Simulation, output: Path) -> None:
    """Write log and truth, and damage the log if the scenario says so.

    Raises
    ------
    OutputError
        If they cannot be written.
    """
    from quadid_logs.simulator import damage_bytes
    from quadid_logs.writers import write_log

    text = json.dumps(simulation.truth, indent=1, allow_nan=False) + "\n"
    with new_folder(output.parent):
        write_log(simulation.log, output)
        if simulation.damage:
            seed = int(simulation.truth["seed"])
            write_beside(output, damage_bytes(output.read_bytes(), simulation.damage, seed))
        write_beside(truth_path(output), text.encode("utf-8"))
