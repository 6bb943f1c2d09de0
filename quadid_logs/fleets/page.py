"""The page about a fleet: one self-contained HTML file without a script."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from quadid_logs.commands import command, named
from quadid_logs.counting import counted
from quadid_logs.data.tuning import GOOD
from quadid_logs.fleets.changes import MIN_RUN, ChangePoint, OpenChange, Shift
from quadid_logs.fleets.coverage import coverage_words
from quadid_logs.fleets.history import Fleet, Flight, VehicleHistory
from quadid_logs.fleets.sparklines import HEIGHT, WIDTH, Sparkline, sparkline
from quadid_logs.fleets.store import REPORTS
from quadid_logs.numerals import number, p_words, plus_minus, resolved
from quadid_logs.report.pages import environment
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__
from quadid_logs.vocabulary import AXES

#: Flights and failures that the page lists one by one; the rest is for `quadid-log query`.
_MOST_FLIGHTS: Final = 200
_MOST_FAILURES: Final = 500
#: Drawn for every vehicle: the quantity's name in the store, and as people read it.
_DRAWN: Final = {"gain": "effectiveness", "damping": "damping"}
_VERDICTS: Final = ("usable", "caution", "refused")
#: What a change of these quantities is typically a sign of, the most specific first.
_CAUSES: Final = (
    ("from", (
        "One rotor gives more or less thrust than the others (propeller, motor, ESC), or the flight "
        "controller is mounted at an angle."
    )),
    ("lag", "The rotors respond later or sooner. Check propellers, motors and ESC settings."),
    ("gain", "Inertia, load, propellers or battery changed. The balance of the rotors did not."),
    ("damping", "The propellers or the shape in the wind changed."),
)  # fmt: skip


_NUMBERS: Final = ("no", "one", "two")


@dataclass(frozen=True, slots=True, kw_only=True)
class _FlightRow:
    """One flight in the list of a vehicle."""

    number: int
    date: str
    name: str
    link: str
    verdicts: tuple[tuple[str, str, str], ...]
    begins_change: bool
    differs: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Story:
    """What was found about a vehicle, in words, and the quantity that says most over its history."""

    head: str
    items: tuple[str, ...]
    cause: str
    drawing: Sparkline | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _VehicleRow:
    """One vehicle: a row of the table, and its own section."""

    anchor: str
    name: str
    about: str
    n_flights: int
    dates: str
    verdicts: tuple[tuple[str, int], ...]
    gains: tuple[tuple[str, Sparkline | None], ...]
    dampings: tuple[tuple[str, Sparkline | None], ...]
    margins: tuple[tuple[str, bool], ...]
    fault: str
    changes: tuple[_Story, ...]
    open_change: _Story | None
    scatter: _Story | None
    outlier: _Story | None
    nothing: str
    flights: tuple[_FlightRow, ...]
    n_hidden: int

    @property
    def is_noticed(self) -> bool:
        """Whether there is anything to say about it."""
        return bool(self.fault or self.changes or self.open_change or self.scatter or self.outlier)


def fleet_page(fleet: Fleet, store: Path, page_folder: Path) -> str:
    """Return the page; every text is escaped by the template.

    Parameters
    ----------
    store : Path
        Where the single reports are, if they were kept.
    page_folder : Path
        Where the page will stand: its links are relative to it.

    Returns
    -------
    str
        HTML.
    """
    # To the single reports that exist, by the name of their file.
    folder, links = store / REPORTS, {}
    if folder.is_dir():
        way = quote(os.path.relpath(folder.resolve(), page_folder.resolve()).replace(os.sep, "/"))
        links = {
            path.name: f"{way}/{quote(path.name)}" for path in folder.iterdir() if path.suffix == ".html"
        }
    rows = [_vehicle_row(number, history, links) for number, history in enumerate(fleet.histories)]
    # Changed vehicles and outliers come first: that is what the page is for; then those with a result.
    rows.sort(
        key=lambda row: (not row.is_noticed, not any(drawn for _, drawn in (*row.gains, *row.dampings)))
    )
    # What was looked for in vain, and what could not be looked for.
    n_compared = sum(history.can_show_change for history in fleet.histories)
    n_short = sum(0 < history.n_known < 2 * MIN_RUN for history in fleet.histories)
    n_without = sum(not history.n_known for history in fleet.histories)
    n_placed = sum(bool(history.outlier_tests) for history in fleet.histories)
    lines = []
    if n_compared:
        lines.append(
            f"No vehicle changed. {counted(n_compared, 'vehicle')} with at least {2 * MIN_RUN} comparable "
            "flights were checked: no flights differ from earlier ones by more than the normal scatter."
        )
    if n_placed:
        lines.append(f"None of {counted(n_placed, 'vehicle')} is an outlier among others of its model.")
    if n_short:
        lines.append(
            f"{counted(n_short, 'vehicle')} with fewer than {2 * MIN_RUN} comparable flights: only large "
            "differences would be found."
        )
    if n_without:
        lines.append(f"{counted(n_without, 'vehicle')} without a usable axis: nothing could be compared.")
    page: str = (
        environment("quadid_logs.fleets")
        .get_template("fleet.html")
        .render(
            rows=rows,
            with_margins=any(row.margins for row in rows),
            noticed=[row for row in rows if row.is_noticed],
            coverage=coverage_words(fleet.coverage),
            all_clear=tuple(lines) or ("There is nothing to compare.",),
            failures=[
                {
                    "url": printable(failure.url, 200),
                    "status": failure.status,
                    "error": printable(failure.error, 300),
                }
                for failure in fleet.failures[:_MOST_FAILURES]
            ],
            n_failures=len(fleet.failures),
            n_set_aside=len(fleet.set_aside),
            set_aside=[f"{row.url}: {row.reason}" for row in fleet.set_aside[:_MOST_FAILURES]],
            n_flights=sum(len(history.flights) for history in fleet.histories),
            n_tests=fleet.n_tests,
            axes=AXES,
            version=__version__,
            width=WIDTH,
            height=HEIGHT,
            query=command("query", named(str(store)), "SELECT * FROM fleet"),
        )
    )
    return page


def vehicle_values(fleet: Fleet, vehicle: str, links: Mapping[str, str]) -> dict[str, Any] | None:
    """Return what ``vehicle_parts.html`` shows of one vehicle.

    Parameters
    ----------
    fleet : Fleet
        What it is compared with.
    links : mapping of str to str
        Addresses of reports by ``<sha256>-<flight>.html``.

    Returns
    -------
    dict or None
        None where the fleet holds no flight of it.
    """
    history = next((each for each in fleet.histories if each.vehicle == vehicle), None)
    if history is None:
        return None
    row = _vehicle_row(0, history, links)
    return {"row": row, "axes": AXES, "width": WIDTH, "height": HEIGHT, "n_tests": fleet.n_tests}


def _vehicle_row(number: int, history: VehicleHistory, links: Mapping[str, str]) -> _VehicleRow:
    """Collect what the page shows about one vehicle."""
    changes = [change.flight for change in history.changes]
    counts = Counter(verdict for flight in history.flights for verdict in flight.verdicts.values())
    about = (
        history.model,
        history.firmware,
        f"named after its {history.vehicle_from}" if history.vehicle_from else "",
    )
    shown = list(enumerate(history.flights))[-_MOST_FLIGHTS:]
    # A centre of mass off the middle is a fact, no alarm.
    last = history.flights[-1] if history.flights else None
    # What it rests on that nothing was found.
    if not history.n_known:
        nothing_found = "nothing to compare: no usable axis"
    elif not history.can_show_change:
        nothing_found = f"too few flights to find a change: {history.n_known}, and {2 * MIN_RUN} are needed"
    else:
        nothing_found = "no change"
    # Of each axis in the last flight that tells them, and whether they are too small.
    margins = []
    for axis in AXES:
        flights = (flight.margins.get(axis) for flight in reversed(history.flights))
        told = next((one for one in flights if one is not None), None)
        if told is not None:
            limits = ((told[0], GOOD.gain_db, "{:.3g} dB"), (told[1], GOOD.phase_deg, "{:.0f}°"))
            known = [(value, limit, form) for value, limit, form in limits if value is not None]
            words = ", ".join(form.format(value) for value, _, form in known)
            margins.append((f"{axis} {words}", any(value < limit for value, limit, _ in known)))
    # The first and the last day, and how many flights have none of their own.
    days = sorted(
        flight.started.date().isoformat() for flight in history.flights if flight.started and flight.is_dated
    )
    n_without = len(history.flights) - len(days)
    if not days:
        dates = "dates unknown"
    else:
        span = days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"
        dates = f"{span}; {n_without} without a date" if n_without else span
    flight_rows = []
    for k, flight in reversed(shown):
        name = flight.url.replace("\\", "/").rsplit("/", 1)[-1]
        if flight.n_flights > 1:
            name += f", flight {flight.number + 1} of {flight.n_flights}"
        flight_rows.append(
            _FlightRow(
                number=k + 1,
                date=_date(flight),
                name=printable(name, 120),
                link=links.get(f"{flight.sha256}-{flight.number}.html", ""),
                verdicts=tuple(
                    (axis, flight.verdicts.get(axis, ""), " ".join(flight.reasons.get(axis, ())))
                    for axis in AXES
                ),
                begins_change=k in changes,
                differs=history.open_change is not None and k >= history.open_change.flight,
            )
        )
    return _VehicleRow(
        anchor=f"v{number}",
        name=printable(history.vehicle, 80),
        about=printable(", ".join(filter(None, about)), 200),
        n_flights=len(history.flights),
        dates=dates,
        verdicts=tuple((verdict, counts[verdict]) for verdict in _VERDICTS if counts[verdict]),
        gains=_lines(history, "gain", changes),
        dampings=_lines(history, "damping", changes),
        margins=tuple(margins),
        fault="" if last is None or not set(last.faults) - {"QL434"} else last.faults_found,
        changes=tuple(_change_story(change, history) for change in history.changes),
        open_change=_open_story(history.open_change, history) if history.open_change else None,
        scatter=_scatter_story(history) if history.scatter else None,
        outlier=_outlier_story(history) if history.outliers else None,
        nothing=nothing_found,
        flights=tuple(flight_rows),
        n_hidden=len(history.flights) - len(shown),
    )


def _lines(
    history: VehicleHistory, name: str, changes: Sequence[int]
) -> tuple[tuple[str, Sparkline | None], ...]:
    """Draw one quantity of the three axes."""
    series = [(axis, history.of(name, axis)) for axis in AXES]
    return tuple(
        (axis, None if one is None else sparkline(one, f"{axis} {_DRAWN[name]}", changes))
        for axis, one in series
    )


def _date(flight: Flight) -> str:
    """Return when a flight began; of a file's date, that it is one."""
    if flight.started is None:
        return "date unknown"
    when = f"{flight.started:%Y-%m-%d %H:%M}"
    return when if flight.is_dated else f"date unknown (file of {when})"


