"""``quadid-log paper``: the source paper's experiment beside ours and the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quadid_logs.cli.failure import say
from quadid_logs.cli.options import Force
from quadid_logs.cli.progress import Progress
from quadid_logs.output import check_folder_free, new_folder, write_together
from quadid_logs.untrusted import printable

_FILES = ("paper.md", "paper.html", "windows.csv", "fig4.png", "windows.png", "tables.png")


def paper(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for page and figures.")
    ] = Path("quadid-paper"),
    force: Force = False,
) -> int:
    """Re-run the source paper's experiment and say what agrees with eq. (12), what cannot, and why."""
    from quadid_logs.report.markdown_page import markdown_page
    from quadid_logs.simulator.paper_experiment import run_experiment
    from quadid_logs.simulator.paper_page import figures, page_text, windows_csv

    check_folder_free(output, _FILES, force=force)
    with Progress("paper") as progress:
        progress("simulating")
        experiment = run_experiment()
        progress("drawing")
        text = page_text(experiment)
        files = {"paper.md": text.encode(), "windows.csv": windows_csv(experiment).encode()}
        drawn = figures(experiment)
        files |= {"paper.html": markdown_page(text, drawn).encode(), **drawn}
    with new_folder(output):
        write_together(output, {name: files[name] for name in _FILES})
    say(text.rstrip("\n"))
    say(f"\nWrote {', '.join(_FILES)} into {printable(output)}")
    return 0
