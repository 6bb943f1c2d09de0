"""Show a page that was just written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from quadid_logs.cli.failure import report_problem
from quadid_logs.untrusted import printable


def open_page(page: Path, say: Callable[[str], None] = report_problem) -> None:
    """Open a page in the browser; where there is none its path is said."""
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        say(f"no browser could be opened. Open the page yourself: {printable(page)}.")
