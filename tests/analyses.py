"""Analyses with default settings, made once for all test processes."""

from __future__ import annotations

import hashlib
import os
import pickle
from pathlib import Path
from typing import Protocol

from quadid_logs import pipeline
from quadid_logs.data.result import Result
from quadid_logs.data.vehicle import Vehicle
from tests.kept import Shelf


class Analyzed(Protocol):
    """`analyze` by default settings."""

    def __call__(self, path: Path, vehicle: Vehicle | None = None) -> Result:
        """Analyze a log of this vehicle."""


def shared_analyses(shelf: Shelf) -> Analyzed:
    """Return `analyze` by default settings, which keeps its results by the log's content and place.

    A log in the working folder, named without it, is the same wherever that lies.
    """

    def analyzed(path: Path, vehicle: Vehicle | None = None) -> Result:
        with path.open("rb") as file:
            content = hashlib.file_digest(file, "sha256").digest()
        given = b"" if vehicle is None else pickle.dumps(vehicle)
        return shelf.get(os.fsencode(path) + content + given, lambda: pipeline.analyze(path, vehicle=vehicle))

    return analyzed
