"""Results of the tuning study: a page, and a picture of margins before and after."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.vocabulary import AXES

_FIGURES: Final = {"gain_margin_db": "gain [dB]", "phase_margin_deg": "phase [deg]", "disk_margin": "disk"}
_LIMITS: Final = {"gain_margin_db": 6.0, "phase_margin_deg": 45.0, "disk_margin": 0.67}
_PICTURE: Final = "margins.png"
#: Finding of an axis that is not usable.
_NOT_USABLE: Final = "QL615"


class Followed(NamedTuple):
    """A flight with recommended gains on one axis: promised, true and estimated margins."""

    promised: dict[str, Any]
    true: dict[str, Any]
    found: dict[str, Any] | None
    final: bool


def followed(vehicles: list[dict[str, Any]]) -> list[Followed]:
    """Return every flight that came after a change, axis by axis.

    Parameters
    ----------
    vehicles : list of dict
        As of `study.tuning.measure_tuning`.

    Returns
    -------
    list of Followed
    """
    return [one for vehicle in vehicles for axis in AXES for one in _followed(vehicle["flights"], axis)]


def _followed(flights: list[dict[str, Any]], axis: str) -> Iterator[Followed]:
    steps = [flight["axes"][axis] for flight in flights]
    changes = [number for number, one in enumerate(steps[:-1]) if one["verdict"] == "change"]
    for number in changes:
        after = steps[number + 1]
        final = number == changes[-1] and after["verdict"] == "keep"
        yield Followed(steps[number]["next"], after["true"], after["now"], final)


def summarise(vehicles: list[dict[str, Any]], output: Path) -> str:
    """Return the page, and draw its picture.

    Parameters
    ----------
    vehicles : list of dict
    output : Path
        Folder of the picture.

    Returns
    -------
    str
        Markdown.
    """
    failed = [one for one in vehicles if "error" in one]
    known = [one for one in vehicles if "error" not in one]
    _draw(known, output / _PICTURE)
    every = followed(known)
    ends = [one["flights"][-1]["axes"][axis] for one in known for axis in AXES]
    lines = [
        f"{len(known)} vehicles, {sum(len(one['flights']) for one in known)} flights, {len(failed)} failed.",
        "",
        f"- Unstable true loops in flights with recommended gains: {_unstable(every)}; "
        f"vehicles that lost control: {sum(one['ran_away'] for each in known for one in each['flights'])}.",
        f"- Verdicts after the last flight: {_counted(one['verdict'] for one in ends)}.",
        f"- Reasons for refusal: {_counted(_refusals(ends))}. In an earlier flight, {_earlier(known)} of "
        "these axes had a recommendation.",
        f"- The true margins meet the limits on {_kept(ends)} axes with the final verdict keep.",
        f"- The measured response contradicted the model (QL614) in {_judged(known, 'QL614')} verdicts.",
        f"- Gains held below what the margins allow, with the final verdict keep: {_counted(_held(ends))}.",
        "",
        *_promise_table(every),
        "",
        *_rejection(known),
    ]
    return "\n".join(lines) + "\n"


def _unstable(every: list[Followed]) -> int:
    return sum(not one.true["stable"] for one in every)


def _refusals(ends: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the first reason of each refused axis, with the finding of the analysis behind it."""
    for one in ends:
        if one["verdict"] == "refused":
            first = one["reasons"][0]
            yield f"{first} ({', '.join(one['codes'])})" if first == _NOT_USABLE and one["codes"] else first


def _kept(ends: list[dict[str, Any]]) -> str:
    """Count the axes with the final verdict keep, and those whose true margins meet the limits."""
    kept = [one["true"] for one in ends if one["verdict"] == "keep"]
    good = [
        all(one[name] is None or one[name][0] >= limit for name, limit in _LIMITS.items()) for one in kept
    ]
    return f"{sum(good)} of {len(kept)}"


def _judged(known: list[dict[str, Any]], code: str) -> str:
    """Count the verdicts of all axes and flights, and those whose first reason is a code."""
    first = [
        one["reasons"][:1] for each in known for flight in each["flights"] for one in flight["axes"].values()
    ]
    return f"{first.count([code])} of {len(first)}"


