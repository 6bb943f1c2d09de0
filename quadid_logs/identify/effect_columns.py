"""What rotors and logs do beside a linear response, as columns of the equations of `identify.spectral`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.data.model import Effect
from quadid_logs.data.torque import HeldScale
from quadid_logs.identify.rotors import Rotors, beside_linear_lag, per_rotor, rotors_known
from quadid_logs.identify.spectral import SpectralSolution, command_records, spectra_of
from quadid_logs.identify.varying_gain import VARIES, likeliest_variation
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.interval_censored import expected_within
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.rotations import tilt_from_rates
from quadid_logs.maths.thrust_curve import slope_at, slopes_at

#: Where dead zones and limits are looked for, as quantiles of the torque's size.
_DEAD_ZONES: Final = (0.1, 0.2, 0.35, 0.5, 0.65)
_LIMITS: Final = (0.8, 0.9, 0.96)
#: Judged, no source: steps of outputs, friction and dead bands of speed controllers are some tenths of a per
#: cent of the full command, and one vehicle of three that has any effect has such a dead zone: it is as
#: likely as three of the six other kinds.
_SMALL_DEAD_ZONE = 0.005
_OTHERS = 3.0
#: By how much of the mean quicker rotors speed up, and slower they slow down: motors that brake slow down
#: about as fast as they speed up, others take 1.5 to 5 times as long.
_ASYMMETRIES: Final = (0.2, 0.35, 0.5, 0.65)
#: Standard deviations of the coefficients. From nothing to all of the torque is lost below a dead zone or
#: beyond a limit.
_LOST = 0.5
#: Drag beside the centre of mass, and loads, swing a tilted vehicle at some 0.4 Hz [1/s^2].
_TILT_1_S2 = (2.0 * np.pi * 0.4) ** 2
#: Thrust goes with the throttle to a power of one to two: its slope, where nothing straightens the curve, to
#: a power of none to one.
_BY_THROTTLE = 0.5
#: Propellers measured on stands have an expo of 0.2 to 0.8 (docs/method.md), most of them: a deviation of
#: 0.15; so has what a firmware was told, and the difference is what counts.
_EXPO = 0.15 * 2.0**0.5
#: Of the curve's derivative by the expo, which is smooth.
_CURVE_POINTS = 1000
#: Equal parts of the flight, ordered by the lift.
_OF_LIFT: Final = (0.1, 0.3, 0.5, 0.7, 0.9)


class EffectColumn(NamedTuple):
    """What one effect adds to the equations of some axes, at one level.

    ``values``, ``by_slope`` of shape (n_blocks, n_lines, 3), as of `BlockSpectra`; ``told``: the same
    function of the commanded torque, None where it is linear. ``of_torque``: it is taken from the torque, and
    acts through the rotors; else it is an acceleration by itself. ``lost``: it takes torque, and gives none.
    ``spread``: standard deviation of its coefficient before the flight is seen; ``weight``: of this level
    among those of its kind; ``varies``: standard deviation over the flight of what a unit makes of the gain.
    """

    kind: Effect
    axes: tuple[int, ...]
    values: ComplexArray
    by_slope: ComplexArray
    told: ComplexArray | None
    of_torque: bool
    lost: bool
    spread: float
    weight: float
    varies: float = 0.0


class Loss(NamedTuple):
    """What an effect takes from a torque (n_samples, 3) at one level.

    ``weight`` of the level among all of its effect's: one, or (3,) of each axis.
    """

    effect: Effect
    lost: Callable[[FloatArray], FloatArray]
    weight: float | FloatArray


class FlownSignals:
    """The torques of a flight, and those that follow from what was commanded, in time.

    Attributes
    ----------
    data : FlightData
    records : list of CommandRecord
    torques, told : list of ndarray, each of shape (n_samples, 3)
        Of each record, as logged and as commanded.
    moved : tuple of int
        The axes that are estimated.
    """

    def __init__(self, solution: SpectralSolution, data: FlightData) -> None:
        self.data, self.records, self.spectra = data, command_records(data), solution.spectra
        self.torques = [record.segment.torque for record in self.records]
        self.told = self.in_time(solution.told)
        self.moved = tuple(axis.number for axis in solution.axes)

    def in_time(self, lines: ComplexArray) -> list[FloatArray]:
        """Return signals, one array of shape (n_samples, 3) a record, of spectra (n_blocks, n_lines, 3)."""
        period_s, step_hz = self.data.sample_period_s, float(np.diff(self.spectra.frequency_hz[:2])[0])
        n = 2 * round(0.5 / (step_hz * period_s))
        where = np.rint(self.spectra.frequency_hz / step_hz).astype(int)
        signals = [np.zeros((record.segment.n_samples, lines.shape[2])) for record in self.records]
        place = np.zeros(len(signals), dtype=int)
        for block, record in zip(lines, self.spectra.run.tolist(), strict=True):
            full = np.zeros((n // 2 + 1, lines.shape[2]), dtype=np.complex128)
            full[where] = block / period_s
            first = place[record]
            # Windows that overlap add to one. One has a mean square of one; Hann's as it is adds up to one,
            # its mean square is 3/8.
            signals[record][first : first + n] += np.sqrt(0.375) * np.fft.irfft(full, n, axis=0)
            place[record] += n // 2
        return signals

    @cached_property
    def hidden_by_steps(self) -> list[FloatArray]:
        """What whole steps towards zero are expected to hide of each record's torque, (n_samples, 3)."""
        grid = (0.0, 0.0, 0.0) if self.data.input is None else self.data.input.grid
        torque, told = np.concatenate(self.torques), np.concatenate(self.told)
        hidden = np.zeros_like(torque)
        for axis, step in enumerate(grid):
            if step:
                logged = torque[:, axis]
                # Zero was logged of both signs.
                low, high = logged - step * (logged < 0.5 * step), logged + step * (logged > -0.5 * step)
                hidden[:, axis] = expected_within(low, high, told[:, axis]) - logged
        return np.split(hidden, np.cumsum([len(each) for each in self.torques])[:-1])

    def column(
        self,
        kind: Effect,
        made: Sequence[Callable[[FloatArray], FloatArray]],
        *,
        lost: bool,
        spread: float,
        weight: float,
        varies: float = 0.0,
    ) -> EffectColumn | None:
        """Return a column about all axes that functions make of the torques, one for each record."""
        actual, commanded = (
            [make(each) for make, each in zip(made, signals, strict=True)]
            for signals in (self.torques, self.told)
        )
        return self.of_signals(
            kind, actual, commanded, lost=lost, spread=spread, weight=weight, varies=varies
        )

    def of_signals(
        self,
        kind: Effect,
        acting: list[FloatArray],
        commanded: list[FloatArray],
        *,
        lost: bool,
        spread: float,
        weight: float,
        varies: float = 0.0,
    ) -> EffectColumn | None:
        """Return a column about all axes of what is lost of torques, and of commanded ones, each (n, 3)."""
        actual, told = (spectra_of(each, self.records, self.data) for each in (acting, commanded))
        if actual is None or told is None:
            return None
        return EffectColumn(
            kind,
            self.moved,
            actual.values,
            actual.by_slope,
            told.values,
            of_torque=True,
            lost=lost,
            spread=spread,
            weight=weight,
            varies=varies,
        )

    def of_loss(self, loss: Loss, spread: float = _LOST) -> EffectColumn | None:
        """Return the column about all axes of what an effect takes from the torque."""
        made = [loss.lost] * len(self.records)
        weight = float(np.mean(loss.weight))
        return self.column(loss.effect, made, lost=True, spread=spread, weight=weight)


