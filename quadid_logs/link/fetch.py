"""Fetch logs: which there are, and each into a folder, whole or as a part that the next run goes on with."""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import shutil
import stat
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Final

from quadid_logs.errors import LinkError, LogNotFoundError, OutputError, SettingsError
from quadid_logs.link.file_transfer import FileTransfer
from quadid_logs.link.requested import RequestedLog, requested_logs
from quadid_logs.link.vehicle import Patience, Vehicle
from quadid_logs.output import check_no_link, make_folder
from quadid_logs.untrusted import portable_name, printable

#: Where firmwares keep their logs: the name that the protocol reserves, then the folders of older versions.
_FOLDERS: Final = ("@MAV_LOG", "/APM/LOGS", "/fs/microsd/log", "/log")
_LOG = re.compile(r".*\.(?:bin|ulg|\w*log|bbl|bfl|usd|txt)|log\d+", re.IGNORECASE)
_NO_LOG = re.compile(r"lastlog\.txt|freespac.*|padding.*|readme.*", re.IGNORECASE)
_DATE = re.compile(r"(\d{4})-(\d\d)-(\d\d)")
#: How logs begin, for those that come without a name.
_ENDINGS: Final = ((b"\xa3\x95", ".bin"), (b"ULog", ".ulg"))
_DEEPEST, _MOST_FILES, _BLOCK = 4, 10_000, 1 << 20
_LONGEST_NAME: Final = 120
_LAST_LOG, _LONGEST_NUMBER = "LASTLOG.TXT", 20


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoteLog:
    """A log that can be fetched.

    Parameters
    ----------
    path : str
        On the vehicle, or on the card; a number where the vehicle gives no names.
    name : str
        Of the file that is written.
    size : int
        [bytes]
    time : datetime or None
        When it was made, as the vehicle tells it.
    """

    path: str
    name: str
    size: int
    time: datetime | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Fetched:
    """A file that was fetched, and whether the vehicle's checksum was compared with it."""

    path: Path
    checked: bool


