"""Effectiveness, damping, lag and delay from block spectra by instruments, weighted by the noise.

Where air moves a vehicle as much as its commands do, a fit in time needs a band to be chosen, and calls the
air an error of the model. Here it is noise with a spectrum: each frequency counts for as much as is known
there. What was commanded tells the torque (first stage), each block by the others (jackknife instrumental
variables: Angrist, Imbens and Krueger, J. Applied Econometrics 14, 1999), and the equation of motion,

    d(rate)/dt = B h * (torque + lead d(torque)/dt) + A rate + c (product of other rates) + o (other axes)
                 + a (speed over ground, where a trajectory was planned and the log has a velocity)
                 + e (what large torques make of rotors whose speeds lag, beside what one lag makes of them),

with h of lag and delay, is multiplied by that and summed over blocks and lines to one complex moment for each
band (generalised method of moments: Hansen, Econometrica 50, 1982; the covariance of the moments is that of
blocks, neighbours together: Newey and West, Econometrica 55, 1987). A smooth departure of the measured
response from the model's, whose size the flight itself tells, is part of their covariance (stochastic
embedding: Goodwin, Gevers and Ninness, IEEE Trans. Automatic Control 37, 1992), so that what the model cannot
describe widens the intervals. So is what commands make of tilt and speed, whose moments the torque holds
against: it rises towards low frequencies, and from where the flight tells, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray, runs
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.log import GyroFilter
from quadid_logs.data.model import Response, SpectralFit
from quadid_logs.identify.driven import by_driven_axis
from quadid_logs.identify.excitation import MIN_RATE_RMS_DEG_S
from quadid_logs.identify.response import Band
from quadid_logs.identify.rotors import Rotors, equivalent_torque, rotors_known
from quadid_logs.identify.systematic import GYRO_SYSTEMATIC
from quadid_logs.identify.terms import MOST_DAMPING_1_S
from quadid_logs.maths.band import ComplexArray, gyro_response
from quadid_logs.maths.block_spectra import BlockSpectra, block_spectra
from quadid_logs.maths.normal import NORMAL_95

#: Of a block: twice the time in which a rate loop of half a hertz forgets, and a flight of half a minute has
#: fourteen [s].
BLOCK_S: Final = 4.0
#: Of a planned trajectory, whose flights last for some seconds. A flight of six seconds has three blocks; one
#: of four has one, and a quarter of it behind that: with fewer than `_FEWEST_BLOCKS`, they overlap by more.
_PLANNED_BLOCK_S = 3.0
#: What commands a turn commands tilt and speed, too, whose moments (of the air, and of the trim that they
#: need) the torque holds against. Where they are as large as the torque's own the flight tells, in half
#: octaves, or that there are none. With 0.25 Hz they are a sixth of the torque's in the lowest band: with
#: less, no more than other departures.
_MOMENTS_HZ: Final = (0.0, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
#: Beyond, blades, frame and filters move a gyro, and not the torque of rotors with a lag of some ten ms.
_HIGHEST_HZ = 30.0
#: Six samples a cycle: with fewer, what the torque does between two samples is a guess.
_OF_SAMPLE_RATE = 1.0 / 6.0
_BANDS_PER_OCTAVE = 6
#: Lines on each side of one that its first stage is fitted to, too: the response of a loop to its command
#: changes over its own bandwidth, which is one hertz and more.
_SHARED_LINES = 2
#: A block that holds more of what was commanded at a frequency than this is told by itself, too.
_MOST_LEVERAGE = 0.8
#: The power of gusts varies from block to block by a factor of two either way: sqrt(2 / 4) of its logarithm.
_GUSTS_FREEDOM = 4.0
#: Loops around the speed of a multirotor, a pilot's or an autopilot's, close a fifth below those around its
#: angles, which have 3 to 8 rad/s [rad/s].
_HOLDS_PLACE_RAD_S = 1.0
#: Of the whole motion, in amplitude, what products of motions (loops for the position, thrust curves, a
#: gyro's nonlinearity) may put where nobody commanded it: as much as a gyro's scale is off.
_ELSEWHERE = GYRO_SYSTEMATIC
#: Of first-stage directions, against the strongest: rounding and more.
_RIDGE = 1e-3
#: Time constants of motors with propellers of 3 to 30 inches are 10 to 150 ms: one standard deviation of
#: their logarithm is 0.7 around 35 ms. Outputs reach the motors 1 to 30 ms after they were logged, before
#: that only where the log stamps them late.
_LAG_S, _LAG_SPREAD = 0.035, 0.7
_DELAY_S, _DELAY_SPREAD_S = 0.008, 0.008
#: Three standard deviations below, one in a thousand motors has such a lag, but every vehicle without motors,
#: as firmware in the loop may fly: 4 ms.
_NO_LAG_S: Final = _LAG_S * float(np.exp(-3.0 * _LAG_SPREAD))
_LAGS_S: Final = np.geomspace(0.002, 0.15, 10)
_DELAYS_S: Final = (-0.02, -0.004, 0.004, 0.012, 0.03)
_LEADS_S: Final = (0.0, 0.1, 0.2)
#: Rotors that accelerate turn yaw ahead of their drag by 0 to 0.3 s.
_LEAD_SPREAD_S = 0.15
#: No gyroscopic coefficient is larger than one.
_GYROSCOPIC_SPREAD = 0.5
#: What one axis takes of another's acceleration: misalignment of the gyro and products of inertia.
_CROSS_SPREAD = 0.03
#: Moments of the air go with the speed: of a nano-drone by 20 rad/s^2 for each m/s, of larger ones by less.
_SPEED_SPREAD = 20.0
#: Columns of `flight_spectra` before speeds and commands.
N_BEFORE_COMMANDS: Final = 12
#: Speed along body x and y.
_N_SPEEDS: Final = 2
#: Of the relative departure, one standard deviation: a rotor is no better described than to some per cent by
#: one lag. With two, nine flown flights of one vehicle scatter by 0.8 of what their intervals say (with three
#: by 0.6, with one by 0.9), so that a departure that all flights have in common finds room in them.
LEAST_DEPARTURE: Final = 0.02
#: Those that are tried.
_DEPARTURES: Final = np.array([LEAST_DEPARTURE, 0.04, 0.08, 0.16, 0.32, 0.64])
#: Half of what is tried lies below this before the flight is seen (half-Cauchy).
_TYPICAL_DEPARTURE = 0.05
#: A departure keeps its value over this much of the logarithm of frequency: an octave.
OCTAVE: Final = float(np.log(2.0))
_ITERATIONS = 5
#: A rotor's time constant is J / (K^2/R + 2 k w): what its propeller's torque k w^2 takes from the speed
#: without load, a quarter to a third at full throttle, makes it half as long there as at rest: a third apart
#: from that in between. 26 flown axes, each fitted without this prior, are 0.04 +- 0.11 off on the mean and
#: scatter by 0.32 (docs/method.md).
_ROTORS_SPREAD = 1.0 / 3.0
#: What rotors make of large torques goes with the square of their lag: until it is the one it was made with.
_ROTOR_ROUNDS, _SAME_LAG = 3, 0.01
#: Of derivatives, in standard deviations of what vehicles have.
_STEP = 1e-4
#: Ten seconds, as of every flight: of fewer blocks, how they scatter is not known.
_FEWEST_BLOCKS = 4
#: Signals beyond have squares that are no numbers; no unit makes a torque or a rate so small or large.
_SMALLEST, _LARGEST = 1e-60, 1e60
_AXES: Final = 3
_YAW: Final = 2
_TINY = float(np.finfo(np.float64).tiny)


class SharedActuator(NamedTuple):
    """Lag and delay [s] that all axes share, and the lead of yaw [s]."""

    lag_s: float
    delay_s: float
    lead_s: float

    def on(self, axis: int) -> SharedActuator:
        """Return what an axis has of it."""
        return self if axis == _YAW else self._replace(lead_s=0.0)

    @property
    def coordinates(self) -> FloatArray:
        """Where it is searched for, in standard deviations of what vehicles have; shape (3,)."""
        return np.array(
            [
                np.log(self.lag_s / _LAG_S) / _LAG_SPREAD,
                (self.delay_s - _DELAY_S) / _DELAY_SPREAD_S,
                self.lead_s / _LEAD_SPREAD_S,
            ]
        )

    @classmethod
    def of(cls, fit: SpectralFit) -> SharedActuator:
        """Return the actuator of an estimate."""
        lag_s, delay_s, reaction = fit.mean[2:].tolist()
        return cls(lag_s, delay_s, reaction / fit.gain if fit.gain else 0.0)

    @classmethod
    def at(cls, coordinates: FloatArray) -> SharedActuator:
        """Return the actuator at coordinates; never beyond five standard deviations."""
        lag, delay, lead = np.clip(coordinates, -5.0, 5.0).tolist()
        return cls(
            _LAG_S * float(np.exp(_LAG_SPREAD * lag)),
            _DELAY_S + _DELAY_SPREAD_S * delay,
            _LEAD_SPREAD_S * lead,
        )


class SpectralSolution(NamedTuple):
    """The estimates of all axes, and what they were made from.

    Attributes
    ----------
    fits : tuple of SpectralFit
        Roll, pitch, yaw.
    axes : list of AxisMoments
        Of the axes that could be estimated, weighted by the noise that these estimates leave.
    actuator : SharedActuator
    told : ndarray of complex, shape (n_blocks, n_lines, 3)
        The torques that follow from what was commanded.
    spectra : BlockSpectra
    planned : bool
        What was commanded is a planned trajectory.
    """

    fits: tuple[SpectralFit, ...]
    axes: list[AxisMoments]
    actuator: SharedActuator
    told: ComplexArray
    spectra: BlockSpectra
    planned: bool


def solve_flight(data: FlightData) -> SpectralSolution | None:
    """Estimate the equations of all axes from what was commanded of them in a flight.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    SpectralSolution or None
        None where nothing tells what was commanded, or it lasts for less than four blocks.
    """
    records = command_records(data)
    spectra = spectra_of([record.columns for record in records], records, data)
    if spectra is None:
        return None
    solve = partial(
        solve_spectra,
        gyro_filter=data.gyro_filter,
        planned=is_planned(data),
        repeated=any(segment.repeated for segment in data.segments),
        with_speed=has_speed(data),
        moved=np.flatnonzero(np.sum(blocks_that_turn(spectra), axis=0) > 1).tolist(),
        n_laws=_laws(data).size,
    )
    solution = solve(spectra)
    if not rotors_known(data):
        return solution
    for _ in range(_ROTOR_ROUNDS):
        if solution is None:
            break
        lag_s = solution.actuator.lag_s
        change = _by_lag_of_rotors(records, data, lag_s)
        if change is None:
            break
        values, by_slope = spectra.values.copy(), spectra.by_slope.copy()
        for each, added in ((values, change.values), (by_slope, change.by_slope)):
            each[:, :, _AXES : 2 * _AXES] += added
        solution = solve(
            spectra._replace(values=values, by_slope=by_slope),
            start=solution.actuator,
            by_rotors=_accelerations(solution, change),
        )
        if solution is not None and abs(solution.actuator.lag_s - lag_s) < _SAME_LAG * lag_s:
            break
    return solution


def _by_lag_of_rotors(
    records: Sequence[CommandRecord], data: FlightData, lag_s: float
) -> BlockSpectra | None:
    """Return what must be added to torques so that they, behind a linear lag, act as rotors do.

    The lag of rotors acts on their speeds, and thrust goes with the square of a speed.
    """
    if data.input is None:
        return None
    rotors = Rotors(lag_s, lag_s)
    changes = [
        equivalent_torque(record.segment, data.input, data.sample_period_s, rotors)[:, :_AXES]
        - record.segment.torque
        for record in records
    ]
    return spectra_of(changes, records, data)


def _accelerations(solution: SpectralSolution, torque: BlockSpectra) -> ComplexArray:
    """Return what torques do to the axes of a solution, shape (n_blocks, n_lines, 3); nothing to others."""
    made = np.zeros_like(torque.values)
    for axis in solution.axes:
        own = (each[:, :, axis.number] for each in (torque.values, torque.by_slope))
        made[:, :, axis.number] = solution.fits[axis.number].gain * axis.behind(solution.actuator, *own)
    return made


def fit_spectra(
    spectra: BlockSpectra,
    gyro_filter: GyroFilter,
    *,
    planned: bool = False,
    with_speed: bool = False,
    moved: Sequence[int] = range(_AXES),
) -> tuple[SpectralFit, ...]:
    """Estimate the equations of all axes from blocks, of a whole flight or of one that goes on.

    Parameters
    ----------
    spectra : BlockSpectra
        As of `flight_spectra`.
    gyro_filter : GyroFilter
        Of the flight.
    planned : bool
        What was commanded is a planned trajectory.
    with_speed : bool
        As of `flight_spectra`: the moments of the air go with it.
    moved : sequence of int
        Axes to estimate. On one at rest the controller turns the gyro's noise into torque, and the lag that
        explains it would be taken for that of all axes.

    Returns
    -------
    tuple of SpectralFit
        Roll, pitch, yaw; empty for less than four blocks, or where nothing was commanded. An axis
        that was not commanded has a wide interval, or `SpectralFit.departure`.
    """
    solution = solve_spectra(spectra, gyro_filter, planned=planned, with_speed=with_speed, moved=moved)
    return () if solution is None else solution.fits


def solve_spectra(
    spectra: BlockSpectra,
    gyro_filter: GyroFilter,
    *,
    planned: bool = False,
    repeated: bool = False,
    with_speed: bool = False,
    moved: Sequence[int] = range(_AXES),
    n_laws: int = 1,
    start: SharedActuator | None = None,
    by_rotors: ComplexArray | None = None,
) -> SpectralSolution | None:
    """Estimate as `fit_spectra` does, and keep what the estimates were made from.

    Parameters
    ----------
    spectra : BlockSpectra
    gyro_filter : GyroFilter
    planned : bool
        As of `fit_spectra`.
    repeated : bool
        The planned trajectory is known by several flights that repeat it.
    with_speed : bool
    moved : sequence of int
        As of `fit_spectra`.
    n_laws : int
        Kinds of flight modes, each with set-points of its own.
    start : SharedActuator or None
        Near the one to be found.
    by_rotors : ndarray of complex, shape (n_blocks, n_lines, 3), or None
        Accelerations by what the torque has beside the commanded one because the speeds of rotors lag.

    Returns
    -------
    SpectralSolution or None
        None where `fit_spectra` has no estimate.
    """
    if len(spectra.run) < _FEWEST_BLOCKS:
        return None
    n_speeds = _N_SPEEDS if with_speed else 0
    command = spectra.values[:, :, N_BEFORE_COMMANDS + n_speeds :]
    axes = [number for number in moved if _moves(spectra, number)]
    if spectra.frequency_hz.size < 2 * _SHARED_LINES or not _has_size(command) or not axes:
        return None
    torque = spectra.values[:, :, _AXES : 2 * _AXES]
    if planned:
        # One instrument an axis, as it is: a first stage of so weak ones would be noise of its own.
        told = command[:, :, :_AXES].copy()
    else:
        from_outside = _from_outside(command, spectra, gyro_filter, n_laws)
        given = np.abs(command).max(axis=(0, 1)) > _SMALLEST
        told = _told_by_others(command[:, :, given], torque, spectra.run, from_outside[:, given])
    axes = [number for number in axes if _has_size(told[:, :, number])]
    if not axes:
        return None
    moments = [
        AxisMoments(
            spectra,
            number,
            told[:, :, number],
            gyro_filter,
            n_speeds,
            planned=planned,
            by_rotors=None if by_rotors is None else by_rotors[:, :, number],
        )
        for number in axes
    ]
    fits, actuator = fit_axes(moments, start)
    if repeated:
        for axis in moments:
            told[:, :, axis.number] *= _weights(axis, actuator)
            axis.told = told[:, :, axis.number]
        fits, actuator = fit_axes(moments)
        fits = tuple(replace(fit, repeated=fit.planned) for fit in fits)
    return SpectralSolution(fits, moments, actuator, told, spectra, planned)


def _weights(axis: AxisMoments, actuator: SharedActuator) -> FloatArray:
    """Return how much each block counts, shape (n_blocks, 1): the less, the more the equation leaves of it.

    Several flights in different air are no even noise (generalised least squares).
    """
    power = np.mean(np.abs(axis.error(axis.solved(actuator)[0], actuator)) ** 2, axis=1)
    return np.asarray(np.median(power) / np.maximum(power, _TINY))[:, np.newaxis]


def blocks_that_turn(spectra: BlockSpectra) -> BoolArray:
    """Say which axes turn by more than a hovering vehicle does, block by block.

    Parameters
    ----------
    spectra : BlockSpectra
        The rates first.

    Returns
    -------
    ndarray of bool, shape (n_blocks, 3)
    """
    power = np.sum(np.abs(spectra.values[:, :, :_AXES]) ** 2, axis=1)
    # Parseval's theorem: lines are 1 / T apart, and stand for negative frequencies too.
    step_hz = spectra.frequency_hz[1] - spectra.frequency_hz[0] if spectra.frequency_hz.size > 1 else 0.0
    return np.asarray(np.degrees(np.sqrt(2.0 * power) * step_hz) >= MIN_RATE_RMS_DEG_S, dtype=np.bool_)


def is_planned(data: FlightData) -> bool:
    """Say whether planned trajectories are what was commanded, in every segment that tells.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    bool
    """
    told = [segment.planned for segment in data.segments if segment.command is not None]
    return bool(told) and all(told)


def has_speed(data: FlightData) -> bool:
    """Say whether the speed over ground stands before the commands in `flight_spectra`.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    bool
        Of planned trajectories, where every segment that tells them has a velocity.
    """
    return is_planned(data) and all(
        segment.velocity_m_s is not None for segment in data.segments if segment.command is not None
    )


def _moves(spectra: BlockSpectra, number: int) -> bool:
    """Say whether an axis has torque and motion."""
    return _has_size(spectra.values[:, :, _AXES + number]) and _has_size(spectra.derivative(number))


class CommandRecord(NamedTuple):
    """A part of the flight of which everything is known that the spectra need, without gaps."""

    segment: Segment
    columns: FloatArray


def command_records(data: FlightData) -> list[CommandRecord]:
    """Return the parts of the flight in which it is known what was commanded.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    list of CommandRecord
        Columns are those of `flight_spectra`; none where the parts differ in what was commanded.
    """
    records, with_speed, laws = [], has_speed(data), _laws(data)
    for segment in data.segments:
        if segment.command is None:
            continue
        p, q, r = segment.body_rate_rad_s.T
        command = by_driven_axis(segment.command, segment.torque, segment.time_s)
        speed = (
            [segment.velocity_m_s[:, :_N_SPEEDS]] if with_speed and segment.velocity_m_s is not None else []
        )
        if laws.size > 1 and segment.law is not None:
            command = _by_law(command, segment.law, laws)
        given = segment.command if segment.planned or segment.reference is None else segment.reference
        put_back = segment.command[:, :_AXES] - given[:, :_AXES]
        columns = np.column_stack(
            [segment.body_rate_rad_s, segment.torque, q * r, r * p, p * q, put_back, *speed, command]
        )
        records += [
            CommandRecord(segment.rows(slice(first, after)), columns[first:after])
            for first, after in runs(np.isfinite(columns).all(axis=1))
        ]
    return records if len({record.columns.shape[1] for record in records}) == 1 else []


def _laws(data: FlightData) -> IntArray:
    """Return the kinds of flight modes in which it is known what was commanded."""
    flown = [
        segment.law[np.isfinite(segment.command).all(axis=1)]
        for segment in data.segments
        if segment.command is not None and segment.law is not None
    ]
    return np.unique(np.concatenate(flown)) if flown else np.zeros(1, dtype=np.int64)


def _by_law(command: FloatArray, law: IntArray, laws: IntArray) -> FloatArray:
    """Return commands with set-points in columns of their own for each kind of flight mode, others behind.

    What the torque makes of a command is another law in each: in one column the first stage would be neither.
    """
    apart = [np.where((law == each)[:, np.newaxis], command[:, :_AXES], 0.0) for each in laws.tolist()]
    return np.column_stack([*apart, command[:, _AXES:]])


def flight_spectra(data: FlightData) -> BlockSpectra | None:
    """Return the spectra of all that an estimate needs.

    Rates, torques, products of rates, what of the set-points was the answer of the angle controller, speeds
    if any (`has_speed`), commands, of which the first three are set-points without that answer; with modes of
    several kinds, three for each.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    BlockSpectra or None
        None where nothing tells what was commanded, or for less than a block.
    """
    records = command_records(data)
    return spectra_of([record.columns for record in records], records, data)


def spectra_of(
    columns: list[FloatArray], records: Sequence[CommandRecord], data: FlightData
) -> BlockSpectra | None:
    """Return the spectra of some columns of each record, in the blocks of `flight_spectra`.

    Parameters
    ----------
    columns : list of ndarray, each of shape (n_samples, n_columns)
    records : sequence of CommandRecord
    data : FlightData

    Returns
    -------
    BlockSpectra or None
        None for less than a block.
    """
    starts = [float(record.segment.time_s[0]) for record in records]
    highest_hz = min(_HIGHEST_HZ, _OF_SAMPLE_RATE / data.sample_period_s)
    planned = is_planned(data)
    return block_spectra(
        columns,
        starts,
        data.sample_period_s,
        length_s=_PLANNED_BLOCK_S if planned else BLOCK_S,
        highest_hz=highest_hz,
        fewest=_FEWEST_BLOCKS if planned else 0,
    )


class _Whitening(NamedTuple):
    """What brings moments to standard deviations, (n, n_bands, n_bands), and the logarithm of its size."""

    matrix: FloatArray
    log_size: FloatArray


class AxisMoments:
    """One axis: what is summed over blocks once, and what changes with the weights."""

    def __init__(
        self,
        spectra: BlockSpectra,
        number: int,
        told: ComplexArray,
        gyro_filter: GyroFilter,
        n_speeds: int = 0,
        *,
        planned: bool = False,
        by_rotors: ComplexArray | None = None,
    ) -> None:
        self.number, self.told, self.run, self.start_s = number, told, spectra.run, spectra.start_s
        self.s = np.asarray(2j * np.pi * spectra.frequency_hz, dtype=np.complex128)
        self.gyro = gyro_response(self.s, *gyro_filter)
        self.torque, self.by_slope = (
            each[:, :, _AXES + number] for each in (spectra.values, spectra.by_slope)
        )
        self.acceleration = self.logged = spectra.derivative(number)
        self.regressors = [
            spectra.values[:, :, number],
            spectra.values[:, :, 2 * _AXES + number],
            *(spectra.derivative(other) for other in range(_AXES) if other != number),
            *(spectra.values[:, :, N_BEFORE_COMMANDS + along] for along in range(n_speeds)),
        ]
        half = 0.5 * MOST_DAMPING_1_S[number]
        spread = [max(half, 1.0) / 2.0, _GYROSCOPIC_SPREAD, _CROSS_SPREAD, _CROSS_SPREAD]
        spread += [_SPEED_SPREAD] * n_speeds
        if by_rotors is not None:
            self.regressors.append(by_rotors)
            spread.append(_ROTORS_SPREAD)
        self.spread = np.array(spread)
        self.prior = np.array([-0.5 * half, *[0.0] * (len(spread) - 1)])
        self.edges = _band_edges(spectra.frequency_hz)
        self.centre_hz = np.array([band.mean() for band in np.split(spectra.frequency_hz, self.edges[1:-1])])
        centre = np.log(self.centre_hz)
        self.alike = np.exp(-np.abs(centre[:, np.newaxis] - centre) / OCTAVE)
        self.moments_hz, self.planned = _MOMENTS_HZ[0], planned
        # A search comes back to the actuators that it has tried, and lead is nothing to roll and pitch.
        self._responses: dict[SharedActuator, tuple[ComplexArray, ComplexArray]] = {}
        self._solved: dict[SharedActuator, tuple[FloatArray, FloatArray]] = {}

    def take_out(self, acceleration: ComplexArray) -> None:
        """Leave an acceleration (n_blocks, n_lines) that no equation has out of what was logged."""
        self.acceleration = self.logged - acceleration

    def summed(self, lines: ComplexArray) -> ComplexArray:
        """Return the sums of lines (..., n_lines) by band."""
        return np.asarray(np.add.reduceat(lines, self.edges[:-1], axis=-1), dtype=np.complex128)

    def power(self, lines: ComplexArray) -> FloatArray:
        """Return the sums of squared lines (..., n_lines) by band."""
        return np.asarray(np.add.reduceat(np.abs(lines) ** 2, self.edges[:-1], axis=-1), dtype=np.float64)

    def commanded(self) -> float:
        """Return the power of the torque that goes with the commanded one, band by band, over all of it."""
        power = self.power(self.told).sum(axis=0)
        both = np.abs(self.summed((self.told.conj() * self.torque).sum(axis=0)))
        size = float(np.sum(both[power > 0.0] ** 2 / power[power > 0.0]))
        return _ratio(size, float(np.sum(np.abs(self.torque) ** 2)))

    def response(self, actuator: SharedActuator) -> tuple[ComplexArray, ComplexArray]:
        """Return what actuator and gyro make of torque and of the torque under the window's slope."""
        own = actuator.on(self.number)
        if own not in self._responses:
            self._responses[own] = self._response(own)
        return self._responses[own]

    def _response(self, own: SharedActuator) -> tuple[ComplexArray, ComplexArray]:
        s, (lag, delay, lead) = self.s, own
        response = self.gyro * np.exp(-s * delay) * (1.0 + s * lead) / (1.0 + s * lag)
        # FT[w (h * u)] = H FT[w u] + j dH/domega FT[dw/dt u], and dH/domega = j dH/ds.
        slope = response * (lead / (1.0 + s * lead) - lag / (1.0 + s * lag) - delay)
        return response, -slope

    def acting(self, actuator: SharedActuator) -> ComplexArray:
        """Return the torque behind an actuator, shape (n_blocks, n_lines)."""
        return self.behind(actuator, self.torque, self.by_slope)

    def behind(self, actuator: SharedActuator, values: ComplexArray, by_slope: ComplexArray) -> ComplexArray:
        """Return a torque, (n_blocks, n_lines) as of `BlockSpectra`, behind an actuator."""
        response, slope = self.response(actuator)
        return np.asarray(response * values + slope * by_slope)

    def instrument_behind(self, actuator: SharedActuator) -> None:
        """Take the torque that was commanded behind an actuator for the instrument."""
        self.instrument = self.told * self.response(actuator._replace(lead_s=0.0))[0]
        weight = self.instrument.conj()
        self.of_torque, self.of_slope = ((weight * each).sum(axis=0) for each in (self.torque, self.by_slope))
        self.of_acceleration = self.summed((weight * self.acceleration).sum(axis=0))
        self.of_regressors = [self.summed((weight * each).sum(axis=0)) for each in self.regressors]

    def of_commanded(self, actuator: SharedActuator) -> ComplexArray:
        """Return the moments of the torque behind an actuator, shape (n_bands,)."""
        response, slope = self.response(actuator)
        return self.summed(response * self.of_torque + slope * self.of_slope)

    def left(self, theta: FloatArray, actuator: SharedActuator) -> ComplexArray:
        """Return the moments of what an equation [B, A, c, o, o, a.., e] leaves."""
        return np.asarray(self._by_torque(theta) - theta[0] * self.of_commanded(actuator))

    def error(self, theta: FloatArray, actuator: SharedActuator) -> ComplexArray:
        """Return what an equation leaves of the acceleration, shape (n_blocks, n_lines)."""
        left = self.acceleration - theta[0] * self.acting(actuator) - _weighted(theta[1:], self.regressors)
        return np.asarray(left, dtype=np.complex128)

    def explained(self, actuator: SharedActuator, band: Band) -> float:
        """Return R2 of the acceleration in a band by the equation behind an actuator, gusts and all.

        Without what effects do, where they were taken out.

        Parameters
        ----------
        actuator : SharedActuator
        band : Band

        Returns
        -------
        float
        """
        error = self.error(self.solved(actuator)[0], actuator)
        hz = np.imag(self.s) / (2.0 * np.pi)
        inside = (hz >= band.low_hz) & (hz <= band.high_hz)
        left, whole = (float(np.sum(np.abs(each[:, inside]) ** 2)) for each in (error, self.logged))
        return 1.0 - _ratio(left, whole)

    def _by_torque(self, theta: FloatArray) -> ComplexArray:
        """Return the moments of the acceleration that an equation leaves to the torque."""
        return np.asarray(self.of_acceleration - _weighted(theta[1:], self.of_regressors))

    def weigh(self, theta: FloatArray | None, actuator: SharedActuator) -> None:
        """Set the noise of the moments by what an equation leaves; by the acceleration itself without one."""
        error = self.acceleration if theta is None else self.error(theta, actuator)
        self.noise = moment_noise(self, self.instrument, error) + self.elsewhere(self.instrument)
        self.size = np.abs(self.of_acceleration if theta is None else self._by_torque(theta))
        turn = self.of_commanded(actuator)
        if theta is not None:
            # Where noise is more than what commands make, what is left says nothing about the response.
            hidden = self.noise > np.abs(theta[0] * turn) ** 2
            self.noise = np.where(hidden, np.maximum(self.noise, self.size**2), self.noise)
        self.turn = np.exp(-1j * np.angle(turn if theta is None else theta[0] * turn))
        if theta is not None:
            # A departure in proportion to what was measured lets small moments count for more than large
            # ones, and draws the response low (G. D'Agostini, Nucl. Instrum. Methods A 346, 1994).
            self.size = np.abs(theta[0] * turn)
        self.depart(_DEPARTURES[1] ** 2, self.moments_hz)

    def elsewhere(self, instrument: ComplexArray) -> FloatArray:
        """Return the variance of each moment that products of motions make; shape (n_bands,).

        They may be in any octave, and coherent with the instrument at worst. Of a planned trajectory, moments
        of tilt and speed stand for that.
        """
        if self.planned:
            return np.zeros(self.centre_hz.size)
        octaves = 1.0 + np.log2(self.centre_hz[-1] / self.centre_hz[0])
        size = _ELSEWHERE**2 * self.power(self.acceleration).sum() / octaves
        return np.asarray(size * self.power(instrument).sum(axis=0))

    def variance_of_noise(self) -> FloatArray:
        """Return the variance of each complex moment that noise makes, and rounding; shape (n_bands,)."""
        return np.asarray(self.noise + 2e-12 * max(float(self.size.max()) ** 2, _TINY))

    def depart(self, variance: float, moments_hz: float) -> None:
        """Set the whitening for a departure of this relative variance.

        ``moments_hz``: where moments of tilt and speed are as large as the torque's. A tilt is the torque's
        second integral, so that they rise with the square of one over the frequency (and a speed, behind
        drag, like a tilt).
        """
        self.variance, self.moments_hz = variance, moments_hz
        self.whitening = self._whitening(np.array([variance]), moments_hz).matrix[0]

    def _whitening(self, variances: FloatArray, moments_hz: float) -> _Whitening:
        """Return the whitening for each of some variances."""
        size, held = self.size, self.size * self._held(moments_hz)
        covariance = np.diag(0.5 * self.variance_of_noise())
        departure = variances[:, np.newaxis, np.newaxis] * np.outer(size, size) + np.outer(held, held)
        covariance = covariance + departure * self.alike
        scale = 1.0 / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        triangle = np.linalg.cholesky(covariance * (scale[:, :, np.newaxis] * scale[:, np.newaxis, :]))
        diagonal = np.diagonal(triangle, axis1=1, axis2=2)
        log_size = 2.0 * np.log(diagonal).sum(axis=1) - 2.0 * np.log(scale).sum(axis=1)
        return _Whitening(np.linalg.inv(triangle) * scale[:, np.newaxis, :], log_size)

    def likelihoods(self, moments: ComplexArray, variances: FloatArray, moments_hz: float) -> FloatArray:
        """Return logarithms of how likely moments are for departures of these variances, but for a constant.

        Parameters
        ----------
        moments : ndarray of complex, shape (n_bands,)
        variances : ndarray, shape (n,)
        moments_hz : float
            As of `depart`.

        Returns
        -------
        ndarray, shape (n,)
        """
        matrices, log_size = self._whitening(variances, moments_hz)
        turned = moments * self.turn
        whites = (np.concatenate([each.real, each.imag]) for each in (one @ turned for one in matrices))
        return np.array([-0.5 * float(white @ white) for white in whites]) - log_size

    def _held(self, moments_hz: float) -> FloatArray:
        """Return moments of tilt and speed over the torque's; shape (n_bands,)."""
        return np.asarray((moments_hz / self.centre_hz) ** 2)

    def departure_beyond(self, least: float) -> FloatArray:
        """Return the relative covariance of departures beyond a least variance, were all bands alike."""
        held = self._held(self.moments_hz)
        return np.asarray(max(self.variance - least, 0.0) + np.outer(held, held))

    def variance_beside_torque(self) -> FloatArray:
        """Return the variance of each complex moment by noise, tilt and speed; shape (n_bands,)."""
        return np.asarray(self.variance_of_noise() + 2.0 * (self.size * self._held(self.moments_hz)) ** 2)

    def variance_of_departure(self) -> FloatArray:
        """Return the relative variance of what the equation does not describe; shape (n_bands,)."""
        return np.asarray(self.variance + self._held(self.moments_hz) ** 2)

    def white(self, moments: ComplexArray) -> FloatArray:
        """Return moments in standard deviations, real parts along and imaginary ones across the model's."""
        turned = self.whitening @ (moments * self.turn)
        return np.concatenate([turned.real, turned.imag])

    def white_commanded(self, actuator: SharedActuator) -> FloatArray:
        """Return the moments of the torque behind an actuator in standard deviations."""
        return self.white(self.of_commanded(actuator))

    def prepare(self) -> None:
        """Whiten what does not change with the actuator, and solve for it."""
        self._solved = {}
        self._targets = np.concatenate([self.white(self.of_acceleration), self.prior / self.spread])
        self._fixed = np.vstack(
            [np.column_stack([self.white(each) for each in self.of_regressors]), np.diag(1.0 / self.spread)]
        )
        self._basis, triangle = np.linalg.qr(self._fixed)
        self._by_basis = np.linalg.solve(triangle, self._basis.T)
        self._left_by_fixed = self._targets - self._basis @ (self._basis.T @ self._targets)

    def system(self, actuator: SharedActuator) -> tuple[FloatArray, FloatArray]:
        """Return the linear equations for [B, A, c, o, o, a.., e], their priors below."""
        return np.column_stack([self._column(actuator), self._fixed]), self._targets

    def _column(self, actuator: SharedActuator) -> FloatArray:
        """Return the column of the torque behind an actuator; it has no prior."""
        return np.concatenate([self.white_commanded(actuator), np.zeros(len(self.spread))])

    def solved(self, actuator: SharedActuator) -> tuple[FloatArray, FloatArray]:
        """Return [B, A, c, o, o, a.., e] and what they leave of the whitened system.

        Only the torque's column changes with the actuator: it is solved for by what the others leave of it
        (theorem of Frisch, Waugh and Lovell).
        """
        own = actuator.on(self.number)
        if own not in self._solved:
            column = self._column(own)
            alone = column - self._basis @ (self._basis.T @ column)
            gain = float(alone @ self._left_by_fixed) / max(float(alone @ alone), _TINY)
            others = self._by_basis @ (self._targets - gain * column)
            self._solved[own] = np.append(gain, others), self._left_by_fixed - gain * alone
        return self._solved[own]


