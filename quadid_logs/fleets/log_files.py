"""Where the logs are: local files and folders, patterns, and everything that fsspec reaches."""

from __future__ import annotations

import datetime
import glob
import hashlib
import os
import re
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from quadid_logs.autopilots import formats
from quadid_logs.errors import LogError, LogNotFoundError
from quadid_logs.extra import load
from quadid_logs.output import DOWNLOADS, beside_prefix
from quadid_logs.untrusted import printable

_BLOCK_BYTES = 1 << 20
#: By its beginning a format knows its files.
_HEAD_BYTES = 1 << 16
#: A network that fails thrice within these pauses [s] is down, not busy.
_PAUSES_S = (0.5, 3.0, 0.0)
#: Protocol, and what stands before the host or inside the query that nobody else may see.
_AUTHORITY = re.compile(r"([a-z][a-z0-9+.-]*://)([^/?#]*)", re.IGNORECASE)
_USER = re.compile(r"(\b[a-z][a-z0-9+.-]*://)[^/?#\s]*@", re.IGNORECASE)
_TOKEN = re.compile(
    r"([?&;][^=&;\s]*(?:token|key|secret|signature|sig|password|passwd|pwd|credential|auth)[^=&;\s]*=)([^&;#\s]+)",
    re.IGNORECASE,
)


def log_suffixes() -> tuple[str, ...]:
    """Return the endings of files that are taken of a folder: beside the logs lie parameters and videos.

    A file that is named, or matches a pattern, is taken whatever its ending. Tables would be too many. A
    local file that ends as many others do is taken, too, if it begins like a log: cards hold LOG00001.TXT.
    """
    every = (suffix for one in formats() if one.name != "table" for suffix in one.suffixes)
    return tuple(dict.fromkeys(every))


def _is_log_by_content(path: str) -> bool:
    """Say whether a file whose ending many others have begins like a log with that ending."""
    kinds = [one for one in formats() if path.lower().endswith(one.shared_suffixes)]
    if not kinds:
        return False
    try:
        with Path(path).open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    return any(one.is_mine(head) for one in kinds)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFile:
    """A file that may be a log: path or URL, size [bytes] and time of modification [s UTC], -1 if unknown.

    ``url`` holds no user, password or token: stores, pages and errors show it.
    ``secret`` is the address with them where there are any, only to fetch by.
    """

    url: str
    n_bytes: int = -1
    modified_s: float = -1.0
    secret: str = field(default="", repr=False)

    @property
    def name(self) -> str:
        """The path or URL as UTF-8 can hold it, as the store does."""
        return self.url.encode("utf-8", "replace").decode()


class FetchError(LogError):
    """The file could not be fetched; another time it may."""


def find_logs(places: Iterable[str]) -> tuple[LogFile, ...]:
    """Return every file that the places name, each once, in the order of their names.

    Parameters
    ----------
    places : iterable of str
        Files, folders (searched to the bottom for the endings of logs) and
        patterns; with ``://`` a URL of any file system that fsspec knows.

    Raises
    ------
    LogNotFoundError
        If a place does not exist, or a pattern or folder holds no log.
    FetchError
        If a remote place cannot be listed.
    """
    found: dict[str, LogFile] = {}
    for place in places:
        here = list(_remote(place) if is_url(place) else _local(place))
        if not here:
            raise LogNotFoundError(
                f"There is no log at {printable(without_secrets(place))}.",
                hint=f"In a folder, files that end in {', '.join(log_suffixes())} are used.",
            )
        found |= {file.url: file for file in here}
    return tuple(found[url] for url in sorted(found))


def is_url(place: str) -> bool:
    """Return whether fsspec is to find it."""
    return "://" in place


def _local(place: str) -> Iterator[LogFile]:
    """Find local files; a name that only looks like a pattern is taken as it is."""
    path, suffixes = Path(place), log_suffixes()
    if path.is_dir():
        for folder, folders, names in os.walk(path):
            folders.sort()
            for name in names:
                full = os.path.join(folder, name)  # noqa: PTH118 - a million of them
                if not name.startswith(".") and (name.lower().endswith(suffixes) or _is_log_by_content(full)):
                    yield _local_file(full)
    elif path.exists():
        yield _local_file(place)
    else:
        found = glob.iglob(place, recursive=True)  # noqa: PTH207 - a Path has no absolute patterns
        yield from (_local_file(name) for name in found if Path(name).is_file())


def _local_file(path: str) -> LogFile:
    """Describe a local file; its name is absolute, so that a store means the same everywhere."""
    full = os.path.abspath(path)  # noqa: PTH100 - links stay: the name is what the user chose
    try:
        status = Path(full).stat()
    except OSError:
        return LogFile(url=full)
    return LogFile(url=full, n_bytes=status.st_size, modified_s=status.st_mtime)


def without_secrets(address: str) -> str:
    """Return an address as it may be shown and stored: without user and password, with tokens blotted out.

    Parameters
    ----------
    address : str
        A path, or a URL.

    Examples
    --------
    >>> without_secrets("sftp://me:pass@host/logs/*.bin")
    'sftp://host/logs/*.bin'
    >>> without_secrets("https://host/a.bin?log=7&token=abc")
    'https://host/a.bin?log=7&token=...'
    >>> without_secrets("s3://bucket/me@home/a.bin")
    's3://bucket/me@home/a.bin'
    """
    if not is_url(address):
        return address
    return _TOKEN.sub(r"\1...", _USER.sub(r"\1", address))


