"""What no flight can tell better, because the sensors themselves are no better."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import products_mixed

#: Scale and cross-axis sensitivity of a MEMS gyro are specified to 1 to 2 %, in 95 of 100 parts
#: better than this. No flight can tell: it is added in squares to every interval.
GYRO_SYSTEMATIC: Final = 0.01


def systematic_half_width(structure: Structure, theta: FloatArray, *, knows_gyro: bool = False) -> FloatArray:
    """Return how far each coefficient may be off because of sensors and linearisation; shape of `theta`.

    Parameters
    ----------
    structure : Structure
        Whose targets begin with the three accelerations.
    theta : ndarray, shape (n_targets, n_columns)
        [A B].
    knows_gyro : bool
        The fit had the gyro's errors among its unknowns, so its intervals know of them already.

    Returns
    -------
    ndarray, shape (n_targets, n_columns)
    """
    terms = structure.all_terms
    fraction = [[term.systematic_fraction(target) for term in terms] for target in structure.targets]
    of_terms = np.array(fraction) * np.abs(theta)
    return of_terms if knows_gyro else np.hypot(of_terms, gyro_half_width(structure, theta))


def gyro_half_width(structure: Structure, theta: FloatArray) -> FloatArray:
    """Return how far each coefficient may be off because of the gyro; like `theta` (n_targets, n_columns).

    A gyro measures (I + E) w, with E of scale errors and cross-axis
    sensitivities. For such rates B becomes (I + E) B, the damping (I + E) A
    (I + E)^-1, and the gyroscopic terms (I + E) G K, where K turns products of
    measured rates into those of true ones: see `terms.Family`. Each of the nine
    entries of E is taken by itself, and the effects are added in squares.

    Parameters
    ----------
    structure : Structure
    theta : ndarray, shape (n_targets, n_columns)
        [A B], the targets beginning with the three accelerations.

    Returns
    -------
    ndarray, shape (n_targets, n_columns)
    """
    symbols = structure.columns
    found = np.zeros(theta.shape)
    families = {term.family for term in structure.all_terms if term.family is not None}
    for a, b in np.ndindex(3, 3):
        E = np.zeros((3, 3))
        E[a, b] = GYRO_SYSTEMATIC
        for family in families:
            known = [number for number, symbol in enumerate(family.symbols) if symbol in symbols]
            own = [symbols.index(family.symbols[number]) for number in known]
            whole = np.zeros((3, len(family.symbols)))
            whole[:, known] = theta[:3, own]
            change = (np.eye(3) + E) @ whole @ family.mixing(_undone(E)) - whole
            found[:3, own] = np.hypot(found[:3, own], change[:, known])
    return found


def as_measured(E: FloatArray, gyroscopic: FloatArray, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return gyroscopic terms and damping as they are for rates measured as (I + E) w.

    All targets are multiplied by I + E besides.

    Parameters
    ----------
    E : ndarray, shape (..., 3, 3)
        Scale and cross-axis errors of the gyro.
    gyroscopic, damping : ndarray, shape (..., 3, 6) and (..., 3, 3)

    Returns
    -------
    gyroscopic, damping : ndarray, shape (..., 3, 6) and (..., 3, 3)
    """
    back = _undone(E)
    return gyroscopic @ products_mixed(back), damping @ back


def _undone(E: FloatArray) -> FloatArray:
    """Return what turns measured rates into true ones; shape (..., 3, 3)."""
    return np.asarray(np.linalg.inv(np.eye(3) + E), dtype=np.float64)
