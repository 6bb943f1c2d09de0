"""Damage logs at random, or fill them with legal extremes, and watch that only our own errors come out.

Every case has a number; the number and --seed alone decide what is done, so
that ``--only NUMBER`` repeats it. A case must end in a result or a
`QuadidError`, with warnings as errors, within 5 times the processor time of
an intact log of its size, in bytes or in samples (at least `LEAST_MINUTES`),
and within 4 times the file + 300 MB.

Run ``python fuzz/run.py --help``.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
os.environ.setdefault("MPLBACKEND", "Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fuzz.extremes import extreme  # noqa: E402
from fuzz.mutations import mutated  # noqa: E402
from fuzz.seeds import Seed, load_seeds  # noqa: E402
from quadid_logs.align import cut  # noqa: E402
from quadid_logs.data.settings import AlignSettings  # noqa: E402
from quadid_logs.errors import QuadidError  # noqa: E402
from quadid_logs.load import load  # noqa: E402
from quadid_logs.pipeline import analyze  # noqa: E402
from quadid_logs.report import json_text, write_report  # noqa: E402
from quadid_logs.simulator import simulate  # noqa: E402
from quadid_logs.writers import write_log  # noqa: E402

#: Below this processor time noise rules, not the input; by depth, in whole analyses of an intact minute at
#: 50 Hz: a machine that is busy or slow is so for both.
LEAST_MINUTES = {"read": 0.25, "analyze": 1.25, "report": 12.5}
#: Of the cases, those that are no damage.
EXTREME_FRACTION = 0.2
TIME_FACTOR, MEMORY_FACTOR, MEMORY_SPARE = 5.0, 4.0, 300e6
#: A process hangs that is silent for this long [s] and works less than this meanwhile [s].
HANG_S, IDLE_S = 300.0, 0.1
#: After so many times its limit a case is broken off.
PATIENCE = 4.0
#: Cases after which a worker is replaced.
BATCH = 500


class Intact(NamedTuple):
    """Processor time [s] of intact logs: by name and depth; a minute's whole analysis, and by sample."""

    seconds: dict[tuple[str, str], float]
    minute_s: float
    sample_s: float


class OutOfTimeError(BaseException):
    """The processor time is over; not an Exception, so that nothing on the way swallows it."""


@dataclass(slots=True)
class Tally:
    """What came out so far."""

    cases: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    failures: list[dict[str, Any]] = field(default_factory=list)
    slowest: dict[str, tuple[float, int]] = field(default_factory=dict)
    largest: tuple[float, int] = (0.0, -1)


def main() -> int:
    """Run the cases, print what came out; 1 if anything broke."""
    options = _options()
    seeds = [each for each in load_seeds(whole=options.whole) if options.kind in ("", each.kind)]
    intact = _intact(seeds)
    if options.only is not None:
        return _one(options, seeds, intact)
    tally, began = Tally(), time.monotonic()
    stop_at = began + options.minutes * 60.0 if options.minutes else float("inf")
    number = options.first
    while number < options.first + options.count and time.monotonic() < stop_at:
        batch = range(number, min(number + BATCH, options.first + options.count))
        number = _run_batch(batch, options, seeds, intact, tally, stop_at)
        _say(tally, time.monotonic() - began)
    print(json.dumps(_summary(tally), indent=1))
    if options.output:
        Path(options.output).write_text(json.dumps(_summary(tally), indent=1) + "\n", encoding="utf-8")
    return 1 if tally.failures else 0


def _options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description="Random damage against every reader and the whole analysis.")
    parser.add_argument("--count", type=int, default=50_000, help="cases at most")
    parser.add_argument("--minutes", type=float, default=0.0, help="stop after this time; 0: only --count")
    parser.add_argument("--seed", type=int, default=0, help="another seed, other cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--whole", action="store_true", help="whole logs of the corpus, not their beginnings")
    parser.add_argument("--kind", default="", help="logs of this kind only, such as blackbox")
    parser.add_argument("--only", type=int, help="repeat this one case, in this process, with traceback")
    parser.add_argument("--keep", help="with --only: write the damaged log to this file")
    parser.add_argument("--output", help="write the summary to this JSON file")
    return parser.parse_args()