def _weighted(weights: FloatArray, columns: Sequence[ComplexArray]) -> ComplexArray:
    """Return the sum of columns, each by its weight."""
    return np.asarray(sum(weight * each for weight, each in zip(weights, columns, strict=True)))


def _has_size(lines: ComplexArray) -> bool:
    """Say whether spectra hold anything whose square is a number."""
    return _SMALLEST < float(np.abs(lines).max(initial=0.0)) < _LARGEST


def _from_outside(
    command: ComplexArray, spectra: BlockSpectra, gyro_filter: GyroFilter, n_laws: int
) -> FloatArray:
    """Return how much of the power of each command comes from outside, shape (n_lines, n_commands).

    What the angle controller answered was put back by angles that the rates tell: to one sample and to the
    gyro's filter, as the controller may have had the angle of the sample before, or without the filter. And
    who holds the vehicle in its place tilts it against its speed, the integral of the tilt. So much of what
    follows every gust may be left in a set-point.
    """
    put_back = shared(
        np.abs(np.moveaxis(spectra.values[:, :, 3 * _AXES : N_BEFORE_COMMANDS], 0, 1)) ** 2
    ).sum(axis=1)
    set_points = command[:, :, : n_laws * _AXES]
    power = np.sum(np.abs(set_points.reshape(*set_points.shape[:2], n_laws, _AXES)) ** 2, axis=2)
    given = shared(np.moveaxis(power, 0, 1)).sum(axis=1)
    s = np.asarray(2j * np.pi * spectra.frequency_hz, dtype=np.complex128)
    later = np.exp(-s * spectra.period_s) * gyro_response(s, *gyro_filter)
    left = np.abs(1.0 - later) ** 2 + np.abs(_HOLDS_PLACE_RAD_S / s) ** 2
    outside = np.ones((s.size, command.shape[2]))
    kept = np.clip(1.0 - left[:, np.newaxis] * put_back / np.maximum(given, _TINY), 0.0, 1.0)
    outside[:, : n_laws * _AXES] = np.tile(kept, n_laws)
    return outside


