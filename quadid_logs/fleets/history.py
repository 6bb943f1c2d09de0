"""Vehicle histories: the store's rows by vehicle and in order of time, with change points and outliers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.comparison import COUPLING_SPREAD
from quadid_logs.control.next_flight import DAMPING_SPREAD
from quadid_logs.fleets.changes import (
    MIN_RUN,
    ChangePoint,
    OpenChange,
    OutlierTest,
    ScatterPrior,
    Series,
    compare_vehicles,
    count_tests,
    find_changes,
    find_open_change,
    present_throttle,
    present_value,
    scatter_prior,
)
from quadid_logs.fleets.coverage import Coverage, coverage_of
from quadid_logs.fleets.disagreement import Scatter, find_disagreements, n_disagreement_tests
from quadid_logs.fleets.naming import MODIFICATION, number_in
from quadid_logs.fleets.rows import ANALYZED
from quadid_logs.fleets.store import SetAside, read_rows
from quadid_logs.vocabulary import AXES, TORQUE_SYMBOLS

#: Systematic uncertainty between flights of an undamaged vehicle. A gain goes with the air's
#: density: 3.5 % per 10 degrees or 300 m of height, so 10 % between a cold day at sea level and a warm
#: one in the hills; payload and battery are in the same size.
_GAIN_SYSTEMATIC: Final = 0.10
#: Measured between manoeuvres: 1 ms [s]; rotors answer slower in thin air and on an old battery.
_LAG_SYSTEMATIC_S: Final = 0.003
_COLUMNS: Final = (
    "vehicle", "vehicle_from", "model", "status", "error", "url", "sha256", "autopilot", "frame", "firmware",
    "hardware_id", "flight", "n_flights", "axis", "verdict", "reasons", "structure", "input_unit", "started",
    "started_from", "duration_s", "throttle", "gain_margin_db", "phase_margin_deg", "faults", "faults_found",
    *(f"{name}{end}" for name in ("gain", "from_l", "from_m", "from_n", "damping", "lag_s")
      for end in ("", "_low", "_high")),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One flight of a vehicle; ``verdicts``, ``reasons`` and ``margins`` [dB, degrees] by axis.

    ``faults`` are the codes of what rotors and sensors show, ``faults_found`` says it in words.
    """

    url: str
    sha256: str
    number: int
    n_flights: int
    started: datetime | None
    started_from: str
    duration_s: float
    verdicts: Mapping[str, str]
    reasons: Mapping[str, tuple[str, ...]]
    margins: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    faults_found: str = ""

    @property
    def is_dated(self) -> bool:
        """Whether the log or its name says when it flew; the date of a copied file does not."""
        return self.started is not None and self.started_from != MODIFICATION


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleHistory:
    """A vehicle's flights in order of time, its quantities over them, and what was found.

    ``series`` are as logged (gains in rad/s^2 per unit of torque); ``structure`` and
    ``input_unit`` are what most of its flights have: only these are in `series`.
    """

    vehicle: str
    vehicle_from: str
    model: str
    frame: str
    firmware: str
    hardware_id: str
    structure: str
    input_unit: str
    flights: tuple[Flight, ...]
    series: tuple[Series, ...]
    changes: tuple[ChangePoint, ...] = ()
    open_change: OpenChange | None = None
    scatter: tuple[Scatter, ...] = ()
    outlier_tests: tuple[OutlierTest, ...] = ()

    @property
    def outliers(self) -> tuple[OutlierTest, ...]:
        """Quantities in which it is an outlier now."""
        return tuple(test for test in self.outlier_tests if test.is_outlier)

    @property
    def n_known(self) -> int:
        """Flights in which the best known quantity was identifiable."""
        return max((len(one.known) for one in self.series), default=0)

    @property
    def can_show_change(self) -> bool:
        """Whether there are enough flights for any change to be found."""
        return self.n_known >= 2 * MIN_RUN

    def of(self, name: str, axis: str) -> Series | None:
        """Return one series."""
        return next((one for one in self.series if (one.name, one.axis) == (name, axis)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """A log that gave nothing."""

    url: str
    vehicle: str
    status: str
    error: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """Everything that a page about the fleet shows."""

    histories: tuple[VehicleHistory, ...]
    failures: tuple[Failure, ...]
    n_tests: int
    set_aside: tuple[SetAside, ...] = ()

    @property
    def coverage(self) -> Coverage:
        """How many axes of all flights are usable, and what blocks the others."""
        return coverage_of(
            (verdict, flight.reasons.get(axis, ()), 1)
            for history in self.histories
            for flight in history.flights
            for axis, verdict in flight.verdicts.items()
        )


def read_fleet(folder: Path) -> Fleet:
    """Read a store, vehicle by vehicle, and look for changes and outliers.

    Parameters
    ----------
    folder : Path
        The store; a run may write into it meanwhile.

    Raises
    ------
    SettingsError
        If the folder is no store, or is damaged.
    """
    histories, failures = [], []
    set_aside: list[SetAside] = []
    for _, group in groupby(read_rows(folder, _COLUMNS, set_aside.append), itemgetter("vehicle")):
        rows = list(group)
        flown = [row for row in rows if row["status"] == ANALYZED]
        if flown:
            by_flight: dict[tuple[str, str, int], dict[str, dict[str, Any]]] = {}
            for row in flown:
                # Two logs may have one name where only their names are known.
                by_flight.setdefault((row["url"], row["sha256"], row["flight"]), {})[row["axis"]] = row
            ordered = _in_order(list(by_flight.values()))
            kinds = Counter((row["structure"], row["input_unit"]) for row in flown if row["gain"] is not None)
            structure, unit = kinds.most_common(1)[0][0] if kinds else ("", "")
            last = _any_axis(ordered[-1])
            histories.append(
                VehicleHistory(
                    vehicle=flown[0]["vehicle"],
                    vehicle_from=last["vehicle_from"] or "",
                    model=last["model"] or "",
                    frame=last["frame"] or "",
                    firmware=last["firmware"] or "",
                    hardware_id=last["hardware_id"] or "",
                    structure=structure,
                    input_unit=unit,
                    flights=tuple(map(_flight, ordered)),
                    series=tuple(_series(ordered, structure, unit)),
                )
            )
        failures += [
            Failure(url=row["url"], vehicle=row["vehicle"], status=row["status"], error=row["error"] or "")
            for row in rows
            if row["status"] != ANALYZED
        ]
    histories.sort(key=lambda history: history.vehicle)
    failures.sort(key=lambda failure: failure.url)
    all_series = [history.series for history in histories]
    prior = scatter_prior(all_series)
    n_tests = count_tests(all_series) + n_disagreement_tests(all_series)
    changed = [_with_changes(history, n_tests, prior) for history in histories]
    outlier_tests: dict[str, list[OutlierTest]] = {}
    for test in _outlier_tests(changed, prior):
        outlier_tests.setdefault(test.vehicle, []).append(test)
    return Fleet(
        histories=tuple(
            replace(history, outlier_tests=tuple(outlier_tests.get(history.vehicle, ())))
            for history in changed
        ),
        failures=tuple(failures),
        n_tests=n_tests,
        set_aside=tuple(set_aside),
    )


def _with_changes(
    history: VehicleHistory, n_tests: int, prior: Mapping[tuple[str, str], ScatterPrior]
) -> VehicleHistory:
    """Return a history with its changes, and with what the last flights leave open."""
    changes = find_changes(history.series, n_tests, prior)
    since = changes[-1].flight if changes else 0
    still_open = find_open_change(history.series, since, n_tests, prior)
    ends = {0, *(change.flight for change in changes), len(history.flights)}
    ends |= {still_open.flight} if still_open else set()
    others = find_disagreements(history.series, sorted(ends), n_tests, prior)
    return replace(
        history,
        changes=tuple(sorted((*changes, *others.changes), key=lambda change: change.flight)),
        open_change=still_open or others.open_change,
        scatter=others.scatter,
    )


def _outlier_tests(
    histories: Sequence[VehicleHistory], prior: Mapping[tuple[str, str], ScatterPrior]
) -> Iterator[OutlierTest]:
    """Compare vehicles of the same model, structure and unit, as they are since their last change."""
    groups: dict[tuple[str, str, str], list[VehicleHistory]] = {}
    for history in histories:
        groups.setdefault((history.model, history.structure, history.input_unit), []).append(history)
    n_tests = sum(len(history.series) for history in histories)
    for group in groups.values():
        for name, axis in dict.fromkeys((one.name, one.axis) for history in group for one in history.series):
            present, systematic, throttle = {}, [], {}
            for history in group:
                one = history.of(name, axis)
                if one is not None:
                    since = history.changes[-1].flight if history.changes else 0
                    scatter = prior.get((name, axis), ScatterPrior())
                    present[history.vehicle] = present_value(one, since, scatter)
                    systematic.append(one.systematic)
                    throttle[history.vehicle] = present_throttle(one, since)
            yield from compare_vehicles(
                present,
                name=name,
                axis=axis,
                systematic=float(np.median(systematic)),
                n_tests=n_tests,
                throttle=throttle,
            )


def _any_axis(rows: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the row of one axis, for what all share."""
    return next(iter(rows.values()))


def _in_order(flights: list[dict[str, dict[str, Any]]]) -> list[dict[str, dict[str, Any]]]:
    """Put flights in order: by the log's own date, then by its number, and by the file's date at last.

    A number counts up with the dated logs beside it, so that a log without a
    date comes after the last dated one of a smaller number. The date of a file
    is mostly that of a copy, and decides only between logs that have nothing else.
    """
    dated, numbered, rest = [], [], []
    for rows in flights:
        row = _any_axis(rows)
        number = number_in(row["url"])
        place = (row["url"], row["flight"])
        if row["started"] is not None and row["started_from"] != MODIFICATION:
            dated.append((row["started"], place, number, rows))
        elif number is not None:
            numbered.append((number, place, rows))
        else:
            # What has no date at all comes first, in the order of the names.
            rest.append((row["started"] is not None, row["started"], place, rows))
    dated.sort(key=itemgetter(0, 1))
    ordered = [(number, rows) for _, _, number, rows in dated]
    for number, _, rows in sorted(numbered, key=itemgetter(0, 1)):
        before = [k for k, (other, _) in enumerate(ordered) if other is not None and other <= number]
        ordered.insert(before[-1] + 1 if before else 0, (number, rows))
    rest.sort(key=itemgetter(0, 1, 2))
    return [rows for *_, rows in rest] + [rows for _, rows in ordered]


def _flight(rows: Mapping[str, dict[str, Any]]) -> Flight:
    """Collect what the three axes share, and their verdicts."""
    row = _any_axis(rows)
    return Flight(
        url=row["url"],
        sha256=row["sha256"],
        number=row["flight"],
        n_flights=row["n_flights"],
        started=row["started"],
        started_from=row["started_from"] or "",
        duration_s=row["duration_s"],
        verdicts={axis: one["verdict"] for axis, one in rows.items()},
        reasons={axis: tuple(one["reasons"] or ()) for axis, one in rows.items()},
        faults=tuple((row["faults"] or "").split()),
        faults_found=row["faults_found"] or "",
        margins={
            axis: pair
            for axis, one in rows.items()
            if (pair := (one["gain_margin_db"], one["phase_margin_deg"])) != (None, None)
        },
    )


def _series(flights: Sequence[Mapping[str, dict[str, Any]]], structure: str, unit: str) -> Iterator[Series]:
    """Yield the quantities over all flights; refused axes are left out."""
    usable = [
        {
            axis: row
            for axis, row in rows.items()
            if row["verdict"] != "refused" and (row["structure"], row["input_unit"]) == (structure, unit)
        }
        for rows in flights
    ]
    gains = {axis: _column(usable, axis, "gain") for axis in AXES}
    scale = {axis: _typical(gains[axis][0]) for axis in AXES}
    for axis in AXES:
        gain = _one("gain", axis, gains[axis], _GAIN_SYSTEMATIC * scale[axis])
        # What yaw answers comes from the rotors' drag, which grows with the throttle.
        yield replace(gain, throttle=_numbers(usable, axis, "throttle")) if axis == "yaw" else gain
        for torque, other in zip(TORQUE_SYMBOLS, AXES, strict=True):
            if other != axis:
                coupling = _column(usable, axis, f"from_{torque.lower()}")
                yield _one(f"from {other}", axis, coupling, COUPLING_SPREAD * max(scale[axis], scale[other]))
        damping = _column(usable, axis, "damping")
        yield _one("damping", axis, damping, DAMPING_SPREAD * _typical(damping[0]))
    lag = _column([{"": next(iter(rows.values()))} if rows else {} for rows in usable], "", "lag_s")
    yield _one("lag", "", lag, _LAG_SYSTEMATIC_S)


def _one(name: str, axis: str, known: tuple[FloatArray, FloatArray], systematic: float) -> Series:
    value, half_width = known
    return Series(name=name, axis=axis, value=value, half_width=half_width, systematic=systematic)


def _column(
    flights: Sequence[Mapping[str, dict[str, Any]]], axis: str, name: str
) -> tuple[FloatArray, FloatArray]:
    """Return value and half-width over the flights, NaN where it was not identifiable."""
    value, low, high = (_numbers(flights, axis, f"{name}{end}") for end in ("", "_low", "_high"))
    return value, 0.5 * (high - low)


def _numbers(flights: Sequence[Mapping[str, dict[str, Any]]], axis: str, column: str) -> FloatArray:
    """Return one column over the flights, NaN where it is empty."""
    values = [rows[axis][column] if axis in rows else None for rows in flights]
    return np.array([math.nan if value is None else float(value) for value in values])


def _typical(value: FloatArray) -> float:
    """Return the median size of what is known, 0 where nothing is."""
    known = np.abs(value[np.isfinite(value)])
    return float(np.median(known)) if known.size else 0.0
