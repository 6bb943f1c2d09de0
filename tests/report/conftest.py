"""Results to report on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from quadid_logs.data.result import Result
from quadid_logs.report import write_report
from tests import chromium
from tests.synthetic_results import hostile_result, refused_result, usable_result, write_placeholder_log


@pytest.fixture(scope="session")
def usable() -> Result:
    """Return a good flight."""
    return usable_result()


@pytest.fixture(scope="session")
def refused() -> Result:
    """Return a log without a flight."""
    return refused_result()


@pytest.fixture(scope="session")
def hostile() -> Result:
    """Return a result whose every text is an attack."""
    return hostile_result()


@pytest.fixture(scope="session")
def report_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the written report of a good flight."""
    folder = tmp_path_factory.mktemp("reports")
    log = write_placeholder_log(folder / "flight.bin")
    write_report(usable_result(path=str(log)), folder / "flight", command="quadid-log analyze flight.bin")
    return folder / "flight"


@pytest.fixture(scope="session")
def hostile_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the written report of the hostile result."""
    folder = tmp_path_factory.mktemp("reports") / "hostile"
    write_report(hostile_result(), folder, command="quadid-log analyze '<script>'")
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Browser]:
    """Start a browser with a profile of its own."""
    with chromium.Browser(tmp_path_factory.mktemp("browser") / "profile") as started:
        yield started