def effect_columns(signals: FlownSignals, lag_s: float) -> Iterator[EffectColumn]:
    """Yield the columns of all effects that do not depend on what is left, at each level.

    Parameters
    ----------
    signals : FlownSignals
    lag_s : float
        Of the rotors [s].

    Yields
    ------
    EffectColumn
    """
    torques, described = signals.torques, signals.data.input
    for loss in _losses_of_axes(torques, described):
        column, weights = signals.of_loss(loss), np.broadcast_to(loss.weight, 3).tolist()
        if column is not None:
            yield from (column._replace(axes=(axis,), weight=weights[axis]) for axis in signals.moved)
    for loss in _losses_of_all(torques, described):
        column = signals.of_loss(loss)
        if column is not None:
            yield column
    yield from _late_rotors(signals, lag_s)
    if described is not None and any(described.grid):
        yield from _cut_off(signals, np.array(described.grid, dtype=np.float64))
    yield from _tilts(signals)
    yield from _by_throttle(signals)
    yield from _by_curve(signals)


def _cut_off(signals: FlownSignals, steps: FloatArray) -> Iterator[EffectColumn]:
    """Yield what whole steps (3,) hide of torques if they were cut and not rounded: lost, it is added.

    One logger writes all axes: the coefficient is one if it cuts, and none if it rounds.
    """
    size = np.where(steps, steps, np.inf)
    column = signals.of_signals(
        "cut steps",
        [-each for each in signals.hidden_by_steps],
        # What was commanded is known: so is what steps hide of it.
        [np.where(steps, -np.fmod(each, size), 0.0) for each in signals.told],
        lost=True,
        spread=1.0,
        weight=1.0,
    )
    if column is not None:
        yield column


