"""The verbs as read-only tools of the Model Context Protocol, over standard input and output."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Any

from quadid_logs.agents import answers
from quadid_logs.agents.answers import Answer, Folders, told
from quadid_logs.extra import load
from quadid_logs.version import __version__

_INSTRUCTIONS = (
    "Identifies a rotational model with 95 % intervals, margins and next gains from multirotor flight "
    "logs. Read `verdict` first: a refused axis has no number to quote. Every refusal has a code. "
    "`explain` says what a code means and what to fly or set next. Quote intervals with their values."
)


def make_server(folders: Folders) -> Any:
    """Return a server with all tools.

    Parameters
    ----------
    folders : Folders
        That may be read.

    Raises
    ------
    SettingsError
        If the protocol's library is not installed.
    """
    module = load("mcp.server", "mcp")
    types = load("mcp.types", "mcp")
    server = module.MCPServer(
        "quadid-logs", instructions=_INSTRUCTIONS, version=__version__, log_level="ERROR"
    )
    reads = types.ToolAnnotations(readOnlyHint=True, openWorldHint=False)

    def info(log: str) -> Answer:
        """Tell what is in a flight log: rates, gaps, what analyze misses, vibration, tracking, filters."""
        return told(lambda: answers.info(folders.path_of(log)))

    def analyze(log: str, vehicle: str = "") -> Answer:
        """Identify the rotational model: verdict and findings by axis, values with intervals, margins.

        `vehicle` is a TOML file with mass, arms and thrust, or empty.
        """
        return told(
            lambda: answers.analyze(folders.path_of(log), folders.path_of(vehicle) if vehicle else None)
        )

    def compare(before: str, after: str) -> Answer:
        """Tell whether the vehicle changed between two flights by more than both leave open."""
        return told(lambda: answers.compare(folders.path_of(before), folders.path_of(after)))

    def explain(code: str) -> Answer:
        """Explain the code of a finding, as QL303, and what to fly or set next."""
        return told(lambda: answers.explain(code))

    def tune(log: str) -> Answer:
        """Recommend the next gains with the margins that they promise, or say why not. Writes no file."""
        return told(lambda: answers.tune(folders.path_of(log)))

    def plan(autopilot: str, axes: list[str] | None = None) -> Answer:
        """Plan a flight that gives an answer, for an autopilot; some axes, or all."""
        return told(lambda: answers.plan(autopilot, axes or ()))

    def query(store: str, sql: str) -> Answer:
        """Run SQL over a store that `quadid-log fleet` made; DESCRIBE fleet lists its columns."""
        return told(lambda: answers.query(folders.path_of(store), sql))

    for tool in (info, analyze, compare, explain, tune, plan, query):
        server.tool(annotations=reads)(tool)
    return server


def serve(allowed: list[Path]) -> None:
    """Answer on standard input and output until it is closed.

    Parameters
    ----------
    allowed : list of Path
        Folders that may be read.

    Raises
    ------
    SettingsError
        If a folder is none, or the protocol's library is not installed.
    """
    server = make_server(Folders(allowed))
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        server.run("stdio")
    sys.stderr.flush()
