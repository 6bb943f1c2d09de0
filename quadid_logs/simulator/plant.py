"""The vehicle's physics over one control period: rotors, rotation, translation."""

from __future__ import annotations

from typing import NamedTuple

from quadid_logs.maths.rotational_dynamics import (
    InertiaTerms,
    Quadruple,
    Triple,
    step_attitude,
    step_rates,
)
from quadid_logs.simulator.control import ZERO
from quadid_logs.simulator.effects import NOTHING, External
from quadid_logs.vocabulary import GRAVITY_M_S2

Rotors = tuple[float, ...]


class Body(NamedTuple):
    """What does not change in flight. Lengths [m], damping [N m s], decays over half and whole steps.

    ``rotor_inertia`` [kg m^2] of each rotor, positive where it turns counter-clockwise from above;
    () for rotors without inertia.
    """

    step_s: float
    mass: float
    inertia: InertiaTerms
    damping: Triple
    thrust_per_speed2: Rotors
    arms: tuple[Triple, ...]
    decay_up: tuple[float, float]
    decay_down: tuple[float, float]
    drag: float
    drag_area: float
    drag_height: float
    rotor_inertia: Rotors = ()


class Wrench(NamedTuple):
    """Torque about the centre of mass [N m] and thrust along -z [N]."""

    torque: Triple
    thrust: float


class State(NamedTuple):
    """The vehicle at the beginning of a control period.

    Rates [rad/s], attitude quaternion, NED velocity [m/s] and acceleration
    [m/s^2], height above ground [m], rotor speeds [rad/s].
    """

    rate: Triple
    attitude: Quadruple
    velocity: Triple
    acceleration: Triple
    height: float
    speeds: Rotors
    wrench: Wrench


def at_rest(n_rotors: int) -> State:
    """Stand level on the ground with still rotors."""
    return State(
        rate=ZERO,
        attitude=(1.0, 0.0, 0.0, 0.0),
        velocity=ZERO,
        acceleration=ZERO,
        height=0.0,
        speeds=(0.0,) * n_rotors,
        wrench=Wrench(ZERO, 0.0),
    )


def advance(state: State, targets: Rotors, wind: Triple, body: Body, external: External = NOTHING) -> State:
    """Fly one control period with the rotor speed targets held [rad/s].

    Rotation and attitude by the classic Runge-Kutta method, with the rotors'
    exact exponential response at its stages. The velocity by the trapezoid
    rule, with the drag of the period's beginning.
    """
    drag, (L, M, N) = _drag(state, wind, body)
    middle_speeds, speeds = _spin(state.speeds, targets, body)
    middle, end = _wrench(middle_speeds, body), _wrench(speeds, body)
    # The moment of the rotors' angular momentum h along -z, -h' - w x h [N m], over one period. What rotors
    # take up of angular momentum, the vehicle loses: one that speeds up turns it against its spin.
    x, y, z = external.torque
    moment = (L + x, M + y, N + z)
    if body.rotor_inertia:
        taken = momentum = 0.0
        for before, speed, inertia in zip(state.speeds, speeds, body.rotor_inertia, strict=True):
            taken = taken + inertia * (speed - before)
            momentum = momentum + inertia * speed
        p, q, _ = state.rate
        moment = (moment[0] + q * momentum, moment[1] - p * momentum, moment[2] + taken / body.step_s)
    torques = (_plus(state.wrench.torque, moment), _plus(middle.torque, moment), _plus(end.torque, moment))
    rate, stages = step_rates(state.rate, torques, body.step_s, body.inertia, body.damping)
    attitude = step_attitude(state.attitude, stages, body.step_s)
    # Newton's law in NED, gravity included [m/s^2].
    w, x, y, z = attitude
    fx, fy, fz = drag
    fx, fy, fz = fx / body.mass, fy / body.mass, (fz - end.thrust) / body.mass
    acceleration = (
        (1.0 - 2.0 * (y * y + z * z)) * fx + 2.0 * ((x * y - w * z) * fy + (x * z + w * y) * fz),
        (1.0 - 2.0 * (x * x + z * z)) * fy + 2.0 * ((x * y + w * z) * fx + (y * z - w * x) * fz),
        (1.0 - 2.0 * (x * x + y * y)) * fz
        + 2.0 * ((x * z - w * y) * fx + (y * z + w * x) * fy)
        + GRAVITY_M_S2,
    )
    north, east, down = external.force
    acceleration = _plus(acceleration, (north / body.mass, east / body.mass, down / body.mass))
    free = 1.0 - 1.0 * ((state.height <= 0.0) & (acceleration[2] >= 0.0))
    return State(*_settled(state, rate, attitude, acceleration, free, body.step_s), speeds, end)