def as_cut(signals: FlownSignals) -> FlightData:
    """Return the flight with the torque as it was before it was cut to whole steps.

    Parameters
    ----------
    signals : FlownSignals

    Returns
    -------
    FlightData
        Of what was commanded, and with no steps.
    """
    data = signals.data
    if data.input is None:
        return data
    segments = [
        replace(record.segment, torque=record.segment.torque + hidden)
        for record, hidden in zip(signals.records, signals.hidden_by_steps, strict=True)
    ]
    return replace(data, segments=tuple(segments), input=replace(data.input, grid=(0.0, 0.0, 0.0)))


def variation_columns(
    signals: FlownSignals, error: ComplexArray, explained: ComplexArray
) -> Iterator[EffectColumn]:
    """Yield the likeliest variation of all effectiveness, at its phase and across it.

    Parameters
    ----------
    signals : FlownSignals
    error, explained : ndarray of complex, shape (n_blocks, n_lines, 3)
        What the equations leave and what they explain, both over the square root of the noise's density.

    Yields
    ------
    EffectColumn
    """
    records = signals.records
    time_s = [record.segment.time_s - records[0].segment.time_s[0] for record in records]
    left, told = (np.concatenate(signals.in_time(each)) for each in (error, explained))
    found = likeliest_variation(np.concatenate(time_s), left, told, signals.data.sample_period_s)
    if found is None:
        return
    for across in (found.phase_rad, found.phase_rad + 0.5 * np.pi):
        varies = [np.cos(2.0 * np.pi * found.frequency_hz * each - across) for each in time_s]
        yield from _varying(signals, varies, VARIES, 0.25 * found.weight)


def _by_throttle(signals: FlownSignals) -> Iterator[EffectColumn]:
    """Yield an effectiveness that goes with the throttle: the torque was rebuilt by another thrust curve."""
    throttle = [record.segment.throttle for record in signals.records]
    known = [each for each in throttle if each is not None]
    if len(known) < len(throttle) or not 0.0 < (mean := float(np.mean(np.concatenate(known)))) < np.inf:
        return
    yield from _varying(signals, [each / mean - 1.0 for each in known], _BY_THROTTLE, 0.25)


