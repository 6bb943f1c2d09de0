"""On-axis control effectiveness by several methods from the same aligned data, in per cent of the truth.

A second table holds our effectiveness and damping against the truth with their intervals,
hits and misses counted.

The logs are those of QUADID_LOG_CORPUS that firmware flew in simulators whose
truth is known, and flights of our own simulator. Run
``python benchmarks/accuracy.py --output benchmarks/accuracy.md``.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import math
import os
import platform
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

from benchmarks.estimators import ESTIMATORS  # noqa: E402
from benchmarks.logs import corpus_folder  # noqa: E402
from benchmarks.methods import data_sets  # noqa: E402
from quadid_logs.arrays import FloatArray  # noqa: E402
from quadid_logs.data.flight import FlightData  # noqa: E402
from quadid_logs.data.model import Model  # noqa: E402
from quadid_logs.data.settings import Settings  # noqa: E402
from quadid_logs.diagnose import diagnose  # noqa: E402
from quadid_logs.identify import identify  # noqa: E402
from quadid_logs.vocabulary import (  # noqa: E402
    ACCELERATION_SYMBOLS,
    AXES,
    RATE_SYMBOLS,
    TORQUE_SYMBOLS,
)

PACKAGES: Final = ("pysindy", "nfoursid", "sysidentpy")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """An aligned flight with its true B11, B22, B33, shape (3,), and our verdict on each axis.

    ``damping`` (3,) is the truth of the damping about each axis, ``found`` what we identified.
    """

    name: str
    data: FlightData
    truth: FloatArray
    damping: FloatArray
    verdicts: tuple[str, ...]
    found: Model | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """Errors of every method on one flight [%], each of shape (3,), and seconds taken."""

    case: Case
    errors: dict[str, FloatArray]
    seconds: dict[str, float]


def main() -> int:
    """Print the table; with --output write it to a file too."""
    parser = argparse.ArgumentParser(description="B11, B22, B33 by several methods against the truth.")
    parser.add_argument("--output", type=Path, help="file to write the table to")
    parser.add_argument("--short", action="store_true", help="two simulated flights only")
    options = parser.parse_args()
    methods = [name for name in ESTIMATORS if name not in PACKAGES or importlib.util.find_spec(name)]
    rows = []
    for case in _cases(short=options.short):
        rows.append(_measure(case, methods))
        print(f"{case.name} done", file=sys.stderr, flush=True)
    text = "\n".join(_report(rows, methods)) + "\n"
    print(text)
    if options.output:
        options.output.write_text(text, encoding="utf-8")
    return 0


def _cases(*, short: bool) -> Iterator[Case]:
    """Yield the flights whose effectiveness and damping are known, with our verdicts."""
    for source in data_sets.sources(corpus_folder(), short=short):
        flight = data_sets.load(source) if source.kind != "flown" else None
        if flight is None or flight.truth is None or np.isnan(flight.truth.damping).any():
            continue
        identification = identify(flight.data, Settings().identify)
        diagnosis = diagnose(flight.log, flight.data, identification)
        yield Case(
            name=source.name,
            data=flight.data,
            truth=flight.truth.effectiveness,
            damping=flight.truth.damping,
            verdicts=tuple(diagnosis.axes[axis].verdict for axis in AXES),
            found=identification.recommended,
        )


def _measure(case: Case, methods: list[str]) -> Row:
    """Let every method estimate; one that breaks down gives no number."""
    errors, seconds = {}, {}
    for name in methods:
        began = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # theirs: collinear columns, deprecations
            try:
                gain = ESTIMATORS[name](case.data)
            except Exception as error:  # noqa: BLE001 - whatever a package raises, the others go on
                print(f"{case.name}, {name}: {type(error).__name__}: {error}", file=sys.stderr)
                gain = np.full(3, np.nan)
        seconds[name] = time.process_time() - began
        errors[name] = 100.0 * (gain / case.truth - 1.0)
    return Row(case=case, errors=errors, seconds=seconds)


def _report(rows: list[Row], methods: list[str]) -> Iterator[str]:
    """Yield the lines of the tables."""
    versions = [
        f"{name} {importlib.metadata.version(name)}" if name in methods else f"{name} not installed"
        for name in PACKAGES
    ]
    yield f"Python {platform.python_version()}, {', '.join(versions)}."
    yield ""
    yield "| flight | " + " | ".join(methods) + " |"
    yield "|---" * (len(methods) + 1) + "|"
    for row in rows:
        yield f"| {row.case.name} | " + " | ".join(_cell(row, method) for method in methods) + " |"
    yield ""
    yield "| | " + " | ".join(methods) + " |"
    yield "|---" * (len(methods) + 1) + "|"
    for label, text in _totals(rows, methods):
        yield f"| {label} | " + " | ".join(text) + " |"
    yield ""
    yield "Error and half width of our 95 % intervals, in per cent of the truth; empty without a claim."
    yield ""
    yield from _intervals([row.case for row in rows])


def _intervals(cases: list[Case]) -> Iterator[str]:
    """Yield the table of our intervals against the truth, then how many hold it."""
    columns = [f"{symbol} {axis}" for symbol in ("B", "damping") for axis in AXES]
    yield "| flight | " + " | ".join(columns) + " |"
    yield "|---" * (len(columns) + 1) + "|"
    hits = {column: [0, 0] for column in columns}
    for case in cases:
        cells = [_against_truth(case, symbol, axis) for symbol in ("B", "damping") for axis in range(3)]
        for column, (_, hit) in zip(columns, cells, strict=True):
            if hit is not None:
                hits[column][0] += hit
                hits[column][1] += 1
        yield f"| {case.name} | " + " | ".join(text for text, _ in cells) + " |"
    yield "| **hits** | " + " | ".join(f"**{n} of {of}**" for n, of in hits.values()) + " |"


def _against_truth(case: Case, symbol: str, axis: int) -> tuple[str, bool | None]:
    """Return error and half width [%] of a coefficient, and whether its interval holds the truth.

    None where no claim is made: the axis is refused, or the coefficient is not identifiable.
    """
    truth = float((case.truth if symbol == "B" else case.damping)[axis])
    regressor = (TORQUE_SYMBOLS if symbol == "B" else RATE_SYMBOLS)[axis]
    entry = None if case.found is None else case.found.entries.get((ACCELERATION_SYMBOLS[axis], regressor))
    if entry is None or case.verdicts[axis] == "refused" or not entry.identifiable:
        return "", None
    low, high = entry.ci95
    text = f"{100.0 * (entry.value / truth - 1.0):+.1f} ± {50.0 * (high - low) / abs(truth):.1f}"
    return (text, True) if low <= truth <= high else (f"{text} **missed**", False)


def _cell(row: Row, method: str) -> str:
    """Roll, pitch, yaw error; the smallest in bold, those of axes that we refuse in brackets."""
    parts = []
    for axis, verdict in enumerate(row.case.verdicts):
        value = row.errors[method][axis]
        text = "none" if math.isnan(value) else f"{value:+.1f}" if abs(value) < 100.0 else f"{value:+.0f}"
        if verdict == "refused":
            text = f"({text})"
        elif method == _best(row, axis):
            text = f"**{text}**"
        parts.append(text)
    return ", ".join(parts)


def _best(row: Row, axis: int) -> str:
    """Return the method with the smallest error."""
    return min(row.errors, key=lambda method: np.nan_to_num(abs(row.errors[method][axis]), nan=np.inf))


def _totals(rows: list[Row], methods: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield what the table says in sum, over the axes that we do not refuse."""
    kept = [(row, axis) for row in rows for axis in range(3) if row.case.verdicts[axis] != "refused"]
    size = {
        method: np.array([np.nan_to_num(abs(row.errors[method][axis]), nan=np.inf) for row, axis in kept])
        for method in methods
    }
    yield f"median error [%] of {len(kept)} axes", [f"{np.median(size[m]):.1f}" for m in methods]
    yield (
        "90 % of the errors are below [%]",
        [f"{np.quantile(size[m], 0.9, method='higher'):.1f}" for m in methods],
    )
    yield "smallest error", [str(sum(_best(row, axis) == m for row, axis in kept)) for m in methods]
    yield "median processor time [s]", [f"{np.median([row.seconds[m] for row in rows]):.2f}" for m in methods]


if __name__ == "__main__":
    sys.exit(main())
