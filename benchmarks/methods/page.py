"""The tables and the picture of the benchmark, from entries."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from benchmarks.methods.data_sets import Kind
from benchmarks.methods.entrants import OURS
from benchmarks.methods.entry import Entry
from benchmarks.methods.score import Accuracy, Error, Facts, accuracy, errors, is_same_data, repeated
from quadid_logs.vocabulary import AXES

WITH_TRUTH: Final[dict[Kind, str]] = {
    "firmware": "Autopilot firmware in a simulator of known equations",
    "simulated": "Flights of our own simulator",
}
_COLOURS: Final = ("#1b6ca8", "#7f7f7f", "#b2182b", "#e08214", "#4c9f70", "#8073ac", "#c51b7d", "#35978f")
#: Beyond, a number has no digit right [%].
_FAR: Final = 1000.0


def tables(
    entries: Sequence[Entry],
    facts: Mapping[str, Facts],
    *,
    missing: Sequence[str] = (),
    refused: Sequence[str] = (),
    without_flight: Sequence[str] = (),
    minutes: float = math.nan,
) -> Iterator[str]:
    """Yield the lines of the page's generated part.

    Parameters
    ----------
    entries : sequence of Entry
    facts : mapping of str to Facts
        By data set.
    missing : sequence of str
        Methods that are not installed.
    refused : sequence of str
        Why files are no entries.
    without_flight : sequence of str
        Data sets in which no flight was found.
    minutes : float
        That the command took.

    Yields
    ------
    str
        Markdown.
    """
    for kind, title in WITH_TRUTH.items():
        if any(each.kind == kind and each.truth for each in facts.values()):
            yield from ["", f"## {title}", ""]
            yield from _accuracy_table(entries, facts, kind)
            yield ""
            yield from _detail_table(entries, facts, kind)
    vehicles = sorted({each.vehicle for each in facts.values() if each.vehicle})
    if vehicles:
        yield from ["", "## Flown flights of one vehicle", ""]
        yield from _repeat_table(entries, facts, vehicles)
    yield from ["", "## What each entry is and ran on", ""]
    yield from _entry_table(entries, facts)
    yield ""
    if missing:
        yield f"Not installed, and therefore not in the tables: {', '.join(map(_cell, missing))}."
    for why in refused:
        yield f"Left out: {_cell(why)}"
    if without_flight:
        yield f"No flight was found in {len(without_flight)} logs of flown sets; no method was given them."
    if math.isfinite(minutes):
        yield f"The command took {minutes:.1f} minutes."


def _accuracy_table(entries: Sequence[Entry], facts: Mapping[str, Facts], kind: Kind) -> Iterator[str]:
    """Yield what the errors are in sum, apart for the axes that ours answers and refuses."""
    found = {entry.method: errors(entry, facts, [kind]) for entry in entries}
    ours = _answered(found.get(OURS, []))
    best = _smallest(found, ours)
    n_refused = len(next(iter(found.values()), [])) - len(ours)
    yield (
        f"| method | median error of {len(ours)} axes | nine in ten below | smallest error | "
        f"{n_refused} axes that quadid-logs refuses: a number, median error | "
        "intervals that hold the truth | median half width | interval score | median s |"
    )
    yield "|---" * 9 + "|"
    for entry in entries:
        mine = found[entry.method]
        kept = accuracy([each for each in mine if (each.data_set, each.axis) in ours])
        others = [each for each in mine if (each.data_set, each.axis) not in ours]
        cells = [
            _percent(kept.median),
            _percent(kept.most),
            str(sum(method == entry.method for method in best.values())),
            _refused_cell(others),
            *_interval_cells(accuracy(mine)),
            _seconds(entry, facts, kind),
        ]
        yield f"| {_cell(entry.method)} | " + " | ".join(cells) + " |"


def _answered(found: Sequence[Error]) -> set[tuple[str, str]]:
    """Return the axes that have a number."""
    return {(each.data_set, each.axis) for each in found if not math.isnan(each.error)}


def _smallest(
    found: Mapping[str, Sequence[Error]], places: set[tuple[str, str]]
) -> dict[tuple[str, str], str]:
    """Return the method with the smallest error of each axis."""
    best: dict[tuple[str, str], tuple[float, str]] = {}
    for method, each_error in found.items():
        for each in each_error:
            place = (each.data_set, each.axis)
            if place in places and not math.isnan(each.error):
                best[place] = min(best.get(place, (math.inf, "")), (abs(each.error), method))
    return {place: method for place, (_size, method) in best.items()}


def _refused_cell(others: Sequence[Error]) -> str:
    """Return how many of these axes have a number, and how wrong those are."""
    given = [each for each in others if not math.isnan(each.error)]
    return f"{len(given)}, {_percent(accuracy(given).median)}" if given else "none"


def _interval_cells(mine: Accuracy) -> list[str]:
    """Return what is said of intervals."""
    if not mine.n_intervals:
        return ["no intervals", "–", "–"]
    held = f"{mine.held} of {mine.n_intervals} ({100.0 * mine.held / mine.n_intervals:.0f} %)"
    return [held, _percent(mine.half_width), _percent(mine.interval_score)]


def _seconds(entry: Entry, facts: Mapping[str, Facts], kind: Kind) -> str:
    """Return the median processor time on data sets of a kind."""
    taken = [
        outcome.seconds
        for name, outcome in entry.results.items()
        if outcome.seconds is not None and name in facts and facts[name].kind == kind
    ]
    return f"{np.median(taken):.2f}" if taken else "–"


def _detail_table(entries: Sequence[Entry], facts: Mapping[str, Facts], kind: Kind) -> Iterator[str]:
    """Yield the errors of every data set, the smallest of an axis bold, what ours refuses in brackets."""
    found = {entry.method: errors(entry, facts, [kind]) for entry in entries}
    ours = _answered(found.get(OURS, []))
    best = _smallest(found, ours)
    by_place = {
        method: {(each.data_set, each.axis): each.error for each in mine} for method, mine in found.items()
    }
    yield f"| errors in %: {', '.join(AXES)} | " + " | ".join(_cell(entry.method) for entry in entries) + " |"
    yield "|---" * (len(entries) + 1) + "|"
    for name, known in facts.items():
        if known.kind != kind or known.truth is None:
            continue
        cells = []
        for entry in entries:
            texts = []
            for axis in AXES:
                text = _signed(by_place[entry.method][name, axis])
                if (name, axis) not in ours:
                    text = f"({text})"
                elif best.get((name, axis)) == entry.method:
                    text = f"**{text}**"
                texts.append(text)
            cells.append(", ".join(texts))
        yield f"| {_cell(name)} | " + " | ".join(cells) + " |"


def _repeat_table(
    entries: Sequence[Entry], facts: Mapping[str, Facts], vehicles: Sequence[str]
) -> Iterator[str]:
    """Yield how many axes have a number, and how much these differ, by vehicle; then the pairs."""
    yield "| roll and pitch: numbers, spread | " + " | ".join(_cell(entry.method) for entry in entries) + " |"
    yield "|---" * (len(entries) + 1) + "|"
    pairs = {entry.method: [0, 0] for entry in entries}
    for vehicle in vehicles:
        cells = []
        for entry in entries:
            each = repeated(entry, facts, vehicle)
            pairs[entry.method][0] += each.agree
            pairs[entry.method][1] += each.n_pairs
            spread = "" if math.isnan(each.spread) else f", {_percent(each.spread)}"
            cells.append(f"{each.answered}{spread}" if each.answered else "none")
        n_flights = sum(known.vehicle == vehicle for known in facts.values())
        yield f"| {_cell(vehicle)}: {n_flights} flights | " + " | ".join(cells) + " |"
    told = [f"{agree} of {n}" if n else "no intervals" for agree, n in pairs.values()]
    yield "| **pairs that agree within both 95 % intervals** | " + " | ".join(told) + " |"


def _entry_table(entries: Sequence[Entry], facts: Mapping[str, Facts]) -> Iterator[str]:
    """Yield what each entry is, what its settings were chosen on, and what it ran on."""
    yield "| method | version | what it does | settings chosen on | data sets | machine |"
    yield "|---" * 6 + "|"
    for entry in entries:
        name = _cell(entry.method)
        ran = [each for each in entry.results if each in facts]
        stale = sum(not is_same_data(entry.results[each], facts[each]) for each in ran)
        unknown = len(entry.results) - len(ran)
        counts = [f"{len(ran) - stale} of {len(facts)}"]
        counts += [f"{stale} left out: made from other data"] if stale else []
        counts += [f"{unknown} not known here"] if unknown else []
        cells = [
            f"[{name}]({entry.url})" if entry.url else name,
            _cell(entry.version),
            _cell(entry.description),
            _cell(entry.tuned_on),
            "; ".join(counts),
            _cell(entry.machine),
        ]
        yield "| " + " | ".join(cells) + " |"


def _percent(fraction: float) -> str:
    """Return a fraction as a reader takes it in."""
    if math.isnan(fraction):
        return "–"
    value = 100.0 * fraction
    if value >= _FAR:
        return "no number" if math.isinf(value) else f"> {_FAR:.0f} %"
    return f"{value:.1f} %" if value < 100.0 else f"{value:.0f} %"


def _signed(fraction: float) -> str:
    """Return an error in per cent."""
    value = 100.0 * fraction
    if math.isnan(value):
        return "none"
    if abs(value) >= _FAR:
        return f"{'>' if value > 0 else '<'} {math.copysign(_FAR, value):+.0f}"
    return f"{value:+.1f}" if abs(value) < 100.0 else f"{value:+.0f}"


def _cell(text: str) -> str:
    """Return a text of somebody else so that it stays text in a cell: no markup, no HTML, no new column."""
    escaped = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("|", "&#124;")
    for sign in "\\`*_[]!":
        escaped = escaped.replace(sign, f"&#{ord(sign)};")
    return escaped


def picture(entries: Sequence[Entry], facts: Mapping[str, Facts]) -> bytes:
    """Draw the errors of every method, and how many of its intervals hold.

    Parameters
    ----------
    entries : sequence of Entry
    facts : mapping of str to Facts

    Returns
    -------
    bytes
        PNG.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    cumulative, coverage = figure.subplots(1, 2, width_ratios=(3, 2))
    found = {entry.method: errors(entry, facts, tuple(WITH_TRUTH)) for entry in entries}
    ours = _answered(found.get(OURS, []))
    for number, (method, mine) in enumerate(found.items()):
        kept = [abs(each.error) for each in mine if (each.data_set, each.axis) in ours]
        size = 100.0 * np.sort([each for each in kept if not math.isnan(each)])
        if size.size:
            colour, style = _COLOURS[number % len(_COLOURS)], "-" if number < len(_COLOURS) else "--"
            size = np.concatenate([[0.0], size])
            height = 100.0 * np.arange(size.size) / len(kept)
            cumulative.step(
                np.maximum(size, 0.01), height, where="post", label=method, color=colour, linestyle=style
            )
    cumulative.set(
        xscale="log",
        xlim=(0.05, 300.0),
        ylim=(0.0, 101.0),
        xlabel="error of the effectiveness [%]",
        ylabel=f"of {len(ours)} axes [%]",
        title="Axes with an error below",
    )
    if cumulative.get_legend_handles_labels()[0]:
        cumulative.legend(fontsize=8, loc="lower right")
    claimed = {method: accuracy(mine) for method, mine in found.items()}
    named = [method for method, each in claimed.items() if each.n_intervals]
    held = [100.0 * claimed[method].held / claimed[method].n_intervals for method in named]
    colours = [_COLOURS[list(found).index(method) % len(_COLOURS)] for method in named]
    coverage.barh(named, held, color=colours)
    coverage.axvline(95.0, color="black", linewidth=1.0, linestyle=":")
    coverage.set(xlim=(0.0, 100.0), xlabel="[%]", title="95 % intervals that hold the truth")
    coverage.invert_yaxis()
    for axes in (cumulative, coverage):
        axes.grid(visible=True, alpha=0.3)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=100, metadata={"Software": None})
    return file.getvalue()
