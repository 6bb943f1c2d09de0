"""Yaw on its own: the reaction of accelerating rotors, and a band that slow air in roll leaves alone.

A rotor's drag turns the vehicle, and so does the torque that speeds the rotor up: by N + T dN/dt. Without
that lead, lag, damping and effectiveness of yaw make up for it and come out wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import (
    Model,
    YawReaction,
)
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.actuator_model import KnownActuator
from quadid_logs.identify.design import Design
from quadid_logs.identify.equation_by_equation import (
    INFORMATIVE_R2,
    Unchecked,
    fit_unchecked,
)
from quadid_logs.identify.fit import PooledFit, fit_pooled
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import YAW_REACTION

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

    fit: Unchecked
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
    actuator: KnownActuator | None = None,
) -> YawFit:
    """Fit a structure equation by equation, with the reaction of the rotors in yaw where it is seen.

    Parameters
    ----------
    data, whole, structure, settings, voting
        As of `quadid_logs.identify.equation_by_equation.fit_unchecked`.
    known : YawFit, optional
        Of another band, which says whether there is a reaction.
    actuator : KnownActuator, optional
        As of `quadid_logs.identify.equation_by_equation.fit_unchecked`.

    Returns
    -------
    YawFit
    """
    if known is not None:
        structure = known.fit.structure
        return known._replace(fit=fit_unchecked(data, whole, structure, settings, voting=voting))
    without = fit_unchecked(data, whole, structure, settings, voting=voting, known=actuator)
    at_once = without.model.actuator._replace(lag_s=0.0, delay_s=0.0)
    # The yaw torque follows the yaw motion, at once, and not the motion the torque.
    seen = _beside(without, at_once)
    if (
        seen.lead_s + seen.half_width_s < _INVERSE_LEAD_S
        and seen.r2 >= INFORMATIVE_R2
        and 1.0 - seen.r2 < _BETTER * (1.0 - float(without.fit.r2[_YAW]))
    ):
        return YawFit(without, is_inverse_controller=True)
    seen = _beside(without, without.model.actuator)
    if not seen.reacts and without.fit.r2[_YAW] > _EXPLAINED_R2:
        return YawFit(without)
    # Beside a lead of its own, yaw tells little of the lag that all rotors have.
    tilting = [axis for axis in without.informative if axis != _YAW and axis in voting]
    found = fit_unchecked(
        data, whole, structure.with_reaction(), settings, voting=tilting or (_YAW,), known=actuator
    )
    seen = _lead(found.structure, found.fit)
    if not seen.reacts or seen.r2 <= without.fit.r2[_YAW]:
        return YawFit(without)
    ci95_s = (seen.lead_s - seen.half_width_s, seen.lead_s + seen.half_width_s)
    return YawFit(found, YawReaction(lead_s=seen.lead_s, ci95_s=ci95_s))


def _beside(without: Unchecked, actuator: ActuatorFit) -> _Seen:
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
