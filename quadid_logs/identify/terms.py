"""The terms of the model: one object holds all properties of a column.

A new term needs an object here, and a place in the list of a structure (`structures`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import Segment
from quadid_logs.maths.recurrence import linear_filter
from quadid_logs.maths.rotational_dynamics import PRODUCTS
from quadid_logs.maths.rotations import tilt_from_rates
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, GRAVITY_M_S2, RATE_SYMBOLS, TORQUE_SYMBOLS

#: Thrust is not quite what mixer and thrust curve say, and the torque between the rows of a slow log is
#: interpolated: no effectiveness is known better than this fraction for that alone.
TORQUE_SYSTEMATIC: Final = 0.003
#: The damping by rotors goes with the air that flows through them too, and no sensor tells that: on three
#: flights of a firmware's simulator in still air, roll and pitch are damped by 1 to 7 % more than at hover.
DAMPING_SYSTEMATIC: Final = 0.05
#: The reaction of rotors goes with the slope of their speed by command, which falls by 0.2 to 1.4 % with each
#: hundredth of throttle (expo 0.8 to 0.2, at a third of throttle); a flight spreads over some hundredths.
REACTION_SYSTEMATIC: Final = 0.02
#: No moment of inertia exceeds the sum of the other two, so gyroscopic coefficients lie within 1.
_MOST_GYROSCOPIC = 1.0
#: Damping of multirotors in roll, pitch and yaw is published at up to this; in yaw hovering ones have half of
#: it and less. One that no flight shows lies between none and this.
MOST_DAMPING_1_S: Final = (5.0, 5.0, 1.0)
_YAW = 2
#: Drag over mass of multirotors is 0.1 to 0.3 1/s. Which value hardly matters:
#: it shapes what is slower than 0.05 Hz.
_DRAG_1_S = 0.2

#: Maps M of rates M w (3, 3) to the matrix that does the same to a family of columns.
Mixing = Callable[[FloatArray], FloatArray]


class Family(NamedTuple):
    """Columns that a misalignment of the gyro's axes mixes.

    ``mixing(M)`` is K with columns(M w) = K columns(w), in the order of ``symbols``.
    """

    symbols: tuple[str, ...]
    mixing: Mixing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Term:
    """One column of the model.

    Attributes
    ----------
    symbol : str
    units : tuple of str
        Units of its coefficient in the equations of an angular acceleration and of an Euler angle rate.
    words : str
        Description in the report; "" if another term of its kind is described.
    factors : tuple of str
        The one or two measured signals that the term is computed from, and whose noise it has.
    plausible : float
        Largest physically possible coefficient. A wider interval contains no information.
    notable : float
        A coefficient of this size changes how the vehicle flies. An interval that is narrow compared with it
        is a result, even if it contains zero.
    answers_disturbances : bool
        Whether the controller changes it in response to gusts and noise; it is then no valid instrument.
    family : Family or None
        The effect of gyro errors on its coefficient; None if there is none.
    systematic : mapping of str to float
        By target, the fraction of the coefficient that no flight can identify.
    """

    symbol: str
    units: tuple[str, str]
    words: str = ""
    factors: tuple[str, ...] = ()
    plausible: float = np.inf
    notable: float = np.inf
    answers_disturbances: bool = False
    family: Family | None = None
    systematic: Mapping[str, float] | None = None

    passes_actuator: ClassVar[bool] = False

    def unit(self, target: str, input_unit: str) -> str:
        """Return the unit of the coefficient in the equation of a target, with torque in `input_unit`."""
        unit = self.units[target not in ACCELERATION_SYMBOLS]
        return f"{unit}/({input_unit})" if self.passes_actuator and input_unit != "1" else unit

    def plausible_size(self, on_axis_gain: FloatArray) -> float:
        """Return the largest possible coefficient, given |B11|, |B22|, |B33|; shape (3,).

        An off-axis effectiveness is bounded by the on-axis effectiveness of its two axes.
        """
        return float(np.max(on_axis_gain)) if self.passes_actuator else self.plausible

    def systematic_fraction(self, target: str) -> float:
        """Return the fraction of the coefficient in the equation of a target that no flight can identify."""
        return (self.systematic or {}).get(target, 0.0)

    def noise(self, rms: Mapping[str, float], size: Mapping[str, float]) -> float:
        """Return the noise (rms) of the column, from noise and size (rms) of its factors.

        A product has the noise of each factor times the size of the other; a square has twice that product.
        """
        if len(self.factors) < 2:
            return sum(rms.get(factor, 0.0) for factor in self.factors)
        first, second = self.factors
        parts = size[first] * rms[second], size[second] * rms[first]
        return sum(parts) if first == second else float(np.hypot(*parts))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateTerm(Term):
    """A column computed from the body rates only: (n_samples, 3) [rad/s] to (n_samples,), before smoothing.

    Examples
    --------
    >>> from quadid_logs import RateTerm, own_structure
    >>> drag = RateTerm(symbol="p|p|", units=("1", "s"), of_rate=lambda rate: rate[:, 0] * abs(rate[:, 0]))
    >>> own_structure("with drag", ["p", "q", "r", drag]).regressors
    ('p', 'q', 'r', 'p|p|')
    """

    of_rate: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeTerm(Term):
    """A column computed from the Euler angles (n_samples, 3) [rad] and their period [s], before smoothing."""

    of_attitude: Callable[[FloatArray, float], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TiltTerm(AttitudeTerm):
    """An `AttitudeTerm` of roll and pitch only; without logged attitude they are integrated from rates."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VelocityTerm(Term):
    """A column computed from the velocity along the body axes (n, 3) [m/s] and the throttle (n,) or None.

    The velocity is over ground; the terms `WIND` add the effect of wind.
    """

    of_velocity: Callable[[FloatArray, FloatArray | None], FloatArray | None]


