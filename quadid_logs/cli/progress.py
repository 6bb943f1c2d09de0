"""Say on stderr what takes long, and stay silent where nothing does."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType

from quadid_logs.untrusted import printable

_PATIENCE_S = 1.0


class Progress:
    """Tell the present stage once a second has passed; a context manager, called with a stage's name.

    On a terminal one line is written again and again and wiped in the end; in
    a pipe every stage is a line of its own.
    """

    def __init__(self, label: str, *, quiet: bool = False) -> None:
        self._label = printable(label, 60)
        self._started = time.monotonic()
        self._stage = ""
        self._shown = False
        self._quiet = quiet
        self._lock = threading.Lock()
        self._timer = threading.Timer(_PATIENCE_S, self._show)
        self._timer.daemon = True

    def __enter__(self) -> Progress:
        if not self._quiet:
            self._timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._timer.cancel()
        with self._lock:
            if self._shown and sys.stderr.isatty():
                sys.stderr.write("\r\x1b[2K")
            self._quiet = True

    def __call__(self, stage: str) -> None:
        """Note that a stage begins."""
        self._stage = printable(stage, 60)
        if time.monotonic() - self._started > _PATIENCE_S:
            self._show()

    def _show(self) -> None:
        """Write the present stage."""
        with self._lock:
            if self._quiet or not self._stage:
                return
            text = f"{self._label}: {self._stage} ({time.monotonic() - self._started:.0f} s)"
            sys.stderr.write(f"\r\x1b[2K{text}" if sys.stderr.isatty() else f"{text}\n")
            sys.stderr.flush()
            self._shown = True
