"""A controller's answers as sums over its gains: thousands of gains are tried in the time of a few."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.loop import Paths
from quadid_logs.data.controller import AxisController
from quadid_logs.maths.band import ComplexArray

#: The sums are exact but for rounding.
_ROUNDING = 1e-6


class GainPaths(NamedTuple):
    """Answers of the command over frequency, with the flown gains and what each gain adds to them.

    Attributes
    ----------
    names : tuple of str
        Parameters of P, I and D; the angle gain multiplies what stands before it.
    angle : str
        Parameter of the angle gain, "" where it is none of those that are varied.
    flown : ndarray of complex, shape (3, n_frequencies)
        To the rate, to the rate by way of the angle loop (zero without one), and to a rate set-point.
    added : ndarray of complex, shape (n_names, 3, n_frequencies)
        By as much of each gain as flew.
    """

    names: tuple[str, ...]
    angle: str
    flown: ComplexArray
    added: ComplexArray

    def at(self, factors: Mapping[str, float | FloatArray]) -> ComplexArray:
        """Return the answers with other gains.

        Parameters
        ----------
        factors : mapping of str to float or to ndarray, shape (n_sets,)
            On the flown gains.

        Returns
        -------
        ndarray of complex, shape (3, n_frequencies) or (n_sets, 3, n_frequencies)
            As `GainPaths.flown`.
        """
        more = np.array([np.asarray(factors[name]) - 1.0 for name in self.names])
        found = self.flown + np.tensordot(more.T, self.added, axes=1)
        found[..., 1, :] *= np.asarray(factors.get(self.angle, 1.0))[..., np.newaxis]
        return np.asarray(found, dtype=np.complex128)


def gain_paths(
    controllers: Mapping[str, AxisController | None],
    flown: AxisController,
    both: tuple[Mapping[str, float], AxisController | None],
    angle: str,
    frequency_hz: FloatArray,
) -> GainPaths | None:
    """Take a controller apart by its gains.

    Parameters
    ----------
    controllers : mapping of str to AxisController
        By parameter of P, I or D, that with this gain doubled.
    flown : AxisController
    both : tuple
        Factors on all gains, the angle gain among them, and the controller that they make.
    angle : str
        Parameter of the angle gain, "" where it is not varied.
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    GainPaths or None
        None where the answers are no sums over the gains, or some gains make no controller.
    """
    factors, other = both
    if other is None:
        return None
    base = _answers(flown, frequency_hz)
    added = []
    for one in controllers.values():
        if one is None:
            return None
        added.append(_answers(one, frequency_hz) - base)
    shape = (len(added), *base.shape)
    found = GainPaths(tuple(controllers), angle, base, np.array(added, dtype=np.complex128).reshape(shape))
    expected = _answers(other, frequency_hz)
    return found if np.allclose(found.at(factors), expected, rtol=_ROUNDING, atol=0.0) else None


def _answers(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the answers of the command, shape (3, n_frequencies), see `GainPaths.flown`."""
    paths = Paths(controller, frequency_hz)
    by_angle = np.zeros(frequency_hz.shape, dtype=np.complex128)
    if controller.angle_gain_per_s is not None:
        by_angle = paths.on_angle
    return np.stack([paths.on_rate, by_angle, paths.forward])