class RotorField(NamedTuple):
    """Where the rotors are, as their torques tell (``torque_per_thrust``, (3, n_rotors)), and mean thrust."""

    torque_per_thrust: FloatArray
    mean_thrust: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotorDampingTerm(Term):
    """What the damping about one axis has more in proportion to rotor speeds than at their mean.

    A rotor resists its own motion through the air in proportion to its speed, the root of its thrust.
    """

    axis: int

    def of_rotors(self, segment: Segment, rotors: RotorField) -> FloatArray | None:
        """Return the column of a segment [rad/s], shape (n_samples,); None where its thrusts are not known.

        Roll and pitch move a rotor along its axis by its two arms, yaw across it by its distance.
        """
        arms = rotors.torque_per_thrust[:2]
        square = np.sum(arms**2, axis=0)
        weight = square if self.axis == _YAW else arms[self.axis] ** 2
        if segment.rotor_thrust is None or not (rotors.mean_thrust > 0.0 and weight.sum() > 0.0):
            return None
        faster = np.sqrt(np.maximum(segment.rotor_thrust, 0.0) / rotors.mean_thrust) - 1.0
        rate = segment.body_rate_rad_s
        if self.axis == _YAW:
            return np.asarray(faster @ square * rate[:, _YAW] / square.sum())
        return np.asarray(np.sum(faster * arms[self.axis] * (rate[:, :2] @ arms), axis=1) / weight.sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorqueTerm(Term):
    """A column that passes the actuator: of torque (n, 3), and throttle above its mean (n,) or None.

    Behind rotors a fourth column of the torque is N to first order in their speeds. The column is the
    derivative by time of what ``of_torque`` returns where it is ``differentiated``.
    """

    passes_actuator: ClassVar[bool] = True

    of_torque: Callable[[FloatArray, FloatArray | None], FloatArray | None]
    differentiated: bool = False


def column_of(
    term: Term, segment: Segment, period_s: float, rotors: RotorField | None = None
) -> FloatArray | None:
    """Return a term's raw column on the samples of a segment, shape (n_samples,).

    None where the log does not have it, and for the constant and torques, which no smoothing filter makes.

    Parameters
    ----------
    term : Term
    segment : Segment
    period_s : float
        Of its samples [s].
    rotors : RotorField, optional

    Returns
    -------
    ndarray, shape (n_samples,), or None
    """
    if isinstance(term, RateTerm):
        return term.of_rate(segment.body_rate_rad_s)
    if isinstance(term, RotorDampingTerm):
        return None if rotors is None else term.of_rotors(segment, rotors)
    if isinstance(term, VelocityTerm):
        known = segment.velocity_m_s
        return None if known is None else term.of_velocity(known, segment.throttle)
    if isinstance(term, AttitudeTerm) and segment.attitude_rad is not None:
        return term.of_attitude(segment.attitude_rad, period_s)
    if isinstance(term, TiltTerm):
        tilt = tilt_from_rates(segment.body_rate_rad_s, period_s)
        return term.of_attitude(tilt, period_s)
    return None


def products_mixed(M: FloatArray) -> FloatArray:
    """Return K with products(M w) = K products(w); shape (..., 6, 6).

    Parameters
    ----------
    M : ndarray, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 6, 6)
        In the order of `PRODUCTS`.
    """
    pairs = [(RATE_SYMBOLS.index(name[0]), RATE_SYMBOLS.index(name[1])) for name in PRODUCTS]
    place = {frozenset(pair): number for number, pair in enumerate(pairs)}
    K = np.zeros((*M.shape[:-2], 6, 6))
    for row, (first, second) in enumerate(pairs):
        for a, b in np.ndindex(3, 3):
            K[..., row, place[frozenset((a, b))]] += M[..., first, a] * M[..., second, b]
    return K


_RATE_FAMILY = Family(RATE_SYMBOLS, lambda M: M)
_PRODUCT_FAMILY = Family(PRODUCTS, products_mixed)
_TORQUE_FAMILY = Family(TORQUE_SYMBOLS, lambda _M: np.eye(3))
_REACTION_FAMILY = Family(("N_dot",), lambda _M: np.eye(1))


def _product(symbol: str, words: str = "") -> RateTerm:
    """Return the product of two rates that a symbol names."""
    first, second = (RATE_SYMBOLS.index(factor) for factor in symbol)
    return RateTerm(
        symbol=symbol,
        units=("1", "s"),
        words=words,
        factors=(symbol[0], symbol[1]),
        plausible=_MOST_GYROSCOPIC,
        notable=0.5,
        family=_PRODUCT_FAMILY,
        of_rate=lambda rate: rate[:, first] * rate[:, second],
    )


def _rate(axis: int, words: str = "") -> RateTerm:
    """Return a body rate itself."""
    return RateTerm(
        symbol=RATE_SYMBOLS[axis],
        units=("1/s", "1"),
        words=words,
        factors=(RATE_SYMBOLS[axis],),
        plausible=max(MOST_DAMPING_1_S),
        notable=1.0,
        answers_disturbances=True,
        family=_RATE_FAMILY,
        systematic={ACCELERATION_SYMBOLS[axis]: DAMPING_SYSTEMATIC},
        of_rate=lambda rate: rate[:, axis],
    )


def _angle(axis: int, symbol: str, words: str = "") -> AttitudeTerm:
    """Return an Euler angle."""
    return AttitudeTerm(
        symbol=symbol,
        units=("1/s^2", "1/s"),
        words=words,
        factors=(symbol,),
        notable=1.0,
        of_attitude=lambda attitude, _period_s: attitude[:, axis],
    )


def _torque(axis: int) -> TorqueTerm:
    """Return the torque about an axis."""
    everywhere = (*ACCELERATION_SYMBOLS, *(f"{symbol}_dot" for symbol in ANGLE_SYMBOLS))
    return TorqueTerm(
        symbol=TORQUE_SYMBOLS[axis],
        units=("rad/s^2", "rad/s"),
        factors=(TORQUE_SYMBOLS[axis],),
        answers_disturbances=True,
        family=_TORQUE_FAMILY,
        systematic=dict.fromkeys(everywhere, TORQUE_SYSTEMATIC),
        of_torque=lambda torque, _throttle: torque[:, axis],
    )


def _pull(along: int, attitude_rad: FloatArray) -> FloatArray:
    """Return gravity along body x (0) or y (1) [m/s^2]: what a tilt brings of acceleration."""
    phi, theta = attitude_rad[:, 0], attitude_rad[:, 1]
    return np.asarray(GRAVITY_M_S2 * (np.sin(phi) * np.cos(theta) if along else -np.sin(theta)))


def _gravity(along: int) -> Callable[[FloatArray, float], FloatArray]:
    return lambda attitude_rad, _period_s: _pull(along, attitude_rad)


def _air_speed(along: int) -> Callable[[FloatArray, float], FloatArray]:
    """Return what a tilt has brought of speed along x (0) or y (1), up to slow errors [m/s].

    u' = -g sin(theta) - d u and v' = g sin(phi) cos(theta) - d v: thrust
    balances weight, drag is linear.
    """

    def speed(attitude_rad: FloatArray, period_s: float) -> FloatArray:
        decay = -float(np.exp(-_DRAG_1_S * period_s))
        return linear_filter((period_s,), (1.0, decay), _pull(along, attitude_rad))

    return speed


def _velocity(
    symbol: str,
    units: tuple[str, str],
    of_velocity: Callable[[FloatArray, FloatArray | None], FloatArray | None],
    words: str = "",
) -> VelocityTerm:
    """Return a column of the logged velocity.

    A moment of the air is in proportion to it where the rotors flap and their drag is above or below the
    centre of mass, with its square where the body's own drag is, and with thrust times it where a rotor that
    meets the air from the front lifts more on its advancing side.
    """
    return VelocityTerm(symbol=symbol, units=units, words=words, of_velocity=of_velocity)


def _along(axis: int) -> Callable[[FloatArray, FloatArray | None], FloatArray]:
    return lambda velocity, _throttle: velocity[:, axis]


def _along_squared(axis: int) -> Callable[[FloatArray, FloatArray | None], FloatArray]:
    return lambda velocity, _throttle: velocity[:, axis] * np.abs(velocity[:, axis])


def _along_lifted(axis: int) -> Callable[[FloatArray, FloatArray | None], FloatArray | None]:
    return lambda velocity, throttle: None if throttle is None else velocity[:, axis] * throttle


def _throttled_yaw(torque: FloatArray, throttle: FloatArray | None) -> FloatArray | None:
    return None if throttle is None else torque[:, 2] * throttle


#: The Euler angles, in the order of their columns.
ANGLE_SYMBOLS: Final = ("phi", "theta", "psi")
RATE_TERMS: Final = (_rate(0, "p, q, r: the rates themselves, for damping"), _rate(1), _rate(2))
SQUARES: Final = (
    _product("pp", "pp, qq, rr: squares of the rates, which act if there are products of inertia"),
    _product("qq"),
    _product("rr"),
)
#: The diagonal coefficients of these are the gyroscopic ones of a vehicle without products of inertia.
GYROSCOPIC: Final = (
    _product(
        "qr", "qr, pr, pq: products of two rates, by which rotation about two axes couples into the third"
    ),
    _product("pr"),
    _product("pq"),
)
PRODUCT_TERMS: Final = (*SQUARES, *GYROSCOPIC)
ANGLES: Final = (
    _angle(0, "phi", "phi, theta, psi: roll, pitch and yaw angle"),
    _angle(1, "theta"),
    _angle(2, "psi"),
)
#: The constant of an equation.
TRIM: Final = Term(
    symbol="1",
    units=("rad/s^2", "rad/s"),
    words="1: a constant angular acceleration, for example from a bent arm",
)
INPUTS: Final = (_torque(0), _torque(1), _torque(2))
#: Yaw comes from drag of the rotors, which grows with throttle in another way than thrust does.
THROTTLED_YAW: Final = TorqueTerm(
    symbol="N*throttle",
    units=("rad/s^2", "rad/s"),
    words="N*throttle: the stronger response of yaw at more throttle",
    of_torque=_throttled_yaw,
)
#: Rotors that speed up turn the vehicle against their spin, beside their drag: with the inertia J_r and the
#: drag torque k w^2 of a rotor at the speed w, yaw gets N + T dN/dt, where T = J_r / (2 k w).
YAW_REACTION: Final = TorqueTerm(
    symbol="N_dot",
    units=("rad/s", "rad"),
    words="N_dot: the reaction of rotors that speed up or slow down, which leads the yaw torque",
    answers_disturbances=True,
    family=_REACTION_FAMILY,
    systematic={ACCELERATION_SYMBOLS[2]: REACTION_SYSTEMATIC},
    of_torque=lambda torque, _throttle: torque[:, -1],
    differentiated=True,
)
#: What the loop of each axis is made of besides lag and delay: its torque, its damping, and of yaw the
#: reaction of the rotors.
LOOP_SYMBOLS: Final = tuple(
    (torque, rate, *((YAW_REACTION.symbol,) if torque == TORQUE_SYMBOLS[2] else ()))
    for torque, rate in zip(TORQUE_SYMBOLS, RATE_SYMBOLS, strict=True)
)
#: What an actuator may shape; those beside L, M, N only where the flight has what they need.
TORQUE_TERMS: Final = (*INPUTS, THROTTLED_YAW, YAW_REACTION)
#: Speed along body x and y, as the tilt brings it.
AIR_SPEED: Final = tuple(
    TiltTerm(symbol=symbol, units=("rad/(m s)", "rad/m"), of_attitude=_air_speed(along))
    for along, symbol in enumerate(("u", "v"))
)
#: Gravity along body x and y: the acceleration across the thrust that a tilt brings.
GRAVITY: Final = tuple(
    TiltTerm(symbol=symbol, units=("rad/m", "rad s/m"), of_attitude=_gravity(along))
    for along, symbol in enumerate(("gx", "gy"))
)
_SPEEDS = ("vx", "vy", "vz")
#: Logged speed along the body axes, its square with its sign, and its product with the throttle.
VELOCITY: Final = tuple(
    _velocity(symbol, ("rad/(m s)", "rad/m"), _along(axis), "vx, vy, vz: logged speed" * (axis == 0))
    for axis, symbol in enumerate(_SPEEDS)
)
VELOCITY_SQUARED: Final = tuple(
    _velocity(f"{symbol}|{symbol}|", ("rad/m^2", "rad s/m^2"), _along_squared(axis))
    for axis, symbol in enumerate(_SPEEDS)
)
VELOCITY_LIFTED: Final = tuple(
    _velocity(f"{symbol}*throttle", ("rad/(m s)", "rad/m"), _along_lifted(axis))
    for axis, symbol in enumerate(_SPEEDS)
)
#: A constant wind is an unknown speed along north and along east, which a vehicle that turns meets from
#: other sides: along its axes it goes with cosine and sine of the heading. Without a turn it is trim.
WIND: Final = (
    AttitudeTerm(
        symbol="cos(psi)",
        units=("rad/s^2", "rad/s"),
        words="cos(psi), sin(psi): a constant wind, whose direction in body axes changes with the heading",
        of_attitude=lambda attitude, _period_s: np.cos(attitude[:, 2]),
    ),
    AttitudeTerm(
        symbol="sin(psi)",
        units=("rad/s^2", "rad/s"),
        of_attitude=lambda attitude, _period_s: np.sin(attitude[:, 2]),
    ),
)
#: Damping that goes with the speed of each rotor: where yaw makes half of them faster, roll damps pitch.
ROTOR_DAMPING: Final = tuple(
    RotorDampingTerm(symbol=f"{symbol}*rotors", units=("1/s", "1"), axis=axis)
    for axis, symbol in enumerate(RATE_SYMBOLS)
)


def of_loops(symbols: Sequence[str], values: FloatArray) -> FloatArray:
    """Return what belongs to the `LOOP_SYMBOLS` of each axis, zero where it has none.

    Parameters
    ----------
    symbols : sequence of str
        Of the columns.
    values : ndarray, shape (n_targets, n_symbols, ...)
        The first targets are the accelerations about the three axes.

    Returns
    -------
    ndarray, shape (3, 3, ...)
    """
    found = np.zeros((3, 3, *values.shape[2:]))
    for axis, wanted in enumerate(LOOP_SYMBOLS):
        known = [symbols.index(symbol) for symbol in wanted if symbol in symbols]
        found[axis, : len(known)] = values[axis, known]
    return found
