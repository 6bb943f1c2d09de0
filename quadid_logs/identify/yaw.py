"""Yaw on its own: the reaction of accelerating rotors, and a band that slow air in roll leaves alone.

A rotor's drag turns the vehicle, and so does the torque that speeds the rotor up: by N + T dN/dt. Without
that lead, lag, damping and effectiveness of yaw make up for it and come out wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import (
    ChangeCheck,
    FitSeries,
    FormulationCheck,
    Model,
    Posterior,
    Validation,
    YawReaction,
)
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.design import Design
from quadid_logs.identify.equation_by_equation import (
    INFORMATIVE_R2,
    ActuatedFit,
    fit_equation_by_equation,
)
from quadid_logs.identify.fit import PooledFit, fit_pooled
from quadid_logs.identify.inertia import inertia_of
from quadid_logs.identify.inference import Estimate
from quadid_logs.identify.model import discrete_of
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import YAW_REACTION
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

_Check = TypeVar("_Check", ChangeCheck, FormulationCheck)

_YAW: Final = 2
#: A lead below this changes the yaw response by 1 % at 5 Hz, which no effectiveness is known to.
_LEAST_LEAD_S = 0.005
#: Light propellers on strong motors have 0.04 s, the lightest vehicles 0.15 s, heavy rotors 0.3 s.
_LONGEST_LEAD_S = 0.5
#: Where more is explained without, lag and delay are right, and a lead shows beside them at once.
_EXPLAINED_R2 = 0.98
#: The inverse controller, N = -K dr/dt, is a lead that is all derivative from 1 Hz on and has the wrong sign.
_INVERSE_LEAD_S = -1.0 / (2.0 * np.pi)
#: It explains twice as much as a vehicle does: the error falls to half.
_BETTER = 0.5


class YawFit(NamedTuple):
    """A fit whose structure has the term of the reaction if it is used, and what is known of it.

    ``reaction`` is None where there is nothing to be seen; ``is_inverse_controller`` says that the
    yaw torque follows the yaw motion.
    """

    fit: ActuatedFit
    reaction: YawReaction | None = None
    is_inverse_controller: bool = False

    def on(self, model: Model) -> Model:
        """Return a model with what is known of its yaw."""
        return replace(
            model,
            yaw_reaction=self.reaction,
            yaw_is_inverse_controller=self.is_inverse_controller,
        )


class _Seen(NamedTuple):
    """Lead with its half width [s], and the fraction of the yaw acceleration that is explained with it."""

    lead_s: float
    half_width_s: float
    r2: float

    @property
    def reacts(self) -> bool:
        """Whether the lead is that of rotors."""
        return self.lead_s - self.half_width_s > _LEAST_LEAD_S and self.lead_s < _LONGEST_LEAD_S


def fit_with_reaction(
    data: FlightData,
    whole: Design,
    structure: Structure,
    settings: IdentifySettings,
    *,
    voting: Sequence[int] = (0, 1, 2),
    known: YawFit | None = None,
) -> YawFit:
    """Fit a structure equation by equation, with the reaction of the rotors in yaw where it is seen.

    Parameters
    ----------
    data, whole, structure, settings, voting
        As of `quadid_logs.identify.equation_by_equation.fit_equation_by_equation`.
    known : YawFit, optional
        Of another band, which says whether there is a reaction.

    Returns
    -------
    YawFit
    """
    if known is not None:
        structure = known.fit.structure
        found = fit_equation_by_equation(data, whole, structure, settings, voting=voting)
        return known._replace(fit=found)
    without = fit_equation_by_equation(data, whole, structure, settings, voting=voting)
    at_once = without.model.actuator._replace(lag_s=0.0, delay_s=0.0)
    if _is_inverse_controller(_beside(without, at_once), without):
        return YawFit(without, is_inverse_controller=True)
    seen = _beside(without, without.model.actuator)
    if not seen.reacts and without.fit.r2[_YAW] > _EXPLAINED_R2:
        return YawFit(without)
    # Beside a lead of its own, yaw tells little of the lag that all rotors have.
    tilting = [axis for axis in without.informative if axis != _YAW and axis in voting]
    found = fit_equation_by_equation(
        data, whole, structure.with_reaction(), settings, voting=tilting or (_YAW,)
    )
    seen = _lead(found.structure, found.fit)
    if not seen.reacts or seen.r2 <= without.fit.r2[_YAW]:
        return YawFit(without)
    ci95_s = (seen.lead_s - seen.half_width_s, seen.lead_s + seen.half_width_s)
    return YawFit(found, YawReaction(lead_s=seen.lead_s, ci95_s=ci95_s))


def _beside(without: ActuatedFit, actuator: ActuatorFit) -> _Seen:
    """Return the lead that one column more makes of a fit without it, behind some lag and delay."""
    model, structure = without.model, without.structure.with_reaction()
    kept = np.insert(without.fit.kept, len(without.structure.terms), False, axis=1)
    kept[_YAW, structure.terms.index(YAW_REACTION)] = True
    return _lead(structure, fit_pooled(model.design, structure, actuator, kept, model.unknown))


def _lead(structure: Structure, fit: PooledFit) -> _Seen:
    """Return the lead, the coefficient of the reaction over the effectiveness."""
    column = structure.terms.index(YAW_REACTION)
    gain = max(abs(float(structure.on_axis(fit.theta)[_YAW])), float(np.finfo(float).tiny))
    return _Seen(
        float(fit.theta[_YAW, column]) / gain,
        float(fit.half_width[_YAW, column]) / gain,
        float(fit.r2[_YAW]),
    )


def _is_inverse_controller(seen: _Seen, without: ActuatedFit) -> bool:
    """Say whether the yaw torque follows the yaw motion, at once, and not the motion the torque."""
    return (
        seen.lead_s + seen.half_width_s < _INVERSE_LEAD_S
        and seen.r2 >= INFORMATIVE_R2
        and 1.0 - seen.r2 < _BETTER * (1.0 - float(without.fit.r2[_YAW]))
    )


def with_yaw_of(model: Model, yaw: Model, data: FlightData) -> Model:
    """Return a model whose equation of yaw is that of another one, fitted to the same flight in another band.

    Parameters
    ----------
    model, yaw : Model
        Of the same structure, whose equations do not depend on each other.
    data : FlightData

    Returns
    -------
    Model
    """
    A, B = _row(model.A, yaw.A), _row(model.B, yaw.B)
    target = ACCELERATION_SYMBOLS[_YAW]
    parameters = tuple(
        new if old.target == target else old
        for old, new in zip(model.parameters, yaw.parameters, strict=True)
    )
    bounds = np.array([each.ci95 for each in parameters])
    low, high = bounds.T.reshape(2, len(A), -1)
    estimate = Estimate(theta=np.column_stack([A, B]), low=low, high=high, kept=np.isfinite(high))
    return replace(
        model,
        A=A,
        B=B,
        parameters=parameters,
        validation=_validation(model.validation, yaw.validation),
        inertia=None if data.input is None else inertia_of(estimate, parameters, data.input),
        discrete=discrete_of(model.states, model.regressors, A, B, data.sample_period_s),
        fit=_series(model.fit, yaw.fit),
        change=_columns(model.change, yaw.change),
        formulations=_columns(model.formulations, yaw.formulations),
        bootstrap_half_width=_column(model.bootstrap_half_width, yaw.bootstrap_half_width),
        posterior=_posterior(model.posterior, yaw.posterior),
        yaw_band=yaw.band,
    )


def _posterior(first: Posterior | None, second: Posterior | None) -> Posterior | None:
    """Return what is known of each axis, with yaw from the second."""
    if first is None or second is None:
        return None
    mean, covariance = first.mean.copy(), first.covariance.copy()
    mean[_YAW], covariance[_YAW] = second.mean[_YAW], second.covariance[_YAW]
    only_brakes = (*first.only_brakes[:_YAW], second.only_brakes[_YAW])
    return replace(first, mean=mean, covariance=covariance, only_brakes=only_brakes)


def _row(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the first matrix with the row of yaw from the second."""
    return np.where(np.arange(len(first))[:, np.newaxis] == _YAW, second, first)


