"""Windows, macOS and Linux: names that all of them allow, and nothing that only one of them can import."""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path, PureWindowsPath

import pytest

from quadid_logs.figures import FIGURE_KEYS
from quadid_logs.report.folder import INDEX_FILE, REPORT_FILE, RESULT_FILE, report_folders
from tests.conftest import REPOSITORY

DEVICES = {"con", "prn", "aux", "nul", *(f"{kind}{n}" for kind in ("com", "lpt") for n in range(1, 10))}
POSIX_ONLY = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}


def is_windows_name(name: str) -> bool:
    """Say whether Windows takes it for the name of a file."""
    path = PureWindowsPath(name)
    whole = path.name == name and not path.drive and not path.root
    allowed = not set(name) & set('<>:"/\\|?*') and not name.endswith((".", " "))
    return whole and allowed and name.split(".")[0].strip().lower() not in DEVICES


@pytest.mark.parametrize(
    "log",
    [
        PureWindowsPath(r"C:\logs\CON.bin"),
        PureWindowsPath(r"C:\logs\com1.tar.bin"),
        PureWindowsPath(r"\\server\share\2026-01-01 flight.BIN"),
        Path("12:30:00.bin"),
        Path("what?.ulg"),
        Path("back\\slash.ulg"),
        Path("ends with a dot..bin"),
        Path("bell\a.bin"),
    ],
)
def test_the_folder_of_a_report_has_a_name_that_windows_allows(log: Path) -> None:
    """Whatever the log is called, and wherever the report is written."""
    (folder,) = report_folders([log], Path("out"))
    assert is_windows_name(folder.name), folder.name


def test_an_ordinary_log_keeps_its_name() -> None:
    """On Windows as elsewhere."""
    logs = [PureWindowsPath(r"D:\flights\flight.bin"), Path("flights/Flug Süd.bin")]
    assert [folder.name for folder in report_folders(logs, Path("out"))] == ["flight", "Flug Süd"]


def test_every_file_that_is_written_has_a_name_that_windows_allows() -> None:
    """Results, reports, the index, and the figures."""
    for name in (RESULT_FILE, REPORT_FILE, INDEX_FILE, *(f"{key}.png" for key in FIGURE_KEYS)):
        assert is_windows_name(name), name


def test_a_checkout_works_where_case_makes_no_difference() -> None:
    """No two files of the repository differ in case only, and none has a forbidden name."""
    folders = ("quadid_logs", "docs", "tests", "benchmarks", "study", "examples", "sample_logs")
    files = [path.relative_to(REPOSITORY) for each in folders for path in (REPOSITORY / each).rglob("*")]
    assert [str(path) for path in files if not is_windows_name(path.name)] == []
    twice = Counter(str(path).lower() for path in files if "__pycache__" not in path.parts)
    assert [name for name, count in twice.items() if count > 1] == []


def test_no_module_needs_a_posix_system_to_start() -> None:
    """What only some systems have is imported inside the function that uses it, where there is an else."""
    found = []
    for path in (REPOSITORY / "quadid_logs").rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            found += [f"{path.name}: {name}" for name in names if name.split(".")[0] in POSIX_ONLY]
    assert found == []


def test_the_modules_that_are_looked_for_are_not_everywhere() -> None:
    """The list above is of modules that the standard library does have."""
    assert sys.stdlib_module_names >= POSIX_ONLY