def _told_by_others(
    command: ComplexArray, torque: ComplexArray, run: IntArray, from_outside: FloatArray
) -> ComplexArray:
    """Return the torques as a block's commands tell them by what other blocks show; shape of ``torque``.

    ``from_outside``: shape (n_lines, n_commands).
    """
    gram = shared(np.einsum("bfi,bfj->fbij", command.conj(), command))
    cross = shared(np.einsum("bfi,bfk->fbik", command.conj(), torque))
    whole_gram, whole_cross = gram.sum(axis=1), cross.sum(axis=1)
    own_gram, own_cross = _with_neighbours(gram, run), _with_neighbours(cross, run)
    size = np.sqrt(np.maximum(np.einsum("fii->fi", whole_gram).real, _TINY))
    share = np.einsum("fbii,fi->fb", own_gram, size**-2.0).real / size.shape[1]
    elsewhere = share <= _MOST_LEVERAGE
    gram = whole_gram[:, np.newaxis] - own_gram * elsewhere[:, :, np.newaxis, np.newaxis]
    cross = whole_cross[:, np.newaxis] - own_cross * elsewhere[:, :, np.newaxis, np.newaxis]
    gram = gram / (size[:, np.newaxis, :, np.newaxis] * size[:, np.newaxis, np.newaxis, :])
    gram = gram + _RIDGE * np.eye(size.shape[1])
    scale = size[:, np.newaxis, :, np.newaxis]
    law = np.linalg.solve(gram, cross / scale) / scale
    return np.asarray(np.einsum("bfi,fi,fbik->bfk", command, from_outside, law))


