"""The verbs as tools of the Model Context Protocol, asked by the client of its own library."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from quadid_logs.agents.answers import Folders
from quadid_logs.cli import main
from quadid_logs.errors import SettingsError
from tests.conftest import REPOSITORY
from tests.marks import thorough

# Imported by the tests alone: it takes a second, in each test process.
pytestmark = pytest.mark.skipif(find_spec("mcp") is None, reason="could not import 'mcp'")

SAMPLES = REPOSITORY / "sample_logs"
TOOLS = {"info", "analyze", "compare", "explain", "tune", "plan", "query"}


def ask(allowed: Path, tool: str, **arguments: object) -> dict[str, Any]:
    """Return what a tool answers, through the protocol."""
    import mcp

    from quadid_logs.agents.server import make_server

    async def asked() -> Any:
        async with mcp.Client(make_server(Folders([allowed]))) as client:
            return await client.call_tool(tool, arguments)

    answer = asyncio.run(asked())
    assert not answer.is_error
    return dict(json.loads(answer.content[0].text))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder that may be read, with a log in it and one beside it."""
    inside = tmp_path / "logs"
    inside.mkdir()
    for place in (inside / "flight.tlog", tmp_path / "other.tlog"):
        shutil.copy(SAMPLES / "doublets.tlog", place)
    return inside


def test_a_program_that_starts_the_server_is_offered_every_tool_as_read_only() -> None:
    """Over standard input and output, as such programs do."""
    import mcp

    command = mcp.StdioServerParameters(
        command=sys.executable,
        args=["-m", "quadid_logs", "mcp", "--allow", str(SAMPLES)],
        cwd=str(REPOSITORY),
    )

    async def asked() -> Any:
        async with mcp.Client(command) as client:
            return await client.list_tools()

    tools = asyncio.run(asked()).tools
    assert {one.name for one in tools} == TOOLS
    assert all(one.annotations.read_only_hint for one in tools)
    assert all(one.description for one in tools)


def test_an_analysis_begins_with_the_verdict_and_gives_intervals() -> None:
    found = ask(SAMPLES, "analyze", log="sysid-quad-x.bin")
    assert next(iter(found)) == "verdict"
    assert found["verdict"] == {"roll": "usable", "pitch": "usable", "yaw": "usable"}
    truth = json.loads((SAMPLES / "sysid-quad-x.truth.json").read_text(encoding="utf-8"))
    of_axes = {(one["target"], one["regressor"]): one for one in found["model"]["parameters"]}
    roll = of_axes["p_dot", "L"]
    assert roll["ci95"][0] < truth["models"]["quadrotor-6"]["B"][0][0] < roll["ci95"][1]


def test_a_refused_axis_says_by_codes_why_and_what_to_do() -> None:
    """Logged at 10 Hz."""
    found = ask(SAMPLES, "analyze", log="default-logging.bin")
    assert found["verdict"]["roll"] == "refused"
    assert found["exit_code"] == 1
    codes = found["axes"]["roll"]["reasons"]
    assert codes
    assert all(ask(SAMPLES, "explain", code=code)["what_to_do"] for code in codes)


@pytest.mark.parametrize(
    "path", ["../other.tlog", "link.tlog", "/etc/passwd", "absent.tlog", "a\0b", "", "."]
)
def test_nothing_outside_the_allowed_folders_is_read(folder: Path, path: str) -> None:
    """By dots, by a link, by an absolute path; what is absent is told alike."""
    (folder / "link.tlog").symlink_to(folder.parent / "other.tlog")
    found = ask(folder, "info", log=path)
    assert found["verdict"] == "error"
    assert found["what_to_do"]
    assert "body_rate" not in json.dumps(found)


def test_a_log_in_an_allowed_folder_is_read_by_either_name(folder: Path) -> None:
    by_name = ask(folder, "info", log="flight.tlog")
    assert by_name["exit_code"] == 0
    assert ask(folder, "info", log=str(folder / "flight.tlog"))["exit_code"] == 0


def test_tools_write_no_file(folder: Path) -> None:
    before = sorted(folder.parent.rglob("*"))
    for tool in ("info", "analyze", "tune"):
        assert ask(folder, tool, log="flight.tlog")["exit_code"] in (0, 1)
    ask(folder, "compare", before="flight.tlog", after="flight.tlog")
    assert sorted(folder.parent.rglob("*")) == before


@pytest.mark.parametrize(
    ("tool", "arguments"),
    [
        ("tune", {"log": "sysid-quad-x.bin"}),
        thorough("compare", {"before": "sysid-quad-x.bin", "after": "sysid-quad-x.bin"}),
        thorough("plan", {"autopilot": "ardupilot", "axes": ["roll"]}),
    ],
)
def test_every_answer_begins_with_verdict_or_exit_code(tool: str, arguments: dict[str, object]) -> None:
    found = ask(SAMPLES, tool, **arguments)
    assert next(iter(found)) in {"verdict", "exit_code"}
    assert found["exit_code"] in {0, 1, 3}


@pytest.mark.thorough
def test_a_store_is_asked_by_sql(tmp_path: Path) -> None:
    pytest.importorskip("duckdb")
    for name in ("default-logging.bin", "doublets.tlog"):
        shutil.copy(SAMPLES / name, tmp_path)
    assert main(["fleet", str(tmp_path), "-o", str(tmp_path / "store")]) in {0, 1, 3, 4}
    found = ask(tmp_path, "query", store="store", sql="SELECT count(*) >= 2 FROM fleet")
    assert found["rows"] == [[True]]


def test_a_store_that_is_none_is_an_answer_and_no_failure(folder: Path) -> None:
    assert ask(folder, "query", store=".", sql="SELECT 1")["verdict"] == "error"


def test_a_folder_that_is_not_there_is_told_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(SettingsError):
        Folders([tmp_path / "absent"])
    with pytest.raises(SettingsError):
        Folders([])
