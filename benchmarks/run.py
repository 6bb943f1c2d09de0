"""Measure speed and memory against the readers that people use today.

Every measurement is a process of its own: the action runs once on a tiny log,
so that imports do not count, then on the file. Ours and the other reader take
turns on the same machine; the ratio is the result, absolute figures are not.

Run ``python benchmarks/run.py --help``.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
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
from benchmarks.against import MACHINE, told  # noqa: E402
from benchmarks.logs import CACHE, corpus_logs, generated_log, many_flights, simulated_flight  # noqa: E402

WARM_UP_MB = 0.2
#: Per suffix: what is read, our action, the other readers'.
READERS = {
    ".bin": (
        ("needed", "quadid_dataflash_needed", ("pymavlink_dataflash_needed",)),
        ("all", "quadid_dataflash_all", ("pymavlink_dataflash_all", "mavparser_all", "signalviewer_all")),
    ),
    ".tlog": (
        ("needed", "quadid_tlog_needed", ("pymavlink_tlog_needed",)),
        ("all", "quadid_tlog_all", ("pymavlink_tlog_all", "fasttlogparser_all", "signalviewer_all")),
    ),
    ".ulg": (
        ("needed", "quadid_ulog_needed", ("pyulog_needed",)),
        ("all", "quadid_ulog_all", ("pyulog_all", "signalviewer_all")),
    ),
    ".bbl": (
        ("needed", "quadid_blackbox_needed", ()),
        ("all", "quadid_blackbox_all", ("orangebox_all",)),
    ),
}
#: Largest generated log of a format [MB]: the writer of Blackbox logs holds all numbers of a log at once.
LARGEST_MB = {".bbl": 50.0}
_MACHINE = """
import numpy
sum(i * i for i in range(2_000_000))
square = numpy.ones((600, 600))
for _ in range(20):
    square @ square
