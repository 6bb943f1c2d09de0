"""The model structures: which terms explain which targets, and how they are estimated."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.errors import SettingsError
from quadid_logs.identify.terms import (
    AIR_SPEED,
    ANGLE_SYMBOLS,
    ANGLES,
    GYROSCOPIC,
    INPUTS,
    PRODUCT_TERMS,
    RATE_TERMS,
    ROTOR_DAMPING,
    THROTTLED_YAW,
    TRIM,
    VELOCITY,
    VELOCITY_LIFTED,
    VELOCITY_SQUARED,
    WIND,
    YAW_REACTION,
    Term,
    TorqueTerm,
)
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS

Estimator = Literal["as published", "equation by equation", "single rigid body"]


class Structure(NamedTuple):
    """A model structure: target = A @ regressors + B @ [L M N].

    ``terms`` are the regressors. Published structures use the torque as logged; the others include lag, delay
    and gyro filter. ``width`` is the number of samples of a window, 0 if the publication does not define it.
    """

    name: str
    states: tuple[str, ...]
    terms: tuple[Term, ...]
    targets: tuple[str, ...]
    estimator: Estimator
    width: int = 0

    @property
    def regressors(self) -> tuple[str, ...]:
        """Symbols of the regressors."""
        return tuple(term.symbol for term in self.terms)

    @property
    def all_terms(self) -> tuple[Term, ...]:
        """Regressors and inputs, in the order of the columns of H_k."""
        return self.terms + INPUTS

    @property
    def columns(self) -> tuple[str, ...]:
        """Symbols of regressors and inputs, in the order of the columns of H_k."""
        return self.regressors + TORQUE_SYMBOLS

    @property
    def inputs(self) -> tuple[str, ...]:
        """Symbols of all columns that pass the actuator: L, M, N, then such regressors."""
        among = (term.symbol for term in self.terms if isinstance(term, TorqueTerm))
        return (*TORQUE_SYMBOLS, *among)

    @property
    def torques(self) -> tuple[str, ...]:
        """Symbols of the columns with errors by lag, delay and torque: L, M, N, yaw reaction."""
        return (*TORQUE_SYMBOLS, *((YAW_REACTION.symbol,) if YAW_REACTION in self.terms else ()))

    def with_reaction(self) -> Structure:
        """Return the structure with the reaction of accelerating rotors in yaw."""
        return self._replace(terms=(*self.terms, YAW_REACTION)) if self.actuated else self

    @property
    def actuated(self) -> bool:
        """Whether the torque passes lag, delay and gyro filter."""
        return self.estimator != "as published"

    def on_axis(self, theta: FloatArray) -> FloatArray:
        """Return the entries of B11, B22, B33 in an array like [A B], (n_targets, n_columns); shape (3,)."""
        first = len(self.terms)
        return np.diag(theta[:3, first : first + 3]).copy()

    def known(self, symbols: Collection[str]) -> Structure:
        """Return the structure without the torque terms that a flight lacks."""
        lost = set(self.inputs).difference(symbols)
        return self._replace(terms=tuple(term for term in self.terms if term.symbol not in lost))


#: Eq. (10)-(11): the Newton-Euler equation of a rigid body, exact but for damping.
QUADROTOR_6: Final = Structure(
    "quadrotor-6", RATE_SYMBOLS, GYROSCOPIC, ACCELERATION_SYMBOLS, "as published", 6
)
#: Eq. (4)-(5): the generic linear form.
LINEAR_9: Final = Structure(
    "linear-9",
    RATE_SYMBOLS + ANGLE_SYMBOLS,
    RATE_TERMS + ANGLES,
    ACCELERATION_SYMBOLS + tuple(f"{angle}_dot" for angle in ANGLE_SYMBOLS),
    "as published",
    9,
)
#: Eq. (10) with what a real vehicle adds: rotor and air damping, and a trim torque.
DAMPED: Final = Structure(
    "damped",
    RATE_SYMBOLS,
    (*GYROSCOPIC, *RATE_TERMS, TRIM),
    ACCELERATION_SYMBOLS,
    "equation by equation",
)
#: Eq. (6)-(8) with one inertia tensor behind all equations; products of inertia bring in the squares.
RIGID_BODY: Final = Structure(
    "rigid-body",
    RATE_SYMBOLS,
    (*PRODUCT_TERMS, *RATE_TERMS, TRIM, THROTTLED_YAW),
    ACCELERATION_SYMBOLS,
    "single rigid body",
)
#: In the order in which they are fitted: the single rigid body starts from the first.
STRUCTURES: Final = (DAMPED, RIGID_BODY, QUADROTOR_6, LINEAR_9)
#: What a structure can be put together from, by symbol; `own_structure` takes other `Term` objects too.
TERMS: Final = MappingProxyType(
    {
        term.symbol: term
        for term in (
            *(*RATE_TERMS, *PRODUCT_TERMS, *ANGLES, TRIM, THROTTLED_YAW, *AIR_SPEED),
            *(*VELOCITY, *VELOCITY_SQUARED, *VELOCITY_LIFTED, *WIND),
        )
    }
)
#: What turns a vehicle beside the terms of an actuated structure. Of a vehicle with products of inertia the
#: squares of the rates do: left out, they pass for a gyroscopic term where the gyro's cross talk mixes rates.
DISTURBANCES: Final = (*AIR_SPEED, *PRODUCT_TERMS, *ROTOR_DAMPING)


def own_structure(name: str, terms: Iterable[str | Term]) -> Structure:
    """Return a user-defined structure, fitted equation by equation with lag, delay and gyro filter.

    Parameters
    ----------
    name : str
        A name that is not in `STRUCTURES`.
    terms : iterable of str or Term
        Regressors of the three angular accelerations: symbols of `TERMS`, or new terms such as a `RateTerm`.
        The torques L, M, N are always inputs.

    Returns
    -------
    Structure

    Raises
    ------
    SettingsError
        If the name exists already, or a term is unknown or occurs twice.

    Examples
    --------
    >>> import quadid_logs
    >>> own = quadid_logs.own_structure("own", ["p", "q", "r", "qr", "1"])
    >>> own.columns
    ('p', 'q', 'r', 'qr', '1', 'L', 'M', 'N')
    """
    if not name or any(name == each.name for each in STRUCTURES):
        raise SettingsError(f"The structure name {name} is empty or already used.", hint="Choose another.")
    terms = tuple(terms)
    unknown = [each for each in terms if isinstance(each, str) and each not in TERMS]
    if unknown:
        raise SettingsError(f"There is no term {unknown[0]!a}.", hint=f"Choose from {', '.join(TERMS)}.")
    chosen = tuple(TERMS[each] if isinstance(each, str) else each for each in terms)
    symbols = [*(term.symbol for term in chosen), *TORQUE_SYMBOLS]
    if len(set(symbols)) < len(symbols):
        raise SettingsError(f"The structure {name} holds a term twice.", hint="Leave one of the two out.")
    return Structure(name, RATE_SYMBOLS, chosen, ACCELERATION_SYMBOLS, "equation by equation")
