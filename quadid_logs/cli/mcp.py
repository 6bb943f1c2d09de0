"""``quadid-log mcp``: the verbs as tools for language models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def mcp(
    allow: Annotated[
        list[Path],
        typer.Option(
            "--allow",
            metavar="FOLDER",
            help="Folder with logs that may be read. Can be given several times.",
        ),
    ],
) -> int:
    """Answer a language model's questions about logs: info, analyze, compare, explain, tune, plan, query.

    A server of the Model Context Protocol on standard input and output, to be started by the program that
    asks. It reads the folders that are allowed, and writes nothing.
    """
    from quadid_logs.agents.server import serve

    serve(allow)
    return 0
