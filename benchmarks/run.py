"""Measure speed and memory against the readers that people use today.

Every measurement is a process of its own: the action runs once on a tiny log,
so that imports do not count, then on the file. Ours and the other reader take
turns on the same machine; the ratio is the result, absolute figures are not.

Run ``python benchmarks/run.py --help``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

# One core for everyone, before numpy starts its threads.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import actions  # noqa: E402
from benchmarks.logs import corpus_logs, generated_log  # noqa: E402

WARM_UP_MB = 0.2
#: Per suffix: what is read, our action, the reference's.
READERS = {
    ".bin": (
        ("needed", "quadid_read_log", "pymavlink_dataflash_needed"),
        ("all", "quadid_dataflash_all", "pymavlink_dataflash_all"),
    ),
    ".tlog": (
        ("needed", "quadid_read_log", "pymavlink_tlog_needed"),
        ("all", "quadid_tlog_all", "pymavlink_tlog_all"),
    ),
    ".ulg": (
        ("needed", "quadid_read_log", "pyulog_needed"),
        ("all", "quadid_ulog_all", "pyulog_all"),
    ),
}


class Measurement(NamedTuple):
    """Seconds on the wall and of the processor, and the growth of the process's peak memory [bytes]."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int


def main() -> None:
    """Print the tables; with --output write them to a file too."""
    options = _options()
    if options.measure:
        print(json.dumps(_measure_here(*options.measure)))
        return
    lines: list[str] = []
    for line in _report(options):
        print(line, flush=True)
        lines.append(line)
    if options.output:
        Path(options.output).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description="Speed and memory of quadid-logs against other readers.")
    parser.add_argument(
        "--short", action="store_true", help="4 MB generated logs, once: a check that all runs"
    )
    parser.add_argument("--repeats", type=int, default=5, help="of ours; the reference runs at most 3 times")
    parser.add_argument(
        "--sizes-mb",
        type=float,
        nargs="*",
        default=[40.0, 200.0],
        help="generated .bin logs read by ours alone",
    )
    parser.add_argument("--output", help="write the tables to this Markdown file")
    parser.add_argument(
        "--measure", nargs=3, metavar=("ACTION", "WARM_UP", "ARGUMENT"), help=argparse.SUPPRESS
    )
    return parser.parse_args()


def _report(options: argparse.Namespace) -> Iterator[str]:
    """Yield the lines of the results page."""
    repeats = 1 if options.short else options.repeats
    yield "# Measured speed and memory"
    yield ""
    yield f"`python benchmarks/run.py {' '.join(sys.argv[1:])}`".replace(" `", "`")
    yield ""
    yield (
        f"{os.cpu_count()} cores, Python {platform.python_version()}; each process on one core, file in the "
        f"page cache, imports not counted, medians of {repeats}. The ratios are the result."
    )
    logs = [] if options.short else corpus_logs()
    size_mb = 4.0 if options.short else 40.0
    kinds = {path.suffix.lower() for path in logs}
    logs += [generated_log(suffix, size_mb) for suffix in READERS if suffix not in kinds]
    yield from _readers(logs, repeats)
    if not options.short:
        yield from _sizes(options.sizes_mb, repeats)
    yield from _computations(options.short, repeats)


def _readers(logs: list[Path], repeats: int) -> Iterator[str]:
    """Compare the readers on each log."""
    yield from ("", "## Reading, against pymavlink and pyulog", "")
    yield "| log | MB | columns | ours MB/s | theirs MB/s | ratio | our peak / file | their peak / file |"
    yield "|---|---|---|---|---|---|---|---|"
    for path in logs:
        warm_up = str(generated_log(path.suffix.lower(), WARM_UP_MB))
        size = path.stat().st_size
        for columns, ours, theirs in READERS[path.suffix.lower()]:
            own, other = _take_turns(ours, theirs, warm_up, str(path), repeats)
            yield (
                f"| {path.name} | {size / 1e6:.1f} | {columns} | {size / 1e6 / own.seconds:.0f} "
                f"| {size / 1e6 / other.seconds:.1f} | {other.seconds / own.seconds:.1f} "
                f"| {own.peak_bytes / size:.1f} | {other.peak_bytes / size:.1f} |"
            )


