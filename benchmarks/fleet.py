"""A fleet of 20 vehicles and 500 logs: speed, change points, and what kills, restarts and damage leave.

Run ``python benchmarks/fleet.py --help``. Everything stays on this machine:
scheduler, workers and the S3-compatible server listen on loopback.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

# One core a process, before numpy starts its threads.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.fleet_cluster import LoopbackCluster, s3_server  # noqa: E402
from benchmarks.fleet_logs import Worn, spoil, vehicles, write_fleet  # noqa: E402
from benchmarks.fleet_rows import n_logs_of, rows_of  # noqa: E402
from quadid_logs.fleets.store import DATABASE  # noqa: E402

#: By the number of the vehicle: the propeller that wears, and from which flight on.
WORN = {
    4: Worn(flight=12, fraction=0.8),
    9: Worn(flight=6, rotor=2, fraction=0.85),
    15: Worn(flight=18, rotor=3, fraction=0.75),
}
#: Of every twenty logs, one is none.
SPOILED_EVERY = 20
#: Logs that each process analyzes without Dask, to compare with.
N_SINGLE = 40
_BUCKET = "flights"
_START = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from quadid_logs.cli import run
run()
"""


def main() -> None:
    """Run the study and print it as Markdown."""
    options = _options()
    lines: list[str] = []
    options.folder = options.folder.resolve()
    for line in _study(options):
        print(line, flush=True)
        lines.append(line)
    if options.output:
        options.output.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("fleet-study"), help="logs and stores go there")
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--flights", type=int, default=25, help="per vehicle")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--part", choices=("speed", "disturbed", "all"), default="all")
    parser.add_argument("--output", type=Path, help="write the Markdown there too")
    options: argparse.Namespace = parser.parse_args()
    return options


def _study(options: argparse.Namespace) -> Iterator[str]:
    """Yield the lines of the study."""
    fleet = vehicles(options.vehicles, WORN)
    logs, spoiled = options.folder / "logs", options.folder / "spoiled"
    logs.mkdir(parents=True, exist_ok=True)
    if len(list(logs.glob("*.bin"))) < options.vehicles * options.flights:
        write_fleet(fleet, options.flights, logs, processes=options.workers)
    if options.part != "disturbed":
        yield from _whole_logs(logs, options)
    if options.part != "speed":
        yield from _disturbed(logs, spoiled, options)


def _whole_logs(logs: Path, options: argparse.Namespace) -> Iterator[str]:
    """Speed on undamaged logs, and the change points."""
    store = options.folder / "whole"
    yield from _speed(logs, store, options)
    n_logs = len(list(logs.glob("*.bin")))
    yield f"- the store: {(store / DATABASE).stat().st_size / n_logs / 1e3:.1f} kB a log"
    began = time.perf_counter()
    found = _found(store)
    yield f"- reading it and looking for changes: {time.perf_counter() - began:.1f} s"
    # Three flights must lie behind a change.
    expected = {
        number: [worn.flight]
        for number, worn in WORN.items()
        if number < options.vehicles and worn.flight + 3 <= options.flights
    }
    yield f"- change points, by vehicle: true {expected}, found {found}: {_same(found == expected)}"


def _speed(logs: Path, store: Path, options: argparse.Namespace) -> Iterator[str]:
    """Compare the fleet with as many plain processes, on the same logs."""
    n = options.workers
    single, together = _plain_rate(logs, 1), _plain_rate(logs, n)
    cpu_before = _cpu_s()
    seconds, rate = _run_alone(logs, store, n)
    cpu_s = _cpu_s() - cpu_before
    # What else the machine does changes with the hour: half before, half after.
    single = _mean(single, _plain_rate(logs, 1))
    together = _mean(together, _plain_rate(logs, n))
    n_logs = len(list(logs.glob("*.bin")))
    size_mb = sum(path.stat().st_size for path in logs.glob("*.bin")) / 1e6
    yield f"- {n_logs} logs, {size_mb:.0f} MB, {options.vehicles} vehicles, {n} workers"
    yield f"- without Dask: one process {single.logs_hz:.2f} logs/s, {n} at once {together.logs_hz:.2f}"
    fraction, core_s = rate / (n * single.logs_hz), n / rate
    yield f"- the fleet: {rate:.2f} logs/s, {fraction:.0%} of {n} times one process"
    yield f"- that is {rate / together.logs_hz:.0%} of {n} processes at once"
    yield f"- wall clock with start and end: {seconds:.1f} s; per 1000 logs {1000.0 * core_s:.0f} core s"
    yield f"- processor time a log: {together.cpu_s:.2f} s without Dask, {cpu_s / n_logs:.2f} s in all"


def _disturbed(logs: Path, spoiled: Path, options: argparse.Namespace) -> Iterator[str]:
    """Run with 5 % of the files spoiled: undisturbed, then with everything that can happen."""
    shutil.rmtree(spoiled, ignore_errors=True)
    shutil.copytree(logs, spoiled)
    kinds = dict(spoil(sorted(spoiled.glob("*.bin")), SPOILED_EVERY))
    reference = options.folder / "reference"
    _run_alone(spoiled, reference, options.workers)
    rows = rows_of(reference)
    reasons = {row["url"]: row["error"] for row in rows if row["status"] == "unreadable"}
    as_expected = {Path(url) for url in reasons} == set(kinds) and all(reasons.values())
    yield f"- {len(kinds)} files spoiled; each a row with its reason, and no other: {_same(as_expected)}"
    for name, run in (
        ("worker killed, scheduler restarted", _killed),
        ("interrupted and resumed", _interrupted),
    ):
        began = time.perf_counter()
        run(spoiled, options.folder / name.split()[0], options.workers)
        same = rows_of(options.folder / name.split()[0]) == rows
        seconds = time.perf_counter() - began
        yield f"- {name}: store identical to the undisturbed one: {_same(same)} ({seconds:.0f} s)"
    began = time.perf_counter()
    _from_s3(spoiled, options.folder / "s3", options.workers)
    same = rows_of(options.folder / "s3", without=["url"]) == rows_of(reference, without=["url"])
    seconds = time.perf_counter() - began
    yield f"- from S3 on loopback: identical but for the URLs: {_same(same)} ({seconds:.0f} s)"


