"""The rotating rigid body, eq. (6)-(8) of the source paper, and its integration.

The step functions take the vector components one by one, so that the same
lines of physics run on floats (a simulated flight, no array overhead) and on arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.errors import ShapeError
from quadid_logs.maths.rotations import Component, quaternion_rate

Triple: TypeAlias = tuple[Component, Component, Component]
Quadruple: TypeAlias = tuple[Component, Component, Component, Component]

#: The products of rates that Euler's equation holds, in the order of `gyroscopic_matrix`.
PRODUCTS: Final = ("pp", "qq", "rr", "qr", "pr", "pq")


class InertiaTerms(NamedTuple):
    """Elements of a symmetric inertia tensor [kg m^2] and of its inverse, as components."""

    xx: Component
    yy: Component
    zz: Component
    xy: Component
    xz: Component
    yz: Component
    inverse_xx: Component
    inverse_yy: Component
    inverse_zz: Component
    inverse_xy: Component
    inverse_xz: Component
    inverse_yz: Component


def inertia_terms(inertia_kg_m2: FloatArray) -> InertiaTerms:
    """Take an inertia tensor apart, for equations that run on components.

    Parameters
    ----------
    inertia_kg_m2 : ndarray, shape (3, 3)

    Returns
    -------
    InertiaTerms
        Plain floats.

    Raises
    ------
    ShapeError
        If it is not symmetric and positive definite.
    """
    J = np.asarray(inertia_kg_m2, dtype=np.float64)
    if J.shape != (3, 3) or not np.allclose(J, J.T, rtol=1e-9, atol=0.0):
        raise ShapeError(f"An inertia tensor is symmetric and of shape (3, 3), found {J.tolist()}.")
    if not np.all(np.linalg.eigvalsh(J) > 0.0):
        raise ShapeError(f"An inertia tensor is positive definite, found {J.tolist()}.")
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    inverse = np.linalg.inv(J)
    return InertiaTerms(*[float(tensor[i, j]) for tensor in (J, inverse) for i, j in places])


def euler_equation(
    rate: Triple, torque: Triple, inertia: InertiaTerms, damping: Triple = (0.0, 0.0, 0.0)
) -> Triple:
    """Return the angular acceleration J^-1 (u - D w - w x (J w)) [rad/s^2]: eq. (8), with damping D.

    Parameters
    ----------
    rate : tuple
        p, q, r [rad/s].
    torque : tuple
        L, M, N [N m].
    inertia : InertiaTerms
    damping : tuple
        Torque against each rate [N m s/rad].

    Returns
    -------
    tuple
        p_dot, q_dot, r_dot [rad/s^2].
    """
    p, q, r = rate
    L, M, N = torque
    dp, dq, dr = damping
    xx, yy, zz, xy, xz, yz, ixx, iyy, izz, ixy, ixz, iyz = inertia
    hx = xx * p + xy * q + xz * r
    hy = xy * p + yy * q + yz * r
    hz = xz * p + yz * q + zz * r
    L = L - dp * p - q * hz + r * hy
    M = M - dq * q - r * hx + p * hz
    N = N - dr * r - p * hy + q * hx
    return (
        ixx * L + ixy * M + ixz * N,
        ixy * L + iyy * M + iyz * N,
        ixz * L + iyz * M + izz * N,
    )


def angular_acceleration(
    rate_rad_s: FloatArray, torque_n_m: FloatArray, inertia_kg_m2: FloatArray
) -> FloatArray:
    """Return eq. (8), J^-1 (u - w x (J w)), for arrays.

    Parameters
    ----------
    rate_rad_s, torque_n_m : ndarray, shape (..., 3)
    inertia_kg_m2 : ndarray, shape (3, 3)

    Returns
    -------
    ndarray, shape (..., 3)
        [rad/s^2].

    Raises
    ------
    ShapeError
        If the tensor is not symmetric and positive definite.
    """
    rate, torque = np.moveaxis(rate_rad_s, -1, 0), np.moveaxis(torque_n_m, -1, 0)
    acceleration = euler_equation(
        (rate[0], rate[1], rate[2]), (torque[0], torque[1], torque[2]), inertia_terms(inertia_kg_m2)
    )
    return np.stack(acceleration, axis=-1)


def gyroscopic_matrix(inertia_kg_m2: FloatArray) -> FloatArray:
    """Return what multiplies the products of rates in eq. (8).

    With no torque, [p_dot, q_dot, r_dot] is this matrix times `PRODUCTS`.

    Parameters
    ----------
    inertia_kg_m2 : ndarray, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3, 6)
        Dimensionless: -J^-1 times the coefficients of w x (J w).

    Examples
    --------
    >>> gyroscopic_matrix(np.diag([0.008, 0.008, 0.01]))[0, 3].round(6)
    np.float64(-0.25)
    """
    J = np.asarray(inertia_kg_m2, dtype=np.float64)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.moveaxis(J, (-2, -1), (0, 1))
    no = np.zeros_like(xx)
    cross = np.array(
        [
            [no, yz, -yz, zz - yy, -xy, xz],
            [-xz, no, xz, xy, xx - zz, -yz],
            [xy, -xy, no, -xz, yz, yy - xx],
        ]
    )
    return np.asarray(-np.linalg.solve(J, np.moveaxis(cross, (0, 1), (-2, -1))), dtype=np.float64)


def step_rates(
    rate: Triple,
    torques: tuple[Triple, Triple, Triple],
    step_s: float,
    inertia: InertiaTerms,
    damping: Triple,
) -> tuple[Triple, tuple[Triple, Triple, Triple, Triple]]:
    """Advance p, q, r by one step of the classic Runge-Kutta method.

    Parameters
    ----------
    rate : tuple
        p, q, r at the beginning of the step [rad/s].
    torques : tuple of three
        L, M, N at the beginning, the middle and the end of the step [N m].
    step_s : float
    inertia : InertiaTerms
    damping : tuple
        Torque against each rate [N m s/rad].

    Returns
    -------
    rate : tuple
        At the end of the step.
    stages : tuple of four
        The rates at which the method looked: what `step_attitude` needs.
    """
    start, middle, end = torques
    p, q, r = rate
    half = 0.5 * step_s
    a1, b1, c1 = euler_equation(rate, start, inertia, damping)
    second = (p + half * a1, q + half * b1, r + half * c1)
    a2, b2, c2 = euler_equation(second, middle, inertia, damping)
    third = (p + half * a2, q + half * b2, r + half * c2)
    a3, b3, c3 = euler_equation(third, middle, inertia, damping)
    fourth = (p + step_s * a3, q + step_s * b3, r + step_s * c3)
    a4, b4, c4 = euler_equation(fourth, end, inertia, damping)
    sixth = step_s / 6.0
    final = (
        p + sixth * (a1 + a4 + 2.0 * (a2 + a3)),
        q + sixth * (b1 + b4 + 2.0 * (b2 + b3)),
        r + sixth * (c1 + c4 + 2.0 * (c2 + c3)),
    )
    return final, (rate, second, third, fourth)


def step_attitude(
    quaternion: Quadruple, stages: tuple[Triple, Triple, Triple, Triple], step_s: float
) -> Quadruple:
    """Advance the attitude with the rates of the same Runge-Kutta step, and renormalise.

    Parameters
    ----------
    quaternion : tuple
        w, x, y, z of unit length, body to Earth.
    stages : tuple of tuples
        p, q, r [rad/s] at the four stages of `step_rates`.
    step_s : float

    Returns
    -------
    tuple
        w, x, y, z, of unit length to second order of the step's error.
    """
    w, x, y, z = quaternion
    first, second, third, fourth = stages
    half = 0.5 * step_s
    a1, b1, c1, d1 = quaternion_rate(quaternion, first)
    a2, b2, c2, d2 = quaternion_rate((w + half * a1, x + half * b1, y + half * c1, z + half * d1), second)
    a3, b3, c3, d3 = quaternion_rate((w + half * a2, x + half * b2, y + half * c2, z + half * d2), third)
    ahead = (w + step_s * a3, x + step_s * b3, y + step_s * c3, z + step_s * d3)
    a4, b4, c4, d4 = quaternion_rate(ahead, fourth)
    sixth = step_s / 6.0
    w = w + sixth * (a1 + a4 + 2.0 * (a2 + a3))
    x = x + sixth * (b1 + b4 + 2.0 * (b2 + b3))
    y = y + sixth * (c1 + c4 + 2.0 * (c2 + c3))
    z = z + sixth * (d1 + d4 + 2.0 * (d2 + d3))
    # One Newton step towards unit length: the error per step is of order step^5 already.
    scale = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)
    return w * scale, x * scale, y * scale, z * scale


def integrate_adams(
    inertia_kg_m2: FloatArray,
    torque_n_m: Callable[[float], FloatArray],
    time_s: FloatArray,
    *,
    rate_rad_s: FloatArray,
    tolerance: float = 1e-12,
) -> tuple[FloatArray, FloatArray]:
    """Integrate eq. (8) and the attitude as the source paper does.

    A variable-step, variable-order Adams predictor-corrector: VODE's, the
    nearest relative of the ode113 that the paper used.

    Parameters
    ----------
    inertia_kg_m2 : ndarray, shape (3, 3)
    torque_n_m : callable
        Torque of shape (3,) at a time.
    time_s : ndarray, shape (n_samples,)
        When the solution is wanted.
    rate_rad_s : ndarray, shape (3,)
        At the first sample. The attitude starts level.
    tolerance : float
        Relative error of a step.

    Returns
    -------
    rate_rad_s : ndarray, shape (n_samples, 3)
    quaternion : ndarray, shape (n_samples, 4)

    Raises
    ------
    ShapeError
        If the integrator gives up.
    """
    from scipy.integrate import ode

    inertia = inertia_terms(inertia_kg_m2)

    def derivative(time: float, state: FloatArray) -> list[float]:
        p, q, r, w, x, y, z = state.tolist()
        L, M, N = torque_n_m(time).tolist()
        return [
            *euler_equation((p, q, r), (L, M, N), inertia),
            *quaternion_rate((w, x, y, z), (p, q, r)),
        ]

    solver = ode(derivative).set_integrator(
        "vode", method="adams", rtol=tolerance, atol=1e-3 * tolerance, nsteps=1_000_000
    )
    state = np.concatenate([rate_rad_s, [1.0, 0.0, 0.0, 0.0]])
    solver.set_initial_value(state, float(time_s[0]))
    states = [state]
    for time in time_s[1:].tolist():
        states.append(np.array(solver.integrate(time)))
        if not solver.successful():
            raise ShapeError(f"The Adams integrator gave up at {time:g} s.")
    history = np.asarray(states)
    return history[:, :3], history[:, 3:]
