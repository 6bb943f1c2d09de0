"""Take a log from a browser: block by block onto the disk, counted and hashed on the way."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from starlette.requests import ClientDisconnect

from quadid_logs.serve.store import ServeStore

#: What stays free on the disk, for results and for everybody else [bytes].
RESERVE_BYTES: Final = 500_000_000
#: How often the disk is asked how much is left [bytes].
_CHECK_BYTES: Final = 16 << 20
#: A browser that sends nothing for so long has gone away [s].
_SILENCE_S: Final = 60.0
#: Uploads at a time; a page sends two.
_MOST_AT_ONCE: Final = 16
#: Of Windows: no line end is changed.
_BINARY: Final = getattr(os, "O_BINARY", 0)


class UploadError(Exception):
    """The log is not taken: the HTTP status, and for people why."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """A log that is on the disk as a whole."""

    sha256: str
    n_bytes: int


class Uploads:
    """All uploads into one store: together they leave room on the disk."""

    def __init__(self, store: ServeStore, max_bytes: int) -> None:
        """Take logs up to a size.

        Parameters
        ----------
        max_bytes : int
            Of one log.
        """
        self._store = store
        self._max_bytes = max_bytes
        self._announced = 0
        self._n_open = 0

    async def take(self, blocks: AsyncIterator[bytes], declared: int | None) -> Upload:
        """Write a request's body into the store.

        Parameters
        ----------
        declared : int or None
            What the request says about its size; it is counted all the same.

        Raises
        ------
        UploadError
            If it is too large, the disk too full, or the browser went away.
        """
        if self._n_open >= _MOST_AT_ONCE:
            raise UploadError(503, "Too many uploads at once. Try again.")
        self._check(declared or 0, 0)
        self._n_open += 1
        self._announced += declared or 0
        path = self._store.new_upload()
        try:
            upload = await self._write(path, blocks)
            await asyncio.to_thread(self._move, path, upload)
            return upload
        except OSError as error:
            raise UploadError(507, f"The log cannot be written: {error.strerror or error}.") from error
        except (ClientDisconnect, TimeoutError) as error:
            raise UploadError(408, "The upload was cut off.") from error
        finally:
            self._n_open -= 1
            self._announced -= declared or 0
            path.unlink(missing_ok=True)

    async def _write(self, path: Path, blocks: AsyncIterator[bytes]) -> Upload:
        """Write blocks as they come, and stop at the first that is too much."""
        digest, n_bytes, checked = hashlib.sha256(), 0, 0
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, 0o600), "wb") as file:
            while (block := await _next(blocks)) is not None:
                n_bytes += len(block)
                if n_bytes > self._max_bytes or n_bytes - checked >= _CHECK_BYTES:
                    self._check(n_bytes, n_bytes)
                    checked = n_bytes
                digest.update(block)
                file.write(block)
        if not n_bytes:
            raise UploadError(400, "The file is empty (0 bytes).")
        return Upload(sha256=digest.hexdigest(), n_bytes=n_bytes)

    def _check(self, n_bytes: int, n_written: int) -> None:
        """Refuse what is too large, or would fill the disk."""
        if n_bytes > self._max_bytes:
            raise UploadError(413, f"The log is larger than {self._max_bytes / 1e6:.0f} MB (--max-mb).")
        others = 0 if n_written else self._announced
        if self._store.free_bytes() - others - (n_bytes - n_written) < RESERVE_BYTES:
            raise UploadError(507, "The disk of this server is nearly full.")

    def _move(self, path: Path, upload: Upload) -> None:
        """Put a complete log into its place: on the disk first, so that not even a power cut leaves half."""
        file = os.open(path, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)
        path.replace(self._store.log(upload.sha256))


async def _next(blocks: AsyncIterator[bytes]) -> bytes | None:
    """Return the next block, None at the end."""
    async with asyncio.timeout(_SILENCE_S):
        return await anext(blocks, None)
