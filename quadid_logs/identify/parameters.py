"""What a coefficient is called, its unit, and whether the data could see it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.model import Parameter
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.structures import THROTTLED_YAW, Structure
from quadid_logs.maths.rigid_body import PRODUCTS
from quadid_logs.vocabulary import TORQUE_SYMBOLS

_GYROSCOPIC = ("qr", "pr", "pq")
_RATES = ("p", "q", "r")


class Estimate(NamedTuple):
    """theta, interval and which columns were used, each (n_targets, n_columns)."""

    theta: FloatArray
    low: FloatArray
    high: FloatArray
    kept: BoolArray


def plausible_size(structure: Structure, on_axis_gain: FloatArray) -> FloatArray:
    """Return how large each coefficient can physically be; shape (n_targets, n_columns).

    An interval wider than this says nothing. Gyroscopic coefficients lie
    within 1, because no moment of inertia exceeds the sum of the other two.
    Damping of multirotors is published at up to some 5 1/s. A cross torque
    gain is bounded by the gains of the two axes.

    Parameters
    ----------
    on_axis_gain : ndarray, shape (3,)
        |B11|, |B22|, |B33|.
    """
    size = np.full((len(structure.targets), len(structure.columns)), np.inf)
    for column, name in enumerate(structure.columns):
        if name in PRODUCTS:
            size[:, column] = 1.0
        elif name in _RATES:
            size[:, column] = 5.0
        elif name in TORQUE_SYMBOLS or name == THROTTLED_YAW:
            size[:, column] = np.max(on_axis_gain)
    return size


def build_parameters(
    structure: Structure,
    estimate: Estimate,
    *,
    input_unit: str,
    settings: IdentifySettings,
    doubts: Mapping[str, str],
) -> tuple[Parameter, ...]:
    """Name every element of A and B and say whether the data identify it.

    ``doubts`` gives the targets of whose equations nothing is identified,
    however narrow the intervals, with the reason.
    """
    n_regressors = len(structure.regressors)
    gain = np.abs(np.diag(estimate.theta[:3, n_regressors:]))
    size = plausible_size(structure, gain)
    gyroscopic = _gyroscopic_doubt(structure, estimate)
    found = []
    for row, target in enumerate(structure.targets):
        for column, regressor in enumerate(structure.columns):
            value = float(estimate.theta[row, column])
            low, high = float(estimate.low[row, column]), float(estimate.high[row, column])
            own = column == n_regressors + row
            scale = abs(value) if own else max(abs(value), min(size[row, column], _NOTABLE[_kind(regressor)]))
            reason = (
                doubts.get(target, "")
                or (gyroscopic if regressor in _GYROSCOPIC else "")
                or _doubt(
                    (high - low) / 2.0,
                    scale,
                    settings,
                    kept=bool(estimate.kept[row, column]),
                    regressor=regressor,
                )
            )
            found.append(
                Parameter(
                    name=_name(row, column, n_regressors),
                    target=target,
                    regressor=regressor,
                    value=value,
                    unit=_unit(target, regressor, input_unit),
                    ci95=(low, high),
                    identifiable=not reason,
                    reason=reason,
                )
            )
    return tuple(found)


#: A coefficient of this size changes how the vehicle flies; an interval that is
#: narrow against it is an answer even if it contains zero.
_NOTABLE = {
    "product": 0.5,
    "rate": 1.0,
    "angle": 1.0,
    "constant": np.inf,
    "torque": np.inf,
    "throttle": np.inf,
}


def _gyroscopic_doubt(structure: Structure, estimate: Estimate) -> str:
    """Return why the coefficients of qr, pr, pq are none of a rigid body, "" if they may be.

    (Iyy - Izz) / Ixx, (Izz - Ixx) / Iyy and (Ixx - Iyy) / Izz have a sum that
    is minus their product, whatever the inertias. Something else than rotation
    that goes with these products (air speed, sensor filters) breaks that.
    """
    if not all(name in structure.regressors for name in _GYROSCOPIC):
        return ""
    own = np.arange(3), np.array([structure.columns.index(name) for name in _GYROSCOPIC])
    value = estimate.theta[own]
    half_width = 0.5 * (estimate.high - estimate.low)[own]
    if not estimate.kept[own].all():
        return ""
    excess = float(abs(value.sum() + value.prod()))
    if excess <= _PRODUCTS_OF_INERTIA + float(np.linalg.norm(half_width)):
        return ""
    return (
        f"no rigid body has gyroscopic coefficients {value[0]:.2g}, {value[1]:.2g}, {value[2]:.2g}: "
        "their sum and product must cancel"
    )


#: Products of inertia of a tenth of the moments move the sum by some hundredths.
_PRODUCTS_OF_INERTIA = 0.1


def _kind(regressor: str) -> str:
    if regressor in PRODUCTS:
        return "product"
    if regressor in _RATES:
        return "rate"
    if regressor in TORQUE_SYMBOLS:
        return "torque"
    if regressor == THROTTLED_YAW:
        return "throttle"
    return "constant" if regressor == "1" else "angle"


def _doubt(half_width: float, scale: float, settings: IdentifySettings, *, kept: bool, regressor: str) -> str:
    """Return why a coefficient is not identified, "" if it is."""
    if not kept:
        return f"left out: the flight does not move {regressor} enough to see its effect"
    if not np.isfinite(half_width):
        return "its interval cannot be told"
    if half_width > settings.max_relative_ci * scale:
        return f"the 95 % interval of ±{half_width:.3g} is wide against {scale:.3g}"
    return ""


def _name(row: int, column: int, n_regressors: int) -> str:
    """Return A11, B23, ... with one-based row and column."""
    if column < n_regressors:
        return f"A{row + 1}{column + 1}"
    return f"B{row + 1}{column - n_regressors + 1}"


def _unit(target: str, regressor: str, input_unit: str) -> str:
    """Return the target's unit over the regressor's."""
    angular = target[:-4] in _RATES
    table = {
        "product": "1" if angular else "s",
        "rate": "1/s" if angular else "1",
        "angle": "1/s^2" if angular else "1/s",
        "constant": "rad/s^2" if angular else "rad/s",
        "torque": "rad/s^2" if angular else "rad/s",
        "throttle": "rad/s^2",
    }
    kind = _kind(regressor)
    if kind not in ("torque", "throttle"):
        return table[kind]
    return table[kind] if input_unit == "1" else f"{table[kind]}/({input_unit})"
