"""``promise.json``: what a flight promises of the next one, written by `tune` and read by `check`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NoReturn, cast, get_args

from quadid_logs.data.closed_loop import Estimated, LoopMargins, Margins
from quadid_logs.data.health import Quantity, RotorBalance
from quadid_logs.data.off_nominal import OFF_NOMINAL, Ranges, checked
from quadid_logs.data.promise import AxisPromise, Gain, Promise, QuantityKind, VehicleQuantity
from quadid_logs.data.tuning import Limits, TuningVerdict
from quadid_logs.errors import PromiseFileError, SettingsError
from quadid_logs.report.loop_json import MARGIN_FIGURES, loops_dict
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.strict_json import fields_of, some_fields, strict_text
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

PROMISE_FILE: Final = "promise.json"
#: Minor steps add keys, a major step changes or removes one.
SCHEMA_VERSION: Final = "1.2"
_KIND: Final = "promise"
#: Ours have 20 kB.
_MOST_BYTES: Final = 1_000_000
_MOST_GAINS, _MOST_QUANTITIES, _MOST_CELLS = 100, 40, 100
_MOST_ROTORS: Final = 32
_LONGEST_TEXT: Final = 300


def promise_text(promise: Promise, provenance: Provenance) -> str:
    """Return a promise as strict JSON in ASCII."""
    balance = None
    if promise.balance is not None:
        centre = [{"value": one.value, "ci95": one.ci95} for one in promise.balance.centre]
        balance = {"centre": centre, "place": promise.balance.place}
    axes = {}
    for axis, one in promise.axes.items():
        gains = {name: gain._asdict() for name, gain in one.gains.items()}
        axes[axis] = {"verdict": one.verdict, "gains": gains, "margins": loops_dict(one.margins)}
    content: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "kind": _KIND,
        "tool": {"name": "quadid-logs", **fields_of(provenance)},
        "log": {"name": promise.log, "sha256": promise.log_sha256},
        "vehicle": {
            **some_fields(promise, "autopilot", "frame", "hardware_id", "n_cells"),
            **some_fields(promise, "throttle", "throttle_powers", "structure"),
            "quantities": [
                {"kind": one.kind.value, **some_fields(one, "axis", "command", "value", "ci95")}
                for one in promise.quantities
            ],
            "balance": balance,
        },
        "limits": promise.limits._asdict(),
        "ranges": {name: list(ends) for name, ends in promise.ranges._asdict().items()},
        "axes": axes,
    }
    return strict_text(content)


def read_promise(path: Path) -> Promise:
    """Read a promise.

    Parameters
    ----------
    path : Path
        Of the file, or of the folder that `tune` wrote it into.

    Raises
    ------
    PromiseFileError
        If there is none, or it is not what `tune` writes.
    """
    file = path / PROMISE_FILE if path.is_dir() else path
    try:
        if not file.is_file():
            raise PromiseFileError(
                f"There is no promise {printable(file)}.",
                hint="`quadid-log tune` writes promise.json into the folder with the gains of a log.",
            )
        with file.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
    except OSError as error:
        raise PromiseFileError(f"{printable(file)} cannot be read: {error.strerror}.") from error
    if len(content) > _MOST_BYTES:
        raise PromiseFileError(f"{printable(file)} is too large for a promise.", hint=_HINT)
    try:
        return _Reader(file).promise(json.loads(content))
    except (ValueError, RecursionError) as error:
        raise PromiseFileError(f"{printable(file)} is not JSON.", hint=_HINT) from error


_HINT: Final = "Give the promise.json that `quadid-log tune` wrote."


class _Reader:
    """Takes a promise apart; whatever is not as it is written ends in one error that names the key."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def promise(self, content: object) -> Promise:
        top = self._table(content, "the file")
        version = self._text(top, "schema_version")
        if top.get("kind") != _KIND:
            self._refuse("kind")
        if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
            raise PromiseFileError(
                f"{printable(self._file)} has the schema version {printable(version, 20)}. This tool reads "
                f"version {SCHEMA_VERSION}.",
                hint="Run `quadid-log tune` again on its log.",
            )
        log, vehicle = (self._table(top.get(name), name) for name in ("log", "vehicle"))
        powers = self._table(vehicle.get("throttle_powers"), "throttle_powers")
        quantities = self._list(vehicle.get("quantities"), "quantities", _MOST_QUANTITIES)
        limits = self._table(top.get("limits"), "limits")
        axes = self._table(top.get("axes"), "axes")
        n_cells = self._number(vehicle, "n_cells")
        if not 0.0 <= n_cells <= _MOST_CELLS:
            self._refuse("n_cells")
        return Promise(
            log=self._text(log, "name"),
            log_sha256=self._text(log, "sha256"),
            autopilot=self._text(vehicle, "autopilot"),
            frame=self._text(vehicle, "frame"),
            hardware_id=self._text(vehicle, "hardware_id"),
            n_cells=int(n_cells),
            throttle=self._number(vehicle, "throttle"),
            throttle_powers={axis: self._number(powers, axis) for axis in AXES if axis in powers},
            structure=self._text(vehicle, "structure"),
            quantities=tuple(self._quantity(one) for one in quantities),
            axes={axis: self._axis(axes[axis], axis) for axis in AXES if axis in axes},
            limits=Limits(*(self._number(limits, name) for name in Limits._fields)),
            ranges=self._ranges(top.get("ranges")),
            balance=self._balance(vehicle.get("balance")),
        )

    def _balance(self, content: object) -> RotorBalance | None:
        """Return the balance of the rotors, which files before version 1.2 do not have."""
        if content is None:
            return None
        table = self._table(content, "balance")
        each = [self._table(one, "centre") for one in self._list(table.get("centre"), "centre", 3)]
        rows = [self._list(one, "place", 3) for one in self._list(table.get("place"), "place", _MOST_ROTORS)]
        if len(each) != 3 or any(len(row) != 3 for row in rows):
            self._refuse("balance")
        forward, right, yaw = (
            Quantity(one.value, "1", one.ci95) for one in (self._estimated(every, "centre") for every in each)
        )
        place = [[self._finite(number, "place") for number in row] for row in rows]
        return RotorBalance(
            (forward, right, yaw), tuple((ahead, aside, spin) for ahead, aside, spin in place)
        )

    def _ranges(self, content: object) -> Ranges:
        """Return the ranges, which files of version 1.0 do not have."""
        if content is None:
            return OFF_NOMINAL
        table = self._table(content, "ranges")
        ends = [self._list(table.get(name), "ranges", 2) for name in Ranges._fields]
        numbers = [[self._finite(one, "ranges") for one in pair] for pair in ends]
        try:
            return checked(Ranges(*((low, high) for low, high in numbers)))
        except (SettingsError, ValueError):  # no range, or not two ends
            self._refuse("ranges")

    def _quantity(self, content: object) -> VehicleQuantity:
        one = self._table(content, "quantities")
        kind = self._text(one, "kind")
        if kind not in set(QuantityKind):
            self._refuse("kind of quantities")
        axis, command = (self._text(one, name) for name in ("axis", "command"))
        if not {axis, command} <= {"", *AXES}:
            self._refuse("axis of quantities")
        value = self._estimated(one, "quantities")
        return VehicleQuantity(QuantityKind(kind), axis, command, value.value, value.ci95)

    def _axis(self, content: object, axis: str) -> AxisPromise:
        one = self._table(content, axis)
        verdict = self._text(one, "verdict")
        if verdict not in get_args(TuningVerdict):
            self._refuse(f"verdict of {axis}")
        gains = self._table(one.get("gains"), "gains")
        if len(gains) > _MOST_GAINS:
            self._refuse("gains")
        told = {}
        for name, each in gains.items():
            pair = self._table(each, "gains")
            told[name] = Gain(self._number(pair, "back"), self._number(pair, "next"))
        margins = None
        if one.get("margins") is not None:
            loops = self._table(one["margins"], "margins")
            full = None if loops.get("full") is None else self._margins(loops["full"])
            margins = LoopMargins(rate=self._margins(loops.get("rate")), full=full)
        return AxisPromise(verdict=cast("TuningVerdict", verdict), gains=told, margins=margins)

    def _margins(self, content: object) -> Margins:
        one = self._table(content, "margins")
        figures = {
            name: self._open_ended(self._table(one[name], name), name)
            for name in MARGIN_FIGURES
            if one.get(name) is not None
        }
        return Margins(
            stable=one.get("stable") is True,
            stable_fraction=self._number(one, "stable_fraction"),
            extrapolated=one.get("extrapolated") is True,
            **figures,
        )

    def _estimated(self, one: Mapping[str, object], key: str) -> Estimated:
        ends = self._list(one.get("ci95"), key, 2)
        if len(ends) != 2:
            self._refuse(key)
        value, low, high = (self._finite(each, key) for each in (one.get("value"), *ends))
        if not low <= high:
            self._refuse(key)
        return Estimated(value, (low, high))

    def _open_ended(self, one: Mapping[str, object], key: str) -> Estimated:
        """Return a figure; JSON knows no infinite end of an interval, and has null for it."""
        ends = self._list(one.get("ci95"), key, 2)
        low, high = ends if len(ends) == 2 else ("", "")
        ends = [-math.inf if low is None else low, math.inf if high is None else high]
        value = self._finite(one.get("value"), key)
        numbers = [each if each in (-math.inf, math.inf) else self._finite(each, key) for each in ends]
        if not numbers[0] <= numbers[1]:
            self._refuse(key)
        return Estimated(value, (numbers[0], numbers[1]))

    def _table(self, value: object, key: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            self._refuse(key)
        return value

    def _list(self, value: object, key: str, most: int) -> list[Any]:
        if not isinstance(value, list) or len(value) > most:
            self._refuse(key)
        return value

    def _text(self, table: Mapping[str, object], key: str) -> str:
        value = table.get(key)
        if not isinstance(value, str) or len(value) > _LONGEST_TEXT:
            self._refuse(key)
        return value

    def _number(self, table: Mapping[str, object], key: str) -> float:
        return self._finite(table.get(key), key)

    def _finite(self, value: object, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._refuse(key)
        try:
            number = float(value)
        except OverflowError:
            self._refuse(key)
        if not math.isfinite(number):
            self._refuse(key)
        return number

    def _refuse(self, key: str) -> NoReturn:
        raise PromiseFileError(
            f"{printable(self._file)} is not a promise: {printable(key, 60)} has an unexpected value.",
            hint=_HINT,
        )
