"""Whether what was commanded tells the torque of an axis: the strength of instruments, axis by axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.identify.design import Design
from quadid_logs.identify.excitation import excited_axes
from quadid_logs.identify.inference import clusters_of
from quadid_logs.identify.instruments import Projection, from_attitude, held_by_attitude
from quadid_logs.maths.least_squares import without_rounding

#: Instruments are weak that may leave a tenth of the bias which feedback makes without them. Of flights that
#: are as weak as that, five in a hundred pass (both are Montiel Olea and Pflueger's own).
_MOST_BIAS, _LEVEL = 0.1, 0.95
#: Fraction of a set-point that follows from the attitude, beyond which it answers more than it commands.
_MOSTLY_HELD = 0.5


class FirstStage(NamedTuple):
    """Effective F statistic of each torque on the instruments, and what it must reach; (3,) each."""

    statistic: FloatArray
    needed: FloatArray

    @property
    def strong(self) -> BoolArray:
        """Whether the instruments tell the torque of each axis; shape (3,)."""
        return np.asarray(self.statistic >= self.needed, dtype=np.bool_)


def first_stage(design: Design) -> FirstStage | None:
    """Return how strongly the instruments drive each torque.

    Parameters
    ----------
    design : Design
        As it is fitted.

    Returns
    -------
    FirstStage or None
        None without instruments.

    Notes
    -----
    J. L. Montiel Olea and C. Pflueger (Journal of Business & Economic Statistics 31, 2013): what follows
    from the instruments, over what would by chance, which is that of clusters because gusts last. The
    critical value is theirs, by their approximation with the noncentral chi-square distribution.
    """
    if design.instruments is None:
        return None
    train, clusters = design.train, clusters_of(design)
    columns = design.instruments[train]
    torque = design.torque.behind(0.0, 0.0)[train]
    project = Projection.onto(without_rounding(columns - columns.mean(axis=0), columns))
    basis = project.directions(len(torque), np.arange(len(torque), dtype=np.int64))
    coordinates = project.coordinates(torque - torque.mean(axis=0))
    rest = torque - torque.mean(axis=0) - project.on_rows(coordinates)
    found = [_effective_f(basis, coordinates[:, axis], rest[:, axis], clusters) for axis in range(3)]
    statistic, needed = np.array(found).T
    return FirstStage(statistic, needed)


def _effective_f(
    basis: FloatArray | None, coordinates: FloatArray, rest: FloatArray, clusters: IntArray
) -> tuple[float, float]:
    """Return the effective F of one torque with what it must reach."""
    from scipy.special import chndtrix

    if basis is None or not coordinates.any():
        return 0.0, 1.0
    scores = np.column_stack([np.bincount(clusters, column * rest) for column in basis.T])
    by_chance = scores.T @ scores
    size, largest = float(np.trace(by_chance)), float(np.linalg.eigvalsh(by_chance)[-1])
    if not size > 0.0:
        return np.inf, 1.0
    worst = 1.0 / _MOST_BIAS
    n = size**2 * (1.0 + 2.0 * worst) / (np.sum(by_chance**2) + 2.0 * worst * size * largest)
    return float(coordinates @ coordinates) / size, float(chndtrix(_LEVEL, n, n * worst)) / n


def with_strong_instruments(design: Design, high_passed: Design, axes: Sequence[int]) -> Design:
    """Return the design, without its instruments where they tell the torque of none of the axes.

    A set-point is exogenous in so far as it does not follow from the attitude. Where most of it follows and
    the rest of the instruments tells the torque of its axis, the part that follows is taken out of them.

    Parameters
    ----------
    design, high_passed : Design
        As it is, and as it is fitted.
    axes : sequence of int
        That are excited.

    Returns
    -------
    Design
    """
    found = first_stage(high_passed)
    if found is None:
        return design
    if not found.strong[list(axes)].any():
        return design.without_instruments()
    held = np.where(from_attitude(high_passed) > _MOSTLY_HELD, held_by_attitude(high_passed), 0.0)
    rest = first_stage(high_passed.without_held(held)) if held.any() else None
    held = held if rest is None else np.where(rest.strong, held, 0.0)
    return design.without_held(held) if held.any() else design


def told_axes(design: Design) -> list[int]:
    """Return the excited axes of which the instruments, where there are any, tell the torque.

    Parameters
    ----------
    design : Design
        As it is fitted.

    Returns
    -------
    list of int
        0 roll, 1 pitch, 2 yaw; all excited ones where there are no instruments, or these tell none.
    """
    axes, found = excited_axes(design), first_stage(design)
    return axes if found is None else [axis for axis in axes if found.strong[axis]] or axes
