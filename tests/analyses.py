"""Analyses of corpus logs with default settings, made once for all test processes."""

from __future__ import annotations

import hashlib
import os
import pickle
import time
from collections.abc import Callable
from pathlib import Path

from quadid_logs import pipeline
from quadid_logs.data.result import Result

Analyzed = Callable[[Path], Result]
#: After this the other process is taken for dead, and the analysis is made again [s].
_PATIENCE_S = 120.0


def shared_analyses(folder: Path) -> Analyzed:
    """Return `analyze` by default settings, remembering its results in a folder that processes share."""
    folder.mkdir(exist_ok=True)

    def analyzed(path: Path) -> Result:
        kept = folder / hashlib.sha256(os.fsencode(path)).hexdigest()
        claim = kept.with_suffix(".claim")
        if not _made(claim):
            _wait(kept, claim)
        if kept.exists():
            return _read(kept)
        try:
            result = pipeline.analyze(path)
            unfinished = kept.with_suffix(f".{os.getpid()}")
            unfinished.write_bytes(pickle.dumps(result, pickle.HIGHEST_PROTOCOL))
            unfinished.replace(kept)
        finally:
            claim.unlink(missing_ok=True)
        return result

    return analyzed


def _made(claim: Path) -> bool:
    """Say whether this process is the one to make the analysis."""
    try:
        claim.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _wait(kept: Path, claim: Path) -> None:
    """Wait until the process with the claim has written its result or failed."""
    until = time.monotonic() + _PATIENCE_S
    while claim.exists() and not kept.exists() and time.monotonic() < until:
        time.sleep(0.1)


def _read(kept: Path) -> Result:
    result = pickle.loads(kept.read_bytes())
    assert isinstance(result, Result)
    return result
