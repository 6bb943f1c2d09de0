"""Whether margins promised from one flown flight hold in the next: `python study/flown_loops.py`.

Flights of one vehicle in the corpus (`QUADID_LOG_CORPUS`, folder ``blackbox``; `--vehicle NAME LOG...` adds
others). The vehicle of each flight has margins with the gains of each other flight, as `tune` promises them;
the other flight's own log tells them, too. Writes as markdown how often both agree, what `check` says, and by
how much the response around the crossover differs between flights beyond chance.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks.logs import corpus_folder  # noqa: E402
from quadid_logs.data.closed_loop import Estimated, LoopMargins  # noqa: E402
from quadid_logs.data.promise import AxisPromise, Gain, Outcome  # noqa: E402
from quadid_logs.data.result import Result  # noqa: E402
from quadid_logs.maths.random_effect import random_effect  # noqa: E402
from quadid_logs.pipeline import analyze  # noqa: E402
from quadid_logs.promise import check, promise_of  # noqa: E402
from quadid_logs.tuning import margins_with, shaping_gains, tuning_of  # noqa: E402
from quadid_logs.vocabulary import AXES  # noqa: E402

DEFAULT_OUTPUT: Final = ROOT / "docs" / "tuning" / "flown.md"
#: Logs of one vehicle in the corpus, by the beginning of their names.
VEHICLES: Final[Mapping[str, str]] = {
    "5-inch, Betaflight 3.1": "bf3-hiro-",
    "5-inch, Betaflight 3.4": "bf3-log",
    "quad, Betaflight 3.1": "bf3-plasmatree",
    "quad, Betaflight 4.2": "bf42-",
    "quad, Betaflight 4.3": "bf431-",
    "quad, Betaflight 2025.12": "bf2025-",
}
#: Of `Margins`, with the unit of a difference; that of a frequency is in per cent.
FIGURES: Final[Mapping[str, str]] = {"gain_margin_db": "dB", "phase_margin_deg": "deg", "crossover_hz": "%"}


class Flight(NamedTuple):
    """A flight that tells the loop of an axis: its result, and the parameters that shape the loop."""

    result: Result
    gains: Mapping[str, float]
    margins: LoopMargins


class Pair(NamedTuple):
    """A figure as promised from one flight and told by another, and by how much they differ.

    ``beyond`` is the difference over half the interval of the difference.
    """

    figure: str
    difference: float
    beyond: float
    same_gains: bool


def told(result: Result, axis: str) -> Flight | None:
    """Return what a flight tells of the loop of an axis; None where it tells none."""
    loop = result.loop_of(axis)
    if loop is None or loop.margins is None or loop.plants is None or loop.contradicted:
        return None
    return Flight(result, shaping_gains(result, axis), loop.margins)


def changes(before: Flight, after: Flight) -> dict[str, float]:
    """Return the parameters that have other values in another flight."""
    return {name: value for name, value in after.gains.items() if before.gains.get(name) != value}


def pairs(flights: list[Flight], axis: str) -> Iterator[Pair]:
    """Yield what each flight promises of each other flight's gains, and what that flight tells."""
    for before, after in itertools.permutations(flights, 2):
        changed = changes(before, after)
        promised = margins_with(before.result, axis, changed, next_flight=True)
        if promised is None:
            continue
        for figure, unit in FIGURES.items():
            said, found = (getattr(one.rate, figure) for one in (promised, after.margins))
            if said is not None and found is not None:
                yield _pair(figure, unit, said, found, same_gains=not changed)


def _pair(figure: str, unit: str, said: Estimated, told: Estimated, *, same_gains: bool) -> Pair:
    difference = told.value - said.value
    # Of each interval, the half that faces the other value.
    sides = (0, 1) if difference < 0.0 else (1, 0)
    half = math.hypot(said.ci95[sides[0]] - said.value, told.ci95[sides[1]] - told.value)
    if unit == "%":
        difference = 100.0 * difference / said.value
    return Pair(figure, difference, abs(told.value - said.value) / half, same_gains)


def outcome(before: Result, after: Result) -> Outcome | None:
    """Return what `check` says where a flight has the gains that another one promised it; None without."""
    promise = promise_of(before, tuning_of(before))
    if promise is None:
        return None
    axes = {}
    for axis in AXES:
        now, then = shaping_gains(before, axis), shaping_gains(after, axis)
        changed = {name: value for name, value in then.items() if now.get(name) != value}
        known = told(before, axis) is not None
        margins = margins_with(before, axis, changed, next_flight=True) if known else None
        gains = {name: Gain(now.get(name, value), value) for name, value in then.items()}
        axes[axis] = AxisPromise(
            verdict="refused" if margins is None else "change", gains=gains, margins=margins
        )
    return check(replace(promise, axes=axes), after).outcome


