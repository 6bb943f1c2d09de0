"""The table of a fleet: one row per log, flight and axis, and one for a log that gave nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, get_args

from quadid_logs.control.room import whole
from quadid_logs.data.diagnosis import Verdict
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Model
from quadid_logs.data.result import Result
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.naming import Identity, NamingRules, clock_zero, identify_unread, identify_vehicle
from quadid_logs.tuning import shaping_gains
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS, TORQUE_SYMBOLS

if TYPE_CHECKING:
    import pyarrow as pa

#: What became of a log: analyzed (whatever the verdict), unreadable (it will never be read), or lost
#: (it could not be fetched, or killed the worker: the next run tries again).
ANALYZED, UNREADABLE, LOST = "analyzed", "unreadable", "lost"

#: Estimated quantities: value, and low and high end of the 95 % interval. Null where the flight does
#: not identify them. `gain` is the on-axis control effectiveness, `from_l` to `from_n` the whole row of B.
QUANTITIES: Final = ("gain", "from_l", "from_m", "from_n", "damping", "trim", "lag_s", "delay_s")
#: Of the whole loop as it flew, with intervals likewise: of runs with margins alone. Zero where the loop of
#: the estimate is unstable, null where it is not known or does not have the figure.
MARGINS: Final = ("gain_margin_db", "phase_margin_deg", "disk_margin")
_TEXTS: Final = (
    "vehicle", "vehicle_from", "model", "status", "error", "url", "sha256", "version",
    "format", "autopilot", "firmware", "vehicle_type", "frame", "hardware_id", "started_from",
    "axis", "verdict", "sentence", "structure", "input_unit", "gains", "faults", "faults_found",
)  # fmt: skip
_NUMBERS: Final = (
    "start_s", "duration_s", "analyzed_s", "throttle", "condition_number", "r2", "run_s", "limited_fraction",
    "mass_forward", "mass_right",
    *(f"{name}{end}" for name in (*QUANTITIES, *MARGINS) for end in ("", "_low", "_high")),
)  # fmt: skip
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
#: Columns that a store of the format before this one lacks.
ADDED: Final = frozenset(
    {
        "gains",
        "limited_fraction",
        "faults",
        "faults_found",
        "mass_forward",
        "mass_right",
        *(f"{name}{end}" for name in MARGINS for end in ("", "_low", "_high")),
    }
)
#: Columns that differ between two runs over the same files.
RUN_COLUMNS: Final = ("run_s",)
#: The columns of the store in order, with SQLite's types: ``started`` is UTC in ISO 8601, ``reasons`` a
#: JSON list, ``gains`` a JSON object of parameters, everything else SI, or as its name says.
COLUMNS: Final[Mapping[str, str]] = {
    **dict.fromkeys(_TEXTS, "TEXT"),
    **dict.fromkeys(("n_bytes", "flight", "n_flights"), "INTEGER"),
    **dict.fromkeys(("started", "reasons"), "TEXT"),
    **dict.fromkeys(_NUMBERS, "REAL"),
}
_TYPES: Final[Mapping[str, tuple[type, ...]]] = {"TEXT": (str,), "INTEGER": (int,), "REAL": (float, int)}
#: What every row of an analyzed axis has.
_NEEDED: Final = ("flight", "n_flights", "duration_s", "reasons")


#: No quantity of ours is larger; squares of it are still numbers.
_LARGEST: Final = 1e60
_VERDICTS: Final = frozenset(get_args(Verdict))


class ForeignRowError(Exception):
    """A row of a store that none of our runs has written."""


def decode(row: dict[str, Any]) -> None:
    """Turn a row as the store keeps it into one as the worker made it, in place.

    Parameters
    ----------
    row : dict
        With all keys of `COLUMNS`.

    Raises
    ------
    ForeignRowError
        If a value cannot be one of ours: the file is damaged, or another program wrote into it.
    """
    for name, kind in COLUMNS.items():
        value: Any = row[name]
        if value is None:
            continue
        is_huge = isinstance(value, (int, float)) and not abs(value) < _LARGEST
        if is_huge or not isinstance(value, _TYPES[kind]):
            raise ForeignRowError(f"{name} is {printable(repr(value), 60)}")
    for name, read in (("started", datetime.fromisoformat), ("reasons", _read_codes)):
        try:
            row[name] = None if row[name] is None else read(row[name])
        except (ValueError, RecursionError) as error:
            raise ForeignRowError(f"{name} is {printable(repr(row[name]), 60)}") from error
    of_axis: dict[str, frozenset[str | None]] = {"axis": frozenset(AXES), "verdict": _VERDICTS}
    words = {
        "status": frozenset({ANALYZED, UNREADABLE, LOST}),
        **(of_axis if row["status"] == ANALYZED else {}),
    }
    for name, allowed in words.items():
        if row[name] not in allowed:
            raise ForeignRowError(f"{name} is {printable(repr(row[name]), 60)}")
    needed = ("vehicle", "url", "sha256", *(_NEEDED if row["status"] == ANALYZED else ()))
    if missing := [name for name in needed if row[name] is None]:
        raise ForeignRowError(f"it has no {missing[0]}")
    if row["started"] is not None and row["started"].tzinfo is None:
        raise ForeignRowError("started has no time zone")


def _read_codes(text: str) -> list[str]:
    """Read a list of codes.

    Raises
    ------
    ValueError
        If it is none.
    """
    codes = json.loads(text)
    if not isinstance(codes, list) or not all(isinstance(code, str) for code in codes):
        raise ValueError
    return codes


def schema() -> pa.Schema:
    """Return the columns as Arrow's types."""
    import pyarrow as pa

    types = {"TEXT": pa.string(), "INTEGER": pa.int64(), "REAL": pa.float64()}
    special = {
        "flight": pa.int32(),
        "n_flights": pa.int32(),
        "started": pa.timestamp("us", tz="UTC"),
        "reasons": pa.list_(pa.string()),
    }
    return pa.schema([(name, special.get(name, types[kind])) for name, kind in COLUMNS.items()])