def _case(number: int, seed: int, seeds: list[Seed]) -> tuple[Seed, str, bytes]:
    """Return the log, how deep it is taken, and its damaged content."""
    rng = random.Random(f"{seed}/{number}")
    log = seeds[number % len(seeds)]
    # Of 100 rounds through the seeds 9 go through the whole analysis; 1 of 1000 through the report too.
    lot = rng.randrange(1000)
    depth = "report" if lot == 0 else "analyze" if lot < 90 else "read"
    if rng.random() < EXTREME_FRACTION:
        return log, depth, extreme(rng, log.kind, log.content, int(2 ** rng.uniform(10.0, 19.0)))
    return log, depth, mutated(rng, log.kind, log.content)


def _run(path: Path, depth: str) -> int:
    """Take one file through the chain; return the number of samples that a whole analysis was about."""
    if depth == "read":
        cut(load(path), AlignSettings())
        return 0
    result = analyze(path)
    json_text(result)
    if depth == "report":
        write_report(result, path.parent / "report", force=True)
    return result.data.n_samples


def _intact(seeds: list[Seed]) -> Intact:
    """Return the processor time of every intact log, the second time it is read."""
    taken = {}
    with tempfile.TemporaryDirectory() as folder:
        for log in seeds:
            path = Path(folder) / f"log{log.suffix}"
            path.write_bytes(log.content)
            for depth in ("read", "read", "analyze"):
                taken[log.name, depth] = _processor_time(_run_tolerant, path, depth)
            taken[log.name, "report"] = taken[log.name, "analyze"]
        path = Path(folder) / "minute.bin"
        write_log(simulate("sysid-quad-x", seed=1, duration_s=60.0, rate_hz=50.0).log, path)
        began = time.process_time()
        n_samples = _run(path, "analyze")
        minute_s = time.process_time() - began
    return Intact(taken, minute_s, minute_s / n_samples)


def _run_tolerant(path: Path, depth: str) -> None:
    """Run, where a refusal is a fine end."""
    try:
        _run(path, depth)
    except QuadidError:
        return


def _processor_time(action: Callable[..., None], *arguments: object) -> float:
    """Return the processor time of an action [s]."""
    began = time.process_time()
    action(*arguments)
    return time.process_time() - began


