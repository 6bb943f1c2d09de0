"""Estimates that feedback does not bias: instruments from what the vehicle was commanded.

In flight the controller answers every gust and every noise of the gyro with
torque, so torque and disturbance go together and plain least squares takes
part of one for the other. What was commanded (rate setpoints, an injected
chirp) moves the vehicle too, but answers nothing. Only the part of torque and
rate that follows from it is used: two-stage least squares (T. Soderstrom and
P. Stoica, Instrumental Variable Methods for System Identification, 1983).

Some two dozen instruments follow a part of the disturbances of half a minute by chance, and by so much
two-stage least squares keeps the error of plain ones. So what follows from the instruments is told, for each
second, by all the others: the jackknife instrumental variables of J. D. Angrist, G. W. Imbens and A. B.
Krueger (J. Applied Econometrics 14, 1999), with seconds left out because disturbances last.
"""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.identify.design import Design
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import ANGLES

#: Squared relative size below which a direction of the Gram matrix is rounding.
_ROUNDING = 1e-11
#: A direction of the instruments of which a second holds more than this has too little elsewhere to be told
#: by (its noise would be five times that of the whole): it is told by that second too.
_MOST_LEVERAGE = 0.8


class Projection:
    """The part of columns that follows from the instruments, on some rows of a design.

    Parameters
    ----------
    design : Design
        Without instruments nothing is changed.
    structure : Structure
        Its regressors that no controller answers disturbances with are their own instruments.
    rows : ndarray of bool, shape (n_rows,)
    also : ndarray, shape (n_rows, n_columns), optional
        More instruments.
    """

    def __init__(
        self,
        design: Design,
        structure: Structure,
        rows: BoolArray | IntArray,
        *,
        also: FloatArray | None = None,
    ) -> None:
        self._basis: FloatArray | None = None
        if design.instruments is not None:
            own = [term.symbol for term in structure.terms if not term.answers_disturbances]
            names = [name for name in (*own, *design.disturbances(structure)) if name in design.columns]
            columns = [design.instruments, *(design.columns[name] for name in names)]
            columns += [] if also is None else [also]
            self._basis = _orthonormal(np.column_stack([each[rows] for each in columns]))

    @classmethod
    def onto(cls, instruments: FloatArray) -> Projection:
        """Return the projection on columns of instruments, shape (n_rows, n_instruments)."""
        project = cls.__new__(cls)
        project._basis = _orthonormal(instruments)
        return project

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Return columns of shape (n_rows, n) as explained by the instruments; themselves without any."""
        return columns if self._basis is None else self._basis @ (self._basis.T @ columns)

    def coordinates(self, columns: FloatArray) -> FloatArray:
        """Return the explained part in the instruments' own few rows: same squares, same least squares."""
        return columns if self._basis is None else self._basis.T @ columns

    def on_rows(self, coordinates: FloatArray) -> FloatArray:
        """Return what has such coordinates, on the rows; itself without any instruments."""
        return coordinates if self._basis is None else self._basis @ coordinates

    def jackknifed(self, columns: FloatArray, clusters: IntArray) -> Projection:
        """Return the projection on what the instruments make of columns, each cluster told by the others.

        Parameters
        ----------
        columns : ndarray, shape (n_rows, n_columns)
            Of the equations, with their derivatives by all else that is fitted.
        clusters : ndarray of int, shape (n_rows,)
            From 0, without gaps; disturbances are alike inside one only.

        Returns
        -------
        Projection
            As many instruments as there are columns: no more follow a disturbance by chance than are needed.
            Itself without any instruments.
        """
        if not self.n_instruments or self._basis is None:
            return self
        told = np.empty_like(columns)
        products = self._basis.T @ columns
        order = np.argsort(clusters, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(clusters[order])) + 1):
            basis = self._basis[rows]
            gram, own = basis.T @ basis, basis.T @ columns[rows]
            # No leverage is more than the norm of all. Eigenvectors take ten times as long.
            if np.linalg.norm(gram) <= _MOST_LEVERAGE:
                told[rows] = basis @ np.linalg.solve(np.eye(len(gram)) - gram, products - own)
                continue
            leverage, vector = np.linalg.eigh(gram)
            elsewhere = leverage <= _MOST_LEVERAGE
            here = np.where(elsewhere, 1.0, 0.0)[:, np.newaxis] * (vector.T @ own)
            rest = np.where(elsewhere, 1.0 - leverage, 1.0)[:, np.newaxis]
            told[rows] = (basis @ vector) @ ((vector.T @ products - here) / rest)
        return Projection.onto(told) if told.any() else self

    def directions(self, n_rows: int, rows: IntArray) -> FloatArray | None:
        """Return the basis of the instruments on all rows of the design, zero elsewhere; None without any."""
        if self._basis is None:
            return None
        whole = np.zeros((n_rows, self._basis.shape[1]))
        whole[rows] = self._basis
        return whole

    @property
    def n_instruments(self) -> int:
        """Number of independent instruments, 0 without any."""
        return 0 if self._basis is None else self._basis.shape[1]