def _column(first: FloatArray | None, second: FloatArray | None) -> FloatArray | None:
    """Return the first array (..., 3) with the column of yaw from the second."""
    return None if first is None or second is None else np.where(np.arange(3) == _YAW, second, first)


def _columns(first: _Check | None, second: _Check | None) -> _Check | None:
    """Return a check with its arrays of yaw from another one."""
    if first is None or second is None:
        return None
    arrays: dict[str, Any] = {
        each.name: _column(getattr(first, each.name), getattr(second, each.name)) for each in fields(first)
    }
    return replace(first, **arrays)


def _validation(first: Validation, second: Validation) -> Validation:
    """Return a validation with the figures of yaw from another one."""
    names = (ACCELERATION_SYMBOLS[_YAW], RATE_SYMBOLS[_YAW])
    changes: dict[str, Any] = {}
    for each in fields(first):
        values = getattr(first, each.name)
        if isinstance(values, Mapping):
            own = {name: value for name, value in getattr(second, each.name).items() if name in names}
            changes[each.name] = {**values, **own}
    return replace(first, **changes)


def _series(first: FitSeries | None, second: FitSeries | None) -> FitSeries | None:
    """Return series with those of yaw from another band, brought to the same times."""
    if first is None or second is None:
        return first
    at, known = first.time_s, second.time_s
    changes: dict[str, Any] = {}
    for name in ("acceleration", "modelled_acceleration", "rate", "simulated_rate"):
        yaw = np.interp(at, known, getattr(second, name)[:, _YAW])
        changes[name] = _column(getattr(first, name), yaw[:, np.newaxis])
    return replace(first, **changes)