def _change_story(change: ChangePoint, history: VehicleHistory) -> _Story:
    """Say when the vehicle changed, in what, and what that is a sign of."""
    flight = history.flights[change.flight]
    when = f", {_date(flight)}" if flight.is_dated else ""
    shifts = _largest_first(change.shifts)
    return _Story(
        head=f"changed with flight {change.flight + 1} of {len(history.flights)}{when}",
        items=tuple(_shift_words(shift, history.input_unit) for shift in shifts),
        cause=_cause(shift.name for shift in shifts),
        drawing=_drawing(history, shifts[0].name, shifts[0].axis),
    )


def _open_story(found: OpenChange, history: VehicleHistory) -> _Story:
    """Say how the last flights differ, and what would decide whether the vehicle changed."""
    shifts = _largest_first(found.shifts)
    last = "last flight differs" if found.n_after == 1 else f"last {found.n_after} flights differ"
    first = found.flight + 1
    which = f"flight {first}" if found.n_after == 1 else f"flights {first} to {len(history.flights)}"
    # With the 95 % interval: in per cent where it is not about zero.
    shift = shifts[0]
    name, unit, factor = _spoken(shift.name, shift.axis, history.input_unit)
    difference, half = shift.after - shift.before, shift.half_width
    if shift.name.startswith("from ") or not abs(shift.before) > half:
        size = f"{plus_minus(factor * difference, factor * half)} {unit}"
    else:
        scale = 100.0 / abs(shift.before)
        size = f"{plus_minus(scale * difference, scale * half)} %"
    return _Story(
        head=f"may have changed: the {last} ({which}) by {size} in {name}; " + _decided_by(found),
        items=tuple(_shift_words(shift, history.input_unit) for shift in shifts),
        cause=_cause(shift.name for shift in shifts),
        drawing=_drawing(history, shifts[0].name, shifts[0].axis),
    )