def from_attitude(design: Design) -> FloatArray:
    """Return which fraction of each rate set-point follows from the attitude.

    Parameters
    ----------
    design : Design

    Returns
    -------
    ndarray, shape (3,)
        As logged; zero where no attitude is known. That fraction may be no command but the answer of an angle
        controller to the motion.
    """
    names = [term.symbol for term in ANGLES if term.symbol in design.columns]
    if design.instruments is None or not names:
        return np.zeros(3)
    train = design.train
    columns = np.column_stack([design.columns[name][train] for name in names])
    angles = _orthonormal(columns)
    setpoints = design.instruments[train, :3]
    if design.held_per_s is not None:
        setpoints = setpoints + columns @ design.held_per_s
    whole = np.sum(setpoints**2, axis=0)
    follows = np.sum((angles.T @ setpoints) ** 2, axis=0)
    return np.asarray(np.divide(follows, whole, out=np.zeros(3), where=whole > 0.0))


def held_by_attitude(design: Design) -> FloatArray:
    """Return the rate set-points that hold an attitude, per angle.

    Parameters
    ----------
    design : Design
        As it is fitted, with the set-points as logged.

    Returns
    -------
    ndarray, shape (3, 3)
        Least squares of the set-points on the angles [1/s], angles as rows. Zero for set-points that do not
        oppose their own angle, and where an angle is not known.

    Notes
    -----
    An angle controller asks for r = k (s - x), where the angle x = T s + g follows the command s and
    the gusts, g. Least squares take c k x out of it, and leave (1 - c) of what answers gusts, where c k is
    the slope of -r by x: less wherever r opposes x, and nothing where s stands still (c = 1).
    """
    names = [term.symbol for term in ANGLES]
    if design.instruments is None or any(name not in design.columns for name in names):
        return np.zeros((3, 3))
    train = design.train
    angles = np.column_stack([design.columns[name][train] for name in names])
    slope = np.linalg.lstsq(angles, design.instruments[train, :3], rcond=None)[0]
    return np.where(np.diag(slope) < 0.0, slope, 0.0)


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the columns' span, without directions that are rounding only.

    Columns are scaled to unit length: one that is the rounding of what it came from has to be zero by now
    (`without_rounding`), or it would pass for a direction of its own. Without any other, the basis is empty.

    By eigenvectors of the Gram matrix, twice: many rows of few columns go
    through matrix products only, and the second time removes what rounding
    left of the first (CholeskyQR2, Yamamoto et al. 2015, doi:10.1553/etna_vol44s306).
    """
    length = np.linalg.norm(columns, axis=0)
    moving = length > 0.0
    basis = columns / length if moving.all() else columns[:, moving] / length[moving]
    if not moving.any():
        return np.empty((len(columns), 0))
    for _ in range(2):
        value, vector = np.linalg.eigh(basis.T @ basis)
        seen = value > _ROUNDING * value[-1]
        basis = basis @ (vector[:, seen] / np.sqrt(value[seen]))
    return np.asarray(basis, dtype=np.float64)
