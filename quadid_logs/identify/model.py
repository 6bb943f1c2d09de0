"""From a design to one fitted model of a structure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.model import (
    Actuator,
    BandCheck,
    ChangeCheck,
    Discrete,
    FitSeries,
    FormulationCheck,
    Model,
    Validation,
    Windows,
)
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.actuator import ActuatorFit, fit_actuator
from quadid_logs.identify.checks import bootstrapped_half_width, check_change, check_formulations
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.fit import (
    PooledFit,
    clusters_of,
    coefficients_of,
    fit_pooled,
    problem_of,
    r2_of,
    with_trim,
)
from quadid_logs.identify.inertia import inertia_of
from quadid_logs.identify.parameters import Estimate, build_parameters, plausible_size
from quadid_logs.identify.refine import Drive, Task, find_drive, same_drive
from quadid_logs.identify.rigid_body import fit_rigid_body, rigid_body_for
from quadid_logs.identify.rotors import rotors_known, with_lag_on_rotors
from quadid_logs.identify.structures import DAMPED, THROTTLED_YAW, TRIM, Structure
from quadid_logs.identify.systematic import systematic_half_width
from quadid_logs.identify.validate import validate
from quadid_logs.identify.windows import Piece, solve_pieces
from quadid_logs.maths.discretise import zero_order_hold
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS

#: The fit is repeated with the smoothing cut-off times these: half an octave
#: and more to either side. A gain that slides with the band is no gain.
_OTHER_BANDS = (0.5, 1.6)
#: An axis tells of the actuator if the model explains this share of its acceleration.
_TELLING_R2 = 0.75
#: Windows of structures that the paper does not fix: of these lengths the shortest, which sees the model
#: change best, in which most windows see all directions above the noise.
_WINDOW_S = (0.5, 1.0, 2.0, 4.0, 8.0)
_MOST_OF_THEM = 0.5
#: The spread of a hundred thousand windows (four minutes at 400 Hz) is known
#: to some thousandths; more only cost time.
_MOST_WINDOWS = 100_000


class Actuated(NamedTuple):
    """A structure's estimate behind lag, delay and gyro filter, with what says whether to believe it.

    ``whole`` are the rows with what is slow, and with the lag on the rotors
    if it acts there; ``telling`` are the axes that answer to their own torque.
    """

    whole: Design
    drive: Drive
    structure: Structure
    fit: PooledFit
    telling: list[int]
    band: BandCheck
    change: ChangeCheck
    formulations: FormulationCheck
    bootstrap_half_width: FloatArray


def fit_rows_apart(data: FlightData, whole: Design, settings: IdentifySettings) -> Actuated:
    """Fit `DAMPED`: every row by itself, lag and delay common to all."""
    design = whole.without_slow(settings.high_pass_hz)
    actuator, telling = _on_torque(DAMPED, design, settings)
    described = data.input if rotors_known(data) else None
    task = Task(
        design,
        DAMPED,
        _possible(DAMPED, telling),
        telling or moved_axes(design, settings),
        every_step=data.input is not None and data.input.every_step,
    )
    drive = find_drive(task, actuator, described, settings)
    fit, telling = _fit_behind(drive, DAMPED, settings)
    if drive.rotors is not None and data.input is not None:
        whole = with_lag_on_rotors(whole, data.input, drive.rotors)
    problem = problem_of(drive.design, DAMPED, drive.actuator, fit.kept)
    return Actuated(
        whole=whole,
        drive=drive,
        structure=DAMPED,
        fit=with_trim(fit, DAMPED, whole, drive.actuator),
        telling=telling,
        band=_other_bands(data, task._replace(kept=fit.kept), drive, fit, settings),
        change=check_change(drive.design, DAMPED, problem, telling),
        formulations=check_formulations(drive, DAMPED, fit),
        bootstrap_half_width=bootstrapped_half_width(drive.design, DAMPED, problem),
    )


def fit_one_body(data: FlightData, first: Actuated, settings: IdentifySettings) -> Actuated | None:
    """Fit the rigid body behind the actuator, and with the checks, of the rows fitted one by one."""
    drive = first.drive
    found = fit_rigid_body(
        drive.design,
        drive.actuator,
        first.fit,
        first.telling,
        calibrated=data.input is not None and data.input.unit == "N m",
        gyro_systematic=settings.gyro_systematic,
        unknown=drive.unknown,
    )
    if found is None:
        return None
    structure = rigid_body_for(drive.design)
    fit = with_trim(found, structure, first.whole, drive.actuator)
    # How a gain moves with the band is a matter of the data, not of what the rows share.
    moved = first.band.on_axis_gain / first.band.on_axis_gain[0]
    return first._replace(
        structure=structure,
        fit=fit,
        band=replace(first.band, on_axis_gain=_own_gain(structure, fit.theta) * moved),
    )


def actuated_model(
    data: FlightData, found: Actuated, settings: IdentifySettings, *, noise: Mapping[str, float]
) -> Model:
    """Validate an estimate, solve its windows, and put the model together."""
    structure, fit, design = found.structure, found.fit, found.whole
    actuator, rotors = found.drive.actuator, found.drive.rotors
    torque = design.torque(actuator.lag_s, actuator.delay_s, throttled=THROTTLED_YAW in structure.regressors)
    validation, series = validate(
        design,
        structure,
        fit.as_seen,
        torque,
        settings,
        disturbance=fit.disturbance,
        high_pass_hz=settings.high_pass_hz,
    )
    windows = _windows_on_rows(structure, design, torque, settings, noise=_noise(structure, noise))
    floor_s = settings.timing_systematic * data.sample_period_s
    described = Actuator(
        lag_s=actuator.lag_s,
        lag_ci95_s=_lag_interval(
            actuator, fit, float(np.hypot(floor_s, settings.lag_systematic * actuator.lag_s))
        ),
        delay_s=actuator.delay_s,
        delay_ci95_s=_delay_interval(actuator, fit, floor_s),
        acts_on="torque" if rotors is None else "rotor speed",
        lag_grid_s=actuator.lag_grid_s,
        delay_grid_s=actuator.delay_grid_s,
        loss=actuator.loss,
        lag_up_s=float("nan") if rotors is None else rotors.up_s,
        lag_down_s=float("nan") if rotors is None else rotors.down_s,
    )
    return _model(
        structure,
        data,
        design,
        fit,
        settings,
        actuator=described,
        found=found,
        validation=validation,
        series=series,
        windows=windows,
    )


Smooth = Sequence[tuple[FloatArray, dict[str, FloatArray]]]
"""Times and columns of every segment at its full rate, as `smooth_segment` returns them."""


def fit_as_published(
    structure: Structure,
    data: FlightData,
    design: Design,
    smooth: Smooth,
    settings: IdentifySettings,
    *,
    noise: Mapping[str, float],
) -> Model:
    """Fit a structure of the paper: torque as logged, windows of consecutive samples."""
    fit = fit_pooled(design, structure, None)
    validation, series = validate(design, structure, fit.theta, design.torque_as_logged(), settings)
    windows = _windows_at_full_rate(structure, smooth, settings, noise=_noise(structure, noise))
    return _model(
        structure,
        data,
        design,
        fit,
        settings,
        actuator=None,
        found=None,
        validation=validation,
        series=series,
        windows=windows,
    )


def _on_torque(
    structure: Structure, design: Design, settings: IdentifySettings
) -> tuple[ActuatorFit, list[int]]:
    """Find a lag on the torque and a delay, and the axes that tell behind them."""
    axes = moved_axes(design, settings)
    actuator = fit_actuator(design, structure, axes, settings)
    telling = _telling(r2_of(problem_of(design, structure, actuator)), axes)
    if telling and telling != axes:
        actuator = fit_actuator(design, structure, telling, settings)
        telling = _telling(r2_of(problem_of(design, structure, actuator)), axes)
    return actuator, telling


def _fit_behind(
    drive: Drive, structure: Structure, settings: IdentifySettings
) -> tuple[PooledFit, list[int]]:
    """Fit behind lag and delay without what cannot be seen, and return the axes that tell as well."""
    axes = moved_axes(drive.design, settings)
    fit = fit_pooled(drive.design, structure, drive.actuator, unknown=drive.unknown)
    telling = _telling(fit.r2, axes)
    kept = _visible(structure, fit, telling)
    if not kept.all():
        fit = fit_pooled(drive.design, structure, drive.actuator, kept, drive.unknown)
    return fit, telling


def _telling(r2: FloatArray, axes: Sequence[int]) -> list[int]:
    """Return the axes of whose acceleration the model explains enough."""
    return [axis for axis in axes if r2[axis] >= _TELLING_R2]


def moved_axes(design: Design, settings: IdentifySettings) -> list[int]:
    """Return the axes that turn more than a hovering vehicle does, all if none does.

    On an axis at rest, the controller turns gyro noise into torque, and a
    model with a short delay explains that noise perfectly: its R2 is no proof.
    """
    moved = [
        axis
        for axis, name in enumerate(RATE_SYMBOLS)
        if np.degrees(np.std(design.columns[name][design.train])) >= settings.min_rate_rms_deg_s
    ]
    return moved or [0, 1, 2]


def _possible(structure: Structure, telling: Sequence[int]) -> BoolArray:
    """Leave out what cannot be a cause; shape (n_targets, n_columns).

    An axis that does not answer to its own torque is moved by noise: its rate
    is nothing that another axis could answer to. Its torque may turn an axis
    that does answer, where the inertia is askew.
    """
    kept = np.ones((len(structure.targets), len(structure.columns)), dtype=np.bool_)
    silent = {0, 1, 2}.difference(telling)
    for axis in silent:
        others = np.arange(len(kept)) != axis
        kept[others, structure.columns.index(RATE_SYMBOLS[axis])] = False
        kept[list(silent - {axis}), structure.columns.index(TORQUE_SYMBOLS[axis])] = False
    return kept


def _visible(structure: Structure, fit: PooledFit, telling: Sequence[int]) -> BoolArray:
    """Keep possible columns whose interval is narrower than what the coefficient can be at all.

    The own torque and the trim stay in any case: they are the model.
    """
    n_regressors = len(structure.regressors)
    gain = np.abs(np.diag(fit.theta[:3, n_regressors:]))
    kept = _possible(structure, telling) & (fit.half_width < plausible_size(structure, gain))
    for row in range(3):
        kept[row, n_regressors + row] = True
        if TRIM in structure.regressors:
            kept[row, structure.regressors.index(TRIM)] = True
    return np.asarray(kept, dtype=np.bool_)


def _other_bands(
    data: FlightData, task: Task, drive: Drive, fit: PooledFit, settings: IdentifySettings
) -> BandCheck:
    """Repeat the fit in a narrower and a wider band."""
    design, structure = task.design, task.structure
    cutoffs, gains = [design.smoothing_hz], [_own_gain(structure, fit.theta)]
    for factor in _OTHER_BANDS:
        other = build_design(data, factor * design.smoothing_hz, settings)
        if other is not None and np.count_nonzero(other.train) > 2 * len(structure.columns):
            if design.instruments is None:
                other = other.without_instruments()
            other = other.without_slow(settings.high_pass_hz)
            again = same_drive(task._replace(design=other), drive, data.input, settings)
            problem = problem_of(again.design, structure, again.actuator, task.kept)
            cutoffs.append(other.smoothing_hz)
            gains.append(_own_gain(structure, coefficients_of(problem)))
    return BandCheck(cutoff_hz=np.array(cutoffs), on_axis_gain=np.array(gains))


def _own_gain(structure: Structure, theta: FloatArray) -> FloatArray:
    first = len(structure.regressors)
    return np.diag(theta[:3, first : first + 3]).copy()


def _lag_interval(actuator: ActuatorFit, fit: PooledFit, floor_s: float) -> tuple[float, float]:
    """Return the interval of the lag, up to where it could not be told from a delay."""
    half_width = np.hypot(np.nan_to_num(fit.lag_half_width_s), floor_s)
    low = max(0.0, actuator.lag_s - half_width) if np.isfinite(fit.lag_half_width_s) else 0.0
    return low, max(actuator.lag_s + half_width, actuator.lag_limit_s)


def _delay_interval(actuator: ActuatorFit, fit: PooledFit, floor_s: float) -> tuple[float, float]:
    """Return the interval of the delay; what might be lag is taken off its lower end."""
    half_width = np.hypot(fit.delay_half_width_s, floor_s)
    mistaken_s = actuator.lag_limit_s - actuator.lag_s
    low = min(actuator.delay_s - half_width, actuator.delay_s - mistaken_s)
    return max(0.0, low), actuator.delay_s + half_width


def _estimate(
    structure: Structure, fit: PooledFit, band: BandCheck | None, settings: IdentifySettings
) -> Estimate:
    """Return theta with intervals that also cover the floor and how the own gains move with the band."""
    half_width = np.hypot(
        fit.half_width, systematic_half_width(structure, fit.theta, settings, knows_gyro=fit.gyro is not None)
    )
    low, high = fit.theta - half_width, fit.theta + half_width
    if band is not None:
        for axis in range(3):
            column = len(structure.regressors) + axis
            low[axis, column] = min(low[axis, column], *band.on_axis_gain[:, axis])
            high[axis, column] = max(high[axis, column], *band.on_axis_gain[:, axis])
    return Estimate(theta=fit.theta, low=low, high=high, kept=fit.kept)


def _calibrated(estimate: Estimate, n_regressors: int, given: InputDescription | None) -> Estimate:
    """Widen the gains per N m by what is not known of a newton metre of this vehicle."""
    if given is None or given.unit == "1":
        return estimate
    share = NORMAL_95 * np.nan_to_num(np.array(given.calibration.relative_sigma))
    spread = np.zeros(estimate.theta.shape)
    spread[:, n_regressors:] = np.abs(estimate.theta[:, n_regressors:]) * share
    return estimate._replace(
        low=estimate.theta - np.hypot(estimate.theta - estimate.low, spread),
        high=estimate.theta + np.hypot(estimate.high - estimate.theta, spread),
    )


def _model(
    structure: Structure,
    data: FlightData,
    design: Design,
    fit: PooledFit,
    settings: IdentifySettings,
    *,
    actuator: Actuator | None,
    found: Actuated | None,
    validation: Validation,
    series: FitSeries,
    windows: Windows | None,
) -> Model:
    """Put the parts of a model together."""
    n_regressors = len(structure.regressors)
    unit = data.input.unit if data.input is not None else "1"
    band = None if found is None else found.band
    estimate = _calibrated(_estimate(structure, fit, band, settings), n_regressors, data.input)
    A, B = fit.theta[:, :n_regressors], fit.theta[:, n_regressors:]
    parameters = build_parameters(
        structure,
        estimate,
        input_unit=unit,
        settings=settings,
        doubts=_doubts_by_target(design, validation, settings),
    )
    return Model(
        structure=structure.name,
        recommended=False,
        states=structure.states,
        regressors=structure.regressors,
        targets=structure.targets,
        inputs=("L", "M", "N"),
        A=A,
        B=B,
        parameters=parameters,
        windows=windows,
        validation=validation,
        actuator=actuator,
        inertia=None if data.input is None else inertia_of(estimate, parameters, data.input),
        discrete=_discrete(structure, A, B, data.sample_period_s),
        fit=series,
        smoothing_hz=design.smoothing_hz,
        condition_number=fit.condition_number,
        band=band,
        change=None if found is None else found.change,
        formulations=None if found is None else found.formulations,
        bootstrap_half_width=None if found is None else found.bootstrap_half_width,
        criterion=_criterion(design, fit),
    )


def _criterion(design: Design, fit: PooledFit) -> float:
    """Return the Bayesian information criterion (Schwarz 1978) of the rotational rows.

    Coloured residuals carry less than their number says: a stretch as long as
    their memory counts as one observation.
    """
    n_stretches = int(clusters_of(design).max()) + 1
    unexplained = np.maximum(1.0 - fit.r2[:3], 1e-12)
    return float(n_stretches * np.log(unexplained).sum() + fit.n_parameters * np.log(n_stretches))


def _doubts_by_target(design: Design, validation: Validation, settings: IdentifySettings) -> dict[str, str]:
    """Return the targets of whose equations nothing is identified, with the reason."""
    least = settings.min_signal_to_noise / (1.0 + settings.min_signal_to_noise)
    doubts = {
        target: f"the model explains only {100.0 * max(0.0, np.nan_to_num(r2)):.0f} % of held-out {target}"
        for target, r2 in validation.r2_acceleration.items()
        if not r2 >= least
    }
    for target, rate in zip(ACCELERATION_SYMBOLS, RATE_SYMBOLS, strict=True):
        if not validation.r2_high_passed_rate.get(rate, np.inf) >= settings.min_simulated_r2:
            doubts.setdefault(target, "the torque alone does not reproduce the motion")
    for axis in {0, 1, 2}.difference(moved_axes(design, settings)):
        doubts[ACCELERATION_SYMBOLS[axis]] = "the axis was hardly moved"
    return doubts


def _discrete(structure: Structure, A: FloatArray, B: FloatArray, period_s: float) -> Discrete:
    """Discretise the part that is linear in the states; products and trim are left out."""
    linear = np.zeros((len(structure.states), len(structure.states)))
    for column, name in enumerate(structure.states):
        if name in structure.regressors:
            linear[:, column] = A[:, structure.regressors.index(name)]
    A_d, B_d = zero_order_hold(linear, B, period_s)
    return Discrete(sample_period_s=period_s, states=structure.states, A_d=A_d, B_d=B_d)


def _windows_on_rows(
    structure: Structure, design: Design, torque: FloatArray, settings: IdentifySettings, *, noise: FloatArray
) -> Windows | None:
    """Solve windows on the rows of the design, so long that most of them see more than noise."""
    columns = design.stack(structure.columns, torque)
    targets = np.column_stack([design.columns[name] for name in structure.targets])
    by_piece = (design.segment == number for number in np.unique(design.segment))
    pieces = [Piece(columns[rows], targets[rows], design.time_s[rows]) for rows in by_piece]
    found = None
    for length_s in _WINDOW_S:
        width = settings.window or max(len(structure.columns), int(length_s / design.period_s))
        windows = solve_pieces(pieces, width=width, stride=settings.stride or max(1, width // 2), noise=noise)
        if windows is None:
            # Longer than the flight there are none: the last that there were must do.
            break
        found = windows
        if settings.window or np.mean(windows.used) >= _MOST_OF_THEM:
            break
    return found


def _windows_at_full_rate(
    structure: Structure, smooth: Smooth, settings: IdentifySettings, *, noise: FloatArray
) -> Windows | None:
    """Solve the paper's windows: consecutive samples, every k (of very long flights, every so many)."""
    width = settings.window or structure.width
    stride = settings.stride or max(1, int(np.ceil(sum(time_s.size for time_s, _ in smooth) / _MOST_WINDOWS)))
    pieces = (
        Piece(
            np.column_stack([columns[name] for name in structure.columns]),
            np.column_stack([columns[name] for name in structure.targets]),
            time_s,
        )
        for time_s, columns in smooth
        if time_s.size >= max(width, 2)
    )
    return solve_pieces(pieces, width=width, stride=stride, noise=noise)


def _noise(structure: Structure, noise: Mapping[str, float]) -> FloatArray:
    """Return the noise of each column of H_k; shape (n_columns,)."""
    return np.array([noise.get(name, 0.0) for name in structure.columns])
