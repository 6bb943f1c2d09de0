"""What a coefficient is called, its unit, and whether the data could see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Model, Parameter
from quadid_logs.identify.inference import Estimate
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import GYROSCOPIC, Term
from quadid_logs.numerals import resolved
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS

#: Explained over unexplained acceleration variance in the fitted band: R2 of 0.75.
MIN_SIGNAL_TO_NOISE: Final = 3.0
#: R2 of 0.5. Without set-points an interval holds what feedback may have taken, three times the fraction that
#: is not explained, and becomes too wide by itself where that is much. With set-points it does not, and does
#: not hold the truth in half of simulated flights in rough air whose R2 is below 0.75.
_LEAST_WITHOUT_SETPOINTS = 1.0
#: Half of the rate in the fitted band must follow from the torque over a held-out block. Where disturbances
#: move the vehicle, the torque is the controller's answer, the one-step fit stays good, and the gain is low
#: (measured in gusts without setpoints: 8 % at an R2 of 0.85 to 0.9, 10 to 16 % from 0.3 to 0.6, more below).
MIN_SIMULATED_R2: Final = 0.5
#: A coefficient whose 95 % interval has a wider half width than this is not identified.
MAX_RELATIVE_CI: Final = 0.3
_YAW = 2
#: Products of inertia of a tenth of the moments move the sum of the gyroscopic terms by some hundredths.
_PRODUCTS_OF_INERTIA = 0.1


def least_signal_to_noise(model: Model) -> float:
    """Return below which ratio of explained to unexplained acceleration an axis has no number.

    Parameters
    ----------
    model : Model

    Returns
    -------
    float
    """
    without_setpoints = model.structural is not None and not model.structural.instrumented
    return _LEAST_WITHOUT_SETPOINTS if without_setpoints else MIN_SIGNAL_TO_NOISE


def is_explained(model: Model, signal_to_noise: float, axis: int) -> bool:
    """Say whether a model explains enough of an axis: of its acceleration, or of what was commanded of it.

    Parameters
    ----------
    model : Model
    signal_to_noise : float
        Explained over unexplained acceleration of the axis.
    axis : int
        0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    bool
    """
    return signal_to_noise >= least_signal_to_noise(model) or is_commanded_explained(model, axis)


def is_commanded_explained(model: Model, axis: int) -> bool:
    """Say whether a model explains what was commanded of an axis, whatever else moved it.

    Parameters
    ----------
    model : Model
    axis : int
        0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    bool
        Never of yaw: air that hides its motion hides the reaction of the rotors, too, which then passes for
        effectiveness. Nor without set-points.
    """
    r2 = model.validation.r2_commanded.get(ACCELERATION_SYMBOLS[axis], float("nan"))
    return axis != _YAW and r2 >= MIN_SIGNAL_TO_NOISE / (1.0 + MIN_SIGNAL_TO_NOISE)


def plausible_size(structure: Structure, on_axis_gain: FloatArray) -> FloatArray:
    """Return how large each coefficient can physically be; shape (n_targets, n_columns).

    An interval wider than this says nothing.

    Parameters
    ----------
    structure : Structure
    on_axis_gain : ndarray, shape (3,)
        |B11|, |B22|, |B33|.

    Returns
    -------
    ndarray, shape (n_targets, n_columns)
    """
    sizes = [term.plausible_size(on_axis_gain) for term in structure.all_terms]
    return np.tile(np.array(sizes), (len(structure.targets), 1))


def build_parameters(
    structure: Structure, estimate: Estimate, *, input_unit: str, caveats: Mapping[str, str]
) -> tuple[Parameter, ...]:
    """Name every element of A and B and say whether the data identify it.

    Parameters
    ----------
    structure : Structure
    estimate : Estimate
        Of shape (n_targets, n_columns).
    input_unit : str
        Of L, M, N.
    caveats : mapping of str to str
        Targets of whose equations nothing is identified, however narrow the intervals, with the reason.

    Returns
    -------
    tuple of Parameter
        Row by row.
    """
    size = plausible_size(structure, np.abs(structure.on_axis(estimate.theta)))
    gyroscopic = _gyroscopic_caveat(structure, estimate)
    n_regressors = len(structure.terms)
    found = []
    for row, target in enumerate(structure.targets):
        for column, term in enumerate(structure.all_terms):
            value, low, high = (float(each[row, column]) for each in estimate[:3])
            on_axis = column == n_regressors + row
            scale = abs(value) if on_axis else max(abs(value), min(size[row, column], term.notable))
            reason = (
                caveats.get(target, "")
                or (gyroscopic if term in GYROSCOPIC else "")
                or _caveat(term, 0.5 * (high - low), scale, kept=bool(estimate.kept[row, column]))
            )
            in_A = column < n_regressors
            name = f"A{row + 1}{column + 1}" if in_A else f"B{row + 1}{column - n_regressors + 1}"
            found.append(
                Parameter(
                    name=name,
                    target=target,
                    regressor=term.symbol,
                    value=value,
                    unit=term.unit(target, input_unit),
                    ci95=(low, high),
                    identifiable=not reason,
                    reason=reason,
                    half_width=0.5 * (high - low),
                )
            )
    return tuple(found)


def with_intervals(parameters: Sequence[Parameter], estimate: Estimate) -> tuple[Parameter, ...]:
    """Return the parameters with other intervals; whether the data identify them stays as it was.

    Parameters
    ----------
    parameters : sequence of Parameter
        Row by row.
    estimate : Estimate

    Returns
    -------
    tuple of Parameter
    """
    intervals = zip(estimate.low.ravel().tolist(), estimate.high.ravel().tolist(), strict=True)
    return tuple(replace(each, ci95=ci95) for each, ci95 in zip(parameters, intervals, strict=True))


def _gyroscopic_caveat(structure: Structure, estimate: Estimate) -> str:
    """Return why the coefficients of qr, pr, pq are none of a rigid body, "" if they may be.

    (Iyy - Izz) / Ixx, (Izz - Ixx) / Iyy and (Ixx - Iyy) / Izz have a sum that
    is minus their product, whatever the inertias. Something else than rotation
    that goes with these products (air speed, sensor filters) breaks that.
    """
    if not all(term in structure.terms for term in GYROSCOPIC):
        return ""
    on_axis = np.arange(3), np.array([structure.terms.index(term) for term in GYROSCOPIC])
    value = estimate.theta[on_axis]
    half_width = 0.5 * (estimate.high - estimate.low)[on_axis]
    if not estimate.kept[on_axis].all():
        return ""
    excess = float(abs(value.sum() + value.prod()))
    if excess <= _PRODUCTS_OF_INERTIA + float(np.linalg.norm(half_width)):
        return ""
    return (
        f"no rigid body has the gyroscopic coefficients {value[0]:.2g}, {value[1]:.2g}, {value[2]:.2g}: "
        "their sum and product must cancel"
    )


def _caveat(term: Term, half_width: float, scale: float, *, kept: bool) -> str:
    """Return why a coefficient is not identified, "" if it is."""
    if not kept:
        return f"left out: the flight does not excite {term.symbol} enough to show its effect"
    if not np.isfinite(half_width):
        return "its interval cannot be computed"
    if half_width > MAX_RELATIVE_CI * scale:
        ends = -half_width, half_width
        return (
            f"the 95 % interval of ±{resolved(half_width, *ends)} is wide compared with "
            f"{resolved(scale, *ends)}"
        )
    return ""