def _earlier(known: list[dict[str, Any]]) -> int:
    """Count the axes that only their last flight refused."""
    verdicts = [
        [flight["axes"][axis]["verdict"] for flight in one["flights"]] for one in known for axis in AXES
    ]
    return sum(each[-1] == "refused" and set(each) != {"refused"} for each in verdicts)


def _held(ends: list[dict[str, Any]]) -> Iterator[str]:
    for one in ends:
        if one["verdict"] == "keep":
            yield from (code for code in one["reasons"] if code in ("QL632", "QL635", "QL637", "QL638"))


def _counted(names: Iterator[str]) -> str:
    counts = Counter(names)
    return ", ".join(f"{name} {count}" for name, count in counts.most_common()) or "none"


def _promise_table(every: list[Followed]) -> Iterator[str]:
    """Yield how often the intervals of a promise contain the true value, in all and in final flights."""
    yield "| promised margin | true value in interval | next estimate in interval | true value not below it |"
    yield "|---|---|---|---|"
    for kind, chosen in (("", every), ("final flight, ", [one for one in every if one.final])):
        for name, title in _FIGURES.items():
            cells = [_fraction(chosen, name, way) for way in ("true", "found", "least")]
            yield f"| {kind}{title} | {' | '.join(cells)} |"


def _fraction(chosen: list[Followed], name: str, way: str) -> str:
    inside = []
    for one in chosen:
        seen = one.found if way == "found" else one.true
        if one.promised.get(name) is None or seen is None or seen.get(name) is None:
            continue
        _, low, high = one.promised[name]
        value = seen[name][0]
        inside.append(value >= low and (way == "least" or value <= high))
    return f"{100.0 * np.mean(inside):.1f} % of {len(inside)}" if inside else "–"


def _rejection(known: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the change of the attitude error by gusts."""
    raised, lowered = [], []
    for vehicle in known:
        for axis in AXES:
            ratios = [
                flight["axes"][axis]["attitude_error"] or 1.0
                for flight in vehicle["flights"]
                if flight["axes"][axis]["verdict"] == "change"
            ]
            if ratios:
                total = float(np.prod(ratios))
                (raised if total < 1.0 else lowered).append(total)
    for name, found in (("reduced", raised), ("increased, for larger margins,", lowered)):
        if found:
            times = f"times {np.median(found):.2f} (median)"
            yield f"- Attitude error by gusts {name} on {len(found)} axes: {times}."


def _draw(known: list[dict[str, Any]], path: Path) -> None:
    """Draw the true margins of the first and of the last flight of every axis that was changed."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(10, 4.2), constrained_layout=True)
    for panel, name in zip(panels, ("gain_margin_db", "phase_margin_deg"), strict=True):
        pairs = sorted(_pairs(known, name))
        rows = np.arange(len(pairs))
        for row, (before, after) in zip(rows, pairs, strict=True):
            panel.plot([row, row], [before, after], color="0.8", lw=1.0, zorder=1)
        panel.scatter(rows, [one for one, _ in pairs], s=12, color="0.5", label="first flight", zorder=2)
        panel.scatter(rows, [one for _, one in pairs], s=12, color="#0057a0", label="last flight", zorder=3)
        panel.axhline(_LIMITS[name], color="#a3290c", lw=1.0, label="to be kept")
        panel.set_xlabel("axes of all vehicles that were changed, by their first flight")
        panel.set_ylabel(f"true margin of the whole loop, {_FIGURES[name]}")
        panel.legend(frameon=False)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _pairs(known: list[dict[str, Any]], name: str) -> Iterator[tuple[float, float]]:
    for vehicle in known:
        flights = vehicle["flights"]
        for axis in AXES:
            ends = [flights[place]["axes"][axis]["true"].get(name) for place in (0, -1)]
            if flights[0]["axes"][axis]["verdict"] == "change" and None not in ends:
                yield ends[0][0], ends[1][0]


def publish(text: str, output: Path, folder: Path) -> None:
    """Put page and picture into the documentation.

    Parameters
    ----------
    text : str
    output, folder : Path
    """
    folder.mkdir(exist_ok=True)
    (folder / "table.md").write_text(text, encoding="utf-8")
    (folder / _PICTURE).write_bytes((output / _PICTURE).read_bytes())
