"""``quadid-log serve``: a page on one's own machine to drop logs on."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.failure import flush, report_problem, say
from quadid_logs.cli.options import OpenPage


def serve(
    port: Annotated[
        int | None,
        typer.Option(
            "--port",
            metavar="N",
            min=0,
            max=65535,
            help="Port of the server; 0: a free one [default: 8723].",
        ),
    ] = None,
    open_page: OpenPage = False,
    store: Annotated[
        Path | None,
        typer.Option(
            "--store", metavar="DIR", help="Folder for logs and results [default: the user's data folder]."
        ),
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help="Address to listen on, for other machines; needs QUADID_SERVE_TOKEN.",
        ),
    ] = "",
    token: Annotated[
        str,
        typer.Option(
            "--token", envvar="QUADID_SERVE_TOKEN", hidden=True, help="Token that other machines must give."
        ),
    ] = "",
    max_mb: Annotated[
        float, typer.Option("--max-mb", metavar="MB", min=0.001, help="Largest log that is accepted.")
    ] = 4000.0,
    timeout_min: Annotated[
        float, typer.Option("--timeout", metavar="MIN", min=0.01, max=10_080.0, help="Longest analysis.")
    ] = 30.0,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Analyses at a time; 0: one per core.")
    ] = 0,
    idle_min: Annotated[
        float,
        typer.Option(
            "--idle",
            metavar="MIN",
            min=0.0,
            help="End after this time without an open page or work; 0: never.",
        ),
    ] = 120.0,
) -> int:
    """Serve a page to drop logs on: verdicts, reports, comparisons and each vehicle's history.

    It listens on this machine only, and nothing leaves it. Ctrl-C ends it;
    what is in the queue goes on at the next start.
    """
    from quadid_logs.extra import load

    for library in ("starlette", "uvicorn"):
        load(library, "serve")
    from quadid_logs.serve.server import DEFAULT_PORT, ServeSettings, default_folder
    from quadid_logs.serve.server import serve as run

    settings = ServeSettings(
        folder=store or default_folder(),
        port=DEFAULT_PORT if port is None else port,
        host=host,
        token=token,
        max_bytes=int(max_mb * 1e6),
        timeout_s=60.0 * timeout_min,
        idle_s=60.0 * idle_min,
        n_workers=workers,
    )
    run(settings, lambda address: _began(address, open_page=open_page))
    return 0


def _began(address: str, *, open_page: bool) -> None:
    """Say where the page is, and show it."""
    say(f"Open {address}")
    flush()
    if open_page:
        import webbrowser

        if not webbrowser.open(address):
            report_problem("no browser could be opened. Open the address above.")
    sys.stderr.flush()