"""
_FLEET = """
import pathlib, sys
from quadid_logs.data.settings import Settings
from quadid_logs.fleets.per_flight import analyze_flights
tuple(analyze_flights(pathlib.Path(sys.argv[1]), Settings(), None, "verdict", published=False))
"""
#: Readers that are measured only where they can be imported.
OPTIONAL = ("mavparser", "fasttlogparser", "signalviewer", "orangebox")


class Measurement(NamedTuple):
    """Seconds on the wall and of the processor, growth of the process's peak memory [bytes], stages [s]."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    stages: dict[str, float]


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
    if options.against and Path(options.against).is_file():
        before = Path(options.against).read_text(encoding="utf-8")
        print("\n## Against the page before\n")
        print("\n".join(told(before, "\n".join(lines))), flush=True)
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
        default=[40.0, 200.0, 1000.0],
        help="generated logs of each format, read by ours alone",
    )
    parser.add_argument(
        "--others-python",
        default=sys.executable,
        help="interpreter that has the optional readers: " + ", ".join(OPTIONAL),
    )
    parser.add_argument(
        "--against",
        default=str(Path(__file__).with_name("results.md")),
        help="page of an earlier run: what got slower is said at the end, and fails nothing; empty for none",
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
    arguments = ["PYTHON" if part == options.others_python else part for part in sys.argv[1:]]
    yield f"`{' '.join(['python', 'benchmarks/run.py', *arguments])}`"
    yield ""
    yield (
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start, Python "
        f"{platform.python_version()}; linear algebra on one thread, file in the page cache, imports not "
        f"counted unless said, medians of {repeats}. Processor time is user + system; it suffers less from "
        "other work on the machine than wall time. Peaks are of the process's memory, beyond what it had "
        "before."
    )
    logs = [] if options.short else corpus_logs()
    size_mb = 4.0 if options.short else 40.0
    kinds = {path.suffix.lower() for path in logs}
    logs += [generated_log(suffix, size_mb) for suffix in READERS if suffix not in kinds]
    yield from _beginnings(2 if options.short else repeats)
    yield from _readers(logs, repeats, options.others_python)
    if not options.short:
        yield from _sizes(options.sizes_mb, repeats)
        yield from _analyses(options.sizes_mb, repeats)
    yield from _memory_of_flights([4.0] if options.short else [10.0, 40.0])
    yield from _computations(options.short, repeats)


def _beginnings(repeats: int) -> Iterator[str]:
    """Time what is short, start of Python included: it is in every run, so that each can be compared."""
    yield from ("", "## Short commands, start of Python included (least of the runs)", "")
    yield "| what | CPU s |"
    yield "|---|---|"
    root = Path(__file__).resolve().parents[1]
    cli = "import sys; from quadid_logs.cli import run; sys.exit(run())"
    samples, flight, output = root / "sample_logs", str(simulated_flight("doublets")), str(CACHE / "output")
    alone = ("--json", "--no-report")
    commands = {
        MACHINE: (_MACHINE,),
        "`import quadid_logs.pipeline`": ("import quadid_logs.pipeline",),
        "`quadid-log --help`": (cli, "--help"),
        "`analyze --json --no-report` of the sample log": (
            cli, "analyze", str(samples / "sysid-quad-x.bin"), *alone,
        ),
        "the same with report": (
            cli, "analyze", str(samples / "sysid-quad-x.bin"), "-o", output, "--force",
        ),
        "`analyze --json --no-report` of the sample that logs 10 Hz": (
            cli, "analyze", str(samples / "default-logging.bin"), *alone,
        ),
        "`analyze --json --no-report` of the Blackbox sample": (
            cli, "analyze", str(samples / "betaflight-doublets.bbl"), *alone,
        ),
        "`tune` of doublets at 400 Hz": (cli, "tune", flight, "-o", output, "--force"),
        "a fleet's rows of doublets at 400 Hz": (_FLEET, flight),
    }  # fmt: skip
    least = dict.fromkeys(commands, math.inf)
    for _ in range(repeats):
        for what, command in commands.items():
            began = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(
                [sys.executable, "-c", *command],
                env={**os.environ, "PYTHONPATH": str(root)},
                capture_output=True,
                check=False,
            )
            ended = resource.getrusage(resource.RUSAGE_CHILDREN)
            taken = ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime
            least[what] = min(least[what], taken)
    for what, taken in least.items():
        yield f"| {what} | {taken:.3f} |"


def _readers(logs: list[Path], repeats: int, others_python: str) -> Iterator[str]:
    """Compare the readers on each log."""
    missing = [name for name in OPTIONAL if not _can_import(others_python, name)]
    yield from ("", "## Reading columns, against other readers", "")
    if missing:
        yield from (f"Not measured, because not importable here: {', '.join(missing)}.", "")
    yield "| log | MB | columns | reader | MB/s | MB/s wall | ours faster | ours faster, wall | peak / file |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for path in logs:
        warm_up = str(generated_log(path.suffix.lower(), WARM_UP_MB))
        size = path.stat().st_size
        for columns, ours, others in READERS[path.suffix.lower()]:
            present = [name for name in others if not name.startswith(tuple(missing) or ("-",))]
            own, rest = _take_turns(ours, present, warm_up, str(path), repeats, others_python)
            for name, one in (("quadid-logs", own), *rest.items()):
                yield (
                    f"| {path.name} | {size / 1e6:.1f} | {columns} | {name.split('_')[0]} "
                    f"| {size / 1e6 / one.cpu_seconds:.1f} | {size / 1e6 / one.seconds:.1f} "
                    f"| {one.cpu_seconds / own.cpu_seconds:.1f} | {one.seconds / own.seconds:.1f} "
                    f"| {one.peak_bytes / size:.2f} |"
                )


def _can_import(python: str, name: str) -> bool:
    """Tell whether an interpreter has a module."""
    return not subprocess.run([python, "-c", f"import {name}"], capture_output=True, check=False).returncode


def _sizes(sizes_mb: list[float], repeats: int) -> Iterator[str]:
    """Show that the cost grows linearly with the file."""
    yield from ("", "## Growth with the file (generated logs, all of needed types at 400 Hz, ours)", "")
    yield "| log | MB | what | CPU s | wall s | MB/s of CPU | peak / file |"
    yield "|---|---|---|---|---|---|---|"
    for suffix, tasks in READERS.items():
        warm_up = str(generated_log(suffix, WARM_UP_MB))
        for action in (tasks[0][1], tasks[1][1], "quadid_read_log"):
            for size_mb in sizes_mb:
                if size_mb > LARGEST_MB.get(suffix, math.inf):
                    continue
                path = generated_log(suffix, size_mb)
                size = path.stat().st_size
                turns = repeats if size_mb < 500.0 else min(repeats, 3)
                own = _median([_measure(action, warm_up, str(path)) for _ in range(turns)])
                what = {"quadid_read_log": "read_log"}.get(action, f"columns, {action.split('_')[-1]} types")
                yield (
                    f"| {suffix} | {size / 1e6:.0f} | {what} | {own.cpu_seconds:.2f} | {own.seconds:.2f} "
                    f"| {size / 1e6 / own.cpu_seconds:.0f} | {own.peak_bytes / size:.2f} |"
                )


def _analyses(sizes_mb: list[float], repeats: int) -> Iterator[str]:
    """Time the whole command, start of Python included, and its stages."""
    yield from ("", "## The whole command, start of Python included", "")
    yield "| log | MB | command | CPU s | wall s | peak MB | stages, wall s |"
    yield "|---|---|---|---|---|---|---|"
    logs = [path for path in corpus_logs() if path.suffix.lower() != ".tlog"]
    logs += [generated_log(".bin", size_mb) for size_mb in sizes_mb]
    for path in logs:
        size = path.stat().st_size
        for action, what in (
            ("quadid_cli_json", "analyze --json --no-report"),
            ("quadid_cli_report", "analyze -o DIR"),
        ):
            turns = repeats if path in corpus_logs() else 1
            runs = [_measure(action, str(generated_log(".bin", WARM_UP_MB)), str(path)) for _ in range(turns)]
            own = _median(runs)
            stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in runs[-1].stages.items())
            yield (
                f"| {path.name} | {size / 1e6:.0f} | `{what}` | {own.cpu_seconds:.2f} | {own.seconds:.2f} "
                f"| {own.peak_bytes / 1e6:.0f} | {stages} |"
            )


