"""The rate's answer to a step of its set-point, with the band that the vehicle's uncertainty makes."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.frequency_response import Response, above_zero
from quadid_logs.control.loop import integrators, rate_answers
from quadid_logs.control.margins import is_stable
from quadid_logs.data.closed_loop import Estimated, Plant, Step
from quadid_logs.data.controller import AxisController
from quadid_logs.maths.normal import ENDS_95

#: A rate loop that is of use has settled by then [s].
_LENGTH_S: Final = 4.0
#: No rate loop answers within this time [s].
_FINEST_S = 0.0025
#: A band needs fewer draws than a margin's tail.
_MOST_DRAWS = 200
#: The last eighth is where the answer ends.
_END = 8
#: A closed loop seen in fewer third octaves than this has no step response.
_FEWEST_BANDS = 4
#: Settled: within a twentieth of where it ends.
_SETTLED = 0.05


def step_of(controller: AxisController, plants: Plant, closed: Response | None = None) -> Step | None:
    """Return the answer of the rate behind the gyro's filters to a step of the rate set-point.

    Parameters
    ----------
    controller : AxisController
    plants : Plant
        The estimate, then vehicles drawn around it; those with an unstable loop are left out.
    closed : Response, optional
        The answer of the rate to its set-point, measured over modelled.

    Returns
    -------
    Step or None
        None where the loop of the estimate is unstable.
    """
    return Steps(plants).of(controller, closed)


class Steps:
    """The answers of several controllers around the same vehicles, whose own answers are computed once."""

    def __init__(self, plants: Plant) -> None:
        self._few, self._hold_s = plants.at(slice(0, 1 + _MOST_DRAWS)), float("nan")

    def of(self, controller: AxisController, closed: Response | None = None) -> Step | None:
        """Return what `step_of` does, for one of the controllers."""
        period_s = max(controller.period_s, _FINEST_S)
        n_samples = 2 * round(0.5 * _LENGTH_S / period_s)
        # Twice as long, so that the end does not run into the beginning.
        frequency_hz = above_zero(np.fft.rfftfreq(2 * n_samples, period_s))
        if controller.period_s != self._hold_s:
            self._hold_s = controller.period_s
            self._body = self._few.response(frequency_hz, self._hold_s)
        answers = rate_answers(controller, self._body, frequency_hz)
        rate, _, target_to_rate = answers
        stable = is_stable(rate, integrators(controller), self._few.damping > 0.0)
        if not stable[0]:
            return None
        impulse = np.fft.irfft(target_to_rate[stable], 2 * n_samples, axis=1)
        steps = np.cumsum(impulse, axis=1, dtype=np.float64)[:, :n_samples]
        time_s = max(controller.period_s, _FINEST_S) * np.arange(n_samples, dtype=np.float64)
        low, high = np.quantile(steps, ENDS_95, axis=0) if len(steps) > 1 else (steps[0], steps[0])
        # Time from 10 to 90 % [s], overshoot [%] and time until settled [s] of steps (n, n_samples).
        relative = steps / np.mean(steps[:, -(steps.shape[1] // _END) :], axis=1, keepdims=True)
        first, last = (np.argmax(relative >= level, axis=1) for level in (0.1, 0.9))
        overshoot = np.maximum(100.0 * (np.max(relative, axis=1) - 1.0), 0.0)
        unsettled = np.abs(relative - 1.0) > _SETTLED
        after = unsettled.shape[1] - np.argmax(unsettled[:, ::-1], axis=1)
        settled_s = np.where(after < time_s.size, time_s[np.minimum(after, time_s.size - 1)], np.inf)
        figures = (time_s[last] - time_s[first], overshoot, settled_s)
        measured = None
        if closed is not None and closed.frequency_hz.size >= _FEWEST_BANDS:
            # Where nothing was measured, what is next to it was.
            ratio = [
                np.interp(frequency_hz, closed.frequency_hz, part)
                for part in (closed.gain.real, closed.gain.imag)
            ]
            spectrum = target_to_rate[0] * (ratio[0] + 1j * ratio[1])
            measured = np.cumsum(np.fft.irfft(spectrum, 2 * n_samples), dtype=np.float64)[:n_samples]
        return Step(
            rise_time_s=_estimated(figures[0]),
            overshoot_percent=_estimated(figures[1]),
            settling_time_s=_estimated(figures[2]),
            time_s=time_s,
            response=steps[0],
            low=low,
            high=high,
            measured=measured,
        )


def _estimated(values: FloatArray) -> Estimated:
    low, high = np.quantile(values, ENDS_95, method="nearest")
    return Estimated(float(values[0]), (float(min(low, values[0])), float(max(high, values[0]))))