def _redacted(text: object, address: str) -> str:
    """Return what a library says about an address, without the secrets in that."""
    shown = without_secrets(str(text)).replace(address, without_secrets(address))
    found = [match[0].removeprefix(match[1]).rstrip("@") for match in _USER.finditer(address)]
    secrets = [part for user in found for part in (user, *user.split(":", 1)[1:])]
    secrets += [match[2] for match in _TOKEN.finditer(address)]
    for secret in sorted({*secrets, *map(unquote, secrets)}, key=len, reverse=True):
        shown = shown.replace(secret, "...") if secret else shown
    return printable(shown)


def _remote(place: str) -> Iterator[LogFile]:
    """Find what a URL names: a file, a pattern, or everything below a folder."""
    files, path = _file_system(place)
    shown = without_secrets(place)
    try:
        if any(letter in path for letter in ("*[" if place.lower().startswith("http") else "*?[")):
            listing = files.glob(path, detail=True)
        elif files.isfile(path):
            listing = {path: files.info(path)}
        else:
            below, suffixes = files.find(path, detail=True), log_suffixes()
            listing = {name: info for name, info in below.items() if name.lower().endswith(suffixes)}
    except Exception as error:  # noqa: BLE001 - every file system has exceptions of its own
        raise FetchError(
            f"{printable(shown)} cannot be listed: {type(error).__name__}: {_redacted(error, place)}.",
            hint="Check the address and the credentials.",
        ) from (error if shown == place else None)
    for name, info in listing.items():
        if info.get("type", "file") == "file":
            address = _full_address(str(files.unstrip_protocol(name)), place)
            url = without_secrets(address)
            yield LogFile(
                url=url,
                n_bytes=int(-1 if info.get("size") is None else info["size"]),
                modified_s=_modified_s(info),
                secret="" if url == address else address,
            )


def _full_address(address: str, place: str) -> str:
    """Return the address of a listed file with host and credentials of the place that was listed.

    Several of fsspec's file systems leave out where they are connected to.
    """
    authority = _AUTHORITY.match(place)
    if authority is None or "@" not in authority[2] or "@" in (_AUTHORITY.match(address) or ["", "", ""])[2]:
        return address
    host = authority[2].rpartition("@")[2]
    path = address.split("://", 1)[1].lstrip("/").removeprefix(f"{host}/")
    return f"{authority[1]}{authority[2]}/{path}"


def _file_system(url: str) -> tuple[Any, str]:
    """Return fsspec's file system and the path in it."""
    core = load("fsspec.core", "fleet")
    try:
        files, path = core.url_to_fs(url)
    except Exception as error:  # noqa: BLE001 - what an address that makes no sense raises is up to each file system
        shown = without_secrets(url)
        raise FetchError(
            f"{printable(shown)}: {_redacted(error, url) or type(error).__name__}.",
            hint="Check the address, and that the fsspec library of its protocol is installed.",
        ) from (error if shown == url else None)
    return files, str(path)


def _modified_s(info: dict[str, Any]) -> float:
    """Find the time of modification under the names that file systems give it."""
    for key in ("LastModified", "mtime", "updated", "last_modified", "created"):
        value = info.get(key)
        if isinstance(value, datetime.datetime):
            return value.timestamp()
        if isinstance(value, (int, float)):
            return float(value)
    return -1.0


@contextmanager
def fetched(file: LogFile, max_bytes: int) -> Iterator[tuple[Path, str]]:
    """Give a local path to the content, and its SHA-256; a download is deleted at the end.

    Parameters
    ----------
    max_bytes : int
        Largest download.

    Yields
    ------
    path : Path
    sha256 : str

    Raises
    ------
    FetchError
        If it cannot be fetched, or not now.
    """
    if is_url(file.url):
        with tempfile.TemporaryDirectory(
            prefix=beside_prefix(DOWNLOADS), ignore_cleanup_errors=True
        ) as folder:
            path = Path(folder) / "log"
            yield path, _download(file.secret or file.url, path, max_bytes)
    else:
        yield Path(file.url), _local_hash(file.url)


def _local_hash(path: str) -> str:
    """Hash a file; an own error for what is not there, or is no file (a pipe would never end)."""
    try:
        if not Path(path).is_file():
            raise FetchError("The file is gone, or it is not a regular file.")
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FetchError(f"The file cannot be read: {error.strerror or error}.") from error


def _download(url: str, path: Path, max_bytes: int) -> str:
    """Copy a URL's content to a file and return its SHA-256; try again where the network fails."""
    for pause_s in _PAUSES_S:
        try:
            return _download_once(url, path, max_bytes)
        except FetchError:
            raise
        except Exception as error:  # noqa: BLE001 - every file system has exceptions of its own
            failure = f"{type(error).__name__}: {_redacted(error, url)}"
        time.sleep(pause_s)
    raise FetchError(f"The file cannot be fetched: {failure}.")


def _download_once(url: str, path: Path, max_bytes: int) -> str:
    """Copy block by block, so that neither memory nor disk is filled by a huge or endless file."""
    files, name = _file_system(url)
    digest, n_bytes = hashlib.sha256(), 0
    with files.open(name, "rb") as remote, path.open("wb") as local:
        while block := remote.read(_BLOCK_BYTES):
            n_bytes += len(block)
            if n_bytes > max_bytes:
                raise FetchError(f"The file is larger than {max_bytes / 1e6:.0f} MB (--max-mb).")
            digest.update(block)
            local.write(block)
    return digest.hexdigest()