def _same(good: bool) -> str:
    return "yes" if good else "NO"


def _mean(one: _Rate, other: _Rate) -> _Rate:
    return _Rate(0.5 * (one.logs_hz + other.logs_hz), 0.5 * (one.cpu_s + other.cpu_s))


def _cpu_s() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


class _Rate(NamedTuple):
    """Logs per second on the wall, and processor time per log [s]."""

    logs_hz: float
    cpu_s: float


def _plain_rate(logs: Path, n_processes: int) -> _Rate:
    """Analyze a sample in so many processes at once, each on its own, without Dask and without reports."""
    every = sorted(str(path) for path in logs.glob("*.bin"))
    chosen = every[:: max(len(every) // (N_SINGLE * n_processes), 1)]
    with ProcessPoolExecutor(n_processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        rates = list(pool.map(_analyze_slice, [chosen[k::n_processes] for k in range(n_processes)]))
    return _Rate(sum(rate.logs_hz for rate in rates), sum(rate.cpu_s for rate in rates) / n_processes)


def _analyze_slice(paths: list[str]) -> _Rate:
    """Analyze logs one after the other; the first does not count, for it loads the libraries."""
    from quadid_logs.fleets.log_files import find_logs
    from quadid_logs.fleets.options import Options
    from quadid_logs.fleets.tasks import Task
    from quadid_logs.fleets.work import work

    tasks = [Task(file=file, options=Options()) for file in find_logs(paths)]
    work(tasks[0])
    began, cpu_began = time.perf_counter(), time.process_time()
    for task in tasks:
        work(task)
    return _Rate(len(tasks) / (time.perf_counter() - began), (time.process_time() - cpu_began) / len(tasks))


def _run_alone(logs: Path, store: Path, n_workers: int) -> tuple[float, float]:
    """Run over a local cluster in this process; return wall clock [s] and logs per second once it works."""
    from quadid_logs.fleets.engine import Cluster
    from quadid_logs.fleets.log_files import find_logs
    from quadid_logs.fleets.options import Options
    from quadid_logs.fleets.run import run_fleet

    shutil.rmtree(store, ignore_errors=True)
    began = time.perf_counter()
    rates: list[float] = []
    run_fleet(
        find_logs([str(logs)]), store, Options(), Cluster(workers=n_workers),
        progress=lambda tally: rates.append(tally.rate_hz),
    )  # fmt: skip
    return time.perf_counter() - began, rates[-1]


def _found(store: Path) -> dict[int, list[int]]:
    """Return the change points by the number of the vehicle."""
    from quadid_logs.fleets.history import read_fleet

    return {
        int(history.vehicle[-8:], 16) - 0x34383700: [change.flight for change in history.changes]
        for history in read_fleet(store).histories
        if history.changes
    }


def _command(*arguments: object, environment: dict[str, str] | None = None) -> subprocess.Popen[bytes]:
    """Start quadid-log in a process group of its own; it hears Ctrl-C even if we were started not to."""
    return subprocess.Popen(
        [sys.executable, "-c", _START, *map(str, arguments)],
        env={**os.environ, **(environment or {})},
        start_new_session=True,
    )


def _wait_for_fraction(process: subprocess.Popen[bytes], store: Path, logs: Path, fraction: float) -> None:
    """Wait until this fraction of the logs is in the store."""
    wanted = fraction * len(list(logs.glob("*.bin")))
    while n_logs_of(store) < wanted:
        if process.poll() is not None:
            raise SystemExit(f"the run ended before {fraction:.0%} were done")
        time.sleep(0.2)


def _killed(logs: Path, store: Path, n_workers: int) -> None:
    """Kill a worker twice and the scheduler once, each while logs are in flight."""
    shutil.rmtree(store, ignore_errors=True)
    with LoopbackCluster(store.with_suffix(".cluster"), n_workers) as cluster:
        process = _command("fleet", logs, "-o", store, "--scheduler", cluster.address)
        for fraction, harm in (
            (0.2, cluster.kill_worker),
            (0.4, cluster.restart),
            (0.7, cluster.kill_worker),
        ):
            _wait_for_fraction(process, store, logs, fraction)
            harm()
        process.wait()


def _interrupted(logs: Path, store: Path, n_workers: int) -> None:
    """Press Ctrl-C, resume; kill, resume."""
    shutil.rmtree(store, ignore_errors=True)
    for fraction, ending in ((0.3, signal.SIGINT), (0.6, signal.SIGKILL)):
        process = _command("fleet", logs, "-o", store, "--workers", n_workers, "--resume")
        _wait_for_fraction(process, store, logs, fraction)
        os.killpg(process.pid, ending)
        process.wait()
    _command("fleet", logs, "-o", store, "--workers", n_workers, "--resume").wait()


def _from_s3(logs: Path, store: Path, n_workers: int) -> None:
    """Let the workers fetch the logs from an object store."""
    shutil.rmtree(store, ignore_errors=True)
    with s3_server(logs, _BUCKET) as environment:
        _command(
            "fleet", f"s3://{_BUCKET}", "-o", store, "--workers", n_workers, environment=environment
        ).wait()


if __name__ == "__main__":
    main()
