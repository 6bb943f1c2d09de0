"""``analyze --open``: the report that was just written, in the browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import pytest

from quadid_logs.cli import main
from tests.conftest import REPOSITORY

LOG = str(REPOSITORY / "sample_logs" / "doublets.tlog")


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Note what would be opened."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address) or True)
    return addresses


def test_the_report_is_opened(tmp_path: Path, opened: list[str]) -> None:
    """Whatever the verdict."""
    main(["analyze", LOG, "-o", str(tmp_path), "--png", "none", "--open", "-q"])
    assert opened == [(tmp_path / "doublets" / "report.html").resolve().as_uri()]


@pytest.mark.parametrize("options", [["--open", "--no-report"], []])
def test_nothing_is_opened_without_a_report_or_the_wish(
    tmp_path: Path, opened: list[str], options: list[str]
) -> None:
    """A page of an earlier run would show other numbers."""
    main(["analyze", LOG, "-o", str(tmp_path), "--no-report", "-q", *options])
    assert opened == []


def test_a_log_that_cannot_be_read_opens_nothing(tmp_path: Path, opened: list[str]) -> None:
    """There is no report."""
    assert main(["analyze", str(tmp_path / "none.bin"), "-o", str(tmp_path), "--open"]) == 2
    assert opened == []
