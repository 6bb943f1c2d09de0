"""The local page under load: many logs, two browsers, a kill; memory of uploads; time to a verdict.

Run with ``python benchmarks/serve.py [--logs N] [--upload-mb MB] [--corpus FOLDER]``; prints Markdown. Two
headless browsers drop the same N logs on one server, which is killed (SIGKILL) once a third is done
and started again; every log must have exactly one result, equal to what `quadid-log analyze` gives. An
upload of noise shows what the server's memory does. With a corpus, one log of 38 MB is dropped on the
page and given to the command line in turn.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import psutil

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests import chromium  # noqa: E402
from tests.serve.running import Running  # noqa: E402

#: Small logs; behind each copy stands noise of its own, so that no two have the same content.
BASES: Final = ("doublets.tlog", "default-logging.bin", "doublets.tlog", "default-logging.bin", "damaged.bin")
LARGE: Final = "firmware/ac47_quadx_multisine.BIN"
_LONGEST_S: Final = 3600.0
_REPEATS: Final = 3
_ENTRY: Final = "from quadid_logs.cli import run; run()"


def make_logs(folder: Path, number: int) -> list[Path]:
    """Write logs that all differ."""
    paths = []
    for place in range(number):
        base = ROOT / "sample_logs" / BASES[place % len(BASES)]
        path = folder / f"{place:03d}-{base.name}"
        path.write_bytes(base.read_bytes() + bytes([place % 251]) * (64 + place))
        paths.append(path)
    return paths


@contextmanager
def pages(server: Running, folder: Path) -> Iterator[list[chromium.Browser]]:
    """Give two browsers with the page open."""
    with chromium.Browser(folder / "one") as one, chromium.Browser(folder / "two") as two:
        for browser in (one, two):
            browser.go(server.start_address)
            browser.wait("document.querySelector('#drop') !== null && location.pathname === '/'")
        yield [one, two]


def states(server: Running) -> dict[str, str]:
    """Return what became of each log."""
    return {entry["name"]: entry["state"] for entry in server.entries()["entries"]}


def wait_for(server: Running, count: int) -> None:
    """Wait until so many logs are done."""
    until = time.monotonic() + _LONGEST_S
    while time.monotonic() < until:
        if sum(state in ("done", "failed") for state in states(server).values()) >= count:
            return
        time.sleep(0.5)
    raise TimeoutError(states(server))


def comparable(content: dict[str, Any]) -> dict[str, Any]:
    """Leave out of result.json how long it took, and where the log lay."""
    kept = {key: value for key, value in content.items() if key not in ("tool", "timings_s")}
    return {**kept, "log": {key: value for key, value in kept["log"].items() if key != "path"}}


def by_command_line(path: Path) -> dict[str, Any]:
    """Return what `quadid-log analyze --json` prints."""
    command = [sys.executable, "-c", _ENTRY, "analyze", str(path), "--json", "--no-report"]
    done = subprocess.run(command, capture_output=True, check=False, cwd=ROOT)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def load(number: int, folder: Path, checked: int) -> str:
    """Drop the logs in two browsers, kill, restart; return a line of the table."""
    logs = make_logs(folder, number)
    store = folder / "store"
    began = time.monotonic()
    with Running(store) as first, pages(first, folder) as (one, two):
        one.drop(logs)
        two.drop(logs)
        wait_for(first, number // 3)
        first.kill()
        with Running(store, port=first.port) as second:
            second.cookie = first.cookie
            wait_for(second, number)
            for browser in (one, two):
                browser.wait("!document.querySelector('#queue-list').children.length", 60.0)
                rows = browser.run("document.querySelectorAll('.flights tbody tr').length")
                assert rows == number, rows
            found = second.entries()["entries"]
            took_s = time.monotonic() - began
            assert sorted(entry["name"] for entry in found) == [path.name for path in logs]
            assert {entry["state"] for entry in found} == {"done"}
            assert len(list((store / "results").iterdir())) == number
            ids = {entry["name"]: entry["id"] for entry in found}
            for path in logs[:: max(1, number // checked)]:
                served = json.loads(second.ask("GET", f"/reports/{ids[path.name]}/files/result.json")[2])
                assert comparable(served) == comparable(by_command_line(path)), path
    return (
        f"| {number} logs, two browsers, one kill | {took_s:.0f} s | one result each, as the command line's |"
    )


def upload(megabytes: int, folder: Path) -> str:
    """Upload noise and watch the server's memory."""
    noise = folder / "noise"
    with noise.open("wb") as file:
        for _ in range(megabytes):
            file.write(os.urandom(1 << 20))
    with Running(folder / "store2") as server:
        process = psutil.Process(server.process.pid)
        before, began = process.memory_info().rss, time.monotonic()
        server.upload(noise)
        took_s = time.monotonic() - began
        status = Path(f"/proc/{process.pid}/status").read_text()
        peak = int(status.split("VmHWM:")[1].split()[0]) * 1024
    noise.unlink()
    grown = f"{(peak - before) / 1e6:.0f} MB more (peak {peak / 1e6:.0f} MB)"
    return f"| upload of {megabytes} MiB | {took_s:.1f} s | the server takes {grown} |"


def to_verdict(log: Path, folder: Path) -> str:
    """Compare a drop on a fresh server with the command line, in turn."""
    page_s, line_s = [], []
    for turn in range(_REPEATS):
        with Running(folder / f"verdict{turn}") as server, chromium.Browser(folder / f"v{turn}") as browser:
            browser.go(server.start_address)
            browser.wait("document.querySelector('#drop') !== null && location.pathname === '/'")
            time.sleep(5.0)
            began = time.monotonic()
            browser.drop([log])
            browser.wait("document.querySelectorAll('.flights tbody tr').length === 1", _LONGEST_S)
            page_s.append(time.monotonic() - began)
        began = time.monotonic()
        command = [sys.executable, "-c", _ENTRY, "analyze", str(log), "-o", str(folder / f"line{turn}")]
        subprocess.run(command, capture_output=True, check=False)
        line_s.append(time.monotonic() - began)
    page, line = statistics.median(page_s), statistics.median(line_s)
    size = f"{log.stat().st_size / 1e6:.0f} MB"
    return f"| drop to verdict and report, {size} | {page:.1f} s | `analyze` {line:.1f} s |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=50)
    parser.add_argument("--checked", type=int, default=50, help="results compared with the command line's")
    parser.add_argument("--upload-mb", type=int, default=1024)
    parser.add_argument("--corpus", type=Path)
    given = parser.parse_args()
    print("| what | time | result |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        if given.upload_mb:
            print(upload(given.upload_mb, Path(folder)), flush=True)
        if given.corpus:
            print(to_verdict(given.corpus / LARGE, Path(folder)), flush=True)
        if given.logs:
            print(load(given.logs, Path(folder), given.checked), flush=True)


if __name__ == "__main__":
    main()
