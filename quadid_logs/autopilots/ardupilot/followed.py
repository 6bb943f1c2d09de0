"""What ArduPilot's harmonic notches may follow, at instants of the flight."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.instants import instants
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import Signal

#: Peaks that AP_GyroFFT follows.
_MOST_PEAKS: Final = 3

THROTTLE: Final = "throttle"
ROTORS: Final = "rotors_hz"
RPM_SENSORS: Final = ("rpm1_hz", "rpm2_hz")
PEAK: Final = "peak_hz"
PEAKS: Final = "peaks_hz"
#: Centres of each set of notches, as the notches themselves logged them.
CENTRES: Final = ("centres1_hz", "centres2_hz")

MESSAGES: Final = frozenset({"FCN", "FCNS", "FTN", "FTNS", "FTN1", "FTN2", "RPM"})
_LOGGED: Final = {
    "FCN": tuple(f"CF{number}" for number in range(1, 7)),
    "FCNS": ("CF",),
    "FTN": tuple(f"DnF{number}" for number in range(1, 5)),
    "FTNS": ("NF",),
}
LABELS: Final = frozenset(
    {*(label for labels in _LOGGED.values() for label in labels), "I", "Id", "PkAvg", "PkX", "PkY", "EnX"}
    | {"EnY", "rpm1", "rpm2", "RPM"}
)


def followed(
    tables: Mapping[str, MessageTable], signals: Mapping[str, tuple[Signal, ...]]
) -> dict[str, FloatArray]:
    """Return what the log holds of what notches follow.

    Parameters
    ----------
    tables : mapping of str to MessageTable
        `MESSAGES` as far as the log has them.
    signals : mapping of str to tuple of Signal
        Throttle [1] and rotor speed [rad/s].

    Returns
    -------
    dict of str to ndarray, shape (n_instants, n_columns)
        By the names above, the throttle [1] and frequencies [Hz]; what was never there is not in it.

    Notes
    -----
    AP_Vehicle.cpp, `update_dynamic_notch`; LogStructure of AP_GyroFFT, AP_RPM and HarmonicNotchFilter.
    """
    found: dict[str, FloatArray] = {}
    for name, signal, scale in ((THROTTLE, "throttle", 1.0), (ROTORS, "rotor_speed", 0.5 / math.pi)):
        for source in signals.get(signal, ())[:1]:
            found[name] = source.values * scale
    rpm = tables.get("RPM")
    for number, name in enumerate(RPM_SENSORS):
        # rpm1 and rpm2 until 4.6, later a row for each sensor.
        label = f"rpm{number + 1}"
        if rpm is not None and rpm.has_numbers(label):
            found[name] = _columns(rpm, (label,)) / 60.0
        elif rpm is not None and rpm.has_numbers("I", "RPM"):
            found[name] = _columns(rpm, ("RPM",), _of(rpm, "I", number)) / 60.0
    found |= dict(_peaks(tables))
    for number, name in enumerate(CENTRES):
        logged = next(_centres(tables, number), None)
        if logged is not None:
            found[name] = logged
    taken = {name: instants(values) for name, values in found.items()}
    return {name: values for name, values in taken.items() if values.size}


def _columns(table: MessageTable, labels: tuple[str, ...], rows: BoolArray | None = None) -> FloatArray:
    values = np.column_stack([table.columns[label].astype(np.float64) for label in labels])
    return values if rows is None else values[rows]


def _of(table: MessageTable, label: str, number: int) -> BoolArray:
    """Tell which rows are of a sensor or a set; all of them are of the first where none is numbered."""
    if table.has_numbers(label):
        return np.asarray(table.integers(label) == number, dtype=np.bool_)
    return np.full(table.n_rows, number == 0)


def _peaks(tables: Mapping[str, MessageTable]) -> Iterator[tuple[str, FloatArray]]:
    """Yield the peaks of the gyro's spectrum: the one that is followed, or each of three.

    AP_GyroFFT::calculate_weighted_freq_hz: roll's and pitch's, by their energies.
    """
    one, each = tables.get("FTN1"), tables.get("FTN2")
    if one is not None and one.has_numbers("PkAvg"):
        yield PEAK, _columns(one, ("PkAvg",))
    if each is None or not each.has_numbers("Id", "PkX", "PkY", "EnX", "EnY"):
        return
    labels = ("PkX", "PkY", "EnX", "EnY")
    parts = [_columns(each, labels, _of(each, "Id", peak)) for peak in range(_MOST_PEAKS)]
    parts = [part for part in parts if len(part)]
    if not parts:
        return
    n_rows = min(map(len, parts))
    weighted = []
    for part in parts:
        peaks, energies = part[:n_rows, :2], part[:n_rows, 2:]
        weights = np.where(np.all(energies > 0.0, axis=1, keepdims=True), energies, 1.0)
        weighted.append((peaks * weights).sum(axis=1) / weights.sum(axis=1))
    yield PEAKS, np.column_stack(weighted)


def _centres(tables: Mapping[str, MessageTable], number: int) -> Iterator[FloatArray]:
    """Yield the centres that a set of notches logged: FCN, FCNS by set, FTN, FTNS of the first before."""
    for name, labels in _LOGGED.items():
        table = tables.get(name)
        if table is None:
            continue
        there = tuple(label for label in labels if table.has_numbers(label))
        rows = _of(table, "I", number)
        if there and rows.any():
            values = _columns(table, there, rows)
            if np.any(np.nan_to_num(values) > 0.0):
                yield values
