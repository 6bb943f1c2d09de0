"""Files for the user: nothing is overwritten unasked, and none is ever half-written."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from quadid_logs.errors import OutputError
from quadid_logs.untrusted import printable


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
        Path(tempfile.mkdtemp(prefix=".quadid-", dir=here)).rmdir()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise OutputError(
            f"{printable(folder)} cannot be written to: {reason}.", hint="Choose another -o."
        ) from error


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
        raise OutputError(f"{printable(folder)} cannot be made: {error.strerror or error}.") from error


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
    beside = {name: folder / f".{name}.{os.getpid()}.part" for name in files}
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
