"""Every equation fitted by itself behind one actuator, and the checks that say whether to believe it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import BandCheck, ChangeCheck, StructuralCheck
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.actuator import ActuatorFit, fit_actuator
from quadid_logs.identify.actuator_model import (
    ActuatorModel,
    FitProblem,
    KnownActuator,
    find_actuator_model,
    same_actuator_model,
)
from quadid_logs.identify.checks import check_change
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.first_stage import told_axes
from quadid_logs.identify.fit import PooledFit, Regression, fit_laid_out, lay_out, used_columns, with_trim
from quadid_logs.identify.parameters import plausible_size
from quadid_logs.identify.rotors import rotors_known, with_lag_on_rotors
from quadid_logs.identify.structural import check_structure
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import TRIM, YAW_REACTION
from quadid_logs.vocabulary import RATE_SYMBOLS, TORQUE_SYMBOLS

#: The fit is repeated with lower edge and smoothing cut-off times these: half an octave
#: and more to either side. A gain that slides with the band is no gain. Below its lower edge
#: a band is known to be another's.
_OTHER_BANDS = ((1.0, 0.5), (1.0, 1.6), (1.6, 1.0))
#: A band that ends below so many times its lower edge tells no gain from a lag.
_NARROWEST_CHECK = 2.5
#: One that goes beyond so many samples a cycle tells nothing but aliases.
_FEWEST_SAMPLES_PER_CYCLE = 4.0
#: An axis is informative of the actuator if the model explains this fraction of its acceleration.
INFORMATIVE_R2: Final = 0.75
_YAW = 2


class ActuatedFit(NamedTuple):
    """A structure's estimate behind lag, delay and gyro filter, with what says whether to believe it.

    ``whole`` are the rows before they were high-passed, with the lag on the rotors
    if it acts there; ``informative`` are the axes that answer to their own torque. Behind a `KnownActuator`,
    ``band`` is that of the fit alone.
    """

    whole: Design
    model: ActuatorModel
    structure: Structure
    fit: PooledFit
    informative: list[int]
    band: BandCheck
    change: ChangeCheck
    structural: StructuralCheck


class Unchecked(NamedTuple):
    """The same without the checks, which take most of the time, and what they need.

    ``untrimmed`` is the fit on the high-passed rows, which ``regression`` lays out, ``known`` the actuator if
    it was known before.
    """

    data: FlightData
    problem: FitProblem
    whole: Design
    model: ActuatorModel
    structure: Structure
    regression: Regression
    untrimmed: PooledFit
    fit: PooledFit
    informative: list[int]
    known: KnownActuator | None = None


def fit_unchecked(
    data: FlightData,
    whole: Design,
    structure: Structure,
    settings: IdentifySettings,
    *,
    voting: Sequence[int] = (0, 1, 2),
    known: KnownActuator | None = None,
) -> Unchecked:
    """Fit a structure's equations one by one, lag and delay common to all, without the checks.

    Parameters
    ----------
    data : FlightData
    whole : Design
        Its rows, not high-passed, with the structure's terms.
    structure : Structure
    settings : IdentifySettings
        ``high_pass_hz``.
    voting : sequence of int
        Axes that may vote on lag and delay.
    known : KnownActuator, optional
        Nothing is searched for then.

    Returns
    -------
    Unchecked
    """
    described = data.input if rotors_known(data) else None
    problem, model, regression, fit, informative = fit_behind_actuator(
        data, whole.high_passed(settings.high_pass_hz), structure, voting=voting, known=known
    )
    if model.rotors is not None and described is not None:
        whole = with_lag_on_rotors(whole, described, model.rotors)
    return Unchecked(
        data=data,
        problem=problem,
        whole=whole,
        model=model,
        structure=structure,
        regression=regression,
        untrimmed=fit,
        fit=with_trim(fit, structure, whole, model.actuator),
        informative=informative,
        known=known,
    )


def checked(found: Unchecked) -> ActuatedFit:
    """Add the checks to a fit.

    Parameters
    ----------
    found : Unchecked

    Returns
    -------
    ActuatedFit
    """
    data, model, structure, fit = found.data, found.model, found.structure, found.untrimmed
    problem, regression = found.problem._replace(kept=fit.kept), found.regression
    known = found.known
    return ActuatedFit(
        whole=found.whole,
        model=model,
        structure=structure,
        fit=found.fit,
        informative=found.informative,
        band=_bands(data, problem, model, fit, () if known else _OTHER_BANDS),
        change=check_change(model.design, structure, regression, found.informative),
        # An axis that turns too little for lag and delay may still have a number of its own.
        structural=check_structure(
            problem._replace(axes=_informative(fit, range(3))),
            model,
            fit,
            data.input if rotors_known(data) else None,
            known,
        ),
    )


class _Behind(NamedTuple):
    """What was fitted, the actuator, rows and fit behind it, and the axes that answer to their own torque."""

    problem: FitProblem
    model: ActuatorModel
    regression: Regression
    fit: PooledFit
    informative: list[int]


def fit_behind_actuator(
    data: FlightData,
    design: Design,
    structure: Structure,
    *,
    voting: Sequence[int] = (0, 1, 2),
    known: KnownActuator | None = None,
) -> _Behind:
    """Fit a structure's equations one by one behind lag and delay, without any check.

    Parameters
    ----------
    data : FlightData
    design : Design
        Its high-passed rows, with the structure's terms.
    structure : Structure
    voting : sequence of int
        Axes that may vote on lag and delay.
    known : KnownActuator, optional
        Of the torque as logged.

    Returns
    -------
    _Behind
    """
    axes = told_axes(design)
    voters = [axis for axis in axes if axis in voting] or list(voting)
    if known is None:
        actuator = fit_actuator(design, structure, voters)
    else:
        actuator = ActuatorFit(known.lag_s, known.delay_s, np.zeros(0), np.zeros(0), np.zeros((0, 0)))
    regression = lay_out(design, structure, actuator)
    informative = _explained(_r2_commanded(regression, design), axes)
    chosen = [axis for axis in informative if axis in voting]
    if known is None and chosen and chosen != voters:
        actuator = fit_actuator(design, structure, chosen)
        regression = lay_out(design, structure, actuator)
        informative = _explained(_r2_commanded(regression, design), axes)
    voters = [axis for axis in informative if axis in voting] or voters
    problem = FitProblem(
        design,
        structure,
        _possible(structure, informative),
        voters,
        every_step=data.input is not None and data.input.every_step,
        grid=data.input.grid if data.input is not None else (0.0, 0.0, 0.0),
    )
    if known:
        model = ActuatorModel(actuator, design)
    else:
        model = find_actuator_model(problem, actuator, data.input if rotors_known(data) else None)
        regression = lay_out(model.design, structure, model.actuator)
    # Without what cannot be seen behind lag and delay.
    behind, actuator, unknown = model.design, model.actuator, model.unknown
    fit = fit_laid_out(regression, behind, structure, actuator, unknown)
    informative = _informative(fit, told_axes(behind))
    kept = _visible(structure, fit, informative)
    if not kept.all():
        regression = regression._replace(used=used_columns(behind, structure, kept))
        fit = fit_laid_out(regression, behind, structure, actuator, unknown)
    return _Behind(problem, model, regression, fit, informative)


def _r2_commanded(regression: Regression, design: Design) -> FloatArray:
    """Return R2 of what was commanded of each target; shape (n_targets,)."""
    return regression.r2_commanded(regression.solve(), design)


def _visible(structure: Structure, fit: PooledFit, informative: Sequence[int]) -> BoolArray:
    """Keep possible columns whose interval is narrower than what the coefficient can be at all.

    The own torque and the trim stay in any case: they are the model.
    """
    gain = np.abs(structure.on_axis(fit.theta))
    kept = _possible(structure, informative) & (fit.half_width < plausible_size(structure, gain))
    for row in range(3):
        kept[row, len(structure.terms) + row] = True
        if TRIM in structure.terms:
            kept[row, structure.terms.index(TRIM)] = True
    if YAW_REACTION in structure.terms:
        kept[_YAW, structure.terms.index(YAW_REACTION)] = True
        if RATE_SYMBOLS[_YAW] in structure.columns:
            # Behind a lead, damping and effectiveness are nearly one unknown, and feedback from slow air
            # makes the damping negative, which that of rotors cannot be. One that is not seen is less than 1
            # 1/s in published vehicles: left out, it lowers the effectiveness by its product with the
            # reaction, which the interval covers.
            yaw = _YAW, structure.columns.index(RATE_SYMBOLS[_YAW])
            kept[yaw] &= fit.theta[yaw] + fit.half_width[yaw] < 0.0
    return kept


def _informative(fit: PooledFit, axes: Sequence[int]) -> list[int]:
    """Return the axes of whose acceleration, as far as it was commanded, the model explains enough."""
    return _explained(fit.r2 if fit.r2_commanded is None else fit.r2_commanded, axes)


def _explained(r2: FloatArray, axes: Sequence[int]) -> list[int]:
    return [axis for axis in axes if r2[axis] >= INFORMATIVE_R2]


def _possible(structure: Structure, informative: Sequence[int]) -> BoolArray:
    """Leave out what cannot be a cause; shape (n_targets, n_columns).

    An axis that does not answer to its own torque is moved by noise: its rate
    is nothing that another axis could answer to. Its torque may turn an axis
    that does answer, where the inertia is askew. The reaction of the rotors is about the yaw axis.
    """
    kept = np.ones((len(structure.targets), len(structure.columns)), dtype=np.bool_)
    if YAW_REACTION in structure.terms:
        kept[:_YAW, structure.terms.index(YAW_REACTION)] = False
    silent = {0, 1, 2}.difference(informative)
    for axis in silent:
        others = np.arange(len(kept)) != axis
        if RATE_SYMBOLS[axis] in structure.columns:
            kept[others, structure.columns.index(RATE_SYMBOLS[axis])] = False
        kept[list(silent - {axis}), structure.columns.index(TORQUE_SYMBOLS[axis])] = False
    return kept


def _bands(
    data: FlightData,
    problem: FitProblem,
    model: ActuatorModel,
    fit: PooledFit,
    others: Sequence[tuple[float, float]],
) -> BandCheck:
    """Repeat the fit in other bands: lower edge and smoothing cut-off times these."""
    design, structure = problem.design, problem.structure
    bands, gains = [(design.high_pass_hz, design.smoothing_hz)], [structure.on_axis(fit.theta)]
    most_hz = 1.0 / (_FEWEST_SAMPLES_PER_CYCLE * data.sample_period_s)
    for low, high in others:
        cutoff_hz = high * design.smoothing_hz
        if cutoff_hz < _NARROWEST_CHECK * low * design.high_pass_hz or cutoff_hz > most_hz:
            continue
        other = build_design(data, cutoff_hz, [structure])
        if other is not None and np.count_nonzero(other.train) > 2 * len(structure.columns):
            other = other.instrumented_as(design)
            other = other.high_passed(low * design.high_pass_hz)
            again = same_actuator_model(problem._replace(design=other), model, data.input)
            regression = lay_out(again.design, structure, again.actuator, problem.kept)
            bands.append((other.high_pass_hz, other.smoothing_hz))
            gains.append(structure.on_axis(regression.solve()))
    low_hz, cutoff_hz = np.array(bands).T
    return BandCheck(low_hz=low_hz, cutoff_hz=cutoff_hz, on_axis_gain=np.array(gains))