def failure_row(file: LogFile, sha256: str, rules: NamingRules, *, status: str, error: str) -> dict[str, Any]:
    """Return the row of a log that gave nothing.

    Parameters
    ----------
    sha256 : str
        Of its content, "" if that was never seen.
    status : str
        `UNREADABLE` or `LOST`.

    Returns
    -------
    dict
        With the keys of `COLUMNS`, fewer where nothing is known.
    """
    return {
        **_file_part(file, sha256, identify_unread(file, rules)),
        "status": status,
        "error": printable(error, 600),
        "reasons": [],
    }


def result_rows(
    results: Sequence[Result], file: LogFile, sha256: str, rules: NamingRules
) -> list[dict[str, Any]]:
    """Return the rows of an analyzed log, by flight and axis.

    Parameters
    ----------
    results : sequence of Result
        One per flight.
    sha256 : str
        Of the log's content.

    Returns
    -------
    list of dict
        With the keys of `COLUMNS`, fewer where nothing is known.
    """
    n_flights = len(results[0].data.flights) if len(results) == 1 else len(results)
    rows: list[dict[str, Any]] = []
    log: FlightLog | None = None
    zero_s, shared = math.nan, dict[str, Any]()
    for flight, result in enumerate(results):
        if result.log is not log:  # a file may hold several
            log = result.log
            zero_s, started_from = clock_zero(log, result.data.start_s, file)
            identity = identify_vehicle(log, file, rules, sha256)
            shared = {
                **_file_part(file, sha256, identity),
                "status": ANALYZED,
                "format": log.format,
                "autopilot": log.autopilot,
                "firmware": printable(log.firmware),
                "vehicle_type": log.vehicle_type,
                "frame": printable(log.frame),
                "hardware_id": printable(log.hardware_id),
                "started_from": started_from,
            }
        # Start and duration of the flight [s], of the log where it did not fly.
        flights = result.data.flights
        start_s, duration_s = (
            (_finite(result.data.start_s) or 0.0, _finite(result.data.duration_s) or 0.0)
            if not flights
            else (flights[0][0], flights[-1][1] - flights[0][0])
        )
        when = zero_s + start_s
        health = result.health
        topics = () if health is None else (health.rotors, health.vibration)
        there = [topic for topic in topics if topic is not None]
        rotors = None if health is None else health.rotors
        faults: dict[str, Any] = {}
        if there:
            codes = [code for topic in there for code in topic.findings]
            offset = None if rotors is None else rotors.mass_offset
            faults = {
                "faults": " ".join(dict.fromkeys(codes)),
                "faults_found": printable(" ".join(topic.sentence for topic in there if topic.findings), 600),
                "mass_forward": None if offset is None else _finite(offset[0].value),
                "mass_right": None if offset is None else _finite(offset[1].value),
            }
        part = {
            "n_flights": n_flights,
            "flight": flight,
            "start_s": start_s,
            "duration_s": duration_s,
            "started": _EPOCH + timedelta(microseconds=round(when * 1e6)) if 0.0 < when < 4e9 else None,
            "throttle": _finite(result.data.mean_throttle) or None,
            "run_s": result.timings_s["total"],
            **faults,
        }
        rows += [{**shared, **part, **_axis_part(result, number)} for number in range(len(AXES))]
    return rows