def _by_curve(signals: FlownSignals) -> Iterator[EffectColumn]:
    """Yield what another thrust curve makes of the torque of known rotors, per unit of its expo.

    Each rotor's effectiveness goes with its own thrust then, not only with the lift of all.
    """
    data, described = signals.data, signals.data.input
    segments = [record.segment for record in signals.records]
    per_thrust, by_torque = _mixing(described)
    if described is None or described.expo is None or not (rotors_known(data) and per_thrust.size):
        return
    if any(each.thrust_by_expo is None for each in segments):
        return
    lifts = _lifts(segments, by_torque)
    thrust, by_expo = per_rotor(segments)
    if described.expo.held in (HeldScale.WEIGHT, HeldScale.FULL):
        # What an expo makes of the scale is no effect: another slope in hover would pass for the curve.
        by_expo = by_expo - slope_at(thrust, by_expo, float(np.mean(thrust))) * thrust
    levels, first = np.unique(thrust, return_index=True)
    points = slice(None, None, max(1, levels.size // _CURVE_POINTS))
    curve = levels[points], by_expo[first][points]
    made = [
        partial(
            _other_curve,
            lift=each,
            curve=curve,
            mixing=(per_thrust, by_torque),
            own=described.expo.own_slopes,
        )
        for each in lifts
    ]
    # What an expo makes of the effectiveness of all axes comes and goes with the lift.
    lift = np.quantile(np.concatenate([each.mean(axis=1) for each in lifts]), _OF_LIFT)
    varies = float(np.std(slopes_at(*curve, lift)))
    if not np.isfinite(varies):
        return
    # An expo is known better where rotors' speeds tell it.
    expo = described.expo
    measured = expo.lag_is_measured and expo.half_width > 0.0
    spread = min(_EXPO, expo.half_width / NORMAL_95) if measured else _EXPO
    column = signals.column("varying gain", made, lost=False, spread=spread, weight=0.25, varies=varies)
    if column is not None:
        yield column


def _other_curve(
    torque: FloatArray,
    lift: FloatArray,
    curve: tuple[FloatArray, FloatArray],
    mixing: tuple[FloatArray, FloatArray],
    own: FloatArray,
) -> FloatArray:
    """Return what rotors take from a torque per unit that their expo is smaller; shape (n, 3)."""
    per_thrust, by_torque = mixing
    by_expo = np.interp(torque @ by_torque.T + lift, *curve)
    return np.asarray(own * torque - by_expo @ per_thrust.T)


def _varying(
    signals: FlownSignals, varies: Sequence[FloatArray], spread: float, weight: float
) -> Iterator[EffectColumn]:
    """Yield an effectiveness of all axes that is larger by ``varies`` of each record, (n_samples,)."""
    deviation = float(np.std(np.concatenate(varies)))
    made = [partial(np.multiply, -each[:, np.newaxis]) for each in varies]
    column = signals.column("varying gain", made, lost=False, spread=spread, weight=weight, varies=deviation)
    if column is not None:
        yield column


def _below(torque: FloatArray, level: FloatArray) -> FloatArray:
    return np.clip(torque, -level, level)


def _beyond(torque: FloatArray, level: FloatArray) -> FloatArray:
    return torque - np.clip(torque, -level, level)


def _below_of_rotors(
    torque: FloatArray, level: float, by_torque: FloatArray, per_thrust: FloatArray
) -> FloatArray:
    """Return the torque of what each rotor gets of its command below a level."""
    return np.asarray(np.clip(torque @ by_torque.T, -level, level) @ per_thrust.T)


def _losses_of_axes(torques: Sequence[FloatArray], described: InputDescription | None) -> Iterator[Loss]:
    """Yield what the torque about each axis may lose by itself."""
    sizes = np.abs(np.concatenate(torques))
    for level in np.quantile(sizes, _DEAD_ZONES, axis=0):
        yield Loss("threshold", partial(_below, level=level), _dead_zone_weight(level, described))
    for level in np.quantile(sizes, _LIMITS, axis=0):
        yield Loss("limit", partial(_beyond, level=level), 1.0 / len(_LIMITS))


def _losses_of_all(torques: Sequence[FloatArray], described: InputDescription | None) -> Iterator[Loss]:
    """Yield what dead zones of the rotors take, where their mixing is known, and those of the commands.

    One dead zone of the commands about all axes is as likely as one about each.
    """
    per_thrust, by_torque = _mixing(described)
    if per_thrust.size:
        for level in np.quantile(np.abs(np.concatenate(torques) @ by_torque.T), _DEAD_ZONES):
            lost = partial(_below_of_rotors, level=level, by_torque=by_torque, per_thrust=per_thrust)
            yield Loss("rotor threshold", lost, 1.0 / len(_DEAD_ZONES))
    for level in np.quantile(np.abs(np.concatenate(torques)), _DEAD_ZONES):
        yield Loss("threshold", partial(_below, level=level), _dead_zone_weight(level, described))


def _dead_zone_weight(level: FloatArray, described: InputDescription | None) -> FloatArray:
    """Return the weight of dead zones at a level, of one axis or of all: a small one is likelier.

    How small it is, is known where the torque is a fraction of the full command.
    """
    of_command = described is not None and described.kind == "torque_command"
    likelier = _OTHERS / (1.0 + level / _SMALL_DEAD_ZONE) if of_command else 0.0
    return np.asarray(0.5 * (1.0 + likelier) / len(_DEAD_ZONES), dtype=np.float64)


def _tilts(signals: FlownSignals) -> Iterator[EffectColumn]:
    """Yield roll and pitch, of which a moment may be left."""
    angles = [
        tilt_from_rates(record.segment.body_rate_rad_s, signals.data.sample_period_s)
        if record.segment.attitude_rad is None
        else record.segment.attitude_rad[:, :2]
        for record in signals.records
    ]
    if not all(np.isfinite(each).all() for each in angles):
        return
    spectra = spectra_of(
        [np.column_stack([each, 0.0 * each[:, :1]]) for each in angles], signals.records, signals.data
    )
    if spectra is not None:
        for axis in signals.moved:
            if axis < 2:
                yield EffectColumn(
                    "tilt", (axis,), spectra.values, spectra.by_slope, None, False, False, _TILT_1_S2, 1.0
                )


def _late_rotors(signals: FlownSignals, lag_s: float) -> Iterator[EffectColumn]:
    """Yield what rotors that slow down later than they speed up take, where each one's thrust is known.

    The coefficient is one if they do so by as much as the level says.
    """
    per_thrust, by_torque = _mixing(signals.data.input)
    if not (rotors_known(signals.data) and per_thrust.size):
        return
    lift = _lifts([record.segment for record in signals.records], by_torque)
    levels = [Rotors(lag_s / (1.0 + each), lag_s / (1.0 - each)) for each in _ASYMMETRIES]
    of_torques, of_told = (
        [
            _late(torque, each, levels, (per_thrust, by_torque), signals.data.sample_period_s)
            for torque, each in zip(torques, lift, strict=True)
        ]
        for torques in (signals.torques, signals.told)
    )
    for acting, commanded in zip(zip(*of_torques, strict=True), zip(*of_told, strict=True), strict=True):
        column = signals.of_signals(
            "asymmetry", [*acting], [*commanded], lost=True, spread=1.0, weight=1.0 / len(levels)
        )
        if column is not None:
            yield column


def _lifts(segments: Sequence[Segment], by_torque: FloatArray) -> list[FloatArray]:
    """Return what known rotors give beside the torque, as it was flown; (n_samples, n_rotors) a segment."""
    return [
        np.asarray(each.rotor_thrust - each.torque @ by_torque.T)
        for each in segments
        if each.rotor_thrust is not None
    ]


def _late(
    torque: FloatArray,
    lift: FloatArray,
    levels: Sequence[Rotors],
    mixing: tuple[FloatArray, FloatArray],
    period_s: float,
) -> list[FloatArray]:
    """Return what rotors take from a torque that slow down later than they speed up; (n, 3) for each level.

    Speed follows with the lag T/(1 + a) upwards and T/(1 - a) downwards, and would follow with T, the same at
    all levels, both ways. What that adds to a thrust has no sign: of two rotors that a torque moves against
    each other it cancels where both lack as much.
    """
    per_thrust, by_torque = mixing
    thrust = np.maximum(torque @ by_torque.T + lift, 0.0)
    speed, lag_s = np.sqrt(thrust), 2.0 / (1.0 / levels[0].up_s + 1.0 / levels[0].down_s)
    even, *late = (
        beside_linear_lag(thrust, speed, period_s, each, lag_s)[0] for each in (Rotors(lag_s, lag_s), *levels)
    )
    return [np.asarray((even - each) @ per_thrust.T) for each in late]


def _mixing(described: InputDescription | None) -> tuple[FloatArray, FloatArray]:
    """Return the torque per thrust, (3, n_rotors), and its pseudo-inverse; empty where it is not known."""
    per_thrust = None if described is None else described.torque_per_thrust
    if per_thrust is None or not np.isfinite(per_thrust).all() or not per_thrust.any():
        return np.zeros((3, 0)), np.zeros((0, 3))
    return per_thrust, np.asarray(np.linalg.pinv(per_thrust), dtype=np.float64)
