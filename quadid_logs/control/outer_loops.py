"""The loops around the rate loop: the controllers replayed, and velocity and position loops closed.

Tilt about an axis makes acceleration along a horizontal one, and the firmware turns accelerations into angles
by the same law, so that gravity cancels: from the acceleration that is wanted to the one that is had lies the
attitude loop, closed around the identified vehicle, and two integrations. Air drag is left out, which would
give phase rather than take it, and so is the estimator, whose delay no log shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.control.attitude import bandwidth_hz
from quadid_logs.control.loop import Paths, integrators
from quadid_logs.control.margins import grid_hz, is_stable, margins_of
from quadid_logs.data.closed_loop import ClosedLoop, Estimated, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.log import PositionRows
from quadid_logs.data.outer_loops import (
    FEWEST_ROWS,
    AttitudeCommand,
    AttitudeReplay,
    AttitudeRows,
    CascadeController,
    CascadeReplay,
    OuterControllers,
    OuterLoop,
    OuterLoops,
    ShaperReplay,
    ShaperRows,
    Shown,
    shown_by,
)
from quadid_logs.maths.band import ComplexArray, delay_response
from quadid_logs.maths.intervals import following_rows, inside
from quadid_logs.maths.normal import ENDS_95
from quadid_logs.maths.recurrence import low_pass
from quadid_logs.maths.student import student_95
from quadid_logs.vocabulary import AXES

#: Axes whose tilt moves the vehicle.
TILTS: Final = ("roll", "pitch")
#: Rows that differ most are left out: their set-point was made of an attitude that was not logged.
_KEPT: Final = 0.95
#: A replay that leaves more than a twentieth is another law, as of the rate controllers.
_SAME_LAW: Final = 0.05
#: Errors of neighbouring rows are alike: clusters as long as filters of a velocity loop remember [s].
_CLUSTER_S: Final = 1.0
#: Fewer clusters have no covariance to speak of.
_FEWEST_CLUSTERS: Final = 8
#: Between rows signals are interpolated so finely that filters of 5 Hz do not see the steps [s].
_STEP_S: Final = 0.02
#: Rows slower than this cannot show a velocity controller, whose crossover lies at some tenths of a hertz
#: [s].
_SLOWEST_S: Final = 0.5
#: In metres and seconds nothing comes near: such a number is damage.
_IMPOSSIBLE: Final = 1e6
#: No position is held with more; firmware commands absurd ones to take all thrust away on the ground [m/s^2].
_STEEPEST_M_S2: Final = 50.0
#: Above, velocity and position loops have no gain.
_HIGHEST_HZ: Final = 30.0


def outer_loops(
    controllers: OuterControllers,
    closed: ClosedLoop,
    attitude: AttitudeRows | None,
    shaper: ShaperRows | None,
    positions: Sequence[PositionRows],
    intervals: Sequence[tuple[float, float]],
) -> OuterLoops:
    """Replay the outer controllers and close their loops.

    Parameters
    ----------
    controllers : OuterControllers
    closed : ClosedLoop
        The rate loops: tilt answers as they do.
    attitude : AttitudeRows or None
    shaper : ShaperRows or None
    positions : sequence of PositionRows
    intervals : sequence of (start_s, end_s)
        Flights on the log's own clock; none for the whole log.

    Returns
    -------
    OuterLoops
        Loops are closed where velocities were controlled, and where no replay contradicts.
    """
    command, horizontal = controllers.attitude, controllers.horizontal
    if attitude is not None and attitude.lags_s is not None:
        command = replace(command, lags_s=attitude.lags_s)
    replays = {} if attitude is None else attitude_replays(attitude, command)
    cascades = {
        each.direction: replay
        for each in positions
        if (law := controllers.vertical if each.direction == "down" else horizontal) is not None
        if (replay := cascade_replay(each, law, intervals)) is not None
    }
    level = [replay for direction, replay in cascades.items() if direction != "down"]
    loops = {}
    if horizontal is not None and level and all(each.shown is not Shown.DIFFERS for each in level):
        differing = [axis for axis, replay in replays.items() if replay.shown is Shown.DIFFERS]
        for axis in TILTS:
            inner, controller = closed.axes.get(axis), closed.controllers.axes.get(axis)
            if axis in differing or inner is None or controller is None or inner.plants is None:
                continue
            full = None if inner.margins is None else inner.margins.full
            if inner.contradicted or full is None or not full.stable:
                continue
            loop = close_outer(controller, inner.plants, command, horizontal, inner.known_hz)
            if loop is not None:
                loops[axis] = loop
    # The input shaper's law against the logged target, about their means: trims are no part of it.
    shapers = {}
    if shaper is not None and len(shaper.logged) >= FEWEST_ROWS:
        for axis, shaped, wanted, logged in zip(
            TILTS, shaper.shaped.T, shaper.wanted.T, shaper.logged.T, strict=False
        ):
            size = float(np.std(logged))
            if size > 0.0:
                shapers[axis] = ShaperReplay(
                    relative_rms=float(np.std(shaped - logged)) / size,
                    unshaped_rms=float(np.std(wanted - logged)) / size,
                    n_rows=len(logged),
                )
    return OuterLoops(
        controllers=replace(controllers, attitude=command),
        attitude=replays,
        shaper=shapers,
        cascades=cascades,
        loops=loops,
    )


def attitude_replays(rows: AttitudeRows, command: AttitudeCommand) -> dict[str, AttitudeReplay]:
    """Hold the attitude controller's law against the logged rate set-points.

    Returns
    -------
    dict of str to AttitudeReplay
        By axis; empty where the rows are too few.
    """
    if len(rows.time_s) < FEWEST_ROWS:
        return {}
    replays = {}
    for number, axis in enumerate(AXES):
        made, forward, logged = (each[:, number] for each in (rows.from_error, rows.forward, rows.logged))
        off = np.abs(made + forward - logged)
        kept = off <= np.quantile(off, _KEPT)
        size, left = _rms(logged[kept]), _rms(off[kept])
        gain = _slope(made[kept], (logged - forward)[kept], _clusters(rows.time_s[kept]))
        # What is fed forward can hide the gain in the sum, and what was added, as an excitation, the sum.
        unknown = command.not_modelled or axis in rows.not_judged
        shown = Shown.NOT_SHOWN if gain is None or unknown else shown_by(gain)
        if shown is Shown.AGREES and left > _SAME_LAW * size:
            shown = Shown.NOT_SHOWN
        replays[axis] = AttitudeReplay(
            shown=shown,
            relative_rms=left / size if size > 0.0 else float("nan"),
            gain=gain,
            n_rows=int(np.count_nonzero(kept)),
        )
    return replays


class _Run(NamedTuple):
    """Rows of one direction that follow each other without a gap."""

    time_s: FloatArray
    values: Mapping[str, FloatArray]


def cascade_replay(
    rows: PositionRows, controller: CascadeController, intervals: Sequence[tuple[float, float]]
) -> CascadeReplay | None:
    """Replay position and velocity controller of one direction.

    Parameters
    ----------
    rows : PositionRows
    controller : CascadeController
    intervals : sequence of (start_s, end_s)
        Flights on the log's own clock; none for the whole log.

    Returns
    -------
    CascadeReplay or None
        None where velocities were not controlled for long enough.

    Notes
    -----
    Rows come at 5 to 20 Hz and the controllers run at 50 to 400 Hz: filters and integral see the signals
    interpolated between rows, and the gains are estimated by least squares with residuals in clusters of a
    second.
    """
    # The longest run of rows that hold numbers and follow each other.
    needed = ("velocity_target", "velocity")
    if any(name not in rows.values for name in needed):
        return None
    time_s = rows.rows.time_s
    usable = np.isfinite(time_s) if not intervals else inside(time_s, intervals)
    for name in needed:
        usable = usable & (np.abs(rows.values[name]) < _IMPOSSIBLE)
    part, typical_s = following_rows(time_s, usable)
    if not 0.0 < typical_s <= _SLOWEST_S or part.stop - part.start <= FEWEST_ROWS:
        return None
    time_s, values = time_s[part], {name: each[part] for name, each in rows.values.items()}
    run = _Run(time_s, values)
    position, position_rms, position_m = _position(run, controller)
    velocity, integral, velocity_rms = _velocity(run, controller)
    error = values["velocity_target"] - values["velocity"]
    return CascadeReplay(
        position=position,
        velocity=velocity,
        integral=integral,
        position_rms=position_rms,
        velocity_rms=velocity_rms,
        velocity_error_m_s=_rms(error),
        velocity_moved_m_s=float(np.std(values["velocity_target"])),
        position_error_m=position_m,
        n_rows=len(time_s),
        row_s=float(np.median(np.diff(time_s))),
    )


def _position(run: _Run, controller: CascadeController) -> tuple[Estimated | None, float, float]:
    """Return the position gain over that of the parameters, what it leaves, and the error [m]."""
    values, nothing = run.values, (None, float("nan"), float("nan"))
    names = ("position_target", "position", "velocity_forward")
    if any(name not in values for name in names) or not controller.position_per_s > 0.0:
        return nothing
    made = controller.position_per_s * (values["position_target"] - values["position"])
    given = values["velocity_target"] - values["velocity_forward"]
    possible = (np.abs(made) < _IMPOSSIBLE) & (np.abs(given) < _IMPOSSIBLE)
    known = possible & (np.abs(made) < controller.linear_m_s)
    if np.count_nonzero(known) < FEWEST_ROWS:
        return nothing
    error_m = _rms(made[possible]) / controller.position_per_s
    made, given = made[known], given[known]
    gain = _slope(made, given, _clusters(run.time_s[known]))
    size = _rms(given)
    left = _rms(given - made) / size if size > 0.0 else float("nan")
    return gain, left, error_m


def _velocity(run: _Run, controller: CascadeController) -> tuple[Estimated | None, Estimated | None, float]:
    """Return P and I of the velocity controller over those of the parameters, and what it leaves."""
    values, nothing = run.values, (None, None, float("nan"))
    if "acceleration_target" not in values or "acceleration_forward" not in values:
        return nothing
    given = values["acceleration_target"] - values["acceleration_forward"]
    known = np.abs(given) < _STEEPEST_M_S2
    if np.count_nonzero(known) < FEWEST_ROWS:
        return nothing
    fine_s = np.arange(run.time_s[0], run.time_s[-1] + 0.5 * _STEP_S, _STEP_S)
    step_s = np.full(fine_s.shape, _STEP_S)
    target, velocity = (
        np.interp(fine_s, run.time_s, run.values[name]) for name in ("velocity_target", "velocity")
    )
    error = low_pass(target - velocity, controller.error_hz, step_s, first=float(target[0] - velocity[0]))
    moved = error if controller.slope_of_error else -velocity
    slope = low_pass(np.gradient(moved, _STEP_S), controller.derivative_hz, step_s, first=0.0)
    terms = (
        controller.proportional_per_s * error,
        controller.integral_per_s2 * np.cumsum(error) * _STEP_S,
        controller.derivative * slope,
    )
    proportional, integral, slope = (np.interp(run.time_s, fine_s, each) for each in terms)
    regressors = [proportional] + ([integral] if controller.integral_per_s2 > 0.0 else [])
    columns = np.column_stack([*regressors, np.ones(len(given))])[known]
    found = _fit(columns, (given - slope)[known], _clusters(run.time_s[known]))
    whole = given - proportional - integral - slope
    size = float(np.std(given[known]))
    left = float(np.std(whole[known])) / size if size > 0.0 else float("nan")
    if found is None:
        return None, None, left
    return found[0], found[1] if controller.integral_per_s2 > 0.0 else None, left


def _clusters(time_s: FloatArray) -> IntArray:
    """Return the number of the second that each row lies in."""
    return np.unique(np.floor((time_s - time_s[0]) / _CLUSTER_S), return_inverse=True)[1]


def _slope(made: FloatArray, given: FloatArray, clusters: IntArray) -> Estimated | None:
    """Return how many times what was made is given; None where nothing tells."""
    found = _fit(made[:, np.newaxis], given, clusters)
    return None if found is None else found[0]


def _fit(columns: FloatArray, given: FloatArray, clusters: IntArray) -> list[Estimated] | None:
    """Return least squares with 95 % intervals; None where columns are not independent.

    The interval begins with that of least squares, by residuals in clusters (the sandwich of Liang and Zeger,
    1986, with Student's t of the clusters' number). Rows that miss what the loop saw between them make
    columns wrong, too, and draw the estimate to zero: regressed the other way round it is too large by as
    much, and the interval ends there (Frisch's bounds, 1934).
    """
    n_clusters = int(clusters.max()) + 1
    scale = np.sqrt(np.mean(columns**2, axis=0))
    if n_clusters < _FEWEST_CLUSTERS or not (scale > 0.0).all():
        return None
    columns = columns / scale
    if np.linalg.matrix_rank(columns) < columns.shape[1]:
        return None
    bread = np.linalg.inv(columns.T @ columns)
    values = bread @ (columns.T @ given)
    left = given - columns @ values
    scores = np.zeros((n_clusters, columns.shape[1]))
    np.add.at(scores, clusters, columns * left[:, np.newaxis])
    covariance = bread @ (scores.T @ scores) @ bread * n_clusters / (n_clusters - 1.0)
    half = student_95(n_clusters - 1) * np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale
    # Of a column less the others the sum of squares is one over the diagonal of the inverse.
    other_way = values + np.divide(
        left @ left * np.diag(bread), values, where=values != 0.0, out=np.full(values.shape, np.inf)
    )
    return [
        Estimated(float(value), (float(min(value, other) - wide), float(max(value, other) + wide)))
        for value, other, wide in zip(values / scale, other_way / scale, half, strict=True)
    ]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def close_outer(
    controller: AxisController,
    plants: Plant,
    command: AttitudeCommand,
    cascade: CascadeController,
    known_hz: float,
) -> OuterLoop | None:
    """Close velocity and position loop around vehicles with their attitude loops.

    Parameters
    ----------
    controller : AxisController
        With its angle gain.
    plants : Plant
        The estimate, then vehicles drawn around it.
    command : AttitudeCommand
    cascade : CascadeController
    known_hz : float
        Up to where measurement supports the vehicles.

    Returns
    -------
    OuterLoop or None
        None where no angle gain is known.
    """
    if not controller.angle_gain_per_s:
        return None
    every_hz = grid_hz(controller.period_s)
    body = plants.response(every_hz, controller.period_s)
    paths = Paths(controller, every_hz)
    by_angle = body * paths.on_angle
    loop = body * paths.on_rate + by_angle
    answer = np.asarray(by_angle / (1.0 + loop), dtype=np.complex128)
    unstable = ~is_stable(loop, integrators(controller) + 1, plants.damping > 0.0)
    low = every_hz <= _HIGHEST_HZ
    frequency_hz = every_hz[low]
    # What stands before the attitude's target: the lags to it, and its rate that is fed forward.
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    ahead = np.ones(s.shape, dtype=np.complex128)
    if command.forward:
        ahead = ahead + s / controller.angle_gain_per_s
    for lag_s in command.lags_s:
        ahead = ahead / (1.0 + s * lag_s)
    tilts = answer[:, low] * ahead
    velocity, position = cascade_loops(cascade, tilts, frequency_hz)
    n = 1 + int(cascade.integral_per_s2 > 0.0)
    widths_hz = bandwidth_hz(frequency_hz, tilts)
    low, high = np.quantile(widths_hz, ENDS_95)
    return OuterLoop(
        attitude_hz=Estimated(float(widths_hz[0]), (float(low), float(high))),
        velocity=margins_of(frequency_hz, velocity, n, unstable, known_hz),
        whole=None
        if position is None
        else margins_of(frequency_hz, velocity + position, n + 1, unstable, known_hz),
    )


def cascade_loops(
    cascade: CascadeController, tilts: ComplexArray, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray | None]:
    """Return the open velocity loop and what the position loop adds, cut at the acceleration set-point.

    Parameters
    ----------
    cascade : CascadeController
    tilts : ndarray of complex, shape (n_plants, n_frequencies)
        How the attitude answers a wanted attitude.
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    velocity : ndarray of complex, shape (n_plants, n_frequencies)
    position : ndarray of complex or None
        None where positions are not controlled.
    """
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    step_s, late = cascade.period_s, np.asarray(np.exp(-s * cascade.period_s), dtype=np.complex128)
    slope = cascade.derivative * (1.0 - late) / step_s * _low_pass(late, cascade.derivative_hz, step_s)
    on_error = cascade.proportional_per_s + cascade.integral_per_s2 * step_s / (1.0 - late)
    if cascade.slope_of_error:
        on_error = on_error + slope
    on_error = on_error * _low_pass(late, cascade.error_hz, step_s)
    on_velocity = on_error if cascade.slope_of_error else on_error + slope
    held = np.sinc(frequency_hz * step_s) * delay_response(s, 0.5 * step_s)
    to_velocity = held * tilts / s
    velocity = np.asarray(to_velocity * on_velocity, dtype=np.complex128)
    if not cascade.position_per_s > 0.0:
        return velocity, None
    return velocity, np.asarray(to_velocity * on_error * cascade.position_per_s / s, dtype=np.complex128)


def _low_pass(late: ComplexArray, cutoff_hz: float, step_s: float) -> ComplexArray:
    """Return the response of a first-order low-pass; ``late`` is a step's delay, a cut-off of 0 is none."""
    if not cutoff_hz > 0.0:
        return np.ones(late.shape, dtype=np.complex128)
    weight = step_s / (step_s + 1.0 / (2.0 * np.pi * cutoff_hz))
    return np.asarray(weight / (1.0 - (1.0 - weight) * late), dtype=np.complex128)