def _scatter_story(history: VehicleHistory) -> _Story:
    """Say that the flights are not those of one vehicle, and what to do."""
    found, items = sorted(history.scatter, key=lambda one: one.p_value), []
    for one in found:
        # How far the flights lie apart, and how likely that is by chance.
        name, unit, factor = _spoken(one.name, one.axis, history.input_unit)
        low, high = (number(factor * value, 3) for value in (one.lowest, one.highest))
        flights = f"flights {one.first + 1} to {one.last + 1}"
        items.append(f"{name}: {low} to {high} {unit} in {flights} ({p_words(one.p_value)})")
    return _Story(
        head="flights are not of one vehicle: they scatter far beyond their intervals",
        items=tuple(items),
        cause=(
            "Two vehicles have the same name, or the vehicle was rebuilt in between. Give each its own name."
        ),
        drawing=_drawing(history, found[0].name, found[0].axis),
    )


def _decided_by(found: OpenChange) -> str:
    """Say what it takes to decide."""
    if found.n_missing:
        noun = "flight" if found.n_missing == 1 else "flights"
        return f"{_NUMBERS[found.n_missing]} more {noun} will decide"
    before = "1 flight" if found.n_before == 1 else f"{found.n_before} flights"
    return (
        f"{before} before {'is' if found.n_before == 1 else 'are'} too few to distinguish a change from bad "
        "days"
    )


