"""The model structures: which regressors explain which targets."""

from __future__ import annotations

from typing import NamedTuple

from quadid_logs.maths.rigid_body import PRODUCTS
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS

_GYROSCOPIC = ("qr", "pr", "pq")
#: The constant of an equation.
TRIM = "1"
#: Yaw torque times the throttle's deviation from its mean.
THROTTLED_YAW = "N*throttle"
_ANGLES = ("phi", "theta", "psi")


class Structure(NamedTuple):
    """target = A @ regressors + B @ [L M N].

    ``actuated`` structures see the torque through lag, delay and gyro filter;
    the paper's own take it as logged. ``width`` is the number of samples per
    window, 0 for one second.
    """

    name: str
    states: tuple[str, ...]
    regressors: tuple[str, ...]
    targets: tuple[str, ...]
    actuated: bool
    width: int

    @property
    def columns(self) -> tuple[str, ...]:
        """Regressors and inputs, in the order of the columns of H_k."""
        return self.regressors + TORQUE_SYMBOLS


#: Eq. (10)-(11): the Newton-Euler equation of a rigid body, exact but for damping.
QUADROTOR_6 = Structure("quadrotor-6", RATE_SYMBOLS, _GYROSCOPIC, ACCELERATION_SYMBOLS, False, 6)
#: Eq. (4)-(5): the generic linear form.
LINEAR_9 = Structure(
    "linear-9",
    RATE_SYMBOLS + _ANGLES,
    RATE_SYMBOLS + _ANGLES,
    ACCELERATION_SYMBOLS + tuple(f"{angle}_dot" for angle in _ANGLES),
    False,
    9,
)
#: Eq. (10) with what a real vehicle adds: rotor and air damping, and a trim torque.
DAMPED = Structure("damped", RATE_SYMBOLS, (*_GYROSCOPIC, *RATE_SYMBOLS, TRIM), ACCELERATION_SYMBOLS, True, 0)

#: Eq. (6)-(8) with one inertia tensor behind all rows; products of inertia bring in the squares.
RIGID_BODY = Structure(
    "rigid-body", RATE_SYMBOLS, (*PRODUCTS, *RATE_SYMBOLS, TRIM), ACCELERATION_SYMBOLS, True, 0
)
#: The same where throttle is logged: yaw comes from drag of the rotors, which
#: grows with throttle in another way than thrust does.
RIGID_BODY_THROTTLED = RIGID_BODY._replace(regressors=(*RIGID_BODY.regressors, THROTTLED_YAW))
