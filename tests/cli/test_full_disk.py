"""Disks that fill up and folders that cannot be written, seen by the installed command."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

resource = pytest.importorskip("resource", reason="limits on file sizes are POSIX's")

LOG = Path(__file__).resolve().parents[2] / "sample_logs" / "default-logging.bin"
COMMANDS = {
    "report": ["analyze", str(LOG), "-o", "{}"],
    "result": ["analyze", str(LOG), "-o", "{}", "--no-report"],
    "csv": ["export", str(LOG), "-o", "{}/new/series.csv"],
    "parquet": ["export", str(LOG), "-o", "{}/new/series.parquet"],
    "mat": ["export", str(LOG), "-o", "{}/new/series.mat"],
    "bin": ["simulate", "hover", "-o", "{}/new/flight.bin", "--duration-s", "15"],
    "tlog": ["simulate", "hover", "-o", "{}/new/flight.tlog", "--duration-s", "15"],
    "paper": ["paper", "-o", "{}/new"],
}


def disk_of_4_kb() -> None:
    """Let every file end at 4 kB: what comes after fails as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))


def run(
    command: list[str], folder: str, before: Callable[[], None] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    words = [word.replace("{}", folder) for word in command]
    # -B: a compiled module that ends at 4 kB would break every later import of it.
    entry = [sys.executable, "-B", "-c", "from quadid_logs.cli import run; run()"]
    return subprocess.run([*entry, *words], capture_output=True, text=True, preexec_fn=before, check=False)


def last_lines(done: subprocess.CompletedProcess[str]) -> list[str]:
    """Return the lines of stderr that are no progress."""
    return [line for line in done.stderr.splitlines() if "error" in line.lower()]


@pytest.mark.parametrize("what", COMMANDS)
def test_a_full_disk_gives_one_line_and_leaves_nothing(what: str, tmp_path: Path) -> None:
    """Neither a part of a file nor one file of several."""
    done = run(COMMANDS[what], str(tmp_path), disk_of_4_kb)
    assert done.returncode == 2
    assert len(last_lines(done)) == 1
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that nobody can write to")
@pytest.mark.parametrize("what", ["report", "csv", "bin"])
def test_a_folder_that_cannot_be_written_gives_one_line(what: str) -> None:
    """Not even root can make a folder in /proc."""
    done = run(COMMANDS[what], "/proc/reports")
    assert done.returncode == 2
    assert len(last_lines(done)) == 1
    assert "Traceback" not in done.stderr
