"""The inertia tensor from control effectiveness, where torque is known in N m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import Inertia, Parameter
from quadid_logs.identify.inference import Estimate
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, TORQUE_SYMBOLS

#: Beyond this condition number, the inverse of B is made of its errors.
_MOST_CONDITION = 1e6


def inertia_of(
    estimate: Estimate, parameters: Sequence[Parameter], given: InputDescription
) -> Inertia | None:
    """Return J = B^-1, eq. (8), of the axes whose torque is known in N m, with intervals to first order.

    dJ = -J dB J, and the elements of B are taken as independent. Of axes that
    are not calibrated, or whose gain the flight cannot tell, the tensor holds
    NaN; then J of the others is that of a vehicle without products of inertia
    with them.

    Parameters
    ----------
    estimate : Estimate
        Rows of p, q, r acceleration; the intervals already hold the
        calibration's uncertainty if the input is in N m.
    parameters : sequence of Parameter
        Of the same model: says which gains the flight can tell.
    given : InputDescription
        What the input is, and N m per unit of it where that is known.

    Returns
    -------
    Inertia, or None where no axis is calibrated or B cannot be inverted.
    """
    if given.unit == "N m":
        newton_metre, sigma = np.ones(3), np.zeros(3)
    else:
        newton_metre, sigma = (
            np.array(given.calibration.n_m_per_command),
            np.nan_to_num(np.array(given.calibration.relative_sigma)),
        )
    own = set(zip(ACCELERATION_SYMBOLS, TORQUE_SYMBOLS, strict=True))
    found = {each.target: each.identifiable for each in parameters if (each.target, each.regressor) in own}
    known = np.isfinite(newton_metre) & np.array(
        [found.get(target, False) for target in ACCELERATION_SYMBOLS], dtype=np.bool_
    )
    columns = estimate.theta.shape[1] - 3 + np.flatnonzero(known)
    if not known.any():
        return None
    rows = np.ix_(np.flatnonzero(known), columns)
    B = estimate.theta[rows] / newton_metre[known]
    if not (np.isfinite(B).all() and np.linalg.cond(B) < _MOST_CONDITION):
        return None
    half = np.nan_to_num((estimate.high - estimate.low)[rows] / 2.0, posinf=0.0) / newton_metre[known]
    half = np.hypot(half, NORMAL_95 * sigma[known] * np.abs(B))
    J = np.linalg.inv(B)
    half_J = np.sqrt(np.abs(J) ** 2 @ half**2 @ np.abs(J) ** 2)
    symmetric, half_J = 0.5 * (J + J.T), np.maximum(half_J, half_J.T)
    return Inertia(
        matrix=_spread(symmetric, known),
        ci95_low=_spread(symmetric - half_J, known),
        ci95_high=_spread(symmetric + half_J, known),
    )


def _spread(block: FloatArray, known: BoolArray) -> FloatArray:
    """Put the known block into a tensor of NaN."""
    tensor = np.full((3, 3), np.nan)
    tensor[np.ix_(known, known)] = block
    return tensor