def _sizes(sizes_mb: list[float], repeats: int) -> Iterator[str]:
    """Show that the cost grows linearly with the file."""
    yield from ("", "## Growth with the file (generated .bin, ours)", "")
    yield "| MB | read_log s | MB/s | peak / file |"
    yield "|---|---|---|---|"
    warm_up = str(generated_log(".bin", WARM_UP_MB))
    for size_mb in sizes_mb:
        path = generated_log(".bin", size_mb)
        size = path.stat().st_size
        own = _median([_measure("quadid_read_log", warm_up, str(path)) for _ in range(repeats)])
        yield (
            f"| {size / 1e6:.0f} | {own.seconds:.2f} | {size / 1e6 / own.seconds:.0f} "
            f"| {own.peak_bytes / size:.1f} |"
        )


def _computations(short: bool, repeats: int) -> Iterator[str]:
    """Time what is computed rather than read."""
    yield from ("", "## Computing (one core)", "")
    yield "| what | s | CPU s | peak MB |"
    yield "|---|---|---|---|"
    windows = "10000" if short else "100000"
    tasks = [
        (f"{windows} windows of 9x9 (`solve_windows`)", "quadid_windows", "100", windows),
        ("60 s flight simulated, logged at 400 Hz, written as .bin", "quadid_simulate", "15", "60"),
    ]
    if not short:
        tasks.append(("200 such flights at once, not written", "quadid_simulate_many", "1", "200"))
    logs = [] if short else [path for path in corpus_logs() if path.suffix.lower() != ".tlog"]
    tasks += [(f"analyze {path.name}, no report", "quadid_analyze", str(path), str(path)) for path in logs]
    for what, action, warm_up, argument in tasks:
        turns = 1 if action == "quadid_simulate_many" else repeats
        own = _median([_measure(action, warm_up, argument) for _ in range(turns)])
        yield f"| {what} | {own.seconds:.2f} | {own.cpu_seconds:.2f} | {own.peak_bytes / 1e6:.0f} |"


def _take_turns(
    ours: str, theirs: str, warm_up: str, argument: str, repeats: int
) -> tuple[Measurement, Measurement]:
    """Run both actions alternately, so that a busy moment hits both."""
    own, other = [], []
    for turn in range(repeats):
        own.append(_measure(ours, warm_up, argument))
        if turn < 3:
            other.append(_measure(theirs, warm_up, argument))
    return _median(own), _median(other)


def _median(measurements: list[Measurement]) -> Measurement:
    """Return the medians of time and memory."""
    seconds, cpu_seconds, peaks = (statistics.median(column) for column in zip(*measurements, strict=True))
    return Measurement(seconds, cpu_seconds, int(peaks))


def _measure(action: str, warm_up: str, argument: str) -> Measurement:
    """Measure in a process of its own."""
    command = [sys.executable, __file__, "--measure", action, warm_up, argument]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{action} failed on {argument}:\n{done.stderr}")
    return Measurement(*json.loads(done.stdout.splitlines()[-1]))


def _measure_here(action: str, warm_up: str, argument: str) -> Measurement:
    """Run an action in this process and measure it."""
    run = getattr(actions, action)
    run(warm_up)
    before = _reset_peak()
    start, cpu_start = time.perf_counter(), time.process_time()
    result = run(argument)
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - cpu_start
    peak = _status_bytes("VmHWM")
    del result
    return Measurement(seconds, cpu_seconds, peak - before)


def _reset_peak() -> int:
    """Forget the peak so far and return the present memory [bytes] (Linux, proc(5))."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _status_bytes("VmRSS")


def _status_bytes(name: str) -> int:
    """Return a line of /proc/self/status in bytes."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(name):
            return int(line.split()[1]) * 1024
    raise KeyError(name)


if __name__ == "__main__":
    main()
