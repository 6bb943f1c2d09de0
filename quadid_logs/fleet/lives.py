"""The store's rows by vehicle and in order of time, with what changed and who stands out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.compare import COUPLING_FLOOR, DAMPING_FLOOR
from quadid_logs.fleet.changes import (
    Change,
    Series,
    Standing,
    Usual,
    compare_vehicles,
    count_tests,
    find_changes,
    present_value,
    usual_scatter,
)
from quadid_logs.fleet.files import rows_by_vehicle
from quadid_logs.fleet.rows import ANALYZED
from quadid_logs.vocabulary import AXES, TORQUE_SYMBOLS

#: What differs between flights of a whole vehicle, although nothing broke. A gain goes with the air's
#: density: 3.5 % per 10 degrees or 300 m of height, so 10 % between a cold day at sea level and a warm
#: one in the hills; payload and battery are in the same size.
_GAIN_FLOOR: Final = 0.10
#: Measured between manoeuvres: 1 ms [s]; rotors answer slower in thin air and on an old battery.
_LAG_FLOOR_S: Final = 0.003
_COLUMNS: Final = (
    "vehicle", "vehicle_from", "model", "status", "error", "url", "sha256", "autopilot", "frame", "firmware",
    "hardware_id", "flight", "n_flights", "axis", "verdict", "reasons", "structure", "input_unit", "started",
    "started_from", "duration_s",
    *(f"{name}{end}" for name in ("gain", "from_l", "from_m", "from_n", "damping", "lag_s")
      for end in ("", "_low", "_high")),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One flight of a vehicle; ``verdicts`` and ``reasons`` by axis."""

    url: str
    sha256: str
    number: int
    n_flights: int
    started: datetime | None
    started_from: str
    duration_s: float
    verdicts: Mapping[str, str]
    reasons: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Life:
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
    changes: tuple[Change, ...] = ()
    standings: tuple[Standing, ...] = ()

    @property
    def outliers(self) -> tuple[Standing, ...]:
        """Quantities in which it stands out now."""
        return tuple(standing for standing in self.standings if standing.stands_out)

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

    lives: tuple[Life, ...]
    failures: tuple[Failure, ...]
    n_tests: int


def read_fleet(folder: Path) -> Fleet:
    """Read a store, vehicle by vehicle, and look for changes and outliers.

    Raises
    ------
    SettingsError
        If the folder is no store.
    """
    lives, failures = [], []
    for rows in rows_by_vehicle(folder, _COLUMNS):
        flown = [row for row in rows if row["status"] == ANALYZED]
        if flown:
            lives.append(_life(flown[0]["vehicle"], flown))
        failures += [_failure(row) for row in rows if row["status"] != ANALYZED]
    lives.sort(key=lambda life: life.vehicle)
    failures.sort(key=lambda failure: failure.url)
    judged, n_tests = judge(lives)
    return Fleet(lives=judged, failures=tuple(failures), n_tests=n_tests)


def _failure(row: Mapping[str, Any]) -> Failure:
    return Failure(url=row["url"], vehicle=row["vehicle"], status=row["status"], error=row["error"] or "")


def judge(lives: Sequence[Life]) -> tuple[tuple[Life, ...], int]:
    """Return the lives with changes and standings, and how many tests the changes were corrected for."""
    all_series = [life.series for life in lives]
    n_tests, usual = count_tests(all_series), usual_scatter(all_series)
    changed = [replace(life, changes=find_changes(life.series, n_tests, usual)) for life in lives]
    standings: dict[str, list[Standing]] = {}
    for standing in _standings(changed, usual):
        standings.setdefault(standing.vehicle, []).append(standing)
    judged = tuple(replace(life, standings=tuple(standings.get(life.vehicle, ()))) for life in changed)
    return judged, n_tests


def _standings(lives: Sequence[Life], usual: Mapping[tuple[str, str], Usual]) -> Iterator[Standing]:
    """Compare vehicles of the same model, structure and unit, as they are since their last change."""
    groups: dict[tuple[str, str, str], list[Life]] = {}
    for life in lives:
        groups.setdefault((life.model, life.structure, life.input_unit), []).append(life)
    n_tests = sum(len(life.series) for life in lives)
    for group in groups.values():
        for name, axis in dict.fromkeys((one.name, one.axis) for life in group for one in life.series):
            present, floors = {}, []
            for life in group:
                one = life.of(name, axis)
                if one is not None:
                    since = life.changes[-1].flight if life.changes else 0
                    present[life.vehicle] = present_value(one, since, usual.get((name, axis), Usual()))
                    floors.append(one.floor)
            floor = float(np.median(floors))
            yield from compare_vehicles(present, name=name, axis=axis, floor=floor, n_tests=n_tests)


def _life(vehicle: str, rows: list[dict[str, Any]]) -> Life:
    """Put one vehicle's rows in order."""
    by_flight: dict[tuple[Any, ...], dict[str, dict[str, Any]]] = {}
    for row in rows:
        # Flights whose date nobody knows come first, in the order of their names.
        order = (row["started"] is not None, row["started"], row["url"], row["flight"])
        by_flight.setdefault(order, {})[row["axis"]] = row
    ordered = [by_flight[key] for key in sorted(by_flight)]
    kinds = Counter((row["structure"], row["input_unit"]) for row in rows if row["gain"] is not None)
    structure, unit = kinds.most_common(1)[0][0] if kinds else ("", "")
    last = ordered[-1][AXES[0]]
    return Life(
        vehicle=vehicle,
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


def _flight(rows: Mapping[str, dict[str, Any]]) -> Flight:
    """Collect what the three axes share, and their verdicts."""
    row = rows[AXES[0]]
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
    )


def _series(flights: Sequence[Mapping[str, dict[str, Any]]], structure: str, unit: str) -> Iterator[Series]:
    """Yield the quantities over all flights; a refused axis tells nothing."""
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
        yield _one("gain", axis, gains[axis], _GAIN_FLOOR * scale[axis])
        for torque, other in zip(TORQUE_SYMBOLS, AXES, strict=True):
            if other != axis:
                coupling = _column(usable, axis, f"from_{torque.lower()}")
                yield _one(f"from {other}", axis, coupling, COUPLING_FLOOR * max(scale[axis], scale[other]))
        damping = _column(usable, axis, "damping")
        yield _one("damping", axis, damping, DAMPING_FLOOR * _typical(damping[0]))
    lag = _column([{"": next(iter(rows.values()))} if rows else {} for rows in usable], "", "lag_s")
    yield _one("lag", "", lag, _LAG_FLOOR_S)


def _one(name: str, axis: str, known: tuple[FloatArray, FloatArray], floor: float) -> Series:
    value, half_width = known
    return Series(name=name, axis=axis, value=value, half_width=half_width, floor=floor)


def _column(
    flights: Sequence[Mapping[str, dict[str, Any]]], axis: str, name: str
) -> tuple[FloatArray, FloatArray]:
    """Return value and half-width over the flights, NaN where a flight does not tell it."""

    def number(rows: Mapping[str, dict[str, Any]], column: str) -> float:
        value = rows[axis][column] if axis in rows else None
        return float("nan") if value is None else float(value)

    value, low, high = (
        np.array([number(rows, f"{name}{end}") for rows in flights]) for end in ("", "_low", "_high")
    )
    return value, 0.5 * (high - low)


def _typical(value: FloatArray) -> float:
    """Return the median size of what is known, 0 where nothing is."""
    known = np.abs(value[np.isfinite(value)])
    return float(np.median(known)) if known.size else 0.0
