"""Write a result into a folder: all of it or nothing, and nothing over what is there."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path, PurePath
from typing import Final, Literal

from quadid_logs.data.result import Result
from quadid_logs.errors import OutputError
from quadid_logs.output import beside_prefix, check_free, check_no_link, new_folder, remove_unfinished
from quadid_logs.report.json import json_text
from quadid_logs.report.provenance import Provenance, provenance_of
from quadid_logs.untrusted import portable_name, printable
from quadid_logs.vocabulary import AXES

RESULT_FILE, REPORT_FILE = "result.json", "report.html"
#: Beside the folders of several logs.
INDEX_FILE = "index.html"
#: A result.json has one or two.
_MOST_BYTES: Final = 50_000_000
#: Which figures are also written as PNG: the summary alone, every one, or none.
PngChoice = Literal["summary", "all", "none"]


def report_folders(logs: Iterable[PurePath], parent: Path, number: int = 0) -> tuple[Path, ...]:
    """Return one folder per log, named after its stem; no two logs get the same, none the index page's.

    A folder that holds the result of a log with another ending is not taken either: telemetry and card of
    one flight have one stem.

    Parameters
    ----------
    logs : iterable of PurePath
    parent : Path
    number : int
        Which log of a file with several was chosen, from 1; 0 where none was.

    Returns
    -------
    tuple of Path
        In the order of the logs.

    Examples
    --------
    >>> logs = [Path("a/f.bin"), Path("b/f.tlog"), Path("c/f.tlog")]
    >>> [folder.name for folder in report_folders(logs, Path("out"))]
    ['f', 'f-tlog', 'f-tlog-2']
    """
    taken = {INDEX_FILE}
    folders = []
    for log in logs:
        name = next(
            name
            for name in folder_names(log, number)
            if name.lower() not in taken and not _is_of_another(parent / name, log)
        )
        taken.add(name.lower())
        folders.append(parent / name)
    return tuple(folders)


def _is_of_another(folder: Path, log: PurePath) -> bool:
    """Return whether a folder holds the result of a log with another ending; unknown where it is not ours."""
    file = folder / RESULT_FILE
    try:
        if not file.is_file() or file.stat().st_size > _MOST_BYTES:
            return False
        path = json.loads(file.read_bytes())["log"]["path"]
        return PurePath(path).suffix.lower() != log.suffix.lower()
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False


def folder_names(log: PurePath, number: int = 0) -> Iterator[str]:
    """Yield the names that the folder of a log may have, the first one that is free to be taken.

    Parameters
    ----------
    number : int
        Which log of a file with several, from 1; 0 for the only one.

    Yields
    ------
    str
        Without end.
    """
    stem = portable_name(log.stem) + (f"-log{number}" if number else "")
    suffix = log.suffix.lstrip(".").lower()
    longer = f"{stem}-{suffix}" if suffix else stem
    yield stem
    if longer != stem:
        yield longer
    yield from (f"{longer}-{place}" for place in count(2))


def check_folder(folder: Path, *, force: bool = False) -> None:
    """Refuse early what `write_report` would refuse after the work.

    Parameters
    ----------
    folder : Path
    force : bool
        Whether the files of an earlier run may be replaced.

    Raises
    ------
    OutputError
        If the folder is a file, it or the one above is a symbolic link, or holds a result and
        `force` is not set.
    """
    for part in (folder, *folder.parents):
        if part.exists() and not part.is_dir():
            raise OutputError(
                f"{printable(part)} is a file, but a folder is needed.", hint="Choose another -o."
            )
    for place in (folder, folder.parent):
        check_no_link(place)
    check_free(folder / RESULT_FILE, folder / REPORT_FILE, force=force)


def write_report(
    result: Result,
    folder: Path,
    *,
    force: bool = False,
    drawings: bool = True,
    png: PngChoice = "summary",
    command: str = "",
) -> Result:
    """Write result.json, and report.html with figures as PNG beside it unless told not to.

    A full disk or Ctrl-C leaves nothing half-written.

    Parameters
    ----------
    result : Result
    folder : Path
        Made if it does not exist.
    force : bool
        Replace files of an earlier run.
    drawings : bool
        False writes result.json only.
    png : {"summary", "all", "none"}
        ``summary.png`` alone, every figure, or none.
    command : str
        The command line, for the report.

    Returns
    -------
    Result
        With the time that the report took in ``timings_s``.

    Raises
    ------
    OutputError
        If a file exists and `force` is not set, or something cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from quadid_logs import analyze, write_report
    >>> result = analyze("sample_logs/sysid-quad-x.bin")
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     folder = pathlib.Path(parent, "flight")
    ...     _ = write_report(result, folder, png="none")
    ...     sorted(file.name for file in folder.iterdir())
    ['report.html', 'result.json']
    """
    from quadid_logs.tuning import tuning_of

    check_folder(folder, force=force)
    started = time.perf_counter()
    provenance = provenance_of(result.log.path, command)
    # All of it into a new folder beside the target, which is moved into place in the end.
    with _writing_beside(folder) as beside:
        if drawings:
            write_drawings(result, provenance, beside, png)
        # The result with the seconds that the report took.
        report_s = time.perf_counter() - started
        timings = dict(result.timings_s)
        timings["report"] = report_s
        timings["total"] = timings.get("total", 0.0) + report_s
        timed = replace(result, timings_s=timings)
        tuning_of.hand_on(result, timed)
        text = json_text(timed, provenance)
        (beside / RESULT_FILE).write_text(text, encoding="utf-8")
        from quadid_logs.figures import FIGURE_KEYS

        names = sorted((path.name for path in beside.iterdir()), key=lambda name: (name == RESULT_FILE, name))
        check_free(*(folder / name for name in names), force=force)
        with new_folder(folder):
            for name in names:
                # A rename replaces a symbolic link itself and never writes through it.
                (beside / name).replace(folder / name)
        # What an earlier run drew and this one did not is no longer true.
        for name in {REPORT_FILE, *(f"{key}.png" for key in FIGURE_KEYS)}.difference(names):
            if (folder / name).is_file():
                (folder / name).unlink()
    return timed


def write_drawings(result: Result, provenance: Provenance, folder: Path, png: PngChoice) -> None:
    """Write report.html and the chosen PNG files into an existing folder."""
    from quadid_logs.figures import figures_of
    from quadid_logs.figures.png import write_png
    from quadid_logs.report.html import render_html
    from quadid_logs.report.sharing import without_folders
    from quadid_logs.report.view import view_of
    from quadid_logs.tuning import tuning_of

    figures = figures_of(result)
    shown, told = without_folders(result, provenance)
    page = render_html(view_of(shown, told), figures)
    tuning_of.hand_on(shown, result)
    (folder / REPORT_FILE).write_text(page, encoding="utf-8", newline="\n")
    if png == "none":
        return
    from quadid_logs.figures.summary import summary_figure
    from quadid_logs.report.verdict import effect_sentence, headline

    summary = summary_figure(result, headline(result), {axis: effect_sentence(result, axis) for axis in AXES})
    for figure in (summary, *(figures.shown if png == "all" else ())):
        write_png(figure, folder / f"{figure.key}.png")


@contextmanager
def _writing_beside(folder: Path) -> Iterator[Path]:
    """Give a new folder beside the target and remove it in the end; say clearly what went wrong."""
    try:
        with new_folder(folder.parent):
            remove_unfinished(folder.parent)
            with tempfile.TemporaryDirectory(
                prefix=beside_prefix(), dir=folder.parent, ignore_cleanup_errors=True
            ) as beside:
                yield Path(beside)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise OutputError(
            f"Cannot write to {printable(folder)}: {reason}.",
            hint="No file was left half-written. Choose another -o.",
        ) from error
