"""Disks that fill up and folders that cannot be written."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from quadid_logs.cli import main
from tests.marks import thorough_but

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


#: Files may be as long as that: what comes after fails as on a full disk.
MOST_BYTES = 4096


@contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let every file that this process writes end at 4 kB."""
    # A compiled module that ends there would break every later import of it.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def words_of(what: str, folder: str) -> list[str]:
    """Return the arguments of a command that writes into a folder."""
    return [word.replace("{}", folder) for word in COMMANDS[what]]


def last_lines(err: str) -> list[str]:
    """Return the lines of stderr that are no progress."""
    return [line for line in err.splitlines() if "error" in line.lower()]


@pytest.mark.parametrize("what", thorough_but([one for one in COMMANDS if one != "paper"], COMMANDS))
def test_a_full_disk_gives_one_line_and_leaves_nothing(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither a part of a file nor one file of several."""
    with full_disk(monkeypatch):
        code = main(words_of(what, str(tmp_path)))
    assert code == 2
    err = capsys.readouterr().err
    assert len(last_lines(err)) == 1
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_the_installed_command_too_gives_one_line_on_a_full_disk(tmp_path: Path) -> None:
    """From its start on: also what it writes for itself finds no room."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_BYTES, MOST_BYTES))

    entry = [sys.executable, "-B", "-c", "from quadid_logs.cli import run; run()"]
    words = words_of("csv", str(tmp_path))
    done = subprocess.run([*entry, *words], capture_output=True, text=True, preexec_fn=limit, check=False)
    assert done.returncode == 2
    assert len(last_lines(done.stderr)) == 1
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that nobody can write to")
@pytest.mark.parametrize("what", ["report", "csv", "bin"])
def test_a_folder_that_cannot_be_written_gives_one_line(
    what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not even root can make a folder in /proc."""
    assert main(words_of(what, "/proc/reports")) == 2
    err = capsys.readouterr().err
    assert len(last_lines(err)) == 1
    assert "Traceback" not in err
