"""What runs with the corpus of flown logs, and what without."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent


def collect(*arguments: str, corpus: str | None) -> subprocess.CompletedProcess[str]:
    """Collect tests in a process of its own, with QUADID_LOG_CORPUS as given."""
    environment = {name: value for name, value in os.environ.items() if name != "QUADID_LOG_CORPUS"}
    if corpus is not None:
        environment["QUADID_LOG_CORPUS"] = corpus
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--collect-only", *arguments]
    return subprocess.run(
        command, cwd=TESTS.parent, env=environment, capture_output=True, text=True, check=False
    )


def test_a_corpus_that_is_named_but_absent_is_an_error(tmp_path: Path) -> None:
    """Skipped tests look like passed ones."""
    done = collect(__file__, corpus=str(tmp_path))
    assert done.returncode == 4
    assert str(tmp_path) in done.stderr


@pytest.mark.thorough
def test_not_corpus_leaves_out_every_test_that_reads_it() -> None:
    """By the fixture that gives the folder, marked or not; `make test` needs none."""
    chosen = collect("-m", "not corpus", "tests/writers/test_ulog.py", "tests/test_corpus.py", corpus=None)
    every = collect("tests/writers/test_ulog.py", corpus=None)
    assert every.returncode == 0
    assert "test_formats_equal_the_firmware_s" in every.stdout
    assert "test_formats_equal_the_firmware_s" not in chosen.stdout
    assert "test_corpus.py" not in chosen.stdout


def test_the_corpus_is_reached_through_its_fixture_alone() -> None:
    """Otherwise a test could read it without being marked."""
    named = {
        path.relative_to(TESTS).as_posix()
        for path in TESTS.rglob("*.py")
        if "QUADID_LOG_CORPUS" in path.read_text(encoding="utf-8") or "corpus_folder" in path.read_text()
    }
    assert named == {"conftest.py", Path(__file__).name}