def _memory_of_flights(sizes_mb: list[float]) -> Iterator[str]:
    """Show what many short flights in one log cost; what each size adds is what a larger one will."""
    yield from ("", "## Memory of many short flights in one log, start of Python included", "")
    yield "| log | MB | command | peak MB | 4 x file + 300 MB |"
    yield "|---|---|---|---|---|"
    for suffix in (".bin", ".bbl"):
        for size_mb in sizes_mb:
            path = many_flights(suffix, size_mb)
            size = path.stat().st_size
            for action, what in (
                ("quadid_cli_info", "info"),
                ("quadid_cli_json", "analyze --json --no-report"),
            ):
                own = _measure(action, str(generated_log(suffix, WARM_UP_MB)), str(path))
                allowed = 4.0 * size / 1e6 + 300.0
                peak = own.peak_bytes / 1e6
                yield f"| {suffix} | {size / 1e6:.0f} | `{what}` | {peak:.0f} | {allowed:.0f} |"


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
    logs = [] if short else [path for path in corpus_logs() if path.suffix.lower() != ".tlog"]
    tasks += [(f"analyze {path.name}, no report", "quadid_analyze", str(path), str(path)) for path in logs]
    for what, action, warm_up, argument in tasks:
        own = _median([_measure(action, warm_up, argument) for _ in range(repeats)])
        yield f"| {what} | {own.seconds:.2f} | {own.cpu_seconds:.2f} | {own.peak_bytes / 1e6:.0f} |"


def _take_turns(
    ours: str, others: list[str], warm_up: str, argument: str, repeats: int, others_python: str
) -> tuple[Measurement, dict[str, Measurement]]:
    """Run all actions alternately, so that a busy moment hits all."""
    own: list[Measurement] = []
    rest: dict[str, list[Measurement]] = {name: [] for name in others}
    for turn in range(repeats):
        own.append(_measure(ours, warm_up, argument))
        for name in others if turn < 3 else ():
            python = others_python if name.startswith(OPTIONAL) else sys.executable
            rest[name].append(_measure(name, warm_up, argument, python))
    return _median(own), {name: _median(measured) for name, measured in rest.items()}


def _median(measurements: list[Measurement]) -> Measurement:
    """Return the medians of time and memory."""
    columns = zip(*(measured[:3] for measured in measurements), strict=True)
    seconds, cpu_seconds, peaks = (statistics.median(column) for column in columns)
    return Measurement(seconds, cpu_seconds, int(peaks), measurements[-1].stages)


def _measure(action: str, warm_up: str, argument: str, python: str = sys.executable) -> Measurement:
    """Measure in a process of its own."""
    command = [python, __file__, "--measure", action, warm_up, argument]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{action} failed on {argument}:\n{done.stderr}")
    return Measurement(*json.loads(done.stdout.splitlines()[-1]))


def _measure_here(action: str, warm_up: str, argument: str) -> Measurement:
    """Run an action in this process and measure it, and the processes that it starts."""
    run = getattr(actions, action)
    run(warm_up)
    before = _reset_peak()
    start, cpu_start = time.perf_counter(), _cpu_seconds()
    result = run(argument)
    seconds, cpu_seconds = time.perf_counter() - start, _cpu_seconds() - cpu_start
    peak = _status_bytes("VmHWM") - before
    if action.startswith("quadid_cli"):
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    return Measurement(
        seconds, cpu_seconds, peak, result if isinstance(result, dict) and "read" in result else {}
    )


def _cpu_seconds() -> float:
    """Return the processor time of this process and of those that it has started and awaited."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


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
