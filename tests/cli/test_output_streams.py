"""Outputs that cannot be written: one line of the system's own reason, never a bug of ours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

LOG = Path(__file__).resolve().parents[2] / "sample_logs" / "default-logging.bin"
ENTRY = "from quadid_logs.cli import run; run()"
pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a POSIX shell and /dev/full")


def shell(arguments: str, redirection: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a shell that redirects its output."""
    line = f"{sys.executable} -c '{ENTRY}' {arguments} {redirection}"
    return subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("arguments", [f"info {LOG}", "explain", "--help", "explain --help", "--version"])
@pytest.mark.parametrize(("redirection", "words"), [(">&-", "closed"), (">/dev/full", "No space left")])
def test_an_output_that_takes_nothing_is_one_line_and_exit_code_2(
    arguments: str, redirection: str, words: str
) -> None:
    """1 would say that an axis must not be trusted."""
    done = shell(arguments, redirection)
    assert done.returncode == 2
    (line,) = [each for each in done.stderr.splitlines() if not each.startswith(f"{LOG.name}: ")]
    assert words in line
    assert "bug" not in line


@pytest.mark.thorough
def test_a_closed_standard_error_costs_no_result() -> None:
    """Progress and problems have nowhere to go; the result has."""
    done = shell(f"info {LOG}", "2>&-")
    assert (done.returncode, done.stderr) == (0, "")
    assert "firmware" in done.stdout


def test_an_error_of_the_system_is_not_called_a_bug(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Full temporary folders, lost network drives."""
    from quadid_logs.cli import main

    def full(*_arguments: object) -> None:
        raise FileNotFoundError(2, "No usable temporary directory found", "/tmp")

    monkeypatch.setattr("quadid_logs.cli.info.check_log", full)
    assert main(["info", str(LOG)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "No usable temporary directory found (/tmp)" in line
    assert "bug" not in line
