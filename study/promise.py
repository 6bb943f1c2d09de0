"""Promise and check: `python study/run.py --promise`.

Vehicles drawn at random are flown and tuned; the next flight has the recommended gains, on the same vehicle
and on one that something was done to. Promised intervals are held against the true loop of the next flight,
and what `check` says against what was done.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.data.promise import Check, Outcome, Promise
from quadid_logs.data.result import Result
from quadid_logs.promise import FIGURES, check, promise_of
from quadid_logs.simulator import Scenario, fly
from quadid_logs.simulator.closed_loop import Record, Setup
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from study.tuning import (
    analyzed,
    changed,
    draw_vehicle,
    flyable,
    of_each_gain,
    setup_of,
    true_margins,
)


def _same(setup: Setup) -> Setup:
    return setup


def _with_propellers(setup: Setup, thrust: tuple[float, ...]) -> Setup:
    return dataclasses.replace(setup, airframe=dataclasses.replace(setup.airframe, propellers=thrust))


def _weak_motor(setup: Setup) -> Setup:
    return _with_propellers(setup, (0.8, *[1.0] * (setup.airframe.n_rotors - 1)))


def _weak_motors(setup: Setup) -> Setup:
    return _with_propellers(setup, (0.8,) * setup.airframe.n_rotors)


def _other_propellers(setup: Setup) -> Setup:
    """Less pitch: 15 % less thrust."""
    return _with_propellers(setup, (0.85,) * setup.airframe.n_rotors)


#: What is done to a vehicle between the flights.
CASES: Final[Mapping[str, Callable[[Setup], Setup]]] = {
    "nothing": _same,
    "one motor -20 %": _weak_motor,
    "all motors -20 %": _weak_motors,
    "other propellers, -15 % thrust": _other_propellers,
}
#: The gains of the promise were never loaded: the flight of the promise is held against it.
_NOT_LOADED: Final = "gains not loaded"


def measure_promise(seed: int, number: int) -> dict[str, Any]:
    """Fly, tune, and fly again in each of the cases.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    dict
        Ready for JSON; ``cases`` is empty where nothing was promised.
    """
    scenario, autopilot, settings = draw_vehicle(seed, number)
    rng = np.random.default_rng([seed, number, *b"detuning"])
    factors = of_each_gain(flyable(scenario, autopilot, rng))
    first = _analyzed(fly(setup_of(scenario, autopilot, factors, 1000 * seed + 10 * number)), scenario)
    tuning = recommend(first)
    promise = promise_of(first, tuning)
    told: dict[str, Any] = {"number": number, "seed": seed, **settings, "cases": {}}
    if promise is None:
        return told
    if tuning.changes:
        told["cases"][_NOT_LOADED] = _described(check(promise, first))
    following = factors * changed(tuning, first)
    for count, (name, change) in enumerate(CASES.items(), start=1):
        setup = change(setup_of(scenario, autopilot, following, 1000 * seed + 10 * number + count))
        record = fly(setup)
        result = _analyzed(record, scenario)
        told["cases"][name] = _described(check(promise, result))
        if change is _same:
            truth = flight_truth((record,), scenario="", boot_s=0.0)
            told["figures"] = _figures(promise, record, truth)
    return told


def _analyzed(record: Record, scenario: Scenario) -> Result:
    """Return the analysis of a flight's log, with what the log shows of the rotors."""
    return analyzed(record, scenario, with_health=True)


def _figures(promise: Promise, record: Record, truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Return every promised figure with the true one of the next flight."""
    found = []
    for place, axis in enumerate(AXES):
        promised = promise.axes[axis].margins
        if promised is None:
            continue
        true = true_margins(record.setup, truth, place)
        both = (promised.full, true.full) if promised.full and true.full else (promised.rate, true.rate)
        for name in FIGURES:
            said, really = (getattr(one, name) for one in both)
            if said is not None and really is not None:
                found.append(
                    {"axis": axis, "name": name, "ci95": [float(one) for one in said.ci95]}
                    | {"true": float(really.value)}
                )
    return found


def _described(found: Check) -> dict[str, Any]:
    """Return what a check said."""
    return {
        "outcome": found.outcome.value,
        "axes": {axis: one.held.value for axis, one in found.axes.items()},
        "flown": {axis: one.flown.value for axis, one in found.axes.items()},
        "obstacles": {axis: str(one.obstacle) for axis, one in found.axes.items() if one.obstacle},
        "differ": [
            f"{axis} {one.name}" for axis, each in found.axes.items() for one in each.figures if one.differs
        ]
        + [f"{one.kind.value} {one.axis} {one.command}".strip() for one in found.vehicle_changes],
        "n_vehicle": len(found.vehicle),
        "rotor": None if found.rotor is None else [found.rotor.rotor, found.rotor.loss.value],
    }


def summarise(vehicles: list[dict[str, Any]]) -> str:
    """Return the tables.

    Parameters
    ----------
    vehicles : list of dict
        As of `measure_promise`.

    Returns
    -------
    str
        Markdown.
    """
    promised = [one for one in vehicles if one["cases"]]
    lines = [
        f"{len(vehicles)} vehicles, {len(promised)} with a promise.",
        "",
        "| promised margin | true value of the next flight in interval |",
        "|---|---|",
    ]
    figures = [figure for one in promised for figure in one.get("figures", [])]
    for name in (*FIGURES, ""):
        some = [one for one in figures if not name or one["name"] == name]
        inside = sum(one["ci95"][0] <= one["true"] <= one["ci95"][1] for one in some)
        share = 100.0 * inside / max(len(some), 1)
        lines.append(f"| {name or 'all'} | {share:.1f} % of {len(some)} |")
    lines += ["", "| change before the next flight | kept | broken | not comparable |", "|---|---|---|---|"]
    for case in (*CASES, _NOT_LOADED):
        counts = Counter(one["cases"][case]["outcome"] for one in promised if case in one["cases"])
        cells = [str(counts[outcome.value]) for outcome in Outcome]
        lines.append(f"| {case} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Measure what is missing of the study within the time given, then print its tables."""
    from study.run import ROOT
    from study.tuning import read

    parser = argparse.ArgumentParser(description="Promises held against the next flight, simulated.")
    parser.add_argument("--vehicles", type=int, default=40, help="how many vehicles (default 40)")
    parser.add_argument("--seed", type=int, default=1, help="another seed draws other vehicles (default 1)")
    parser.add_argument("--most-s", type=float, default=230.0, help="begin no vehicle after so long")
    parser.add_argument(
        "--output", type=Path, default=ROOT / "build" / "promise", help="default build/promise"
    )
    parser.add_argument("--publish", action="store_true", help="write docs/tuning/promise.md from all seeds")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / f"seed-{options.seed}.jsonl"
    began = time.monotonic()
    done = {one["number"] for one in read(path)}
    with path.open("a", encoding="utf-8") as file:
        for number in sorted(set(range(options.vehicles)) - done):
            if time.monotonic() - began > options.most_s:
                break
            file.write(json.dumps(measure_promise(options.seed, number)) + "\n")
            file.flush()
    vehicles = [one for each in sorted(options.output.glob("seed-*.jsonl")) for one in read(each)]
    text = summarise(vehicles)
    if options.publish:
        (ROOT / "docs" / "tuning" / "promise.md").write_text(text, encoding="utf-8")
    print(text)
    return 0
