"""Gains by twitches: a procedure that steps the set-point, looks at the answer, and changes a gain a little.

Without noise the same gains give the same answer, so that the first success of a stage is its last. The
twitch is that of the linear loop: its size does not matter, and what ends it for its angle is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.control.frequency_response import above_zero
from quadid_logs.control.loop import gyro_filters, rate_loop
from quadid_logs.control.margins import is_stable
from quadid_logs.control.separate_gains import Rebuild
from quadid_logs.data.autotune import Twitching
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import GainNames
from quadid_logs.maths.band import ComplexArray, delay_response

#: A twitch is over by then [s]; the answer is computed over more, so that its end does not run into its
#: beginning.
_TWITCH_S: Final = 1.0
_LENGTH_S: Final = 6.0
_FINEST_S: Final = 0.0025
#: Steps of a gain, and how much below the target the highest rate may stay.
_STEP: Final = 0.05
_MARGIN: Final = 0.2
#: A twitch takes three times as long as the rate needs to this part of the target.
_RISEN: Final = 0.6321
#: Below this part of the target, no bounce back is looked for.
_BOUNCING: Final = 0.25
#: More changes than from the lowest to the highest gain.
_MOST_TWITCHES: Final = 400


class TwitchedGains(NamedTuple):
    """Gains at the end, each of shape (n_plants,); NaN where the procedure does not end."""

    proportional: FloatArray
    derivative: FloatArray
    angle_per_s: FloatArray


class _Gains(NamedTuple):
    """Of one vehicle while it is tuned, and the stage that it is in."""

    p: float
    d: float
    angle: float
    stage: int = 0


class _Answer(NamedTuple):
    """What a twitch shows, relative to its target: the highest, the lowest thereafter, a reversing rate."""

    highest: float
    lowest: float
    reverses: bool = False


#: An unstable loop grows beyond every target, and comes back as far.
_BEYOND: Final = _Answer(np.inf, -np.inf)


def twitch(
    procedure: Twitching, controller: AxisController, plants: Plant, names: GainNames, rebuild: Rebuild
) -> TwitchedGains | None:
    """Run the procedure on vehicles.

    Parameters
    ----------
    procedure : Twitching
    controller : AxisController
        With the gains from which it starts.
    plants : Plant
    names : GainNames
    rebuild : callable

    Returns
    -------
    TwitchedGains or None
        None where the controller's parts are not known apart.
    """
    answers = _answers(procedure, plants, names, rebuild)
    if answers is None or controller.angle_gain_per_s is None:
        return None
    flown = controller.gains
    lowest, highest = procedure.derivative
    start = _Gains(
        flown[names.proportional],
        min(max(flown[names.derivative], lowest), highest),
        controller.angle_gain_per_s,
    )
    found = [start] * plants.effectiveness.size
    for _ in range(_MOST_TWITCHES):
        active = [number for number, one in enumerate(found) if one.stage < len(_STAGES)]
        if not active:
            break
        for number, answer in zip(active, answers(active, found), strict=True):
            found[number] = _STAGES[found[number].stage](found[number], answer, procedure)
    ended = [one.stage == len(_STAGES) for one in found]
    values = np.where(ended, np.transpose([(one.p, one.d, one.angle) for one in found]), np.nan)
    return TwitchedGains(values[0], values[1], procedure.angle_back_off * values[2])


def _rate_d_up(now: _Gains, seen: _Answer, procedure: Twitching) -> _Gains:
    adjusted = _p_to_target(now, seen, procedure)
    if adjusted is not None:
        return adjusted
    if _bounces(seen, procedure):
        return now._replace(stage=now.stage + 1)
    d, highest = now.d * (1.0 + 2.0 * _STEP), procedure.derivative[1]
    return now._replace(d=min(d, highest), stage=now.stage + (d >= highest))


def _rate_d_down(now: _Gains, seen: _Answer, procedure: Twitching) -> _Gains:
    adjusted = _p_to_target(now, seen, procedure)
    if adjusted is not None:
        return adjusted
    if not _bounces(seen, procedure):
        return now._replace(stage=now.stage + 1)
    d, lowest = now.d * (1.0 - _STEP), procedure.derivative[0]
    return now._replace(d=max(d, lowest), stage=now.stage + (d <= lowest))


def _p_to_target(now: _Gains, seen: _Answer, procedure: Twitching) -> _Gains | None:
    """Bring the highest rate to just below the target; None where it is there."""
    (least_p, most_p), least_d = procedure.proportional, procedure.derivative[0]
    if seen.highest > 1.0:
        p, d = now.p * (1.0 - _STEP), now.d
        if p < least_p:
            p, d = least_p, d * (1.0 - _STEP)
        over = d <= least_d and p == least_p
        return now._replace(p=p, d=max(d, least_d), stage=now.stage + over)
    if seen.highest < 1.0 - _MARGIN and now.p < most_p:
        return now._replace(p=min(now.p * (1.0 + _STEP), most_p))
    return None


def _rate_p_up(now: _Gains, seen: _Answer, procedure: Twitching) -> _Gains:
    (least_p, most_p), least_d = procedure.proportional, procedure.derivative[0]
    if seen.highest > 1.0 + 0.5 * procedure.aggressiveness:
        return now._replace(stage=now.stage + 1)
    if 1.0 - _MARGIN < seen.highest < 1.0 and _bounces(seen, procedure) and now.d > least_d:
        return now._replace(d=max(now.d * (1.0 - _STEP), least_d), p=max(now.p * (1.0 - _STEP), least_p))
    p = now.p * (1.0 + _STEP)
    return now._replace(p=min(p, most_p), stage=now.stage + (p >= most_p))


def _angle_down(now: _Gains, seen: _Answer, procedure: Twitching) -> _Gains:
    if seen.highest < 1.0 + 0.5 * procedure.aggressiveness:
        return now._replace(stage=now.stage + 1)
    angle, lowest = now.angle * (1.0 - _STEP), procedure.angle[0]
    return now._replace(angle=max(angle, lowest), stage=now.stage + (angle <= lowest))


def _angle_up(now: _Gains, seen: _Answer, procedure: Twitching) -> _Gains:
    returns = seen.highest > 1.0 and seen.reverses
    if returns or seen.highest > 1.0 + 0.5 * procedure.aggressiveness:
        return now._replace(stage=now.stage + 1)
    angle, highest = now.angle * (1.0 + _STEP), procedure.angle[1]
    return now._replace(angle=min(angle, highest), stage=now.stage + (angle >= highest))


_STAGES: Final[tuple[Callable[[_Gains, _Answer, Twitching], _Gains], ...]] = (
    _rate_d_up,
    _rate_d_down,
    _rate_p_up,
    _angle_down,
    _angle_up,
)
_P_UP: Final = _STAGES.index(_rate_p_up)


def _bounces(seen: _Answer, procedure: Twitching) -> bool:
    return seen.highest - seen.lowest > procedure.aggressiveness * seen.highest


class _Loops(NamedTuple):
    """Of all vehicles, what P and D make of the open rate loop, each 1; (n_plants, n_frequencies)."""

    proportional: ComplexArray
    derivative: ComplexArray
    gyro: ComplexArray
    seen: ComplexArray
    frequency_hz: FloatArray
    period_s: float
    runs_away: FloatArray


def _answers(
    procedure: Twitching, plants: Plant, names: GainNames, rebuild: Rebuild
) -> Callable[[list[int], list[_Gains]], list[_Answer]] | None:
    """Return what answers twitches of some of the vehicles."""
    gains = (names.proportional, names.integral, names.derivative)
    alone = [rebuild({name: float(name == one) for name in gains}) for one in (gains[0], gains[2])]
    if alone[0] is None or alone[1] is None:
        return None
    period_s = max(alone[0].period_s, _FINEST_S)
    frequency_hz = above_zero(np.fft.rfftfreq(2 * round(0.5 * _LENGTH_S / period_s), period_s))
    ratio = frequency_hz / procedure.filter_hz if procedure.filter_hz > 0.0 else np.zeros(frequency_hz.shape)
    loops = _Loops(
        rate_loop(alone[0], plants, frequency_hz),
        rate_loop(alone[1], plants, frequency_hz),
        gyro_filters(alone[0], frequency_hz),
        np.asarray(1.0 / (1.0 + 1j * ratio), dtype=np.complex128),
        frequency_hz,
        period_s,
        plants.damping,
    )

    def answer(numbers: list[int], found: list[_Gains]) -> list[_Answer]:
        gains = [found[number] for number in numbers]
        p, d, angle = np.transpose([(one.p, one.d, one.angle) for one in gains])[:, :, np.newaxis]
        of_angle = np.array([one.stage > _P_UP for one in gains])
        rate = p * loops.proportional[numbers] + d * loops.derivative[numbers]
        stable = is_stable(rate, 0, loops.runs_away[numbers] > 0.0)
        answer = rate / (1.0 + rate)
        answer[~of_angle] *= loops.seen
        if of_angle.any():
            s = np.asarray(2j * np.pi * loops.frequency_hz, dtype=np.complex128)
            outer = angle[of_angle] / s * delay_response(s, loops.period_s) * answer[of_angle] / loops.gyro
            stable[of_angle] &= is_stable(outer, 1, np.zeros(len(outer), dtype=bool))
            answer[of_angle] = outer / (1.0 + outer)
        n = 2 * (loops.frequency_hz.size - 1)
        impulses = np.fft.irfft(answer, n, axis=1)[:, : round(_TWITCH_S / loops.period_s)]
        steps = np.cumsum(impulses, axis=1, dtype=np.float64)
        told = _seen(steps[stable], [one for one, ok in zip(gains, stable, strict=True) if ok], procedure)
        seen = iter(told)
        return [next(seen) if ok else _BEYOND for ok in stable]

    return answer


def _seen(steps: FloatArray, gains: list[_Gains], procedure: Twitching) -> list[_Answer]:
    """Return what the procedure sees of each step until it has seen enough."""
    stage = np.array([one.stage for one in gains])
    top = np.maximum.accumulate(steps, axis=1)
    answers = [_BEYOND] * len(gains)
    for number in np.flatnonzero(stage > _P_UP):
        rate = np.diff(steps[number])
        reverses = float(rate.min()) < -procedure.aggressiveness * float(rate.max())
        answers[number] = _Answer(float(top[number, -1]), float(steps[number].min()), reverses)
    of_rate = np.flatnonzero(stage <= _P_UP)
    target = 1.0 + 0.5 * procedure.aggressiveness * (stage[of_rate] == _P_UP)
    for number, end in zip(of_rate, _ends(steps[of_rate], top[of_rate], target, procedure), strict=True):
        until = steps[number, : end + 1]
        answers[number] = _Answer(float(top[number, end]), float(until[np.argmax(until) :].min()))
    return answers


def _ends(steps: FloatArray, top: FloatArray, target: FloatArray, procedure: Twitching) -> IntArray:
    """Return where each twitch of a rate ends: at its target, bounced back, or three times as late as risen.

    ``top`` is the highest so far; both (n_steps, n_samples).
    """
    column, last = target[:, np.newaxis], steps.shape[1] - 1
    # What never rises so far takes as long as there is.
    risen = np.count_nonzero(top < _RISEN * column, axis=1)
    over = (top > _BOUNCING * column) & (top - steps > procedure.aggressiveness * top)
    over |= top > column
    first = np.where(over.any(axis=1), np.argmax(over, axis=1), last)
    return np.asarray(np.minimum(np.minimum(first, 3 * risen), last))