def shared(lines: ComplexArray | FloatArray) -> ComplexArray:
    """Return sums over neighbouring lines (first axis), the nearer the heavier.

    Parameters
    ----------
    lines : ndarray of real or complex, shape (n_lines, ...)

    Returns
    -------
    ndarray of complex, same shape
    """
    weight = np.bartlett(2 * _SHARED_LINES + 3)[1:-1]
    padded = np.concatenate([np.zeros((_SHARED_LINES, *lines.shape[1:])), lines])
    padded = np.concatenate([padded, np.zeros((_SHARED_LINES, *lines.shape[1:]))])
    n_lines = len(lines)
    return np.asarray(sum(w * padded[k : k + n_lines] for k, w in enumerate(weight)))


def _with_neighbours(blocks: ComplexArray, run: IntArray) -> ComplexArray:
    """Return each block (second axis) with those that overlap it."""
    follows = (run[1:] == run[:-1]).reshape(1, -1, *(1,) * (blocks.ndim - 2))
    both = blocks.copy()
    both[:, 1:] += np.where(follows, blocks[:, :-1], 0.0)
    both[:, :-1] += np.where(follows, blocks[:, 1:], 0.0)
    return both


def _band_edges(frequency_hz: FloatArray) -> IntArray:
    """Return where bands begin and end: sixths of octaves, of two lines at least."""
    step_hz = float(frequency_hz[1] - frequency_hz[0])
    edges = [0]
    while edges[-1] < frequency_hz.size:
        width = frequency_hz[edges[-1]] * (2.0 ** (1.0 / _BANDS_PER_OCTAVE) - 1.0) / step_hz
        edges.append(min(edges[-1] + max(2, round(float(width))), frequency_hz.size))
    return np.array(edges)


