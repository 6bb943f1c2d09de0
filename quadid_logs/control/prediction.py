"""The flight predicted from its set-points alone, and what its torque says of the effectiveness.

Model and controller are linear here, so their answer to a whole segment is one product in the frequency
domain. The torque is the judge: the loop brings the rate to its set-point whatever the effectiveness is,
and only the torque that this takes tells one from another.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.control.frequency_response import Lines, above_zero, acting_torque
from quadid_logs.control.loop import forward_filters, gyro_filters, rate_loop
from quadid_logs.data.closed_loop import Estimated, Plant, PredictedSeries, Prediction
from quadid_logs.data.controller import AxisController
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.model import Actuator, FitSeries
from quadid_logs.identify.inference import student_quantile
from quadid_logs.maths.band import ComplexArray, delay_response, high_pass, shorter_fast_length
from quadid_logs.maths.least_squares import Equation, clustered_covariance
from quadid_logs.maths.normal import NORMAL_95

#: What the loop did before a segment began is forgotten after this [s]: many of the loop's periods.
_SETTLE_S: Final = 3.0
#: A segment's end must not answer its beginning: the transform is this much longer [s].
_PADDING_S = 10.0
#: A fit over less than this [s] is that of a manoeuvre or two.
_SHORTEST_S: Final = 4.0
#: Residuals of a loop are forgotten within its periods, gusts within about a second.
_CLUSTER_S = 1.0
#: Where the motors were at their limits during more than the other half of what the set-points drive, the
#: rest of the flight tells of gusts.
_LEAST_CLOSED: Final = 0.5
#: Standard deviation of when a set-point is used, in periods of the loop: it falls anywhere in one of them.
_TIMING: Final = 1.0 / np.sqrt(12.0)
#: A search for the effectiveness ends when a step changes it by less than this fraction of it: a hundredth of
#: the narrowest interval; slope and residual before that step are those after it.
_SMALL_STEP = 1e-4
_MOST_STEPS = 8
#: One step changes it by no more than this: the torque is no straight line of it.
_LARGEST_STEP = 0.2
#: With fewer windows than this, the coherence is chance.
_FEWEST_WINDOWS = 8


_Change = Callable[[ComplexArray], ComplexArray]
_HighPass = Callable[[list[FloatArray]], FloatArray]


class Chirp(NamedTuple):
    """Whether a system-ID mode adds its excitation to the torque of this axis, and how late it does [s]."""

    at_mixer: bool
    delay_s: float


class AxisModel(NamedTuple):
    """The identified axis with its controller.

    ``plant`` is the estimate; ``covariance`` (4, 4) that of its damping, lag, delay and reaction, one
    standard deviation squared; ``actuator`` tells whether the lag is that of the rotors.
    """

    number: int
    controller: AxisController
    plant: Plant
    covariance: FloatArray
    chirp: Chirp
    actuator: Actuator | None = None


class _Answer(NamedTuple):
    """One segment: all that drives the torque around the loop, the loop, and the vehicle behind its gyro.

    Over frequencies (n_frequencies,): torque is ``driven`` / (1 + ``loop``), the rate ``vehicle`` times that.
    ``bent`` is by how much more the logged torque acts than behind a linear lag, see `acting_torque`.
    """

    segment: Segment
    s: ComplexArray
    driven: ComplexArray
    loop: ComplexArray
    vehicle: ComplexArray
    bent: ComplexArray

    @property
    def torque(self) -> ComplexArray:
        """The torque's spectrum."""
        return self.driven / (1.0 + self.loop)

    def in_time(self, spectrum: ComplexArray) -> FloatArray:
        """Return a spectrum as a series over the segment."""
        series = np.fft.irfft(spectrum, 2 * (self.s.size - 1))
        return np.asarray(series[: self.segment.n_samples], dtype=np.float64)


