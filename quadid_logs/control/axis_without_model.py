"""Filters that all axes share, beside an axis without a model: how far they may change its loop.

The axis keeps its gains. What filters make of its controller is known without any model, and its command
shows its noise. Where its loop may be closed, they may lose no more than no flight would tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.filter_design import MOST_LOST
from quadid_logs.control.guard import Case, tells_too_little
from quadid_logs.control.loop import Paths
from quadid_logs.control.margins import grid_hz
from quadid_logs.control.separate_gains import SMALL_LOOP, Quick, Rebuild, aliases
from quadid_logs.control.torque_noise import noise_band, torque_spectrum
from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.controller import AxisController
from quadid_logs.maths.band import ComplexArray
from quadid_logs.vocabulary import AXES


def axis_without_model(case: Case, rebuild: Rebuild, crossover_hz: float) -> AxisWithoutModel | None:
    """Return an axis that keeps its gains, to be looked at with other filters.

    Parameters
    ----------
    case : Case
    rebuild : callable
    crossover_hz : float
        The highest at which its loop may cross over.

    Returns
    -------
    AxisWithoutModel or None
        None where its controller is not known, or something contradicts a model.
    """
    controller = case.controller
    if controller is None or case.hides_a_notch or not tells_too_little(case.diagnosis, case.axis):
        return None
    return AxisWithoutModel(case, controller, rebuild, crossover_hz)


class AxisWithoutModel:
    """An axis that keeps its gains; as `filter_design.Filterable`."""

    def __init__(self, case: Case, controller: AxisController, rebuild: Rebuild, crossover_hz: float) -> None:
        self._case, self._controller, self._rebuild = case, controller, rebuild
        self._crossover_hz, self._frequency_hz = crossover_hz, grid_hz(controller.period_s)

    @cached_property
    def too_noisy(self) -> float:
        """Noise of the command as flown over what is accepted; NaN where the log does not tell it."""
        return math.sqrt(float(np.sum(self._power))) / MOST_NOISE if np.any(self._power) else math.nan

    @cached_property
    def _power(self) -> FloatArray:
        """Of the noise in the command, at each of the frequencies; zeros where the log does not tell it."""
        case, number = self._case, AXES.index(self._case.axis)
        spectrum = torque_spectrum(case.data, number, self._controller, None, case.rows)
        band = None if spectrum is None else noise_band(spectrum, self._crossover_hz)
        power = np.zeros(self._frequency_hz.shape)
        if spectrum is not None and band is not None:
            places = np.searchsorted(self._frequency_hz, spectrum.frequency_hz[band])
            each = spectrum.density[band] * spectrum.frequency_hz[0]
            np.add.at(power, np.minimum(places, power.size - 1), each)
        return power

    def best(self) -> tuple[_Behind, Mapping[str, float]]:
        """Return the axis as it flew."""
        return self._behind(self._controller), {}

    def filtered(self, filters: Mapping[str, float]) -> _Behind | None:
        """Return the axis behind other filters."""
        controller = self._rebuild(filters)
        if controller is None or controller.period_s != self._controller.period_s:
            return None
        return self._behind(controller)

    def _behind(self, controller: AxisController) -> _Behind:
        flown, other = (_answer(one, self._frequency_hz) for one in (self._controller, controller))
        below = self._frequency_hz <= self._crossover_hz
        # From its crossover on the vehicle answers no more than an integrator: of all places where it may
        # cross over, that which leaves most above.
        most = float(np.max(self._frequency_hz[below] / np.abs(flown[below])))
        ratio, loop = other / flown, np.abs(other) * most / self._frequency_hz
        # Less lag costs nothing; elsewhere a loop that is closed stays as it is, and one that is small small.
        lag = np.where(below, np.maximum(-np.angle(ratio), 0.0), 0.0)
        raised = np.where(below | (loop > SMALL_LOOP), np.abs(ratio) - 1.0, 0.0)
        missing = max(float(np.max(lag)), float(np.max(raised))) - MOST_LOST
        return _Behind(
            self._frequency_hz, ratio, loop, max(missing, 0.0), self._noise(np.abs(ratio)), self._crossover_hz
        )

    def _noise(self, ratio: FloatArray) -> float:
        """Return the command's noise over that as flown; where that is unknown, at the worst frequency."""
        if not np.any(self._power):
            return float(np.max(ratio))
        for places in aliases(self._frequency_hz, self._case.log_hz):
            ratio = np.maximum(ratio, ratio[places])
        return math.sqrt(float(ratio**2 @ self._power / np.sum(self._power)))


class _Behind(NamedTuple):
    """The axis behind some filters: its controller's answer over that as flown, its largest loop.

    ``missing`` is what filters take beyond what they may, ``noise`` the command's over that as flown.
    """

    frequency_hz: FloatArray
    ratio: ComplexArray
    loop: FloatArray
    missing: float
    noise: float
    crossover_hz: float

    def quick(self, begin: Mapping[str, float]) -> Quick:
        """Return what filters alone make: gusts below the crossover are rejected as before."""
        return Quick(begin, 1.0, self.noise, self.missing)

    def phase_lost_deg(self) -> float:
        """Return the phase that filters lose where the loop may cross over [deg]."""
        return -math.degrees(float(np.interp(self.crossover_hz, self.frequency_hz, np.angle(self.ratio))))

    def passes(self, frequency_hz: float) -> tuple[float, float]:
        """Return what filters let pass at a frequency over that as flown, and the largest loop's gain."""
        both = (np.abs(self.ratio), self.loop)
        more, loop = (float(np.interp(frequency_hz, self.frequency_hz, one)) for one in both)
        return more, loop


def _answer(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the answer of the command to the rate, by all paths."""
    paths = Paths(controller, frequency_hz)
    if controller.angle_gain_per_s is None:
        return paths.on_rate
    return np.asarray(paths.on_rate + paths.on_angle)
