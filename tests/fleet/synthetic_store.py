"""A store with made-up numbers: no flight is simulated for it."""

from __future__ import annotations

import datetime
import hashlib

import numpy as np

from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import ANALYZED, UNREADABLE
from quadid_logs.fleets.store import Store
from quadid_logs.fleets.tasks import Outcome, Task, failure
from quadid_logs.vocabulary import AXES

FIRST = datetime.datetime(2026, 3, 1, 12, tzinfo=datetime.UTC)
GAIN = {"roll": 200.0, "pitch": 180.0, "yaw": 11.0}


def make_store(folder, names, n_flights=12, *, worn=None, reports=False, change=None):
    """Write flights of vehicles; `worn` names the one whose couplings grow from half of its history on.

    `change(row, flight)` may change every row.
    """
    rng = np.random.default_rng(11)
    with Store(folder, Options(), resume=False) as store:
        for name in names:
            for flight in range(n_flights):
                broken = name == worn and flight >= n_flights // 2
                outcome = _outcome(name, flight, rng, broken=broken, reports=reports)
                for row in outcome.rows:
                    (change or _unchanged)(row, flight)
                store.take(outcome)
        task = Task(file=LogFile(url="/logs/<script>alert(1)</script>.bin"), options=Options())
        store.take(failure(task, "f" * 64, UNREADABLE, "no <b>log</b>"))
    return folder


def _unchanged(row, flight):
    """Leave a row as it is."""


def scaled(row, quantity, factor):
    """Multiply a quantity and its interval."""
    for end in ("", "_low", "_high"):
        row[f"{quantity}{end}"] *= factor


def _outcome(name, flight, rng, *, broken, reports):
    url = f"/logs/{flight:03d}/{name}.bin"
    sha256 = hashlib.sha256(url.encode()).hexdigest()
    rows = [_row(name, url, sha256, flight, axis, rng, broken) for axis in AXES]
    return Outcome(
        file=LogFile(url=url, n_bytes=100),
        sha256=sha256,
        rows=rows,
        reports={0: b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03\x03\x00\x00\x00\x00\x00\x00\x00\x00\x00"}
        if reports
        else {},
    )


def _row(name, url, sha256, flight, axis, rng, broken):
    refused = axis == "yaw" and flight == 3
    coupling = 0.05 * GAIN["roll"] * broken
    numbers = {
        "gain": (GAIN[axis] * (0.95 if broken else 1.0), 0.01 * GAIN[axis]),
        "from_l": (coupling, 0.5), "from_m": (coupling, 0.5), "from_n": (coupling, 0.5),
        "damping": (-0.8, 0.05), "lag_s": (0.03, 0.0005),
    }  # fmt: skip
    row = {
        "vehicle": name, "vehicle_from": "path", "model": "ardupilot quad X", "status": ANALYZED,
        "url": url, "sha256": sha256, "version": "0", "autopilot": "ardupilot", "frame": "quad X",
        "firmware": "ArduCopter", "axis": axis, "flight": 0, "n_flights": 1, "structure": "damped",
        "input_unit": "1", "duration_s": 30.0,
        "verdict": "refused" if refused else "usable", "reasons": ["QL303"] if refused else [],
        "started": FIRST + datetime.timedelta(days=flight), "started_from": "receiver",
    }  # fmt: skip
    for quantity, (value, half) in numbers.items():
        here = value + 0.4 * half * rng.standard_normal()
        row |= {quantity: here, f"{quantity}_low": here - half, f"{quantity}_high": here + half}
    return row