def _plus(first: Triple, second: Triple) -> Triple:
    """Add two vectors."""
    return first[0] + second[0], first[1] + second[1], first[2] + second[2]


def _spin(speeds: Rotors, targets: Rotors, body: Body) -> tuple[Rotors, Rotors]:
    """Let every speed approach its target exponentially: at half and at the whole step."""
    up_half, up = body.decay_up
    down_half, down = body.decay_down
    more_half, more, middle, end = down_half - up_half, down - up, [], []
    for speed, target in zip(speeds, targets, strict=True):
        gap = speed - target
        falling = gap > 0.0
        middle.append(target + gap * (up_half + more_half * falling))
        end.append(target + gap * (up + more * falling))
    return tuple(middle), tuple(end)


def _wrench(speeds: Rotors, body: Body) -> Wrench:
    """Thrust and drag torque go with speed squared; their sums over the rotors."""
    L = M = N = thrust = 0.0
    for speed, factor, (roll_arm, pitch_arm, yaw_arm) in zip(
        speeds, body.thrust_per_speed2, body.arms, strict=True
    ):
        force = factor * speed * speed
        L = L + roll_arm * force
        M = M + pitch_arm * force
        N = N + yaw_arm * force
        thrust = thrust + force
    return Wrench((L, M, N), thrust)


def _drag(state: State, wind: Triple, body: Body) -> tuple[Triple, Triple]:
    """Drag force in body axes [N] and its moment about the centre of mass [N m]."""
    north, east, down = state.velocity
    north, east, down = north - wind[0], east - wind[1], down - wind[2]
    w, x, y, z = state.attitude
    u = (1.0 - 2.0 * (y * y + z * z)) * north + 2.0 * ((x * y + w * z) * east + (x * z - w * y) * down)
    v = (1.0 - 2.0 * (x * x + z * z)) * east + 2.0 * ((x * y - w * z) * north + (y * z + w * x) * down)
    s = (1.0 - 2.0 * (x * x + y * y)) * down + 2.0 * ((x * z + w * y) * north + (y * z - w * x) * east)
    gain = -body.drag - 0.6125 * body.drag_area * (u * u + v * v + s * s) ** 0.5
    force = (gain * u, gain * v, gain * s)
    return force, (body.drag_height * force[1], -body.drag_height * force[0], 0.0)


def _settled(
    state: State, rate: Triple, attitude: Quadruple, acceleration: Triple, free: float, step_s: float
) -> tuple[Triple, Quadruple, Triple, Triple, float]:
    """Move on where `free` is 1; where it is 0, the ground holds the vehicle as it stands.

    Returns rate, attitude, velocity, acceleration and height.
    """
    p, q, r = rate
    a, b, c, d = state.attitude
    w, x, y, z = attitude
    north, east, down = acceleration
    north, east, down = north * free, east * free, down * free
    before = state.acceleration
    half = 0.5 * step_s
    velocity = (
        (state.velocity[0] + half * (before[0] + north)) * free,
        (state.velocity[1] + half * (before[1] + east)) * free,
        (state.velocity[2] + half * (before[2] + down)) * free,
    )
    return (
        (p * free, q * free, r * free),
        (a + (w - a) * free, b + (x - b) * free, c + (y - c) * free, d + (z - d) * free),
        velocity,
        (north, east, down),
        state.height - half * (state.velocity[2] + velocity[2]),
    )
