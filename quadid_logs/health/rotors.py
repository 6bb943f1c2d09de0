"""How much each rotor gives of what it is sent: weak motors, lost thrust, a centre of mass off the middle.

In steady flight every rotor's thrust follows from weight and centre of mass alone, so that what a rotor is
sent tells what it makes of it. A weak rotor is sent more than the others. The thrusts, weighted by
the rotors' places, are the centre of thrust; weighted by their spin, the balance of yaw. One weak rotor moves
the first along its arm and the second in the sense of its spin; a load moves the first alone.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align import Prepared
from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.health import Quantity, RotorBalance, RotorFault, Rotors
from quadid_logs.health.commanded import Commanded
from quadid_logs.health.desync import find_desync
from quadid_logs.health.effectiveness import directions, find_effectiveness
from quadid_logs.health.motors import motor_names
from quadid_logs.health.propellers import find_shaking
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.self_normalised import FEWEST, Change, Difference, between, change_of, mean_of
from quadid_logs.numerals import number, plus_minus

#: The chance that a flight without a fault shows any: of the whole flight, and of each of the five tests.
FALSE_ALARM: Final = 0.01
_OF_EACH: Final = FALSE_ALARM / 5.0
#: Means over this, or over two samples of a slower log; at most so many of them [s].
_STEP_S: Final = 0.25
_MOST_STEPS: Final = 600
#: Beside the ground a rotor gives more [s].
_NEAR_GROUND_S: Final = 2.0
#: Below this fraction of the median the motors do not carry the vehicle.
_CARRIES: Final = 0.5
#: Height of the drag's centre above the centre of mass, in lengths of the arm, of all but the tallest frames:
#: drag then looks like a centre of mass that is off by this times the tangent of the mean tilt.
_DRAG_HEIGHT: Final = 0.25
#: A flight that tells only larger losses tells nothing of a rotor.
_HALF: Final = 0.5
#: What lies beyond the 99 % interval contradicts; the intervals at hand are of 95 %, narrower by this.
_CONTRADICTS: Final = 1.45
#: Two arms within this angle lie on one line.
_ONE_LINE: Final = 0.99


class _Balances(NamedTuple):
    """Means over short times: ``time_s`` (n,), ``balance`` (n, 3) by place, ``total`` thrust (n,)."""

    time_s: FloatArray
    balance: FloatArray
    total: FloatArray


class _Fit(NamedTuple):
    """One rotor that explains a balance: what it gives, with its 95 % interval, and whether yaw agrees."""

    rotor: int
    gives: Quantity
    yaw_agrees: bool
    yaw_in_errors: float

    @property
    def yaw_is_sure(self) -> bool:
        """Whether yaw moved as this rotor moves it, by more than its 95 % interval."""
        return self.yaw_agrees and self.yaw_in_errors > NORMAL_95


def find_rotors(prepared: Prepared, sent: Commanded | None, intervals: Sequence[Interval]) -> Rotors | None:
    """Test each rotor for what it gives, and for what shakes.

    Parameters
    ----------
    sent : Commanded or None
        As of `commanded_thrust`.
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Rotors or None
        None where the log does not tell what each rotor was sent.
    """
    if sent is None:
        return None
    # Between two flights loads are moved and propellers changed.
    balances = _balances(sent, [max(intervals, key=lambda one: one[1] - one[0])]) if intervals else None
    if balances is None:
        return None
    n_rotors, series = len(sent.place), prepared.series
    names = motor_names(prepared.log.torque, n_rotors)
    rate = series.get("body_rate")
    effectiveness = (
        (None,) * n_rotors if rate is None else find_effectiveness(sent.series, sent.place, rate, intervals)
    )
    # How the centre of thrust moved along each arm.
    changes = tuple(change_of(balances.balance[:, :2] @ arm) for arm in _arms(sent.place))
    faults = [*_lost(balances, sent, rate, changes, names)]
    axes_change = _axes_change(changes, sent.place, [one.rotor for one in faults] or range(n_rotors))
    lost = changes[faults[0].rotor] if faults else None
    begin = slice(None) if lost is None else lost.before
    steady = _Balances(*(part[begin] for part in balances))
    offset = _mass_offset(steady, series.get("attitude"))
    # Of two rotors on one arm, the lower gives less by design.
    stacked = len(np.unique(np.round(sent.place[:, :2], 2), axis=0)) < n_rotors
    weak = None if offset is None or stacked else _weak(steady, sent.place, effectiveness, names)
    if weak is not None:
        faults.append(weak)
    elif offset is not None and offset.p_value < _OF_EACH:
        forward, right = offset.forward, offset.right
        parts = [
            f"{_percent(one)} of the arm {positive if one.value > 0.0 else negative}"
            for one, positive, negative in (
                (forward, "in front", "at the back"),
                (right, "to the right", "to the left"),
            )
            if one.ci95 is not None and one.ci95[0] * one.ci95[1] > 0.0
        ]
        size = max(forward, right, key=lambda one: abs(one.value))
        faults.append(
            RotorFault(
                code=_MASS,
                rotor=-1,
                time_s=float("nan"),
                size=size,
                p_value=offset.p_value,
                sentence="If all rotors are alike, the centre of mass lies "
                f"{' and '.join(parts)} of their middle.",
            )
        )
    shaking = find_shaking(
        prepared.candidates.get("body_rate", ()), series.get("rotor_speed"), n_rotors, intervals
    )
    if shaking is not None and shaking.worst >= 0 and shaking.p_value < _OF_EACH:
        shown = shaking.size[shaking.worst] or Quantity(float("nan"), "rad/s")
        faults.append(
            RotorFault(
                code=_SHAKES,
                rotor=shaking.worst,
                time_s=float("nan"),
                size=shown,
                p_value=shaking.p_value,
                sentence=(
                    f"The propeller of {names[shaking.worst]} shakes the gyro more than all others together "
                    f"({number(float(np.degrees(shown.value)), 2)} deg/s rms at its own speed)."
                ),
            )
        )
    force = series.get("specific_force")
    air = _off_ground(intervals)
    desync = None if rate is None else find_desync(sent.series, sent.place, rate, force, air)
    if desync is not None and desync.rotor >= 0 and desync.p_value < _OF_EACH:
        faults.append(
            RotorFault(
                code=_DESYNC,
                rotor=desync.rotor,
                time_s=desync.time_s,
                size=Quantity(0.5, "1", (0.5, 1.0)),
                p_value=desync.p_value,
                sentence=(
                    f"{names[desync.rotor].capitalize()} lost half of its thrust or more for a moment at "
                    f"{desync.time_s:.1f} s."
                ),
            )
        )
    faults.sort(key=lambda one: (one.code == _MASS, one.p_value))
    allowed = {
        _LOST: any(change is not None for change in changes),
        _WEAK: offset is not None and not stacked,
        _MASS: offset is not None,
        _SHAKES: shaking is not None,
        _DESYNC: desync is not None,
    }
    if len(steady.balance) < FEWEST:
        balance = None
    else:
        still = steady.balance if rate is None else _without_turns(steady, rate)
        forward, right, yaw = (
            Quantity(one.value, "1", (one.value - one.half_width, one.value + one.half_width))
            for one in (mean_of(column) for column in still.T)
        )
        places = tuple((ahead, aside, spin) for ahead, aside, spin in sent.place.tolist())
        balance = RotorBalance((forward, right, yaw), places)
    return Rotors(
        sentence=_sentence(faults, changes, sent.place),
        level="high" if any(one.code != _MASS for one in faults) else "fact",
        names=names,
        effectiveness=effectiveness,
        change=tuple(_as_change(balances, sent.place, rotor, change) for rotor, change in enumerate(changes)),
        mass_offset=None if offset is None else (offset.forward, offset.right),
        thrust_change=_thrust_change(balances, force),
        shaking=(None,) * n_rotors if shaking is None else shaking.size,
        faults=tuple(faults),
        findings=tuple(dict.fromkeys(one.code for one in faults)),
        searched=tuple(code for code, one in allowed.items() if one),
        axes_change=axes_change,
        balance=balance,
    )


def _without_turns(balances: _Balances, rate: CleanSeries) -> FloatArray:
    """Return the balances without what turned the vehicle, and what its turning took, (n, 3).

    Thrust forward turns pitch, thrust to the right roll. The means stay: what is taken has none.
    """
    middle_s, step_s = balances.time_s, float(np.median(np.diff(balances.time_s)))
    steady = []
    for column, axis in zip(balances.balance.T, (1, 0, 2), strict=True):
        values = np.nan_to_num(rate.values[:, axis])
        angle = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(rate.time_s))])
        rates, angles = (
            [np.interp(middle_s + side * step_s, rate.time_s, one) for side in (-0.5, 0.5)]
            for one in (values, angle)
        )
        turns = np.column_stack([rates[1] - rates[0], angles[1] - angles[0]])
        turns -= turns.mean(axis=0)
        steady.append(column - turns @ np.linalg.lstsq(turns, column - column.mean(), rcond=None)[0])
    return np.column_stack(steady)


def weakened(before: RotorBalance, after: RotorBalance) -> tuple[int, Quantity] | None:
    """Return the rotor that gives less than in an earlier flight, and by how much less.

    Parameters
    ----------
    before, after : RotorBalance
        Of two flights of one vehicle.

    Returns
    -------
    (int, Quantity) or None
        None where no rotor alone explains how the balances moved. A load that was moved, or wind, moves the
        centre of thrust and not the balance of yaw.
    """
    if before.place != after.place:
        return None
    place = np.array(after.place)
    moved = [
        Difference(new.value - old.value, float(np.hypot(_half_width(old), _half_width(new))))
        for old, new in zip(before.centre, after.centre, strict=True)
    ]
    value, half_width = (np.array(part) for part in zip(*moved, strict=True))
    found: list[tuple[float, int, Quantity]] = []
    for rotor, arm in enumerate(_arms(place)):
        along, across = (
            Difference(float(way @ value[:2]), float(np.linalg.norm(way * half_width[:2])))
            for way in (arm, np.array([-arm[1], arm[0]]))
        )
        yaw = Difference(float(value[2] * place[rotor, 2]), float(half_width[2]))
        fit = _fit(rotor, place, along, across, yaw)
        if along.value > _CONTRADICTS * along.half_width and fit is not None and fit.yaw_is_sure:
            found.append((along.value / along.half_width, rotor, _loss(fit.gives)))
    if not found:
        return None
    _, rotor, loss = max(found)
    return rotor, loss


def _half_width(one: Quantity) -> float:
    return np.inf if one.ci95 is None else 0.5 * (one.ci95[1] - one.ci95[0])


_WEAK, _LOST, _SHAKES, _DESYNC, _MASS = "QL430", "QL431", "QL432", "QL433", "QL434"


def _balances(sent: Commanded, intervals: Sequence[Interval]) -> _Balances | None:
    """Average over short times what the rotors were sent, off the ground."""
    air = _off_ground(intervals)
    flown_s = sum(end - begin for begin, end in air)
    step_s = max(_STEP_S, 2.0 * sent.series.period_s, flown_s / _MOST_STEPS)
    times, means = [], []
    for begin, end in air:
        edges = begin + step_s * np.arange(int((end - begin) / step_s) + 1, dtype=np.float64)
        rows = np.searchsorted(sent.series.time_s, edges)
        values = sent.series.of_rows(slice(int(rows[0]), int(rows[-1])))
        good = np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)
        kept_values = np.where(good[:, np.newaxis], values, 0.0)
        sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(kept_values, axis=0)])
        count = np.diff(np.concatenate([[0], np.cumsum(good)])[rows - rows[0]])
        kept = count > 0
        means.append(np.diff(sums[rows - rows[0]], axis=0)[kept] / count[kept, np.newaxis])
        times.append(edges[:-1][kept] + 0.5 * step_s)
    if not times:
        return None
    time_s, thrust = np.concatenate(times), np.concatenate(means)
    total = thrust.sum(axis=1)
    carried: BoolArray = np.asarray(total > _CARRIES * float(np.median(total)) if total.size else total > 0.0)
    if np.count_nonzero(carried) < FEWEST:
        return None
    time_s, thrust, total = time_s[carried], thrust[carried], total[carried]
    return _Balances(time_s, thrust @ sent.place / total[:, np.newaxis], total)


def _off_ground(intervals: Sequence[Interval]) -> list[Interval]:
    air = [(begin + _NEAR_GROUND_S, end - _NEAR_GROUND_S) for begin, end in intervals]
    return [(begin, end) for begin, end in air if end > begin]


def _lines(place: FloatArray) -> list[int]:
    """Return one rotor for each line on which arms lie."""
    arms = _arms(place)
    kept: list[int] = []
    for rotor, arm in enumerate(arms):
        if all(abs(float(arm @ arms[other])) < _ONE_LINE for other in kept):
            kept.append(rotor)
    return kept


def _arms(place: FloatArray) -> FloatArray:
    """Return the direction of each arm, shape (n_rotors, 2)."""
    return np.asarray(place[:, :2] / np.linalg.norm(place[:, :2], axis=1, keepdims=True), dtype=np.float64)


def _lost(
    balances: _Balances,
    sent: Commanded,
    rate: CleanSeries | None,
    changes: Sequence[Change | None],
    names: Sequence[str],
) -> Iterator[RotorFault]:
    """Yield the rotor that lost thrust, if one alone explains how the balances moved."""
    for rotor, change, p_value in _moved(changes, sent.place):
        fit = _fit_change(balances, sent.place, rotor, change)
        # What moves the centre of thrust alone is a load, or the wind.
        if fit is None or not fit.yaw_agrees or not _is_the_rotor(fit, balances, sent, rate, change):
            continue
        time_s = float(balances.time_s[change.before.stop - 1])
        begin = float(balances.time_s[change.before.stop - 1])
        end = float(balances.time_s[min(change.after.start, len(balances.time_s) - 1)])
        when = f"at about {begin:.0f} s" if end - begin < 2.0 else f"between {begin:.0f} and {end:.0f} s"
        yield RotorFault(
            code=_LOST,
            rotor=fit.rotor,
            time_s=time_s,
            size=_loss(fit.gives),
            p_value=p_value,
            sentence=f"{names[fit.rotor].capitalize()} lost {_percent(_loss(fit.gives))} of its thrust in "
            f"flight, {when}.",
        )
        return


def _moved(changes: Sequence[Change | None], place: FloatArray) -> list[tuple[int, Change, float]]:
    """Return the rotors along whose arms the centre of thrust moved, with the p-value; the clearest first."""
    n_lines = len(_lines(place))
    found = [
        (rotor, change, change.p_value * n_lines)
        for rotor, change in enumerate(changes)
        if change is not None and change.size.value > 0.0 and change.p_value * n_lines < _OF_EACH
    ]
    return sorted(found, key=lambda one: (one[2], -one[1].size.value))


def _is_the_rotor(
    fit: _Fit, balances: _Balances, sent: Commanded, rate: CleanSeries | None, change: Change
) -> bool:
    """Return whether yaw, or yaw and what the rotor's own movements make, say that it is no load.

    Two independent numbers of standard errors, by Stouffer's sum.
    """
    if fit.yaw_is_sure or rate is None:
        return fit.yaw_is_sure
    parts = []
    for rows in (change.before, change.after):
        time_s = balances.time_s[rows]
        found = find_effectiveness(sent.series, sent.place, rate, [(float(time_s[0]), float(time_s[-1]))])
        parts.append(found[fit.rotor])
    before, after = parts
    if before is None or after is None or before.ci95 is None or after.ci95 is None:
        return False
    error = float(np.hypot(before.ci95[1] - before.value, after.ci95[1] - after.value)) / NORMAL_95
    in_errors = (before.value - after.value) / error
    return in_errors > 0.0 and (fit.yaw_in_errors + in_errors) / np.sqrt(2.0) > NORMAL_95


def _fit_change(balances: _Balances, place: FloatArray, rotor: int, change: Change) -> _Fit | None:
    across, yaw = (
        between(values, change.before, change.after) for values in _across_and_yaw(balances, place, rotor)
    )
    return _fit(rotor, place, change.size, across, yaw)


def _across_and_yaw(balances: _Balances, place: FloatArray, rotor: int) -> tuple[FloatArray, FloatArray]:
    """Return what one rotor cannot move, across its arm, and the balance of yaw in the sense of its spin."""
    forward, right = _arms(place)[rotor]
    across = balances.balance[:, :2] @ np.array([-right, forward])
    return across, balances.balance[:, 2] * place[rotor, 2]


def _fit(
    rotor: int, place: FloatArray, along: Difference, across: Difference, yaw: Difference
) -> _Fit | None:
    """Return what a rotor gives if it alone explains this; None where it does not."""
    reach, n_rotors = float(np.linalg.norm(place[rotor, :2])), len(place)
    if not abs(across.value) <= _CONTRADICTS * across.half_width:
        return None
    low, middle, high = (
        _gives(float(np.clip(value / reach, -0.9, 0.9)), n_rotors)
        for value in (
            along.value + along.half_width,
            along.value,
            along.value - along.half_width,
        )
    )
    expected = along.value / reach
    agrees = abs(yaw.value - expected) <= _CONTRADICTS * yaw.half_width + along.half_width / reach
    in_errors = NORMAL_95 * yaw.value / yaw.half_width if yaw.half_width > 0.0 else 0.0
    return _Fit(rotor, Quantity(middle, "1", (low, high)), agrees, in_errors)


def _gives(excess: float, n_rotors: int) -> float:
    """Return what a rotor gives of what it is sent, if its part is larger by this fraction of the whole."""
    more = n_rotors * excess / (1.0 - excess)
    return 1.0 / (1.0 + more) if more > -1.0 else float("inf")


def _loss(gives: Quantity) -> Quantity:
    low, high = gives.ci95 or (gives.value, gives.value)
    return Quantity(1.0 - gives.value, "1", (1.0 - high, 1.0 - low))


def _as_change(balances: _Balances, place: FloatArray, rotor: int, change: Change | None) -> Quantity | None:
    """Return what a rotor gave at the end over the beginning, if it alone can have changed."""
    fit = None if change is None else _fit_change(balances, place, rotor, change)
    if fit is None or not fit.yaw_agrees:
        return None
    low, high = fit.gives.ci95 or (0.0, 0.0)
    return fit.gives if fit.yaw_is_sure or low <= 1.0 <= high else None


def _axes_change(
    changes: Sequence[Change | None], place: FloatArray, rotors: Container[int]
) -> tuple[Quantity, ...]:
    """Return how the loss of one of these rotors changed each axis; nothing where the balance did not move.

    An axis' torque is shared out by arms, so that a rotor counts by its arm's square. Neither yaw nor what
    moved across the arm is asked: a load that slipped moves the balance, too, and changes nothing.
    """
    found = [one for one in _moved(changes, place) if one[0] in rotors]
    if not found:
        return ()
    rotor, change, _ = found[0]
    reach, share = float(np.linalg.norm(place[rotor, :2])), directions(place) ** 2
    part = share[:, rotor] / share.sum(axis=1)
    low, middle, high = (
        1.0 - part * (1.0 - _gives(float(np.clip(moved / reach, 0.0, 0.9)), len(place)))
        for moved in (change.size.value + sign * change.size.half_width for sign in (1.0, 0.0, -1.0))
    )
    return tuple(
        Quantity(float(value), "1", (float(least), float(most)))
        for value, least, most in zip(middle, low, high, strict=True)
    )


def _weak(
    balances: _Balances,
    place: FloatArray,
    effectiveness: Sequence[Quantity | None],
    names: Sequence[str],
) -> RotorFault | None:
    """Return the rotor that was weak all the time, if one alone explains the balances and yaw says so."""
    n_lines, found = len(_lines(place)), []
    for rotor, arm in enumerate(_arms(place)):
        along = mean_of(balances.balance[:, :2] @ arm)
        if not along.value > 0.0 or not along.p_value * n_lines < _OF_EACH:
            continue
        across, yaw = (mean_of(values) for values in _across_and_yaw(balances, place, rotor))
        fit = _fit(
            rotor,
            place,
            Difference(along.value, along.half_width),
            Difference(across.value, across.half_width),
            Difference(yaw.value, yaw.half_width),
        )
        if (
            fit is not None
            and fit.yaw_is_sure
            and not _contradicts(effectiveness[rotor], fit.gives, len(place))
        ):
            found.append((along.p_value * n_lines, fit))
    if not found:
        return None
    p_value, fit = min(found, key=lambda one: one[0])
    return RotorFault(
        code=_WEAK,
        rotor=fit.rotor,
        time_s=float("nan"),
        size=_loss(fit.gives),
        p_value=p_value,
        sentence=(
            f"{names[fit.rotor].capitalize()} gives {_percent(_loss(fit.gives))} less thrust than the "
            "others for the same command, if the centre of mass is in the middle of the rotors."
        ),
    )


def _contradicts(measured: Quantity | None, claimed: Quantity, n_rotors: int) -> bool:
    """Return whether what a rotor's own movements tell excludes what the balance says of it."""
    if measured is None or measured.ci95 is None or claimed.ci95 is None:
        return False
    most = claimed.ci95[1]
    # The prior draws towards equal rotors: what contradicts is nearer to those than to the claim.
    return measured.ci95[0] > 0.5 * (1.0 + most * n_rotors / (n_rotors - 1.0 + most))