def _run_batch(
    batch: range,
    options: argparse.Namespace,
    seeds: list[Seed],
    intact: Intact,
    tally: Tally,
    stop_at: float,
) -> int:
    """Run a batch in a process of its own: a crash of the interpreter is a finding. Return the next case."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    arguments = (batch, options.seed, seeds, intact, sender, stop_at)
    process = context.Process(target=_work, args=arguments)
    process.start()
    sender.close()
    number = batch.start
    try:
        while True:
            if not _answers(receiver, process.pid):
                process.kill()
                _fail(tally, number, options, seeds, f"hang: no answer after {HANG_S:g} s")
                number += 1
                break
            outcome = receiver.recv()
            _count(tally, outcome)
            number = outcome["number"] + 1
    except EOFError:
        process.join()
        if process.exitcode:
            _fail(tally, number, options, seeds, f"the process died with exit code {process.exitcode}")
            number += 1
        elif number < batch.stop:
            number = batch.stop  # out of time
    process.join()
    return number


def _answers(receiver: Connection, pid: int | None) -> bool:
    """Wait for the next outcome; False if the process neither works nor answers, or works without end.

    By processor time: on a busy machine a sound case may get little of it for minutes.
    """
    began_s = used_s = _used_s(pid)
    while not receiver.poll(HANG_S):
        before_s, used_s = used_s, _used_s(pid)
        if used_s - before_s < IDLE_S or used_s - began_s > HANG_S:
            return False
    return True


def _used_s(pid: int | None) -> float:
    """Return the processor time of a process [s] (Linux, proc(5))."""
    fields = (
        Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    )
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _fail(tally: Tally, number: int, options: argparse.Namespace, seeds: list[Seed], what: str) -> None:
    """Note a case that took its process with it."""
    log, depth, content = _case(number, options.seed, seeds)
    _count(
        tally, {"number": number, "log": log.name, "depth": depth, "n_bytes": len(content), "failure": what}
    )


def _work(
    batch: range,
    seed: int,
    seeds: list[Seed],
    intact: Intact,
    sender: Connection,
    stop_at: float,
) -> None:
    """Run cases one after the other and send what came out."""
    warnings.simplefilter("error")
    signal.signal(signal.SIGPROF, _out_of_time)
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        for number in batch:
            if time.monotonic() > stop_at:
                break
            sender.send(_outcome(number, seed, seeds, intact, folder))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        sender.close()


def _out_of_time(_signal: int, _frame: FrameType | None) -> None:
    raise OutOfTimeError


def _outcome(number: int, seed: int, seeds: list[Seed], intact: Intact, folder: Path) -> dict[str, Any]:
    """Run one case within its limits; one that takes too long may have been disturbed, and runs once more."""
    outcome = _attempt(number, seed, seeds, intact, folder)
    if outcome.pop("slow", False):
        outcome = _attempt(number, seed, seeds, intact, folder)
        outcome.pop("slow", None)
    return outcome


def _attempt(number: int, seed: int, seeds: list[Seed], intact: Intact, folder: Path) -> dict[str, Any]:
    """Run one case once within its limits."""
    log, depth, content = _case(number, seed, seeds)
    path = folder / f"log{log.suffix}"
    path.write_bytes(content)
    size = max(1.0, len(content) / len(log.content))
    limit_s = max(
        LEAST_MINUTES[depth] * intact.minute_s, TIME_FACTOR * size * intact.seconds[log.name, depth]
    )
    outcome: dict[str, Any] = {"number": number, "log": log.name, "depth": depth, "n_bytes": len(content)}
    before = _reset_peak()
    began = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, PATIENCE * limit_s)
    try:
        n_samples = _run(path, depth)
        # What is refused when intact, and analyzed when damage has repeated it, is no measure of itself.
        limit_s = max(limit_s, TIME_FACTOR * intact.sample_s * n_samples)
    except QuadidError as error:
        outcome["refused"] = type(error).__name__
    except OutOfTimeError:
        outcome["failure"] = f"over {PATIENCE * limit_s:.1f} s: {traceback.format_exc(limit=-3)}"
    except Exception:  # noqa: BLE001 - what comes out is the finding
        outcome["failure"] = traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    outcome["seconds"] = time.process_time() - began
    outcome["memory"] = _status_bytes("VmHWM") - before
    if "failure" not in outcome:
        if outcome["seconds"] > limit_s:
            outcome["slow"] = True
            outcome["failure"] = f"{outcome['seconds']:.2f} s of processor time, limit {limit_s:.2f} s"
        elif outcome["memory"] > MEMORY_FACTOR * len(content) + MEMORY_SPARE:
            outcome["failure"] = f"{outcome['memory'] / 1e6:.0f} MB for {len(content) / 1e6:.2f} MB"
    return outcome


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


def _count(tally: Tally, outcome: dict[str, Any]) -> None:
    """Add an outcome."""
    tally.cases[f"{outcome['log']} {outcome['depth']}"] += 1
    if "refused" in outcome:
        tally.refused[outcome["refused"]] += 1
    if "failure" in outcome:
        tally.failures.append(outcome)
        print(
            f"\ncase {outcome['number']} ({outcome['log']}, {outcome['depth']}):\n{outcome['failure']}",
            flush=True,
        )
        return
    slowest = tally.slowest.get(outcome["depth"], (0.0, -1))
    tally.slowest[outcome["depth"]] = max(slowest, (outcome["seconds"], outcome["number"]))
    tally.largest = max(tally.largest, (float(outcome["memory"]), outcome["number"]))


def _say(tally: Tally, seconds: float) -> None:
    """Print one line of progress."""
    print(f"{tally.cases.total()} cases, {len(tally.failures)} failures, {seconds:.0f} s", flush=True)


def _summary(tally: Tally) -> dict[str, Any]:
    """Return everything that came out."""
    return {
        "cases": tally.cases.total(),
        "by_log_and_depth": dict(sorted(tally.cases.items())),
        "refused": dict(tally.refused),
        "failures": tally.failures,
        "slowest_s": tally.slowest,
        "largest_growth_mb": (tally.largest[0] / 1e6, tally.largest[1]),
    }


def _one(options: argparse.Namespace, seeds: list[Seed], intact: Intact) -> int:
    """Repeat one case and show everything."""
    log, depth, content = _case(options.only, options.seed, seeds)
    if options.keep:
        Path(options.keep).write_bytes(content)
    warnings.simplefilter("error")
    signal.signal(signal.SIGPROF, _out_of_time)
    with tempfile.TemporaryDirectory() as folder:
        outcome = _outcome(options.only, options.seed, seeds, intact, Path(folder))
    print(outcome.pop("failure", "no failure"))
    print(f"{log.name}, {depth}: {outcome}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