class Logs:
    """The logs of a vehicle or card, the last one last; a context manager.

    Parameters
    ----------
    address : str
        As `link.vehicle.device_of`, or a folder.
    patience : Patience, optional

    Raises
    ------
    LinkError, SettingsError, LogNotFoundError
    """

    def __init__(self, address: str, patience: Patience | None = None) -> None:
        folder = Path(address)
        self._vehicle = None if folder.is_dir() else Vehicle(address, patience)
        self._files = None if self._vehicle is None else FileTransfer(self._vehicle)
        try:
            self.logs = tuple(self._find(folder))
        except BaseException:
            self.close()
            raise
        if not self.logs:
            self.close()
            raise LogNotFoundError(
                f"There is no log at {printable(address)}.",
                hint="Check that a card is in and that logging is on.",
            )

    def __enter__(self) -> Logs:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the link."""
        if self._vehicle is not None:
            self._vehicle.close()

    def since(self, day: datetime) -> tuple[RemoteLog, ...]:
        """Return the logs of a day and later.

        Raises
        ------
        SettingsError
            If the vehicle gives no dates.
        """
        if all(log.time is None for log in self.logs):
            raise SettingsError(
                "This vehicle's list of logs has no dates.", hint="Use -n N or --all instead of --since."
            )
        return tuple(log for log in self.logs if log.time is not None and log.time >= day)

    def fetch(
        self,
        log: RemoteLog,
        folder: Path,
        *,
        force: bool = False,
        tell: Callable[[int], None] = lambda _: None,
    ) -> Fetched:
        """Write a log into a folder; a part of it from an earlier run is gone on with.

        Parameters
        ----------
        force : bool
            Whether a file of that name may be replaced.
        tell : callable
            Called with the bytes that are there.

        Raises
        ------
        LinkError
            If the vehicle stops sending, or what arrived is not what it has.
        OutputError
            If the file exists with other content, or cannot be written.
        """
        check_no_link(folder)
        make_folder(folder)
        target = folder / log.name
        if os.path.lexists(target) and not force:
            if not target.is_symlink() and target.is_file() and target.stat().st_size == log.size:
                return Fetched(path=target, checked=False)
            raise OutputError(f"{printable(target)} exists already.", hint="Add --force to replace it.")
        part = folder / f"{log.name}.{log.size}.part"
        with _opened(part) as file:
            if file.tell() > log.size:
                file.truncate(0)
                file.seek(0)
            if shutil.disk_usage(folder).free < log.size - file.tell():
                raise OutputError(
                    f"{printable(folder)} has no room for {log.size / 1e6:.0f} MB.", hint="Free it."
                )
            if self._vehicle is None:
                # Append the missing bytes of a file on a card.
                source = Path(log.path)
                with source.open("rb") as card:
                    card.seek(file.tell())
                    while file.tell() < log.size and (
                        block := card.read(min(_BLOCK, log.size - file.tell()))
                    ):
                        file.write(block)
                        tell(file.tell())
                if file.tell() != log.size:
                    raise LinkError(
                        f"The card gave {file.tell()} of {log.size} bytes of {printable(source.name)}.",
                        hint="Check the card. The same command continues where it stopped.",
                    )
            elif self._files is not None:
                self._files.read(log.path, file, log.size, tell)
            else:
                RequestedLog(self._vehicle, int(log.path), log.size).read(file, tell)
            checked = self._check(log, file, part)
        target = folder / _with_ending(log.name, part)
        if os.path.lexists(target) and not force and target.name != log.name:
            raise OutputError(f"{printable(target)} exists already.", hint="Add --force to replace it.")
        try:
            part.replace(target)
        except OSError as error:
            raise OutputError(f"{printable(target)} cannot be written: {error.strerror or error}.") from error
        return Fetched(path=target, checked=checked)

    def _check(self, log: RemoteLog, file: BinaryIO, part: Path) -> bool:
        """Compare with the vehicle's checksum; a log that grows meanwhile has none."""
        if self._files is None or self._vehicle is None:
            return False
        theirs = self._files.checksum(log.path, log.size)
        if theirs is None:
            return False
        # The CRC-32 with start 0 and no final inversion, as the protocol's.
        file.seek(0)
        crc = 0xFFFFFFFF
        while block := file.read(_BLOCK):
            crc = zlib.crc32(block, crc)
        if (crc ^ 0xFFFFFFFF) == theirs:
            return True
        if self._files.size(log.path) != log.size:
            return False
        with contextlib.suppress(OSError):
            part.unlink()
        raise LinkError(
            f"The copy of {printable(log.name)} differs from the log on the vehicle: the checksums differ.",
            hint="Run the command again: it starts from the beginning.",
        )

    def _find(self, folder: Path) -> Iterator[RemoteLog]:
        """Yield the logs with a name each that no other has."""
        if self._vehicle is None:
            found = sorted(_on_card(folder), key=lambda log: (log.time, log.path))
        else:
            found = list(self._on_vehicle())
        taken: set[str] = set()
        for log in found:
            name = portable_name(log.name)[-_LONGEST_NAME:]
            while name.lower() in taken:
                name = f"_{name}"
            taken.add(name.lower())
            yield RemoteLog(path=log.path, name=name, size=log.size, time=log.time)

    def _on_vehicle(self) -> Iterator[RemoteLog]:
        if self._files is None or self._vehicle is None:
            return
        for folder in _FOLDERS:
            logs = list(_in_folder(self._files, folder))
            if self._files.silent:
                break
            if logs:
                last = _last_number(self._files, folder)
                yield from sorted(logs, key=lambda log: (_number(log.name) <= last, _by_number(log.name)))
                return
        self._files = None
        for number, (size, time_s) in requested_logs(self._vehicle).items():
            time = datetime.fromtimestamp(time_s, UTC) if time_s else None
            stamp = "" if time is None else f"-{time:%Y-%m-%d-%H%M%S}"
            yield RemoteLog(path=str(number), name=f"log{number}{stamp}", size=size, time=time)