def moment_noise(axis: AxisMoments, instrument: ComplexArray, error: ComplexArray) -> FloatArray:
    """Return the variance of each complex moment that an error makes.

    Parameters
    ----------
    axis : AxisMoments
    instrument, error : ndarray of complex, shape (n_blocks, n_lines)

    Returns
    -------
    ndarray, shape (n_bands,)

    Notes
    -----
    What all blocks have in common is no noise: it takes the more of a block's own, the more of the
    instrument's power the block has (its leverage). The variance by blocks, over that of an error which is
    equally strong throughout, is averaged over five bands, each by its degrees of freedom, and with the prior
    that the strength of an error varies as gusts do.
    """
    moments = axis.summed(instrument.conj() * error)
    power = axis.power(instrument)
    whole = np.maximum(power.sum(axis=0), _TINY)
    leverage = power / whole
    moments = moments - moments.sum(axis=0) * leverage
    follows = (axis.run[1:] == axis.run[:-1])[:, np.newaxis]
    alone = (np.abs(moments) ** 2).sum(axis=0)
    beside = 2.0 * ((moments[1:] * moments[:-1].conj()).real * follows).sum(axis=0)
    n_lines = np.diff(axis.edges)
    even = np.maximum(whole * axis.power(error).mean(axis=0) / n_lines, _TINY)
    # Half-overlapping Hann windows have a sixth in common: a negative part beyond a third is chance.
    scatter = np.maximum(alone + beside, 2.0 / 3.0 * alone) / even
    own = np.sum(leverage**2, axis=0)
    # A band in which nothing was commanded has seen no noise, and says nothing about its neighbours.
    freedom = np.where(own > 0.0, 1.0 / np.maximum(own, _TINY) - 1.0, 0.0)
    # With all of it in one block, 1 - own is none, and so are the degrees of freedom.
    weighted = scatter / np.maximum(own, _TINY)
    window = np.ones(min(5, scatter.size))
    seen, of = (np.convolve(each, window, "same") for each in (weighted, freedom))
    return np.asarray((seen + _GUSTS_FREEDOM) / (of + _GUSTS_FREEDOM) * even)


