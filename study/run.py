"""Measure whether the intervals keep their promise: `python study/run.py`.

Flights drawn at random are simulated closed-loop, logged, and analyzed as any
log is; every parameter that the analysis calls identifiable is held against
the truth. One line of JSON per flight is written as soon as it is known, so
that an interrupted study goes on where it stopped; a study of other code or
another seed starts anew.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

# One core per process, before numpy starts its threads.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
os.environ.setdefault("MPLBACKEND", "Agg")
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from study.draw import draw_flight  # noqa: E402
from study.margins import draw_loop, measure_loops  # noqa: E402
from study.measure import measure  # noqa: E402

Measured = Callable[[tuple[int, int]], dict[str, Any]]


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing of the study, then print and write its tables and plots."""
    given = sys.argv[1:] if arguments is None else arguments
    if "--tune" in given:
        from study.tuning import main as tune

        return tune([one for one in given if one != "--tune"])
    if "--optimum" in given:
        from study.optimum import main as optimum

        return optimum([one for one in given if one != "--optimum"])
    if "--rate-mode" in given:
        from study.rate_mode import main as rate_mode

        return rate_mode([one for one in given if one != "--rate-mode"])
    if "--promise" in given:
        from study.promise import main as promise

        return promise([one for one in given if one != "--promise"])
    options = _options(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    if options.margins:
        return _study_margins(options)
    path = options.output / f"seed-{options.seed}-{fingerprint()}.jsonl"
    fly_missing(path, options.seed, options.flights, options.processes)

    from study.plots import draw_plots
    from study.summary import page, parameters_of, read_flights, verdict_table

    flights = [flight for flight in read_flights(path) if flight["number"] < options.flights]
    failed = [flight for flight in flights if "error" in flight]
    for flight in failed:
        print(f"flight {flight['number']} failed:\n{flight['error']}", file=sys.stderr)
    flights = [flight for flight in flights if "error" not in flight]
    table = parameters_of(flights)
    table.to_csv(options.output / "parameters.csv", index=False)
    text = f"Code {fingerprint()} (`study/run.py`), {page(flights, table)}"
    (options.output / "coverage.md").write_text(text, encoding="utf-8")
    draw_plots(table, verdict_table(flights, table), options.output)
    if options.publish:
        publish(text, options.output)
    print(text)
    return 1 if failed else 0


def _study_margins(options: argparse.Namespace) -> int:
    """Run what is missing of the study of margins, then print and write its table and picture."""
    from study.margin_tables import draw_margins, loops_of, margins_page
    from study.summary import read_flights

    path = options.output / f"margins-seed-{options.seed}-{fingerprint()}.jsonl"
    fly_missing(path, options.seed, options.flights, options.processes, _measure_margins)
    flights = [flight for flight in read_flights(path) if flight["number"] < options.flights]
    failed = [flight for flight in flights if "error" in flight]
    for flight in failed:
        print(f"flight {flight['number']} failed:\n{flight['error']}", file=sys.stderr)
    flights = [flight for flight in flights if "error" not in flight]
    table = loops_of(flights)
    table.to_csv(options.output / "margins.csv", index=False)
    text = f"Code {fingerprint()} (`study/run.py --margins`), {margins_page(flights, table)}"
    pages = ROOT / "docs" / "coverage" if options.publish else options.output
    (pages / "margins.md").write_text(text, encoding="utf-8")
    draw_margins(table, pages / "margins.png")
    print(text)
    return 1 if failed else 0


def _options(arguments: list[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description="Coverage of the intervals over simulated flights.")
    parser.add_argument("--flights", type=int, default=300, help="how many flights (default 300)")
    parser.add_argument("--seed", type=int, default=1, help="another seed draws other flights (default 1)")
    parser.add_argument("--processes", type=int, default=1, help="flights at the same time (default 1)")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "study", help="default build/study")
    parser.add_argument("--publish", action="store_true", help="write docs/coverage/ from the result")
    parser.add_argument(
        "--margins", action="store_true", help="of the margins of loops, on flights of their own"
    )
    return parser.parse_args(arguments)


def fingerprint() -> str:
    """Return a short hash of the code that is measured: results of different code do not mix."""
    digest = hashlib.sha256()
    own = [ROOT / "study" / f"{name}.py" for name in ("draw", "margins", "measure", "structural")]
    for source in (*sorted((ROOT / "quadid_logs").rglob("*.py")), *own):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:10]


def fly_missing(
    path: Path, seed: int, n_flights: int, n_processes: int, measured: Measured | None = None
) -> None:
    """Append one line per flight that is not in the file yet: its parameters, or what else is measured."""
    done = {json.loads(line)["number"] for line in _whole_lines(path)}
    missing = [(seed, number) for number in range(n_flights) if number not in done]
    if not missing:
        return
    began = time.monotonic()
    # Spawned, not forked: forking a process that has started numpy's threads may hang.
    context = multiprocessing.get_context("spawn")
    with context.Pool(n_processes, maxtasksperchild=50) as pool, path.open("a", encoding="utf-8") as file:
        for count, flight in enumerate(pool.imap_unordered(measured or _measure_one, missing), start=1):
            file.write(json.dumps(flight) + "\n")
            file.flush()
            if count % 20 == 0 or count == len(missing):
                left_s = (time.monotonic() - began) / count * (len(missing) - count)
                print(f"{count} of {len(missing)} flights, {left_s:.0f} s left", file=sys.stderr, flush=True)


def _whole_lines(path: Path) -> list[str]:
    """Return the complete lines of the file; cut off what an interruption left of the last one."""
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    return whole.splitlines()


def _measure_one(task: tuple[int, int]) -> dict[str, Any]:
    """Measure the parameters of one flight."""
    return _caught(lambda: measure(draw_flight(*task)), task)


def _measure_margins(task: tuple[int, int]) -> dict[str, Any]:
    """Measure the margins of one flight."""
    return _caught(lambda: measure_loops(draw_loop(*task)), task)


def _caught(measured: Callable[[], dict[str, Any]], task: tuple[int, int]) -> dict[str, Any]:
    """Return the result of a flight; whatever goes wrong is its result, for the others must go on."""
    try:
        return measured()
    except Exception:  # noqa: BLE001 - the study reports it and fails at its end
        seed, number = task
        return {"number": number, "seed": seed, "error": traceback.format_exc()}


def publish(text: str, output: Path) -> None:
    """Put table and plots into the documentation."""
    folder = ROOT / "docs" / "coverage"
    folder.mkdir(exist_ok=True)
    (folder / "table.md").write_text(text, encoding="utf-8")
    for picture in sorted(output.glob("*.png")):
        (folder / picture.name).write_bytes(picture.read_bytes())


if __name__ == "__main__":
    sys.exit(main())
