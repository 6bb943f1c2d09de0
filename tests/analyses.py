"""Analyses of corpus logs with default settings, made once for all test processes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from quadid_logs import pipeline
from quadid_logs.data.result import Result
from tests.kept import Shelf

Analyzed = Callable[[Path], Result]


def shared_analyses(shelf: Shelf) -> Analyzed:
    """Return `analyze` by default settings, which keeps its results by the log's content and place."""

    def analyzed(path: Path) -> Result:
        with path.open("rb") as file:
            content = hashlib.file_digest(file, "sha256").digest()
        return shelf.get(os.fsencode(path) + content, lambda: pipeline.analyze(path))

    return analyzed
