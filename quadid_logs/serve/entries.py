"""What the page lists: a log or a question about logs, and what became of it."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import Any, Final

from quadid_logs.fleets.naming import MODIFICATION
from quadid_logs.untrusted import printable

#: So many earlier flights of a vehicle are asked as well, the last ones: with four more, what gusts leave of
#: an interval is less than half, and the job takes five times as long.
MOST_EARLIER: Final = 4
#: An id is the SHA-256 of a log's content, or of a question about logs.
_ID: Final = re.compile(r"[0-9a-f]{64}")


class Kind(StrEnum):
    """What is to be done."""

    ANALYZE = "analyze"
    COMPARE = "compare"
    TUNE = "tune"
    PLAN = "plan"


class State(StrEnum):
    """How far it is; the last three are final until somebody tries again."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


#: Nothing is being done, and nothing will be.
FINAL: Final = frozenset({State.DONE, State.FAILED, State.CANCELLED})


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One line of the page.

    Attributes
    ----------
    id : str
        SHA-256 in hexadecimal digits.
    kind : Kind
    name : str
        For people: of a log its file's name as the browser gave it. Untrusted.
    logs : tuple of str
        Ids of the logs that it is about: its own for an analysis.
    options : mapping of str to Any
        Of a plan, what the form held; of an analysis, when the file was modified [s UTC].
    n_bytes : int
        Of the log.
    added_s : float
        When it came [s UTC].
    state : State
    error : str
        Why it failed. Untrusted.
    summary : mapping of str to Any
        What the list shows of a result. Untrusted.
    n_begun : int
        How often it was begun and not ended by us.
    """

    id: str
    kind: Kind
    name: str
    logs: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    n_bytes: int = 0
    added_s: float = field(default_factory=time.time)
    state: State = State.QUEUED
    error: str = ""
    summary: Mapping[str, Any] = field(default_factory=dict)
    n_begun: int = 0

    @property
    def is_final(self) -> bool:
        """Whether nothing is being done, and nothing will be."""
        return self.state in FINAL

    def shown(self) -> dict[str, Any]:
        """Return what the page needs, ready for JSON."""
        return {
            "id": self.id,
            "kind": self.kind.value,
            "name": self.name,
            "logs": list(self.logs),
            "n_bytes": self.n_bytes,
            "added_s": self.added_s,
            "state": self.state.value,
            "error": self.error,
            "summary": dict(self.summary),
        }


def is_id(text: str) -> bool:
    """Return whether a text can be an id: nothing else of an address ever reaches the file system."""
    return _ID.fullmatch(text) is not None


def log_entry(sha256: str, name: str, n_bytes: int, modified_s: float) -> Entry:
    """Return the entry of a log that was just uploaded.

    Parameters
    ----------
    name : str
        As the browser gave it; of a path only the last part stays.
    modified_s : float
        When the file was modified [s UTC], -1 if unknown.
    """
    last = name.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]
    return Entry(
        id=sha256,
        kind=Kind.ANALYZE,
        name=printable(last, 160) or "log",
        logs=(sha256,),
        n_bytes=n_bytes,
        options={"modified_s": modified_s},
    )


def earlier_of(log: Entry, entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Return the earlier flights of the vehicle that flew a log.

    Parameters
    ----------
    log : Entry
        That was analyzed.

    Returns
    -------
    tuple of Entry
        That were analyzed, the last one last, at most `MOST_EARLIER`. Where nothing but a copied file's date
        says when a log flew, it flew when it came.
    """
    vehicle, flown_s = log.summary.get("vehicle"), _flown_s(log)
    earlier = [
        one
        for one in entries
        if one.kind is Kind.ANALYZE
        and one.state is State.DONE
        and one.id != log.id
        and vehicle
        and one.summary.get("vehicle") == vehicle
        and _flown_s(one) < flown_s
    ]
    return tuple(sorted(earlier, key=_flown_s)[-MOST_EARLIER:])


def _flown_s(log: Entry) -> float:
    """Return when a log flew [s UTC], or came."""
    started = log.summary.get("started")
    if not started or log.summary.get("started_from") == MODIFICATION:
        return log.added_s
    return datetime.fromisoformat(str(started)).timestamp()


def question(kind: Kind, name: str, logs: tuple[str, ...], options: Mapping[str, Any] | None = None) -> Entry:
    """Return the entry of a question about logs: asked twice it is the same.

    Parameters
    ----------
    logs : tuple of str
        Ids of the logs, in the order that matters.
    """
    told = json.dumps([kind.value, logs, dict(options or {})], sort_keys=True)
    return Entry(
        id=hashlib.sha256(told.encode()).hexdigest(),
        kind=kind,
        name=printable(name, 240),
        logs=logs,
        options=dict(options or {}),
    )
