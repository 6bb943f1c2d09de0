"""The file in which a method's results enter the benchmark: read, checked, written.

The format is docs/benchmark-entry.schema.json. A file may come from anybody: whatever is wrong with it
raises `EntryError` with what to do.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NoReturn

from quadid_logs.errors import QuadidError
from quadid_logs.extra import load
from quadid_logs.output import write_beside
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

FORMAT: Final = "quadid-logs-benchmark-entry/1"
SCHEMA: Final = Path(__file__).resolve().parents[2] / "docs" / "benchmark-entry.schema.json"
#: 2000 results, the most that the schema allows, take 0.8 MB.
_LARGEST_BYTES: Final = 4_000_000


class EntryError(QuadidError):
    """The file is no entry."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """An on-axis control effectiveness [rad/s^2 per unit of torque], and its 95 % interval or None."""

    value: float
    ci95: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a method gave on one data set.

    Attributes
    ----------
    n_samples : int
    rms : tuple of float
        Of p, q, r, L, M, N: which data it was given.
    seconds : float or None
        Processor time.
    axes : mapping of str to Estimate or None
        By roll, pitch, yaw; None where it gave no number.
    """

    n_samples: int
    rms: tuple[float, ...]
    seconds: float | None
    axes: Mapping[str, Estimate | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A method's results by data set, with what it is and what it ran on."""

    method: str
    version: str
    description: str
    tuned_on: str
    machine: str
    results: Mapping[str, Outcome]
    url: str = ""


def read_entry(path: Path) -> Entry:
    """Read an entry.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Entry

    Raises
    ------
    EntryError
        If it cannot be read, breaks the schema, names a data set twice, or holds a number that is none.
    """
    content = _content(path)
    problem = next(iter(_validator().iter_errors(content)), None)
    if problem is not None:
        _refuse(path, f"{problem.json_path}: {problem.message}")
    results: dict[str, Outcome] = {}
    for each in content["results"]:
        name = each["data_set"]
        if name in results:
            _refuse(path, f"{name} is there twice")
        results[name] = Outcome(
            n_samples=each["n_samples"],
            rms=tuple(_finite(path, name, value) for value in each["rms"]),
            seconds=None if each["seconds"] is None else _finite(path, name, each["seconds"]),
            axes={axis: _estimate(path, f"{name}, {axis}", each["axes"][axis]) for axis in AXES},
        )
    words = {
        name: printable(content[name], 1000)
        for name in ("method", "version", "description", "tuned_on", "machine")
    }
    return Entry(**words, results=results, url=content.get("url", ""))


def write_entry(entry: Entry, path: Path) -> None:
    """Write an entry, whole or not at all.

    Parameters
    ----------
    entry : Entry
    path : Path

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    content: dict[str, Any] = {"format": FORMAT}
    for name in ("method", "version", "description", "tuned_on", "machine"):
        content[name] = getattr(entry, name)
    if entry.url:
        content["url"] = entry.url
    content["results"] = [_result(name, entry.results[name]) for name in sorted(entry.results)]
    write_beside(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


def _result(name: str, outcome: Outcome) -> dict[str, Any]:
    """Return an outcome as it stands in the file."""
    return {
        "data_set": name,
        "n_samples": outcome.n_samples,
        "rms": list(outcome.rms),
        "seconds": outcome.seconds,
        "axes": {
            axis: each and {"value": each.value, "ci95": each.ci95 and list(each.ci95)}
            for axis, each in outcome.axes.items()
        },
    }


def _content(path: Path) -> Any:
    """Return what a file holds, of a size that cannot hurt."""
    try:
        with path.open("rb") as file:
            raw = file.read(_LARGEST_BYTES + 1)
        if len(raw) > _LARGEST_BYTES:
            _refuse(path, f"it is larger than {_LARGEST_BYTES} bytes")
        return json.loads(raw, parse_constant=lambda word: _refuse(path, f"{word} is no number in JSON"))
    except OSError as error:
        _refuse(path, error.strerror or str(error))
    except (ValueError, RecursionError) as error:
        _refuse(path, str(error))


@cache
def _validator() -> Any:
    """Return what holds a file against the schema."""
    jsonschema = load("jsonschema", "bench")
    return jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))


def _estimate(path: Path, where: str, given: Any) -> Estimate | None:
    """Return the estimate of an axis; its interval must hold its value."""
    if given is None:
        return None
    value = _finite(path, where, given["value"])
    if given["ci95"] is None:
        return Estimate(value)
    low, high = (_finite(path, where, each) for each in given["ci95"])
    if not low <= value <= high:
        _refuse(path, f"{where}: the interval does not hold the value")
    return Estimate(value, (low, high))


def _finite(path: Path, where: str, value: float) -> float:
    """Return a number that can be counted with: JSON's may be too large for one."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        _refuse(path, f"{where}: a number is too large")
    return number


def _refuse(path: Path, why: str) -> NoReturn:
    raise EntryError(
        f"{printable(path.name)} is no entry of the benchmark: {printable(why)}.",
        hint="docs/benchmark.md describes the format.",
    )
