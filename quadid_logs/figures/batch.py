"""Draw many figures on two processors, because drawing is most of what a report takes.

matplotlib holds the interpreter's lock, so the second processor needs a
process of its own. It is a fresh interpreter: a fork would copy locks that the
threads of the linear algebra hold, and `multiprocessing` would run the
caller's script again.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import BinaryIO

from quadid_logs.figures import png
from quadid_logs.figures.spec import Figure

_DRAWN = b"+"


class PngBatch:
    """Writes figures as PNG files with the help of a second process, which starts at once.

    The helper draws what it is sent and says so; what it does not confirm,
    for whatever reason, is drawn here, where an error is raised as usual. It
    ends when its input does, so that it never outlives this process. Where it
    cannot be started, or there is one processor only, all is drawn here.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, PngBatch() as batch:
    ...     batch.write([], Path(folder))
    """

    def __init__(self) -> None:
        self._helper = _start_helper() if _processors() > 1 else None

    def __enter__(self) -> PngBatch:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """End the helper, also in the middle of a figure after Ctrl-C."""
        if self._helper is not None:
            self._helper.kill()
            self._helper.communicate()

    def write(self, figures: Sequence[Figure], folder: Path) -> None:
        """Write each figure into the folder, named after its key.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        # The longest first, so that neither process waits long for the other in the end.
        waiting = deque(sorted(figures, key=lambda figure: -len(figure.panels)))
        unconfirmed: list[Figure] = []
        feeder = Thread(target=self._feed, args=(waiting, unconfirmed, folder), daemon=True)
        feeder.start()
        try:
            while (figure := _next(waiting)) is not None:
                png.write_png(figure, _path(folder, figure))
        finally:
            waiting.clear()
            feeder.join()
        for figure in unconfirmed:
            png.write_png(figure, _path(folder, figure))

    def _feed(self, waiting: deque[Figure], unconfirmed: list[Figure], folder: Path) -> None:
        """Give the helper one figure after the other, until there is none left or it fails."""
        helper = self._helper
        if helper is None or helper.stdin is None or helper.stdout is None:
            return
        while (figure := _next(waiting)) is not None:
            unconfirmed.append(figure)
            with suppress(OSError, ValueError):  # it died, or was ended meanwhile
                pickle.dump((figure, _path(folder, figure)), helper.stdin)
                helper.stdin.flush()
                if helper.stdout.read(1) == _DRAWN:
                    unconfirmed.pop()
                    continue
            return


def draw_for(stream: BinaryIO, answer: BinaryIO) -> None:
    """Draw what comes from the process that started this one, until it has no more or is gone."""
    # While the other process still prepares the figures.
    import matplotlib.backends.backend_agg
    import matplotlib.figure  # noqa: F401

    while True:
        try:
            figure, path = pickle.load(stream)  # noqa: S301  (from our own process)
        except EOFError:
            return
        png.write_png(figure, path)
        answer.write(_DRAWN)
        answer.flush()


def _start_helper() -> subprocess.Popen[bytes] | None:
    """Start the second process with the same import path; None where that is not possible."""
    path = [entry or str(Path.cwd()) for entry in sys.path]
    command = (
        f"import sys; sys.path[:] = {path!r}; from quadid_logs.figures.batch import draw_for; "
        "draw_for(sys.stdin.buffer, sys.stdout.buffer)"
    )
    if not sys.executable:
        return None
    try:
        return subprocess.Popen(  # noqa: S603  (no shell, and nothing of it comes from a log)
            [sys.executable, "-c", command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            # Ctrl-C at the terminal is for the process that ends this one.
            start_new_session=True,
        )
    except OSError:
        return None


def _processors() -> int:
    """Return on how many processors this process may run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _next(waiting: deque[Figure]) -> Figure | None:
    """Take the next figure; both threads do, so that asking first would not help."""
    try:
        return waiting.popleft()
    except IndexError:
        return None


def _path(folder: Path, figure: Figure) -> Path:
    """Return where a figure is written."""
    return folder / f"{figure.key}.png"