def fit_axes(
    axes: Sequence[AxisMoments], start: SharedActuator | None = None
) -> tuple[tuple[SpectralFit, ...], SharedActuator]:
    """Iterate between the equations and the noise that they leave.

    Parameters
    ----------
    axes : sequence of AxisMoments
    start : SharedActuator or None
        Near the one to be found; None searches a grid.

    Returns
    -------
    fits : tuple of SpectralFit
        Roll, pitch, yaw; those of other axes hold nothing.
    actuator : SharedActuator
    """
    actuator = start or SharedActuator(_LAG_S, _DELAY_S, 0.0)
    for axis in axes:
        axis.instrument_behind(actuator)
        axis.weigh(None, actuator)
        axis.prepare()
    actuator = start or _coarsely(axes)
    for step in range(_ITERATIONS):
        actuator = _refined(axes, actuator)
        if step == _ITERATIONS - 1:
            break
        for axis in axes:
            theta = axis.solved(actuator)[0]
            axis.instrument_behind(actuator)
            axis.weigh(theta, actuator)
            _depart_likely(axis, axis.left(theta, actuator))
            axis.prepare()
    return _described(axes, actuator), actuator


def _depart_likely(axis: AxisMoments, left: ComplexArray) -> None:
    """Set how far an axis departs from its equation by what that leaves.

    Moments of tilt and speed are the likeliest ones, and with them the variance of the departure is the mean
    of those that are tried, each by how likely it is.
    """
    likely = np.stack([axis.likelihoods(left, _DEPARTURES**2, moments_hz) for moments_hz in _MOMENTS_HZ])
    likely -= np.log1p((_DEPARTURES / _TYPICAL_DEPARTURE) ** 2)
    weight = np.exp(likely - likely.max())
    best = int(weight.sum(axis=1).argmax())
    axis.depart(float(weight[best] @ _DEPARTURES**2 / weight[best].sum()), _MOMENTS_HZ[best])


