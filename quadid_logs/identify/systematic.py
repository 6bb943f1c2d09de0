"""What no flight can tell better, because the sensors themselves are no better."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.structures import Structure
from quadid_logs.maths.rigid_body import PRODUCTS
from quadid_logs.vocabulary import RATE_SYMBOLS, TORQUE_SYMBOLS


def systematic_half_width(
    structure: Structure, theta: FloatArray, settings: IdentifySettings, *, knows_gyro: bool = False
) -> FloatArray:
    r"""Return how far each coefficient may be off because of gyro and linearisation; shape of `theta`.

    A gyro measures (I + E) w, with E of scale errors and cross-axis
    sensitivities. For such rates B becomes (I + E) B, the damping (I + E) A
    (I + E)^-1, and the gyroscopic terms (I + E) G K, where K turns products of
    measured rates into those of true ones. Each of the nine entries of E is
    taken by itself, and the effects are added in squares.

    Parameters
    ----------
    structure : Structure
        Whose targets begin with the three accelerations.
    theta : ndarray, shape (n_targets, n_columns)
        [A B].
    settings : IdentifySettings
        ``gyro_systematic``, ``torque_systematic``, ``damping_systematic``.
    knows_gyro : bool
        The fit had E among its unknowns, so its intervals know of it already.

    Returns
    -------
    ndarray, shape (n_targets, n_columns)
    """
    floor = np.zeros(theta.shape)
    places = [_columns(structure, names) for names in (TORQUE_SYMBOLS, RATE_SYMBOLS, PRODUCTS)]
    for a, b in () if knows_gyro else np.ndindex(3, 3):
        E = np.zeros((3, 3))
        E[a, b] = settings.gyro_systematic
        back = _undone(E)
        through = (np.eye(3), back, products_through(back))
        for columns, of_rates in zip(places, through, strict=True):
            known = [number for number, column in enumerate(columns) if column is not None]
            own = [column for column in columns if column is not None]
            whole = np.zeros((3, len(columns)))
            whole[:, known] = theta[:3, own]
            change = (np.eye(3) + E) @ whole @ of_rates - whole
            floor[:3, own] = np.hypot(floor[:3, own], change[:, known])
    gains = [structure.columns.index(name) for name in TORQUE_SYMBOLS]
    floor[:, gains] = np.hypot(floor[:, gains], settings.torque_systematic * np.abs(theta[:, gains]))
    for axis, name in enumerate(RATE_SYMBOLS):
        if name in structure.columns:
            column = structure.columns.index(name)
            linear = settings.damping_systematic * abs(theta[axis, column])
            floor[axis, column] = np.hypot(floor[axis, column], linear)
    return floor


def _columns(structure: Structure, names: tuple[str, ...]) -> list[int | None]:
    """Return where columns stand, None where the structure has them not."""
    return [structure.columns.index(name) if name in structure.columns else None for name in names]


def seen_through(E: FloatArray, gyroscopic: FloatArray, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return gyroscopic terms (3, 6) and damping (3, 3) as they are for rates measured as (I + E) w.

    All targets are multiplied by I + E besides.
    """
    back = _undone(E)
    return gyroscopic @ products_through(back), damping @ back


def _undone(E: FloatArray) -> FloatArray:
    """Return what turns measured rates into true ones; shape (3, 3)."""
    return np.asarray(np.linalg.inv(np.eye(3) + E), dtype=np.float64)


def products_through(M: FloatArray) -> FloatArray:
    """Return K with products(M w) = K products(w); shape (6, 6)."""
    pairs = [(RATE_SYMBOLS.index(name[0]), RATE_SYMBOLS.index(name[1])) for name in PRODUCTS]
    place = {frozenset(pair): number for number, pair in enumerate(pairs)}
    K = np.zeros((6, 6))
    for row, (first, second) in enumerate(pairs):
        for a, b in np.ndindex(3, 3):
            K[row, place[frozenset((a, b))]] += M[first, a] * M[second, b]
    return K
