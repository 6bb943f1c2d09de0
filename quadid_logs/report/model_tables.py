"""B, A and the inertia tensor as tables, with their intervals and caveats."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Inertia, Model, Parameter, ThrustCurve
from quadid_logs.data.result import Result
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.identify.structures import STRUCTURES
from quadid_logs.maths.rotational_dynamics import PRODUCTS
from quadid_logs.report.cells import Cell, Table, interval_cell
from quadid_logs.report.numbers import estimate, number, percent
from quadid_logs.report.verdict import input_unit, refused_axes
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, regressor_words, term_words

if TYPE_CHECKING:
    from quadid_logs.simulator.published import PublishedVehicle

_HEADS = {target: f"{axis} acceleration" for target, axis in zip(ACCELERATION_SYMBOLS, AXES, strict=True)}
_B_CAPTION = "B: effect of each torque"
_A_CAPTION = "A: effect of the motion itself"
_PRODUCTS_CAPTION = "A, continued: effect of products of the rates"
#: An interval this far below the largest entry is what a tensor's inverse leaves of an exact zero.
_ROUNDING = 1e-6
#: More names with one reason are called the others.
_MOST_NAMED = 3
_DISTRUSTED = "not to be trusted"
_BY_SPEED: Final = "from the measured rotor speeds"
_WORDS = {term.symbol: term.words for structure in STRUCTURES for term in structure.terms}


def model_tables(result: Result, model: Model) -> tuple[Table, ...]:
    """Return B, A without products of rates, which seldom matter, and the inertia tensor.

    As in the equation: one row for each acceleration, one column for each torque or regressor.
    """
    unit = "N m" if input_unit(result) == "N m" else "unit of normalised command"
    refused = _refused_targets(result)
    tables = [_matrix(model, model.B, model.inputs, f"{_B_CAPTION} [rad/s² per {unit}]", refused)]
    chosen = tuple(name for name in model.regressors if name not in PRODUCTS)
    if chosen:
        caption = f"{_A_CAPTION} [rad/s² per unit of the regressor]"
        tables.append(_matrix(model, _columns(model, chosen), chosen, caption, refused))
    if model.inertia is not None:
        # The inertia tensor with its intervals; what rests on a refused axis is grey.
        distrusted = refused_axes(result)
        names = ("x", "y", "z")
        rows = tuple(
            (
                Cell(text=name, detail=_DISTRUSTED if distrusted[i] else ""),
                *(_moment(model.inertia, i, j, weak=distrusted[i] or distrusted[j]) for j in range(3)),
            )
            for i, name in enumerate(names)
        )
        tables.append(
            Table(caption="Inertia tensor about the centre of mass [kg m²]", head=("", *names), rows=rows)
        )
    return tuple(tables)


def more_tables(result: Result, model: Model) -> tuple[Table, ...]:
    """Return what only some readers look for: products of rates, published vehicles, thrust curve."""
    tables = []
    chosen = tuple(name for name in model.regressors if name in PRODUCTS)
    if chosen:
        refused = _refused_targets(result)
        tables.append(_matrix(model, _columns(model, chosen), chosen, _PRODUCTS_CAPTION, refused))
    if model.inertia is not None:
        rows = _comparison_rows(model.inertia, result.vehicle)
        tables.append(
            Table(
                caption="Compared with other vehicles [kg m²]",
                head=("vehicle", "mass [kg]", "Ixx", "Iyy", "Izz"),
                rows=tuple(
                    (
                        Cell(text=name, detail=source),
                        Cell(text=mass),
                        *(
                            Cell(text=moment, weak=place == 0 and distrusted)
                            for moment, distrusted in zip(moments, refused_axes(result), strict=True)
                        ),
                    )
                    for place, (name, mass, source, moments) in enumerate(rows)
                ),
                note="The nearest vehicle comes first. Moments grow with mass times the square of the size.",
            )
        )
    curve = result.identification.thrust_curve
    if curve is not None and curve.effectiveness.size:
        tables.append(_thrust_table(curve))
    return tuple(tables)


def _comparison_rows(inertia: Inertia, vehicle: Vehicle | None) -> list[tuple[str, str, str, list[str]]]:
    """Return name, mass, source and Ixx, Iyy, Izz in words: ours, the user's own, then the published.

    Published vehicles stand in order of their distance from ours, the mean
    ratio of the moments.
    """
    # Not at the top: it brings the whole simulator with it.
    from quadid_logs.simulator.published import PUBLISHED

    identified = np.diagonal(inertia.matrix)
    mass = vehicle.mass_kg if vehicle is not None else None
    rows = [("this flight", "–" if mass is None else number(mass, 3), "identified", _moments(identified))]
    if vehicle is not None and vehicle.inertia_kg_m2 is not None:
        given = np.diagonal(np.asarray(vehicle.inertia_kg_m2, dtype=np.float64))
        # Say about which axes the given moments lie within the identified intervals.
        low, high = np.diagonal(inertia.ci95_low), np.diagonal(inertia.ci95_high)
        known = np.isfinite(low) & np.isfinite(high) & np.isfinite(given)
        inside = known & (low <= given) & (given <= high)
        texts = []
        for words, chosen in (("within the interval", inside), ("outside the interval", known & ~inside)):
            names = [name for name, yes in zip(("Ixx", "Iyy", "Izz"), chosen, strict=True) if yes]
            if names:
                texts.append(f"{', '.join(names)} {words}")
        rows.append(
            ("given with --vehicle", rows[0][1], ("; ".join(texts) or "not comparable"), _moments(given))
        )
    # How far apart two vehicles are, over the moments that are known.
    sure = np.isfinite(identified) & (identified > 0.0)

    def distance(item: PublishedVehicle) -> float:
        if not sure.any():
            return 0.0
        return float(np.abs(np.mean(np.log(identified[sure] / np.array(item.inertia_kg_m2)[sure]))))

    for item in sorted(PUBLISHED, key=distance):
        moments = np.array(item.inertia_kg_m2)
        rows.append((item.name, number(item.mass_kg, 3), item.source, _moments(moments)))
    return rows


def _moments(values: FloatArray) -> list[str]:
    return [number(float(value), 3) for value in values]


def _thrust_table(curve: ThrustCurve) -> Table:
    """Return how the effectiveness per unit of command changes over the thrust that was flown."""
    levels = zip(curve.thrust_over_mean, curve.effectiveness, curve.effectiveness_ci95, strict=True)
    rows = tuple(
        (
            Cell(text=percent(float(thrust))),
            interval_cell(float(value), (float(low), float(high)), weak=not curve.identifiable),
        )
        for thrust, value, (low, high) in levels
    )
    unnamed = "assumed, because no parameter holds it"
    name = printable(curve.parameter, 40) or (_BY_SPEED if curve.measured else unnamed)
    if not curve.identifiable:
        sentence = (
            f"This flight does not identify the expo of the thrust curve: {printable(curve.reason)}. The "
            f"value {number(curve.assumed, 2)} was used ({name}). The intervals allow for an error in it."
        )
    else:
        value, assumed = estimate(curve.expo, *curve.ci95), f"{number(curve.assumed, 2)} ({name})"
        told = f"not {assumed}. The torque was computed with the identified expo"
        sentence = (
            f"The propellers' expo is {value}, {told if curve.corrected else f'which agrees with {assumed}'}."
        )
    return Table(
        caption="Effectiveness per unit of command against thrust",
        head=(
            "thrust divided by its mean during the manoeuvres",
            "effectiveness divided by that at the mean thrust",
        ),
        rows=rows,
        note=f"{sentence} Thrust beyond these rows was not flown.",
    )


def _refused_targets(result: Result) -> frozenset[str]:
    """Return the accelerations whose equations are not to be trusted."""
    pairs = zip(ACCELERATION_SYMBOLS, refused_axes(result), strict=True)
    return frozenset(target for target, no in pairs if no)


def _columns(model: Model, chosen: tuple[str, ...]) -> FloatArray:
    """Return the columns of A that belong to some regressors."""
    return model.A[:, [model.regressors.index(name) for name in chosen]]


def _matrix(
    model: Model, values: FloatArray, columns: tuple[str, ...], caption: str, distrusted: frozenset[str]
) -> Table:
    """Return a matrix as it stands in the equation; what belongs to refused axes is grey."""
    known = model.entries
    largest = float(np.abs(values).max(initial=0.0))
    rows = tuple(
        (
            Cell(text=_HEADS.get(target, target), detail=_DISTRUSTED if target in distrusted else target),
            *(
                replace(
                    _entry(
                        known.get((target, name)), float(values[row, column]), largest, target in distrusted
                    ),
                    name=term_words(target, name),
                )
                for column, name in enumerate(columns)
            ),
        )
        for row, target in enumerate(model.targets)
    )
    # The note says what the regressors are, which entries are no results, and why.
    words = "; ".join(filter(None, (_WORDS.get(name) for name in columns)))
    words = f"{words}." if words else ""
    refused = f"Rows marked {_DISTRUSTED!r} belong to refused axes: do not use them."
    trusted = (
        parameter
        for parameter in model.parameters
        if parameter.target not in distrusted and parameter.regressor in columns
    )
    in_words = ((name, regressor_words(name)) for name in columns)
    # Which elements are grey and why, those with the same reason together.
    reasons: dict[str, list[str]] = {}
    for parameter in trusted:
        if not parameter.identifiable:
            reasons.setdefault(printable(parameter.reason, 160), []).append(
                term_words(printable(parameter.target, 20), printable(parameter.regressor, 20))
            )
    weak_note = ""
    if reasons:
        grey = "Grey: values that this flight does not identify. Do not use them."
        longest = max(reasons, key=lambda reason: len(reasons[reason]))
        if len(reasons[longest]) > _MOST_NAMED:
            # A dozen names with one reason hide the others.
            last = reasons.pop(longest)
            reasons[longest] = ["all others"] if reasons else ["all of them"] if len(last) > 1 else last
        why = "; ".join(f"{', '.join(names)}: {reason or 'not known'}" for reason, names in reasons.items())
        weak_note = f"{grey} {'Reasons' if len(reasons) > 1 else 'Reason'}: {why}."
    return Table(
        caption=caption,
        head=("", *(name if said == name else f"{said} ({name})" for name, said in in_words)),
        rows=rows,
        note=" ".join(filter(None, (words, refused if distrusted else "", weak_note))),
    )


def _entry(parameter: Parameter | None, value: float, largest: float, distrusted: bool) -> Cell:
    """Return value and interval of one element, grey where it is no result."""
    if parameter is None:
        return Cell(text=number(value), weak=True, detail="no interval")
    if parameter.value == 0.0 and not all(map(math.isfinite, parameter.ci95)):
        return Cell(text="–", detail="left out", weak=True)
    if max(map(abs, parameter.ci95)) < _ROUNDING * largest:
        return Cell(text="0")
    return interval_cell(parameter.value, parameter.ci95, weak=distrusted or not parameter.identifiable)


def _moment(inertia: Inertia, i: int, j: int, *, weak: bool) -> Cell:
    """Return one entry of the tensor."""
    ends = float(inertia.ci95_low[i, j]), float(inertia.ci95_high[i, j])
    return interval_cell(float(inertia.matrix[i, j]), ends, weak=weak)