def _left(axes: Sequence[AxisMoments], actuator: SharedActuator) -> FloatArray:
    """Return what an actuator leaves, everything linear solved for; its prior first."""
    return np.concatenate([actuator.coordinates, *(axis.solved(actuator)[1] for axis in axes)])


def _cost(axes: Sequence[AxisMoments], actuator: SharedActuator) -> float:
    """Return the sum of squares that an actuator leaves, its prior among them."""
    left = _left(axes, actuator)
    return float(left @ left)


def by_coordinates(function: Callable[[SharedActuator], FloatArray], actuator: SharedActuator) -> FloatArray:
    """Return the derivatives of a function by the coordinates of an actuator, in columns.

    Parameters
    ----------
    function : callable
        Of an actuator, with an array of shape (n,).
    actuator : SharedActuator

    Returns
    -------
    ndarray, shape (n, 3)
    """
    return slopes_of([function(each) for each in around(actuator)])


def around(actuator: SharedActuator) -> list[SharedActuator]:
    """Return an actuator a small step ahead and behind along each coordinate, for `slopes_of`.

    Parameters
    ----------
    actuator : SharedActuator

    Returns
    -------
    list of SharedActuator
        Six.
    """
    place = actuator.coordinates
    steps = (sign * _STEP * along for along in np.eye(place.size) for sign in (1, -1))
    return [SharedActuator.at(place + step) for step in steps]