def predict(
    data: FlightData, axis: AxisModel, fit: FitSeries, lines: Lines, low_hz: float
) -> Prediction | None:
    """Predict rate and torque of one axis from its set-points alone, and judge by both.

    Parameters
    ----------
    data : FlightData
    axis : AxisModel
    fit : FitSeries
        Tells which parts of the flight the model was not fitted to.
    lines : Lines
        Of the axis: they tell what any linear system could attain.
    low_hz : float
        What is slower is left out: trim, and what holds against steady wind.

    Returns
    -------
    Prediction or None
        None where too little of what was kept from the fit has set-points.
    """
    answers = _answers(data, axis)
    if not answers:
        return None

    def high_passed(parts: list[FloatArray]) -> FloatArray:
        """Take the slow parts off the series of all segments, and join them."""
        return np.concatenate(
            [high_pass(part[:, np.newaxis], data.sample_period_s, low_hz)[:, 0] for part in parts]
        )

    time_s = np.concatenate([each.segment.time_s for each in answers])
    settled = np.concatenate([each.segment.time_s >= each.segment.start_s + _SETTLE_S for each in answers])
    # The times that the model was not fitted to.
    held_out, known = np.zeros(time_s.shape, dtype=np.bool_), np.isfinite(fit.time_s)
    if known.any():
        nearest, kept = np.searchsorted(fit.time_s[known], time_s), fit.held_out[known]
        held_out = settled & kept[np.minimum(nearest, kept.size - 1)]
    held_out_s = float(np.count_nonzero(held_out) * data.sample_period_s)
    if held_out_s < _SHORTEST_S:
        return None
    series = _series(answers, axis.number, held_out, high_passed)
    # While motors were at their limits, and a second after, the loop was open.
    is_open = []
    for segment in (each.segment for each in answers):
        limit_s = segment.time_s[segment.saturated]
        last_s = np.append(-np.inf, limit_s)[np.searchsorted(limit_s, segment.time_s, side="right")]
        is_open.append(segment.time_s - last_s < _CLUSTER_S)
    rows = settled & ~np.concatenate(is_open)
    power = series.predicted_torque**2
    rows = rows if power[rows].sum() >= _LEAST_CLOSED * power[settled].sum() else settled
    clusters = _clusters(time_s[rows])
    search = _Search(answers, series.torque, rows, clusters, high_passed, axis.controller.period_s)
    torque_fit = _fit_percent(series.torque[held_out], series.predicted_torque[held_out])
    rate = [each.segment.body_rate_rad_s[:, axis.number] for each in answers]
    predicted_rate = [each.in_time(each.vehicle * each.torque) for each in answers]
    return Prediction(
        rate_fit_percent=_fit_percent(high_passed(rate)[held_out], high_passed(predicted_rate)[held_out]),
        torque_fit_percent=torque_fit,
        # The best linear system attains at least what this one does.
        attainable_percent=max(torque_fit, _attainable_percent(lines, axis.chirp, low_hz)),
        held_out_s=held_out_s,
        effectiveness=search.effectiveness(axis.plant, axis.covariance),
        at_limits=rows is settled,
        series=series,
    )


def _series(
    answers: list[_Answer], number: int, held_out: BoolArray, high_passed: _HighPass
) -> PredictedSeries:
    """Put set-points, what was measured and what was predicted beside each other."""
    rates = [each.segment.body_rate_rad_s[:, number] for each in answers]
    predicted = [each.in_time(each.vehicle * each.torque) for each in answers]
    return PredictedSeries(
        time_s=np.concatenate([each.segment.time_s for each in answers]),
        setpoint=np.concatenate([_setpoint(each.segment, number) for each in answers]),
        rate=np.concatenate(rates),
        # Integrators are infinite at zero frequency: of means there is no prediction.
        predicted_rate=np.concatenate(
            [one - np.mean(one) + np.mean(rate) for one, rate in zip(predicted, rates, strict=True)]
        ),
        torque=high_passed([each.segment.torque[:, number] for each in answers]),
        predicted_torque=high_passed([each.in_time(each.torque) for each in answers]),
        held_out=held_out,
    )


def _setpoint(segment: Segment, axis: int) -> FloatArray:
    """Return the rate set-point; nothing where the segment has none."""
    return np.zeros(segment.n_samples) if segment.reference is None else segment.reference[:, axis]