class _Offset(NamedTuple):
    forward: Quantity
    right: Quantity
    p_value: float


def _mass_offset(balances: _Balances, attitude: CleanSeries | None) -> _Offset | None:
    """Return where the centre of thrust is: below it hangs the centre of mass, but for drag."""
    if len(balances.balance) < FEWEST:
        return None
    # Without attitude nobody knows how far drag tilted the vehicle, forward and to the right.
    dead = None
    if attitude is not None and balances.time_s.size:
        rows = attitude.within(float(balances.time_s[0]), float(balances.time_s[-1]))
        angles = attitude.of_rows(rows)[:, :2]
        angles = angles[np.isfinite(angles).all(axis=1)]
        dead = _DRAG_HEIGHT * np.abs(np.tan(angles.mean(axis=0)[::-1])) if len(angles) else None
    means = [
        mean_of(balances.balance[:, axis], 0.0 if dead is None else float(dead[axis])) for axis in range(2)
    ]
    forward, right = (
        Quantity(one.value, "arm", (one.value - one.half_width, one.value + one.half_width)) for one in means
    )
    p_value = 1.0 if dead is None else min(2.0 * min(one.p_value for one in means), 1.0)
    return _Offset(forward, right, p_value)


def _thrust_change(balances: _Balances, force: CleanSeries | None) -> Quantity | None:
    """Return thrust for a unit of command at the end of the flight over that at the beginning."""
    if force is None or force.n_columns < 3:
        return None
    rows = np.searchsorted(force.time_s, balances.time_s[:, np.newaxis] + _STEP_S * np.array([-0.5, 0.5]))
    values = np.nan_to_num(force.values[:, 2])
    sums = np.concatenate([[0.0], np.cumsum(values)])
    count = rows[:, 1] - rows[:, 0]
    kept = count > 0
    if np.count_nonzero(kept) < FEWEST:
        return None
    lift = -(sums[rows[kept, 1]] - sums[rows[kept, 0]]) / count[kept] / balances.total[kept]
    mean = float(lift.mean())
    if not mean > 0.0:
        return None
    fifth = len(lift) // 5
    change = between(lift / mean, slice(0, fifth), slice(len(lift) - fifth, len(lift)))
    value = 1.0 + change.value
    return Quantity(value, "1", (value - change.half_width, value + change.half_width))


def _percent(size: Quantity) -> str:
    low, high = size.ci95 or (size.value, size.value)
    return f"{plus_minus(100.0 * abs(size.value), 50.0 * (high - low))} %"


def _sentence(faults: Sequence[RotorFault], changes: Sequence[Change | None], place: FloatArray) -> str:
    if faults:
        return " ".join(one.sentence for one in faults)
    seen = [one for one in changes if one is not None]
    if not seen:
        return "No rotor fault was found. The flight is too short to see a loss of thrust."
    worst = max(
        1.0 - _gives(min(one.detectable / float(np.linalg.norm(place[rotor, :2])), 0.9), len(place))
        for rotor, one in enumerate(changes)
        if one is not None
    )
    if worst > _HALF:
        return "No rotor fault was found. This log would not show the loss of half of a rotor's thrust."
    shown = max(100.0 * worst, 1.0)
    return f"No rotor fault was found. Smallest detectable loss of a rotor's thrust in flight: {shown:.0f} %."