def judged_as(rows: Sequence[Mapping[str, Any]], told: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with the verdicts of others about the same flight.

    Numbers of an axis that its own verdict refused are left out, whatever the other one says.

    Parameters
    ----------
    rows, told : sequence of mapping
        By axis, in the same order.
    """
    nothing = {f"{name}{end}": None for name in (*QUANTITIES, *MARGINS) for end in ("", "_low", "_high")}
    return [
        {
            **row,
            **(nothing if row["verdict"] == "refused" else {}),
            **{name: other[name] for name in ("verdict", "reasons", "sentence")},
        }
        for row, other in zip(rows, told, strict=True)
    ]


def _file_part(file: LogFile, sha256: str, identity: Identity) -> dict[str, Any]:
    """Return what is known of every file."""
    return {
        "vehicle": printable(identity.vehicle, 200),
        "vehicle_from": identity.vehicle_from,
        "model": printable(identity.model, 200),
        "url": file.name,
        "sha256": sha256,
        "n_bytes": file.n_bytes,
        "version": __version__,
    }


def _axis_part(result: Result, number: int) -> dict[str, Any]:
    """Return verdict and numbers of one axis."""
    axis, model = AXES[number], result.identification.recommended
    verdict = result.diagnosis.axes[axis]
    found: dict[str, Any] = {
        "axis": axis,
        "verdict": verdict.verdict,
        "reasons": list(verdict.reasons),
        "sentence": printable(verdict.sentence, 400),
        "analyzed_s": sum(segment.end_s - segment.start_s for segment in result.data.segments),
    }
    # The gains and filters that flew, and the margins of the whole loop, as far as they are known.
    gains = shaping_gains(result, axis)
    if gains:
        found["gains"] = json.dumps(gains)
    loop = result.loop_of(axis)
    if loop is not None and loop.margins is not None:
        margins = whole(loop.margins)
        for name in MARGINS:
            figure = getattr(margins, name)
            if not margins.stable:
                found |= {f"{name}{end}": 0.0 for end in ("", "_low", "_high")}
            elif figure is not None:
                found |= dict(_three(name, *figure))
    if model is None or result.data.input is None:
        return found
    return found | {
        "structure": model.structure,
        "input_unit": result.data.input.unit,
        "limited_fraction": result.data.input.limited_fraction[number],
        "condition_number": _finite(model.condition_number),
        "r2": _finite(model.validation.r2_acceleration.get(ACCELERATION_SYMBOLS[number], math.nan)),
        **dict(_quantities(model, number)),
    }


def _quantities(model: Model, number: int) -> Iterator[tuple[str, float | None]]:
    """Yield value, low and high of everything that was identified about one axis."""
    target = ACCELERATION_SYMBOLS[number]
    names = {TORQUE_SYMBOLS[number]: ["gain"], RATE_SYMBOLS[number]: ["damping"], "1": ["trim"]}
    for symbol in TORQUE_SYMBOLS:
        names.setdefault(symbol, []).append(f"from_{symbol.lower()}")
    for parameter in model.parameters:
        if parameter.target == target and parameter.identifiable:
            for name in names.get(parameter.regressor, ()):
                yield from _three(name, parameter.value, parameter.ci95)
    if model.actuator is not None:
        yield from _three("lag_s", model.actuator.lag_s, model.actuator.lag_ci95_s)
        yield from _three("delay_s", model.actuator.delay_s, model.actuator.delay_ci95_s)


def _three(name: str, value: float, ci95: tuple[float, float]) -> Iterator[tuple[str, float | None]]:
    """Yield a value and its interval; null for what is not finite."""
    yield name, _finite(value)
    yield f"{name}_low", _finite(ci95[0])
    yield f"{name}_high", _finite(ci95[1])


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