def _largest_first(shifts: Sequence[Shift]) -> list[Shift]:
    return sorted(shifts, key=lambda shift: -abs(shift.after - shift.before) / shift.margin)


def _shift_words(shift: Shift, unit: str) -> str:
    """Say from what to what, and which difference would still have been chance."""
    name, unit, factor = _spoken(shift.name, shift.axis, unit)
    before, after, margin = (
        _rounded(factor * v, factor * shift.before, factor * shift.margin)
        for v in (shift.before, shift.after, shift.margin)
    )
    chance = "" if math.isnan(shift.p_value) else f"; {p_words(shift.p_value)}"
    return f"{name}: {before} to {after} {unit} (smallest detectable change {margin}{chance})"


def _outlier_story(history: VehicleHistory) -> _Story:
    """Say in what the vehicle differs from those of its model."""
    found, items = sorted(history.outliers, key=lambda one: -abs(one.value - one.typical) / one.margin), []
    for one in found:
        name, unit, factor = _spoken(one.name, one.axis, history.input_unit)
        value, typical, margin = (
            _rounded(factor * v, factor * one.typical, factor * one.margin)
            for v in (one.value, one.typical, one.margin)
        )
        items.append(f"{name}: {value} {unit}, others of the model {typical} ± {margin}")
    return _Story(
        head=f"is an outlier among {printable(history.model, 80)}",
        items=tuple(items),
        cause=_cause(one.name for one in found),
        drawing=_drawing(history, found[0].name, found[0].axis),
    )


def _rounded(value: float, centre: float, margin: float) -> str:
    """Write a value with the decimals of the interval that a margin makes around `centre`."""
    return resolved(value, centre - margin, centre + margin)


def _drawing(history: VehicleHistory, name: str, axis: str) -> Sparkline | None:
    """Draw one quantity over the vehicle's history."""
    one = history.of(name, axis)
    label, _, _ = _spoken(name, axis, history.input_unit)
    return None if one is None else sparkline(one, label, [change.flight for change in history.changes])


def _spoken(name: str, axis: str, input_unit: str) -> tuple[str, str, float]:
    """Return a quantity's name and unit for people, and the factor to it."""
    per = "per N m" if input_unit == "N m" else "per unit command"
    if name == "lag":
        return "actuator lag", "ms", 1e3
    if name == "damping":
        return f"{axis} damping", "1/s", 1.0
    if name == "gain":
        return f"{axis} effectiveness", f"rad/s² {per}", 1.0
    return f"{axis} acceleration by {name.removeprefix('from ')} torque", f"rad/s² {per}", 1.0


def _cause(names: Iterator[str] | Sequence[str]) -> str:
    """Return what the most specific of the quantities is typically a sign of."""
    heads = {name.split(" ")[0] for name in names}
    return next((cause for head, cause in _CAUSES if head in heads), "")


def headlines(fleet: Fleet) -> list[str]:
    """Return one line per change, open question and outlier."""
    lines = []
    for history in fleet.histories:
        stories = [_change_story(change, history) for change in history.changes]
        if history.open_change:
            stories.append(_open_story(history.open_change, history))
        if history.scatter:
            stories.append(_scatter_story(history))
        if history.outliers:
            stories.append(_outlier_story(history))
        lines += [
            f"{printable(history.vehicle, 80)} {story.head}: {'; '.join(story.items[:2])}"
            for story in stories
        ]
    return lines