def _last_number(files: FileTransfer, folder: str) -> float:
    """Return the number of the last log, infinity where no file beside the logs says it.

    Some firmwares begin again at 1 after so many logs, and keep the last number (AP_Logger_File.cpp,
    `write_lastlog_file`).
    """
    for entry in files.listing(folder) or ():
        if entry.name.upper() == _LAST_LOG and 0 < entry.size <= _LONGEST_NUMBER:
            content = io.BytesIO()
            with contextlib.suppress(LinkError):
                files.read(f"{folder}/{entry.name}", content, entry.size)
            text = content.getvalue().strip()
            return float(text) if text.isdigit() else math.inf
    return math.inf


def _number(name: str) -> float:
    """Return the number that begins a log's name, infinity where none does."""
    found = re.match(r"[0-9]{1,18}", name)
    return math.inf if found is None else float(found[0])


def _in_folder(files: FileTransfer, folder: str, below: str = "") -> Iterator[RemoteLog]:
    """Yield the logs of a folder on the vehicle and of those in it, one level deep: a folder for each day."""
    for entry in files.listing(folder) or ():
        path = f"{folder}/{entry.name}"
        if entry.folder and not below:
            yield from _in_folder(files, path, entry.name)
        elif not entry.folder and entry.size > 0 and _is_log(entry.name) and len(path.encode()) < 200:
            name = f"{below}_{entry.name}" if below else entry.name
            yield RemoteLog(path=path, name=name, size=entry.size, time=_day(below))


def _on_card(folder: Path) -> Iterator[RemoteLog]:
    """Yield the logs in a folder; links are not followed: a card may hold any."""
    count = 0
    for here, folders, names in os.walk(folder):
        if len(Path(here).relative_to(folder).parts) >= _DEEPEST:
            folders.clear()
        for name in names:
            path = Path(here, name)
            count += 1
            if count > _MOST_FILES:
                return
            if not _is_log(name):
                continue
            with contextlib.suppress(OSError, ValueError, OverflowError):
                about = path.lstat()
                if stat.S_ISREG(about.st_mode) and about.st_size > 0:
                    below = "_".join(path.relative_to(folder).parts)
                    time = datetime.fromtimestamp(about.st_mtime, UTC)
                    yield RemoteLog(path=str(path), name=below, size=about.st_size, time=time)


def _is_log(name: str) -> bool:
    return _LOG.fullmatch(name) is not None and _NO_LOG.fullmatch(name) is None


def _by_number(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts 2.BIN before 10.BIN."""
    return [
        (int(text) if text.isdecimal() else -1, text) for text in re.findall(r"[0-9]{1,18}|[^0-9]+", name)
    ]


def _day(name: str) -> datetime | None:
    """Return the day that a folder is named by."""
    found = _DATE.fullmatch(name)
    with contextlib.suppress(ValueError):
        return None if found is None else datetime(*map(int, found.groups()), tzinfo=UTC)  # type: ignore[misc,arg-type]
    return None


@contextlib.contextmanager
def _opened(part: Path) -> Iterator[BinaryIO]:
    """Open a part at its end; never through a link, and nothing but a file."""
    try:
        number = os.open(
            part, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o644
        )
    except OSError as error:
        raise OutputError(
            f"{printable(part)} cannot be written: {error.strerror or error}.",
            hint="Remove it, or choose another -o.",
        ) from error
    with os.fdopen(number, "r+b") as file:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise OutputError(f"{printable(part)} is not a file.", hint="Remove it, or choose another -o.")
        file.seek(0, os.SEEK_END)
        yield file
        file.flush()
        os.fsync(number)


def _with_ending(name: str, part: Path) -> str:
    """Return a name with the ending that its content asks for, where the vehicle gave none."""
    if PurePosixPath(name).suffix:
        return name
    with part.open("rb") as file:
        head = file.read(4)
    return name + next((ending for begin, ending in _ENDINGS if head.startswith(begin)), "")
