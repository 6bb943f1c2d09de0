"""From a fit to a model: validation, intervals, verdict on every parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.model import (
    Actuator,
    Discrete,
    Model,
    Validation,
    Windows,
)
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.checks import with_change
from quadid_logs.identify.design import Design
from quadid_logs.identify.equation_by_equation import ActuatedFit, Unchecked
from quadid_logs.identify.excitation import ColumnNoise, excited_axes
from quadid_logs.identify.fit import PooledFit
from quadid_logs.identify.inertia import inertia_of
from quadid_logs.identify.inference import (
    Estimate,
    clusters_of,
    delay_interval,
    intervals,
    lag_interval,
    posterior_of,
    with_damping_of_vehicles,
)
from quadid_logs.identify.parameters import (
    MIN_SIGNAL_TO_NOISE,
    MIN_SIMULATED_R2,
    build_parameters,
    with_intervals,
)
from quadid_logs.identify.structural import with_alternatives, with_unseen_damping
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.systematic import gyro_half_width
from quadid_logs.identify.terms import MOST_DAMPING_1_S, of_loops
from quadid_logs.identify.validate import validate
from quadid_logs.identify.windows import windows_on_rows
from quadid_logs.maths.discretise import zero_order_hold
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS, explained_words


def actuated_model(
    data: FlightData, found: ActuatedFit, settings: IdentifySettings, noise: ColumnNoise
) -> Model:
    """Solve the windows of an estimate behind its actuator, and put the model together.

    Parameters
    ----------
    data : FlightData
    found : ActuatedFit
    settings : IdentifySettings
        ``window``, ``stride``.
    noise : ColumnNoise

    Returns
    -------
    Model
    """
    structure, actuator = found.structure, found.model.actuator
    torque = found.whole.torque.behind(actuator.lag_s, actuator.delay_s, structure.inputs)
    windows = windows_on_rows(structure, found.whole, torque, settings, noise.of(structure.all_terms))
    model = build_model(
        data,
        found.whole,
        structure,
        found.fit,
        torque=torque,
        windows=windows,
        found=found,
    )
    rotors, fit, of_axes, period_s = found.model.rotors, found.fit, found.fit.of_axes, data.sample_period_s
    posterior = None
    if of_axes is not None and {*RATE_SYMBOLS} <= {*structure.columns}:
        # A controller is given what the gyro shows, and gives commands: neither the gyro's scale nor the
        # newton metres of a command make its loop less certain.
        estimate = _widened(structure, _intervals(structure, fit, found, None), found)
        half = 0.5 * (estimate.high - estimate.low)
        half = np.sqrt(np.maximum(half**2 - gyro_half_width(structure, fit.as_measured) ** 2, 0.0))
        as_measured, half = (of_loops(structure.columns, each) for each in (fit.as_measured, half))
        seen = of_loops(structure.columns, fit.kept.astype(np.float64))[:, 1] > 0.0
        half[:, 1] = np.where(seen, half[:, 1], 0.0)
        of_flight = posterior_of(as_measured, half, actuator, of_axes, period_s)
        posterior = with_damping_of_vehicles(of_flight, seen, np.array(MOST_DAMPING_1_S))
    return replace(
        model,
        actuator=Actuator(
            lag_s=actuator.lag_s,
            lag_ci95_s=lag_interval(actuator, fit.lag_half_width_s, period_s),
            delay_s=actuator.delay_s,
            delay_ci95_s=delay_interval(actuator, fit.delay_half_width_s, period_s),
            acts_on="torque" if rotors is None else "rotor speed",
            lag_grid_s=actuator.lag_grid_s,
            delay_grid_s=actuator.delay_grid_s,
            loss=actuator.loss,
            lag_up_s=float("nan") if rotors is None else rotors.up_s,
            lag_down_s=float("nan") if rotors is None else rotors.down_s,
        ),
        posterior=posterior,
        band=found.band,
        change=found.change,
        structural=found.structural,
    )


def explained_accelerations(found: Unchecked) -> Mapping[str, float]:
    """Return how much of each held-out acceleration a fit explains, as `actuated_model` will tell it.

    Parameters
    ----------
    found : Unchecked

    Returns
    -------
    mapping of str to float
        By target; empty where nothing was held out.
    """
    actuator = found.model.actuator
    validation, _ = validate(
        found.whole,
        found.structure,
        found.fit.as_measured,
        found.whole.torque.behind(actuator.lag_s, actuator.delay_s, found.structure.inputs),
        disturbance=found.fit.disturbance,
        high_pass_hz=found.model.design.high_pass_hz,
    )
    return validation.r2_acceleration


def build_model(
    data: FlightData,
    design: Design,
    structure: Structure,
    fit: PooledFit,
    *,
    torque: FloatArray,
    windows: Windows | None,
    found: ActuatedFit | None = None,
) -> Model:
    """Validate a fit, give it intervals, and put the model together.

    Parameters
    ----------
    data : FlightData
    design : Design
        Its rows, not high-passed.
    structure : Structure
    fit : PooledFit
    torque : ndarray, shape (n_rows, n_inputs)
        Columns of ``structure.inputs`` as the structure takes them.
    windows : Windows or None
    found : ActuatedFit, optional
        The fit behind its actuator with its checks; None for the torque as logged.

    Returns
    -------
    Model
    """
    high_pass_hz = 0.0 if found is None else found.model.design.high_pass_hz
    validation, series = validate(
        design, structure, fit.as_measured, torque, disturbance=fit.disturbance, high_pass_hz=high_pass_hz
    )
    estimate = _intervals(structure, fit, found, data.input)
    unit = data.input.unit if data.input is not None else "1"
    parameters = build_parameters(
        structure, estimate, input_unit=unit, caveats=_caveats_by_target(design, validation)
    )
    if found is not None:
        # What is identified is judged before possible effects widen the intervals.
        estimate = _widened(structure, estimate, found)
        parameters = with_intervals(parameters, estimate)
    A, B = np.split(fit.theta, [len(structure.terms)], axis=1)
    return Model(
        structure=structure.name,
        recommended=False,
        states=structure.states,
        regressors=structure.regressors,
        targets=structure.targets,
        inputs=TORQUE_SYMBOLS,
        A=A,
        B=B,
        parameters=parameters,
        windows=windows,
        validation=validation,
        inertia=None if data.input is None else inertia_of(estimate, parameters, data.input),
        discrete=discrete_of(structure.states, structure.regressors, A, B, data.sample_period_s),
        fit=series,
        smoothing_hz=design.smoothing_hz,
        condition_number=fit.condition_number,
        criterion=_criterion(design, fit),
    )


def _intervals(
    structure: Structure, fit: PooledFit, found: ActuatedFit | None, given: InputDescription | None
) -> Estimate:
    """Give a fit its intervals; those of the calibration only where what was ``given`` is told."""
    return intervals(
        structure,
        fit.theta,
        fit.half_width,
        fit.kept,
        knows_gyro=fit.gyro is not None,
        band=None if found is None else found.band,
        given=given,
    )


def _widened(structure: Structure, estimate: Estimate, found: ActuatedFit) -> Estimate:
    """Widen intervals by effects that may be there."""
    estimate = with_alternatives(structure, estimate, found.structural)
    return with_unseen_damping(structure, with_change(structure, estimate, found.change))


def _criterion(design: Design, fit: PooledFit) -> float:
    """Return the Bayesian information criterion (Schwarz 1978) of the rotational equations.

    Coloured residuals carry less than their number says: a cluster as long as
    their memory counts as one observation.
    """
    n_clusters = int(clusters_of(design).max()) + 1
    unexplained = np.maximum(1.0 - fit.r2[:3], 1e-12)
    return float(n_clusters * np.log(unexplained).sum() + fit.n_parameters * np.log(n_clusters))


def _caveats_by_target(design: Design, validation: Validation) -> dict[str, str]:
    """Return the targets of whose equations nothing is identified, with the reason."""
    least = MIN_SIGNAL_TO_NOISE / (1.0 + MIN_SIGNAL_TO_NOISE)
    caveats = {
        target: f"on validation data the model predicts {explained_words(r2)} of {target}"
        for target, r2 in validation.r2_acceleration.items()
        if not max(r2, validation.r2_commanded.get(target, r2)) >= least
    }
    for target, rate in zip(ACCELERATION_SYMBOLS, RATE_SYMBOLS, strict=True):
        commanded = validation.r2_commanded.get(target, -np.inf) >= least
        if not (commanded or validation.r2_high_passed_rate.get(rate, np.inf) >= MIN_SIMULATED_R2):
            caveats.setdefault(target, "the torque alone does not reproduce the motion")
    for axis in {0, 1, 2}.difference(excited_axes(design)):
        caveats[ACCELERATION_SYMBOLS[axis]] = "the axis was poorly excited"
    return caveats


def discrete_of(
    states: tuple[str, ...], regressors: tuple[str, ...], A: FloatArray, B: FloatArray, period_s: float
) -> Discrete:
    """Discretise the part that is linear in the states; products, trim and yaw reaction are left out.

    Parameters
    ----------
    states, regressors : tuple of str
        Their symbols.
    A : ndarray, shape (n_states, n_regressors)
    B : ndarray, shape (n_states, 3)
    period_s : float

    Returns
    -------
    Discrete
    """
    linear = np.zeros((len(states), len(states)))
    for column, name in enumerate(states):
        if name in regressors:
            linear[:, column] = A[:, regressors.index(name)]
    A_d, B_d = zero_order_hold(linear, B, period_s)
    return Discrete(sample_period_s=period_s, states=states, A_d=A_d, B_d=B_d)