class Spread(NamedTuple):
    """Crossovers of flights with the gains of the first [Hz], and how they spread beyond chance (1 sigma)."""

    crossover_hz: list[Estimated]
    beyond_chance: float


def spread(flights: list[Flight], axis: str) -> Spread:
    """Return how the response around the crossover differs between flights, by its logarithm."""
    first, found = flights[0], []
    for one in flights:
        margins = margins_with(one.result, axis, changes(one, first))
        if margins is not None and margins.rate.crossover_hz is not None:
            found.append(margins.rate.crossover_hz)
    low, value, high = np.log([[one.ci95[0], one.value, one.ci95[1]] for one in found]).T
    return Spread(found, random_effect(value, 0.5 * (high - low)).sd)


def _plain(figure: str) -> str:
    return {"gain_margin_db": "gain margin", "phase_margin_deg": "phase margin", "crossover_hz": "crossover"}[
        figure
    ]


def _vehicle_rows(name: str, flights: list[Flight], axis: str, found: Spread) -> str:
    p = sorted({value for one in flights for key, value in one.gains.items() if key.startswith("p_")})
    values = ", ".join(
        f"{one.value:.1f} ± {0.5 * (one.ci95[1] - one.ci95[0]):.1f}" for one in found.crossover_hz
    )
    gains = f"{p[0]:g}" if len(p) == 1 else f"{p[0]:g} to {p[-1]:g}" if p else "–"
    return f"| {name} | {axis} | {len(flights)} | {gains} | {values} | {100.0 * found.beyond_chance:.1f} % |"


def page(vehicles: Mapping[str, list[Result]]) -> str:
    """Return both tables as markdown."""
    rows, every, spreads = [], [], []
    for name, results in vehicles.items():
        for axis in AXES:
            flights = [one for result in results if (one := told(result, axis)) is not None]
            if len(flights) < 2:
                continue
            found = spread(flights, axis)
            spreads.append((len(flights) - 1, found.beyond_chance))
            rows.append(_vehicle_rows(name, flights, axis, found))
            every += pairs(flights, axis)
    lines = [
        "| vehicle | axis | flights | P | crossover with the first gains [Hz] | spread beyond chance |",
        "|---|---|---|---|---|---|",
        *rows,
        "",
        "| promised from one flight, told by another | gains | pairs | inside both intervals together |"
        " median difference | 90 % of differences below |",
        "|---|---|---|---|---|---|",
    ]
    for figure, unit in FIGURES.items():
        for same in (False, True):
            some = [one for one in every if one.figure == figure and one.same_gains == same]
            if not some:
                continue
            off = np.abs([one.difference for one in some])
            held = sum(one.beyond <= 1.0 for one in some)
            lines.append(
                f"| {_plain(figure)} | {'the same' if same else 'others'} | {len(some)} | "
                f"{100.0 * held / len(some):.0f} % | {np.median(off):.2g} {unit} | "
                f"{np.quantile(off, 0.9):.2g} {unit} |"
            )
    freedom, beyond = np.array(spreads).T
    pooled = math.sqrt(np.average(beyond**2, weights=freedom))
    one = [itertools.permutations(results, 2) for results in vehicles.values()]
    firsts = [results[:1] for results in vehicles.values()]
    others = [itertools.product(a, b) for a, b in itertools.permutations(firsts, 2)]
    lines += [
        "",
        f"Spread of the crossover between flights of one vehicle: {100.0 * pooled:.1f} %.",
        "",
        f"`check` says of two flights of one vehicle: {_outcomes(one)}.",
        f"Of the first flights of two vehicles: {_outcomes(others)}.",
    ]
    return "\n".join(lines) + "\n"


def _outcomes(groups: Iterable[Iterable[tuple[Result, Result]]]) -> str:
    counted = Counter(outcome(*both) for both in itertools.chain.from_iterable(groups))
    return ", ".join(f"{one.value} {counted[one]}" for one in Outcome)


def main(arguments: list[str] | None = None) -> int:
    """Compare the flights of each vehicle, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--vehicle",
        nargs="+",
        action="append",
        default=[],
        metavar=("NAME", "LOG"),
        help="logs of one more vehicle",
    )
    parser.add_argument("--output", type=Path, default=DEFAULT_OUTPUT)
    options = parser.parse_args(arguments)
    logs = {
        name: sorted((corpus_folder() / "blackbox").glob(f"{beginning}*"))
        for name, beginning in VEHICLES.items()
    }
    logs |= {name: [Path(one) for one in paths] for name, *paths in options.vehicle}
    text = page({name: [analyze(one) for one in paths] for name, paths in logs.items()})
    options.output.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
