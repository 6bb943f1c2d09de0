"""Run every method on every data set, write the tables and the picture: `python -m benchmarks.methods`.

Results of this run are written as entries into `build/methods/`. All entries, these and those of others
in `benchmarks/entries/`, are read back by the one reader of the format before they are counted.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Final

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
os.environ.setdefault("MPLBACKEND", "Agg")

from benchmarks import nano_drone  # noqa: E402
from benchmarks.logs import corpus_folder  # noqa: E402
from benchmarks.methods.data_sets import Source, sources  # noqa: E402
from benchmarks.methods.entrants import ENTRANTS, Entrant, machine  # noqa: E402
from benchmarks.methods.entry import Entry, EntryError, Outcome, read_entry, write_entry  # noqa: E402
from benchmarks.methods.export import export  # noqa: E402
from benchmarks.methods.measure import Measured, measure  # noqa: E402
from benchmarks.methods.page import picture, tables  # noqa: E402
from benchmarks.methods.score import Facts  # noqa: E402
from quadid_logs.output import make_folder, write_together  # noqa: E402
from quadid_logs.untrusted import portable_name, printable  # noqa: E402

ROOT: Final = Path(__file__).resolve().parents[2]
OTHERS: Final = ROOT / "benchmarks" / "entries"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write entries, read all entries, write the tables and the picture."""
    options = _options(arguments)
    chosen = sources(corpus_folder(), short=options.short)
    if options.export:
        written = export(chosen, options.export)
        print(f"Wrote {written} data sets into {printable(options.export)}")
        return 0
    began = time.monotonic()
    facts: dict[str, Facts] = {}
    outcomes: dict[str, dict[str, Outcome]] = {each.name: {} for each in ENTRANTS if each.is_installed}
    without: list[str] = []
    for number, measured in enumerate(_measure_all(chosen, options.processes), start=1):
        print(f"{number} of {len(chosen)}: {printable(measured.name)}", file=sys.stderr, flush=True)
        for problem in measured.problems:
            print(f"  {problem}", file=sys.stderr)
        if measured.facts is None:
            without.append(measured.name)
            continue
        facts[measured.name] = measured.facts
        for method, outcome in measured.outcomes.items():
            outcomes[method][measured.name] = outcome
    make_folder(options.build)
    own = [_written(each, outcomes[each.name], options.build) for each in ENTRANTS if each.is_installed]
    entries, refused = _entries([*own, *sorted(OTHERS.glob("*.json"))])
    missing = [each.name for each in ENTRANTS if not each.is_installed]
    make_folder(options.output)
    text = "\n".join(
        tables(
            entries,
            facts,
            missing=missing,
            refused=refused,
            without_flight=without,
            minutes=(time.monotonic() - began) / 60.0,
        )
    )
    written = {"table.md": (text + "\n").encode(), "errors.png": picture(entries, facts)}
    nano = nano_drone.default_folder()
    if not options.short and not nano_drone.missing_files(nano):
        written[nano_drone.PAGE] = nano_drone.scores(nano).encode()
    write_together(options.output, written)
    print(text)
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="benchmarks.methods", description="Every method on every data set.")
    parser.add_argument(
        "--output", type=Path, default=ROOT / "build" / "methods", help="for table and picture"
    )
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "methods", help="for the entries")
    parser.add_argument("--processes", type=int, default=2, help="data sets at the same time (default 2)")
    parser.add_argument("--short", action="store_true", help="two simulated flights only")
    parser.add_argument("--export", type=Path, help="write the data sets as CSV into this folder, and end")
    return parser.parse_args(arguments)


def _measure_all(chosen: Sequence[Source], processes: int) -> Iterable[Measured]:
    """Yield every data set measured, in order."""
    if processes < 2:
        yield from map(measure, chosen)
        return
    # Spawned, not forked: forking a process that has started numpy's threads may hang. Workers are not
    # replaced after some tasks: that deadlocks (CPython issue 115634).
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(measure, chosen)


def _written(entrant: Entrant, results: dict[str, Outcome], folder: Path) -> Path:
    """Write the entry of a method that ran here, and return where."""
    entry = Entry(
        method=entrant.name,
        version=entrant.version,
        description=entrant.description,
        tuned_on=entrant.tuned_on,
        machine=machine(),
        results=results,
    )
    path = folder / f"{portable_name(entrant.name)}.json"
    write_entry(entry, path)
    return path


def _entries(paths: Iterable[Path]) -> tuple[list[Entry], list[str]]:
    """Read entries; return those that are sound, and why the others are not."""
    entries: dict[str, Entry] = {}
    refused = []
    for path in paths:
        try:
            entry = read_entry(path)
        except EntryError as error:
            refused.append(str(error))
            continue
        if entry.method in entries:
            refused.append(f"{printable(path.name)}: there is another entry called {entry.method}.")
        else:
            entries[entry.method] = entry
    return list(entries.values()), refused


if __name__ == "__main__":
    sys.exit(main())