def slopes_of(values: Sequence[FloatArray]) -> FloatArray:
    """Return the derivatives of what was worked out `around` an actuator, in columns.

    Parameters
    ----------
    values : sequence of ndarray, each of shape (n,)
        Six.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    pairs = zip(values[::2], values[1::2], strict=True)
    return np.column_stack([(ahead - behind) / (2.0 * _STEP) for ahead, behind in pairs])


def _coarsely(axes: Sequence[AxisMoments]) -> SharedActuator:
    """Return the best actuator of a grid."""
    tried = [
        SharedActuator(float(lag), delay, lead) for lag in _LAGS_S for delay in _DELAYS_S for lead in _LEADS_S
    ]
    return min(tried, key=lambda actuator: _cost(axes, actuator))


def _refined(axes: Sequence[AxisMoments], actuator: SharedActuator) -> SharedActuator:
    """Bring the actuator to its least cost (Levenberg and Marquardt, everything linear solved for)."""
    cost, damping = _cost(axes, actuator), 1e-3
    for _ in range(20):
        slopes = by_coordinates(partial(_left, axes), actuator)
        normal, gradient = slopes.T @ slopes, slopes.T @ _left(axes, actuator)
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        trial = SharedActuator.at(actuator.coordinates + step)
        new = _cost(axes, trial)
        if new < cost:
            small = cost - new < 1e-4
            actuator, cost, damping = trial, new, 0.3 * damping
            if small:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return actuator


def _described(axes: Sequence[AxisMoments], actuator: SharedActuator) -> tuple[SpectralFit, ...]:
    """Return the estimates with their joint covariance."""
    thetas = [axis.solved(actuator)[0] for axis in axes]
    n_linear = thetas[0].size
    whole = np.zeros((3 + n_linear * len(axes),) * 2)
    whole[:3, :3] = np.eye(3)
    rows, places = [], []
    for number, (axis, theta) in enumerate(zip(axes, thetas, strict=True)):
        columns = axis.system(actuator)[0]
        slopes = theta[0] * by_coordinates(axis.white_commanded, actuator)
        own = np.r_[0:3, 3 + n_linear * number : 3 + n_linear * (number + 1)]
        # The priors of what is linear do not move with the actuator.
        by_actuator = np.vstack([slopes, np.zeros((len(columns) - len(slopes), 3))])
        both = np.column_stack([by_actuator, columns])
        whole[np.ix_(own, own)] += both.T @ both
        rows.append(both[: len(slopes)])
        places.append(own)
    covariance = np.asarray(np.linalg.pinv(whole, hermitian=True), dtype=np.float64)
    found = {
        axis.number: replace(
            _one(axis, theta, actuator, covariance, int(own[3])),
            by_effects=_by_departure(axis, theta[0], of_axis @ covariance[own, own[3]]),
        )
        for axis, theta, of_axis, own in zip(axes, thetas, rows, places, strict=True)
    }
    return tuple(found.get(number, _NOTHING) for number in range(_AXES))


def _by_departure(axis: AxisMoments, gain: float, weights: FloatArray) -> float:
    """Return half of the 95 % interval, relative, of what departs from the equation beyond what any does.

    ``weights`` (2 n_bands,) of the moments in standard deviations make the effectiveness.
    """
    variance = 0.0
    for part in np.split(weights, 2):
        of_moments = axis.whitening.T @ part * axis.size
        variance += float(of_moments @ (axis.departure_beyond(LEAST_DEPARTURE**2) * axis.alike) @ of_moments)
    return NORMAL_95 * float(np.sqrt(max(variance, 0.0))) / abs(gain) if gain else float("inf")


def _one(
    axis: AxisMoments, theta: FloatArray, actuator: SharedActuator, covariance: FloatArray, first: int
) -> SpectralFit:
    """Return the estimate of one axis; ``first`` is the place of its effectiveness in the covariance."""
    lag_s, delay_s, lead_s = actuator.on(axis.number)
    gain = float(theta[0])
    own = np.array([0, 1, 2, first, first + 1])
    known = known_figures(axis, gain, actuator, covariance[np.ix_(own, own)])
    return SpectralFit(
        mean=np.array([gain, theta[1], lag_s, delay_s, gain * lead_s]),
        covariance=known.covariance,
        departure=float(np.sqrt(axis.variance)),
        commanded=axis.commanded(),
        r2_commanded=_explained(axis, theta, actuator),
        n_blocks=int(axis.run.size),
        planned=axis.planned,
        half_width=known.half_width,
        skew=known.skew,
    )


def _explained(axis: AxisMoments, theta: FloatArray, actuator: SharedActuator) -> float:
    """Return the fraction of the commanded acceleration that an equation explains, each band over its noise.

    Where air, manoeuvres of other axes, or moments of tilt and speed hide what commands make, what is left
    says nothing about the equation: summed as they are, the few strongest bands, the slowest, would speak for
    all.
    """
    weight = 1.0 / axis.variance_beside_torque()
    left = float(weight @ np.abs(axis.left(theta, actuator)) ** 2)
    return 1.0 - _ratio(left, float(weight @ np.abs(theta[0] * axis.of_commanded(actuator)) ** 2))


def response_to_commands(axis: AxisMoments) -> Response:
    """Return angular acceleration over torque as far as commands drive both, in bands, behind no gyro filter.

    What a gust does to both through the controller is in neither, nor are few blocks' chances: each block's
    torque is told by the others.

    Parameters
    ----------
    axis : AxisMoments

    Returns
    -------
    Response
        In sixths of octaves.
    """
    torque = axis.gyro * axis.torque
    driven, moved = (axis.summed((axis.told.conj() * each).sum(axis=0)) for each in (torque, axis.logged))
    gain = np.divide(moved, driven, out=np.full(driven.shape, np.nan + 0j), where=driven != 0.0)
    left = axis.logged - np.repeat(np.nan_to_num(gain), np.diff(axis.edges)) * torque
    variance = moment_noise(axis, axis.told, left) + axis.elsewhere(axis.told)
    of_told = np.maximum(axis.power(axis.told).sum(axis=0), _TINY)
    of_motion = np.maximum(axis.power(axis.logged).sum(axis=0), _TINY)
    return Response(
        frequency_hz=axis.centre_hz,
        gain=gain,
        error=np.where(driven != 0.0, np.sqrt(variance) / np.maximum(np.abs(moved), _TINY), np.inf),
        coherence=np.abs(moved) ** 2 / (of_told * of_motion),
        torque_power=np.abs(driven) ** 2 / of_told,
    )


class Known(NamedTuple):
    """How well the figures of a `SpectralFit` are known: its covariance, half width and skew."""

    covariance: FloatArray
    half_width: float
    skew: float


def known_figures(axis: AxisMoments, gain: float, actuator: SharedActuator, covariance: FloatArray) -> Known:
    """Return how well the figures of `SpectralFit` are known.

    Parameters
    ----------
    axis : AxisMoments
    gain : float
        Effectiveness of the axis.
    actuator : SharedActuator
    covariance : ndarray, shape (5, 5)
        Of the coordinates of the actuator, and [B, A].

    Returns
    -------
    Known

    Notes
    -----
    One frequency tells B / sqrt(1 + (w lag)^2): a lag that is known to a factor of two may raise B by more
    than it may lower it. At the ends of what B varies with, everything else is solved for again.
    """
    slopes = figures_by_coordinates(axis.number, gain, actuator)
    wider = few_blocks(axis.run.size)
    spread = wider**2 * slopes @ covariance @ slopes.T
    straight = NORMAL_95 * float(np.sqrt(spread[0, 0]))
    below, above = (
        math.hypot(straight, more * gain) for more in _beyond_slope(axis, actuator, wider, covariance)
    )
    half_width = 0.5 * (below + above)
    spread[0, 0] = (half_width / NORMAL_95) ** 2
    skew = 0.5 * (above - below) / abs(gain) if gain else 0.0
    return Known(spread, float(np.hypot(half_width, GYRO_SYSTEMATIC * gain)), skew)


def _beyond_slope(
    axis: AxisMoments, actuator: SharedActuator, wider: float, covariance: FloatArray
) -> tuple[float, float]:
    """Return how much farther down and up than its slope an actuator takes B, relative roots of squares."""
    along = covariance[:_AXES, _AXES]
    precision = np.linalg.pinv(covariance[:_AXES, :_AXES], hermitian=True)
    size = math.sqrt(max(float(along @ precision @ along), 0.0))
    here = float(axis.solved(actuator)[0][0])
    if not size > 0.0 or not here > 0.0:
        return 0.0, 0.0
    step = wider * NORMAL_95 / size * along
    ends = [
        float(axis.solved(SharedActuator.at(actuator.coordinates + sign * step))[0][0]) / here - 1.0
        for sign in (1, -1)
    ]
    by_slope = wider * NORMAL_95 * size / here
    down, up = (math.sqrt(max(max(end, 0.0) ** 2 - by_slope**2, 0.0)) for end in (-min(ends), max(ends)))
    return down, up


def figures_by_coordinates(axis: int, gain: float, actuator: SharedActuator) -> FloatArray:
    """Return the derivatives of the five figures of `SpectralFit` by what is solved for.

    Parameters
    ----------
    axis : int
    gain : float
        Effectiveness of the axis.
    actuator : SharedActuator

    Returns
    -------
    ndarray, shape (5, 5)
        Effectiveness, damping, lag, delay, reaction by the coordinates of the actuator, and [B, A].
    """
    slopes = np.zeros((5, 5))
    slopes[0, 3] = slopes[1, 4] = 1.0
    slopes[2, 0], slopes[3, 1] = _LAG_SPREAD * actuator.lag_s, _DELAY_SPREAD_S
    if axis == _YAW:
        slopes[4, 2], slopes[4, 3] = gain * _LEAD_SPREAD_S, actuator.lead_s
    return slopes


def with_delay_alone(fit: SpectralFit) -> SpectralFit:
    """Return an estimate whose lag, if it is too short for a motor, is a part of its delay.

    In the band, such a lag and a delay are one and the same: only their sum is known, and what the prior of
    lags makes of it would be a delay that is too short.

    Parameters
    ----------
    fit : SpectralFit

    Returns
    -------
    SpectralFit
    """
    if not fit.mean[2] < _NO_LAG_S:
        return fit
    summed = np.eye(5)
    summed[2, 2], summed[3, 2] = 0.0, 1.0
    return replace(fit, mean=summed @ fit.mean, covariance=summed @ fit.covariance @ summed.T)


def few_blocks(n_blocks: int) -> float:
    """Return how much wider an interval is because its noise is known from so many half-overlapping blocks.

    Parameters
    ----------
    n_blocks : int

    Returns
    -------
    float

    Notes
    -----
    The 97.5 % point of Student's t over that of a normal distribution (Cornish and Fisher's first terms).
    """
    freedom = max(0.5 * n_blocks, 2.0)
    z = NORMAL_95
    t = z + (z**3 + z) / (4.0 * freedom) + (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * freedom**2)
    return float(t / z)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else float("inf")


_NOTHING: Final = SpectralFit(
    mean=np.full(5, np.nan),
    covariance=np.full((5, 5), np.inf),
    departure=float("inf"),
    commanded=0.0,
    r2_commanded=float("nan"),
    n_blocks=0,
    half_width=float("inf"),
)