def _answers(data: FlightData, axis: AxisModel) -> list[_Answer]:
    """Return what model and controller make of the set-points, for each segment that is long enough."""
    from scipy.fft import next_fast_len

    period_s, controller, plant, chirp = data.sample_period_s, axis.controller, axis.plant, axis.chirp
    least = round((_SETTLE_S + _SHORTEST_S) / period_s)
    found = []
    for whole in data.segments:
        # Dozens of cosine transforms of this length follow.
        segment = whole.rows(slice(0, shorter_fast_length(whole.n_samples)))
        if segment.reference is None or segment.n_samples < least:
            continue
        # Of an even length, so that the frequencies tell it.
        n = 2 * int(next_fast_len((segment.n_samples + round(_PADDING_S / period_s) + 1) // 2, real=True))
        frequency_hz = above_zero(np.fft.rfftfreq(n, period_s))
        s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
        late_s = controller.angle_delay_steps * controller.period_s
        driven = np.fft.rfft(segment.reference[:, axis.number], n) * delay_response(s, late_s)
        driven = driven * forward_filters(controller, frequency_hz)
        if chirp.at_mixer and segment.reference.shape[1] > 3:
            driven = driven + np.fft.rfft(segment.reference[:, 3], n) * delay_response(s, chirp.delay_s)
        vehicle = plant.response(frequency_hz, controller.period_s)[0] * gyro_filters(
            controller, frequency_hz
        )
        loop = rate_loop(controller, plant, frequency_hz)[0]
        acting = acting_torque(segment, data, axis.actuator) - segment.torque
        bent = np.fft.rfft(acting[:, axis.number], n)
        found.append(_Answer(segment, s, driven, loop, vehicle, bent))
    return found


class _Search:
    """The effectiveness at which the predicted torque comes nearest to the measured one (output error).

    ``rows`` mark the samples that count, ``clusters`` number them by time; ``period_s`` is the loop's.
    """

    def __init__(
        self,
        answers: list[_Answer],
        torque: FloatArray,
        rows: BoolArray,
        clusters: IntArray,
        high_passed: _HighPass,
        period_s: float,
    ) -> None:
        self._period_s = period_s
        self._answers, self._torque, self._rows = answers, torque[rows], rows
        self._clusters, self._high_passed = clusters, high_passed

    def effectiveness(self, plant: Plant, covariance: FloatArray) -> Estimated:
        """Return the effectiveness, with the interval that residuals, damping, lag and delay leave it.

        Parameters
        ----------
        plant : Plant
            Where the search begins.
        covariance : ndarray, shape (4, 4)
            Of damping, lag, delay and reaction.
        """
        factor = 1.0
        for _ in range(_MOST_STEPS):
            # The derivative of the predicted torque by the logarithm of the effectiveness.
            slope, left = self._slope_by(factor, np.ones_like), self._torque - self._series(factor)
            step = float(np.clip((slope @ left) / (slope @ slope), -_LARGEST_STEP, _LARGEST_STEP))
            factor *= 1.0 + step
            if abs(step) < _SMALL_STEP:
                break
        equation = Equation(slope[:, np.newaxis], left, np.zeros(1, dtype=np.int64))
        by_chance = clustered_covariance([equation], self._clusters, 1)[0, 0]
        others = np.array([slope @ self._slope_by(factor, change) for change in _changes(plant)])
        others = others / (slope @ slope)
        by_others = others @ covariance @ others
        by_timing = (_TIMING * self._period_s * (slope @ self._slope_by_time(factor)) / (slope @ slope)) ** 2
        half = factor * np.sqrt(
            student_quantile(self._clusters) ** 2 * by_chance + NORMAL_95**2 * (by_others + by_timing)
        )
        value = float(plant.effectiveness[0])
        return Estimated(factor * value, (float((factor - half) * value), float((factor + half) * value)))

    def _series(self, factor: float) -> FloatArray:
        """Return the predicted torque with so many times the effectiveness, on the rows that count."""
        return self._high_passed(
            [
                each.in_time((each.driven - factor * each.loop * each.bent) / (1.0 + factor * each.loop))
                for each in self._answers
            ]
        )[self._rows]

    def _slope_by_time(self, factor: float) -> FloatArray:
        """Return the derivative of the predicted torque by the time of what drives it."""
        return self._high_passed(
            [each.in_time(-each.s * each.driven / (1.0 + factor * each.loop)) for each in self._answers]
        )[self._rows]

    def _slope_by(self, factor: float, change: _Change) -> FloatArray:
        """Return the derivative of the predicted torque by what changes the loop by `change`, relatively."""
        return self._high_passed(
            [
                each.in_time(
                    -(each.driven + each.bent)
                    * (factor * each.loop * change(each.s) / (1.0 + factor * each.loop) ** 2)
                )
                for each in self._answers
            ]
        )[self._rows]


def _changes(plant: Plant) -> tuple[_Change, _Change, _Change, _Change]:
    """Return the relative change of the loop with damping, lag, delay and reaction, as functions of s."""
    damping, lag_s = float(plant.damping[0]), float(plant.lag_s[0])
    effectiveness, reaction = float(plant.effectiveness[0]), float(plant.reaction[0])
    return (
        (lambda s: 1.0 / (s - damping)),
        (lambda s: -s / (1.0 + lag_s * s)),
        (lambda s: -s),
        (lambda s: s / (effectiveness + reaction * s)),
    )


def _clusters(time_s: FloatArray) -> IntArray:
    """Return the number of the second that each sample is in."""
    return np.asarray(np.unique(np.floor(time_s / _CLUSTER_S), return_inverse=True)[1], dtype=np.int64)


def _fit_percent(measured: FloatArray, predicted: FloatArray) -> float:
    """Return 100 (1 - |error| / |measured|) of series without slow parts."""
    size = float(np.linalg.norm(measured))
    return 100.0 * (1.0 - float(np.linalg.norm(measured - predicted)) / size) if size > 0.0 else float("nan")


def _attainable_percent(lines: Lines, chirp: Chirp, low_hz: float) -> float:
    """Return the torque fit that the coherence with the set-points allows; 0 with too few windows to tell.

    Each window costs as many degrees of freedom as there are inputs.
    """
    inputs = [lines.setpoint, *([lines.chirp] if chirp.at_mixer and lines.chirp is not None else [])]
    n_windows = len(lines.torque)
    if n_windows < _FEWEST_WINDOWS:
        return 0.0
    band = lines.frequency_hz >= low_hz
    causes = np.stack([each[:, band] for each in inputs], axis=-1).transpose(1, 0, 2)
    torque = lines.torque[:, band].T[..., np.newaxis]
    explained = causes @ (np.linalg.pinv(causes) @ torque)
    left = np.sum(np.abs(torque - explained) ** 2) * n_windows / (n_windows - len(inputs))
    total = np.sum(np.abs(torque) ** 2)
    return 100.0 * max(0.0, 1.0 - float(np.sqrt(left / total))) if total > 0.0 else 0.0
