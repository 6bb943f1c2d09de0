"""Loaded by every local worker as it starts."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


def dask_setup(_worker: object) -> None:
    """Leave Ctrl-C to the one who asked for the work, and load what every log needs."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    import quadid_logs.fleet.work  # noqa: F401 - so that the first log is as fast as the others


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Start processes in here: they ignore Ctrl-C from the first moment on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
