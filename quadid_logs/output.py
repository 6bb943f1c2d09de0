"""Files for the user: nothing is overwritten unasked, and none is ever half-written."""

from __future__ import annotations

import contextlib
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from quadid_logs.errors import OutputError
from quadid_logs.untrusted import printable

#: How the names of unfinished files begin, of reports and of a fleet's downloads.
_HERE = ".quadid"
DOWNLOADS = "quadid-fleet"
#: No run takes so long to write its files [s].
_OVER_S = 86_400.0


def check_free(*paths: Path, force: bool) -> None:
    """Refuse before the work what could not be written after it.

    Parameters
    ----------
    *paths : Path
        Files that shall be written.
    force : bool
        Whether files may be replaced.

    Raises
    ------
    OutputError
        If a path is a folder, or exists and `force` is not set, or nothing can be
        written beside it.
    """
    for path in paths:
        if path.is_dir():
            raise OutputError(f"{printable(path)} is a folder.", hint="Give another name, or move it away.")
        if os.path.lexists(path) and not force:
            raise OutputError(f"{printable(path)} exists already.", hint="Add --force to replace it.")
    for folder in {path.parent for path in paths}:
        check_writable(folder)


def check_folder_free(folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Refuse before the work a folder in which files of these names could not be written after it.

    Parameters
    ----------
    folder : Path
        May be missing.
    names : iterable of str
    force : bool
        Whether files may be replaced.

    Raises
    ------
    OutputError
        If the folder is a symbolic link, or as `check_free`.
    """
    check_no_link(folder)
    check_free(*(folder / name for name in names), force=force)


def check_writable(folder: Path) -> None:
    """Refuse a folder in which nothing can be made, by trying.

    Parameters
    ----------
    folder : Path
        May be missing: then the nearest one above it counts.

    Raises
    ------
    OutputError
    """
    here = next(each for each in (folder, *folder.absolute().parents) if os.path.lexists(each))
    try:
        Path(tempfile.mkdtemp(prefix=beside_prefix(), dir=here)).rmdir()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise OutputError(
            f"{printable(folder)} cannot be written to: {reason}.", hint="Choose another -o."
        ) from error


def check_no_link(folder: Path) -> None:
    """Refuse a folder that is a symbolic link: what is written would land where nobody looked.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    OutputError
    """
    if folder.is_symlink():
        raise OutputError(
            f"{printable(folder)} is a symbolic link, and nothing is written through links.",
            hint="Choose another -o.",
        )


@contextmanager
def new_folder(folder: Path) -> Iterator[None]:
    """Make the folder and those above it; if what follows fails, remove those that it made and left empty.

    Parameters
    ----------
    folder : Path

    Yields
    ------
    None

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    made = [each for each in (folder, *folder.parents) if not os.path.lexists(each)]
    try:
        make_folder(folder)
        yield
    except BaseException:
        for each in made:
            with contextlib.suppress(OSError):
                each.rmdir()
        raise


def beside_prefix(begin: str = _HERE) -> str:
    """Return how names of unfinished files and folders begin: they say whose they are.

    Parameters
    ----------
    begin : str
        What they are.

    Returns
    -------
    str
    """
    return f"{begin}-{_host()}-{os.getpid()}-"


def remove_unfinished(folder: Path, begin: str = _HERE) -> None:
    """Remove what killed runs left unfinished in a folder, and nothing of a run that may go on.

    Parameters
    ----------
    folder : Path
    begin : str
        As of `beside_prefix`.
    """
    for path in folder.glob(f"{begin}-*"):
        with contextlib.suppress(OSError):
            if not _is_unfinished(path, begin):
                continue
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()


def _is_unfinished(path: Path, begin: str) -> bool:
    """Return whether the run that made it is over: its process, or where that cannot be seen, its day."""
    mine = re.fullmatch(rf"{re.escape(begin)}-{re.escape(_host())}-(\d+)-.*", path.name)
    if mine is None or os.name != "posix":
        return time.time() - path.lstat().st_mtime > _OVER_S
    try:
        os.kill(int(mine[1]), 0)
    except (ProcessLookupError, OverflowError):
        return True
    return False


def _host() -> str:
    """Return the machine's name as a part of a file's."""
    return re.sub(r"\W", "_", platform.node())


def make_folder(folder: Path) -> None:
    """Make the folder and those above it.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{printable(folder)} cannot be created: {error.strerror or error}.") from error


def write_beside(path: Path, content: bytes) -> None:
    """Write a file beside its place and rename it, so that none is ever half-written.

    Parameters
    ----------
    path : Path
    content : bytes

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    write_together(path.parent, {path.name: content})


def write_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files beside their places and rename them when all are there: all of them or none.

    Parameters
    ----------
    folder : Path
    files : mapping of str to bytes
        Content by file name.

    Raises
    ------
    OutputError
        If one cannot be written.
    """
    remove_unfinished(folder)
    beside = {name: folder / f"{beside_prefix()}{name}" for name in files}
    name = ""
    try:
        for name, content in files.items():
            beside[name].write_bytes(content)
        for name, part in beside.items():
            part.replace(folder / name)
    except OSError as error:
        path = printable(folder / name)
        raise OutputError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        for part in beside.values():
            part.unlink(missing_ok=True)
