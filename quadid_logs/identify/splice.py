"""A model of which one axis has another model's equation: they share nothing but lag and delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import ChangeCheck, FitSeries, Model
from quadid_logs.identify.inertia import inertia_of
from quadid_logs.identify.inference import Estimate
from quadid_logs.identify.model import discrete_of
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS, RATE_SYMBOLS

_NUMBERS: Final = np.arange(3)


def with_axis_of(model: Model, other: Model, axis: int, data: FlightData) -> Model:
    """Return a model whose equation of one axis is that of another one, fitted to the same flight.

    Parameters
    ----------
    model, other : Model
        Of the same structure, whose equations do not depend on each other.
    axis : int
        0 roll, 1 pitch, 2 yaw.
    data : FlightData

    Returns
    -------
    Model
    """
    A, B = _row(model.A, other.A, axis), _row(model.B, other.B, axis)
    target = ACCELERATION_SYMBOLS[axis]
    parameters = tuple(
        new if old.target == target else old
        for old, new in zip(model.parameters, other.parameters, strict=True)
    )
    bounds = np.array([each.ci95 for each in parameters])
    low, high = bounds.T.reshape(2, len(A), -1)
    estimate = Estimate(theta=np.column_stack([A, B]), low=low, high=high, kept=np.isfinite(high))
    names = (ACCELERATION_SYMBOLS[axis], RATE_SYMBOLS[axis])
    changes: dict[str, Any] = {}
    for each in fields(model.validation):
        values, own = (getattr(one.validation, each.name) for one in (model, other))
        if isinstance(values, Mapping):
            changes[each.name] = {**values, **{name: own[name] for name in own if name in names}}
    posterior, second = model.posterior, other.posterior
    if posterior is None or second is None:
        posterior = None
    else:
        mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
        mean[axis], covariance[axis] = second.mean[axis], second.covariance[axis]
        pairs = zip(posterior.only_brakes, second.only_brakes, strict=True)
        roll, pitch, yaw = (new if number == axis else old for number, (old, new) in enumerate(pairs))
        posterior = replace(posterior, mean=mean, covariance=covariance, only_brakes=(roll, pitch, yaw))
    return replace(
        model,
        A=A,
        B=B,
        parameters=parameters,
        validation=replace(model.validation, **changes),
        inertia=None if data.input is None else inertia_of(estimate, parameters, data.input),
        discrete=discrete_of(model.states, model.regressors, A, B, data.sample_period_s),
        fit=_series(model.fit, other.fit, axis),
        change=_change(model.change, other.change, axis),
        posterior=posterior,
    )


def with_interval(model: Model, axis: int, ci95: tuple[float, float]) -> Model:
    """Return the model with a wider interval of an axis' effectiveness, in what margins are drawn from, too.

    Parameters
    ----------
    model : Model
    axis : int
        0 roll, 1 pitch, 2 yaw.
    ci95 : tuple of float

    Returns
    -------
    Model
    """
    old, posterior = model.entries[ON_AXIS[AXES[axis]]], model.posterior
    new = replace(old, ci95=ci95)
    if posterior is not None:
        farther, was = (max(abs(end - old.value) for end in each.ci95) / NORMAL_95 for each in (new, old))
        covariance = posterior.covariance.copy()
        covariance[axis, 0, 0] += max(farther**2 - was**2, 0.0)
        posterior = replace(posterior, covariance=covariance)
    parameters = tuple(new if each is old else each for each in model.parameters)
    return replace(model, parameters=parameters, posterior=posterior)


def _row(first: FloatArray, second: FloatArray, axis: int) -> FloatArray:
    """Return the first matrix with one row from the second."""
    return np.where(np.arange(len(first))[:, np.newaxis] == axis, second, first)


def _change(first: ChangeCheck | None, second: ChangeCheck | None, axis: int) -> ChangeCheck | None:
    """Return a check with its numbers of one axis from another one."""
    if first is None or second is None:
        return None
    names = [each.name for each in fields(first)]
    changes: dict[str, Any] = {
        name: np.where(axis == _NUMBERS, getattr(second, name), getattr(first, name)) for name in names
    }
    return replace(first, **changes)


def _series(first: FitSeries | None, second: FitSeries | None, axis: int) -> FitSeries | None:
    """Return series with those of one axis from another fit, brought to the same times."""
    if first is None or second is None:
        return first
    at, known = first.time_s, second.time_s
    changes: dict[str, Any] = {}
    for name in ("acceleration", "modelled_acceleration", "rate", "simulated_rate"):
        own = np.interp(at, known, getattr(second, name)[:, axis])
        changes[name] = np.where(axis == _NUMBERS, own[:, np.newaxis], getattr(first, name))
    return replace(first, **changes)
