"""What verbs say of their one outcome, what they write, and the page that they open."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from quadid_logs.cli.failure import report_problem, say
from quadid_logs.output import new_folder, write_together
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from quadid_logs.figures import Figure


def say_outcome(
    text: str, lines: Sequence[str], written: str = "", *, code: int, as_json: bool, quiet: bool
) -> None:
    """Print JSON, or lines with what was written; quiet, the first line where the exit code is not 0."""
    if as_json:
        say(text.rstrip("\n"))
    elif not quiet:
        for line in (*lines, *([f"  written: {written}"] if written else ())):
            say(line)
    elif code:
        report_problem(lines[0])


def write_outcome(
    folder: Path, files: Mapping[str, bytes], figures: Mapping[str, Figure], possible: Iterable[str]
) -> str:
    """Write files and figures by their names, remove the rest of an earlier run; return what was written."""
    import io

    from quadid_logs.figures.png import write_png

    files = dict(files)
    for name, figure in figures.items():
        drawn = io.BytesIO()
        write_png(figure, drawn)
        files[name] = drawn.getvalue()
    with new_folder(folder):
        write_together(folder, files)
    for name in set(possible) - files.keys():
        # That of an earlier run would contradict the JSON beside it.
        (folder / name).unlink(missing_ok=True)
    return ", ".join(printable(folder / name) for name in files)


def open_page(page: Path, say: Callable[[str], None] = report_problem) -> None:
    """Open a page in the browser; where there is none its path is said."""
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        say(f"no browser could be opened. Open the page yourself: {printable(page)}.")
